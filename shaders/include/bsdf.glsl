// What light does at a surface. Directions point away from the surface: `wo` back along the path,
// `wi` onwards, towards the light.
#ifndef BSDF_GLSL
#define BSDF_GLSL
#include "geometry.glsl"
#include "random.glsl"
#include "sampling.glsl"

struct Material {
    vec3 kd;       // Lambert reflectance
    uint surface;  // one of SURFACE_*
    vec3 ks;       // Phong lobe weight, or mirror reflectance
    float ns;      // Phong exponent
    vec3 ke;       // emitted radiance
    float ni;      // index of refraction inside
    vec3 tf;       // tint of transmitted light
};

// Stands for the density of a direction that is the only one.
const float ONE_DIRECTION = FARTHEST;

// A sampled direction and f cos / pdf, zero where the path ends.
struct Scatter {
    vec3 direction;
    vec3 weight;
    float density;  // with MIS: of the direction over solid angle, or ONE_DIRECTION
};

// Reads one texel, repeated in both directions, of which there are no more than one beyond the image.
vec3 texel(uint header, ivec2 size, ivec2 at) {
    at = mix(at, at + size, lessThan(at, ivec2(0)));
    at = mix(at, at - size, greaterThanEqual(at, size));
    at = clamp(at, ivec2(0), size - 1);
    uvec2 bits = fetch_textures(header + 1u + uint(at.y * size.x + at.x));
    return vec3(unpackHalf2x16(bits.x), unpackHalf2x16(bits.y).x);
}

// Bilinear, repeated; row 0 lies at v = 1.
vec3 texture_at(uint header, vec2 uv) {
    ivec2 size = ivec2(fetch_textures(header));
    // Only the fraction counts, and taking it first keeps large coordinates from overflowing.
    vec2 p = vec2(fract(uv.x), 1.0 - fract(uv.y)) * vec2(size) - 0.5;
    ivec2 corner = ivec2(floor(p));
    vec2 f = p - vec2(corner);
    vec3 top = mix(texel(header, size, corner), texel(header, size, corner + ivec2(1, 0)), f.x);
    vec3 bottom = mix(texel(header, size, corner + ivec2(0, 1)), texel(header, size, corner + ivec2(1, 1)), f.x);
    return mix(top, bottom, f.y);
}

Material fetch_material(uint index, vec2 uv) {
    uvec4 a = fetch_materials(MATERIAL_TEXELS * index);
    uvec4 b = fetch_materials(MATERIAL_TEXELS * index + 1u);
    uvec4 c = fetch_materials(MATERIAL_TEXELS * index + 2u);
    uvec4 d = fetch_materials(MATERIAL_TEXELS * index + 3u);
    Material m = Material(uintBitsToFloat(a.xyz), a.w, uintBitsToFloat(b.xyz), uintBitsToFloat(b.w),
        uintBitsToFloat(c.xyz), uintBitsToFloat(c.w), uintBitsToFloat(d.xyz));
    // d.w is one more than the place of the image that replaces Kd, and 0 without one.
    if (HAS_TEXTURES) {
        uint header = max(d.w, 1u) - 1u;
        m.kd = d.w != 0u ? texture_at(header, uv) : m.kd;
    }
    return m;
}

bool is_specular(Material m) { return HAS_SPECULAR && (!HAS_PHONG || m.surface != SURFACE_PHONG); }

float mean3(vec3 c) { return (c.x + c.y + c.z) * (1.0 / 3.0); }

// Share of scattered directions that come from the Phong lobe.
float lobe_probability(Material m) {
    float d = mean3(m.kd);
    float s = mean3(m.ks);
    return s > 0.0 ? s / (d + s) : 0.0;
}

// The side of the surface that `direction` leaves to: +1 front, -1 back.
float side_of(Surface surface, vec3 direction) { return dot(surface.geometric_normal, direction) < 0.0 ? -1.0 : 1.0; }

// (Ns + 1) / (2 pi) cos^Ns about the mirror direction. Also its own density.
float phong_lobe(Material m, vec3 n, vec3 wo, vec3 wi) {
    // The angle is told by the distance of the two directions: a cosine near 1 has lost it.
    vec3 apart = reflect(-wo, n) - wi;
    float drop = 0.5 * dot(apart, apart);
    return drop < 1.0 ? (m.ns + 1.0) * INVERSE_TWO_PI * exponential(m.ns * log_of_rest(drop)) : 0.0;
}

// f cos of Lambert plus Phong lobe, and the density of `scatter_glossy`. Zero below the horizon.
vec3 evaluate_glossy(Material m, Surface surface, vec3 wo, vec3 wi, out float pdf) {
    vec3 n = surface.shading_normal * side_of(surface, wo);
    float cos_theta = dot(n, wi);
    bool above = cos_theta > 0.0 && side_of(surface, wo) == side_of(surface, wi);
    vec3 f = m.kd * INVERSE_PI;
    pdf = cos_theta * INVERSE_PI;
    if (HAS_PHONG_LOBES) {
        float lobe = phong_lobe(m, n, wo, wi);
        f += m.ks * lobe;
        pdf = mix(pdf, lobe, lobe_probability(m));
    }
    pdf = above ? pdf : 0.0;
    return above ? f * cos_theta : vec3(0.0);
}

// Picks a lobe by its weight, then a direction by the lobe.
Scatter scatter_glossy(Material m, Surface surface, vec3 wo, vec2 u) {
    vec3 n = surface.shading_normal * side_of(surface, wo);
    float probability = HAS_PHONG_LOBES ? lobe_probability(m) : 0.0;
    bool lobe = HAS_PHONG_LOBES && !falls_above(u.x, probability);
    // One direction for both: a device that runs both sides of an `if` turns the axis once.
    float cos_theta = cosine_of(u.x);
    float sin_theta = sine_of(cos_theta);
    vec3 axis = n;
    if (HAS_PHONG_LOBES) {
        vec2 in_lobe = cosine_power_of(m.ns, u.x);
        cos_theta = lobe ? in_lobe.x : cos_theta;
        sin_theta = lobe ? in_lobe.y : sin_theta;
        axis = lobe ? reflect(-wo, n) : n;
    }
    vec3 wi = around(axis, vec2(cos_theta, sin_theta), u.y);
    // Without a lobe f cos / pdf is Kd, the same bits as in kernels that know no lobes.
    vec3 weight = side_of(surface, wo) == side_of(surface, wi) ? m.kd : vec3(0.0);
    if (HAS_PHONG_LOBES) {
        float pdf;
        vec3 value = evaluate_glossy(m, surface, wo, wi, pdf);
        weight = probability > 0.0 ? (pdf > 0.0 ? value / pdf : vec3(0.0)) : weight;
    }
    float density = ONE_DIRECTION;
    if (MIS) {
        // Rounding must not make a direction that was taken one that cannot be.
        evaluate_glossy(m, surface, wo, wi, density);
        density = max(density, 1e-20);
    }
    return Scatter(wi, weight, density);
}

// Reflectance of unpolarised light. `eta` is the index beyond over the index before.
float fresnel(float cos_i, float cos_t, float eta) {
    float perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    float parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    return 0.5 * (perpendicular * perpendicular + parallel * parallel);
}

// Mirror, refraction by Snell's law, Fresnel dielectric: one direction, drawn by `choice` where
// there are two. Geometry says which side is inside.
Scatter scatter_specular(Material m, Surface surface, vec3 wo, float choice) {
    float side = side_of(surface, wo);
    vec3 n = surface.shading_normal * side;
    // A shading normal that faces away, or reflects into the surface, gives way to geometry.
    bool bent = dot(n, wo) <= 0.0 || side_of(surface, reflect(-wo, n)) != side;
    n = HAS_NORMALS && bent ? surface.geometric_normal * side : n;
    Scatter mirrored = Scatter(reflect(-wo, n), vec3(1.0), ONE_DIRECTION);
    if (HAS_MIRROR && (!HAS_GLASS || m.surface == SURFACE_MIRROR)) {
        mirrored.weight = m.ks;
        return mirrored;
    }
    if (HAS_GLASS) {
        float inverse_ni = 1.0 / m.ni;
        float eta = side > 0.0 ? m.ni : inverse_ni;
        float inverse_eta = side > 0.0 ? inverse_ni : m.ni;
        float cos_i = min(dot(wo, n), 1.0);
        vec3 along = wo - cos_i * n;
        // The squared cosine beyond, times eta squared: a sum of small numbers where the angle grazes and
        // the indices are alike, so that matched glass is not seen, and where it is steep and little
        // can get out, so that very dense glass lets go of its light.
        float squared = cos_i < 0.7 ? (eta - 1.0) * (eta + 1.0) + cos_i * cos_i : eta * eta - dot(along, along);
        float cos_t = sqrt(max(0.0, squared)) * inverse_eta;
        float reflectance = squared <= 0.0 ? 1.0 : 0.0;
        if (HAS_DIELECTRIC && (!HAS_REFRACTIVE || m.surface == SURFACE_DIELECTRIC)) {
            reflectance = squared <= 0.0 ? 1.0 : fresnel(cos_i, cos_t, eta);
        }
        vec3 refracted = normalize(-along * inverse_eta - cos_t * n);
        // Radiance scales with the square of the index.
        return choice < reflectance ? mirrored : Scatter(refracted, m.tf * (inverse_eta * inverse_eta), ONE_DIRECTION);
    }
    return mirrored;
}

#endif
