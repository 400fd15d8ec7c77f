// The material of a surface, with its texture looked up.
#ifndef MATERIAL_GLSL
#define MATERIAL_GLSL
#include "geometry.glsl"
#include "random.glsl"

// The least width of microfacets that kernels tell from a smooth surface.
const float SMOOTHEST = 1e-6;

// Reads one texel of an image that is repeated in both directions, or whose edges go on. Of repetitions there are no more
// than one beyond the image.
vec3 texel_of(uint header, ivec2 size, ivec2 at, bool repeats) {
    if (!HAS_LOOKUPS || repeats) {
        at = mix(at, at + size, lessThan(at, ivec2(0)));
        at = mix(at, at - size, greaterThanEqual(at, size));
    }
    at = clamp(at, ivec2(0), size - 1);
    return image_texel(header, uint(at.y * size.x + at.x));
}

// Four neighbouring texels, and where between them a point lies.
struct FourTexels {
    vec3 top_left;
    vec3 top_right;
    vec3 bottom_left;
    vec3 bottom_right;
    vec2 at;
};

// The texels about texture coordinates, by the image's lookup. Row 0 lies at v = 1.
FourTexels texels_at(uint header, ivec2 size, vec2 uv) {
    // Only the fraction counts, and taking it first keeps large coordinates from overflowing.
    vec2 inside = fract(uv);
    uint lookup = 0u;
    if (HAS_LOOKUPS) {
        lookup = image_lookup(header);
        uv = image_coordinates(header, uv);
        inside = fract(uv);
        if ((lookup & LOOKUP_CLAMP) != 0u) {
            inside = clamp(uv, 0.0, 1.0);
        } else if ((lookup & LOOKUP_MIRROR) != 0u) {
            inside = 1.0 - abs(1.0 - 2.0 * fract(0.5 * uv));
        }
    }
    vec2 p = vec2(inside.x, 1.0 - inside.y) * vec2(size) - 0.5;
    if (HAS_LOOKUPS && (lookup & LOOKUP_NEAREST) != 0u) {
        p = min(floor(p + 0.5), vec2(size - 1));
    }
    bool repeats = (lookup & (LOOKUP_CLAMP | LOOKUP_MIRROR)) == 0u;
    ivec2 corner = ivec2(floor(p));
    FourTexels four;
    four.at = p - vec2(corner);
    four.top_left = texel_of(header, size, corner, repeats);
    four.top_right = texel_of(header, size, corner + ivec2(1, 0), repeats);
    four.bottom_left = texel_of(header, size, corner + ivec2(0, 1), repeats);
    four.bottom_right = texel_of(header, size, corner + ivec2(1, 1), repeats);
    return four;
}

// What an image gives at texture coordinates: bilinear and repeated, unless its lookup says otherwise.
vec3 texture_at(uint header, vec2 uv) {
    FourTexels four = texels_at(header, image_size(header), uv);
    vec3 top = mix(four.top_left, four.top_right, four.at.x);
    vec3 bottom = mix(four.bottom_left, four.bottom_right, four.at.x);
    return mix(top, bottom, four.at.y);
}

// How its first channel grows with both texture coordinates.
vec2 texture_slope(uint header, vec2 uv) {
    ivec2 size = image_size(header);
    FourTexels four = texels_at(header, size, uv);
    vec2 across = vec2(four.top_right.x - four.top_left.x, four.bottom_right.x - four.bottom_left.x);
    vec2 down = vec2(four.bottom_left.x - four.top_left.x, four.bottom_right.x - four.top_right.x);
    vec2 slope = vec2(mix(across.x, across.y, four.at.y), -mix(down.x, down.y, four.at.x)) * vec2(size);
    if (HAS_LOOKUPS) {
        vec2 origin = image_coordinates(header, vec2(0.0));
        vec2 along_u = image_coordinates(header, vec2(1.0, 0.0)) - origin;
        vec2 along_v = image_coordinates(header, vec2(0.0, 1.0)) - origin;
        slope = vec2(dot(slope, along_u), dot(slope, along_v));
    }
    return slope;
}

// The same of an image by its place, which is one more than its header, or else a constant.
vec3 textured(uint place, vec2 uv, vec3 constant) {
    return place != 0u ? texture_at(max(place, 1u) - 1u, uv) : constant;
}

float textured(uint place, vec2 uv, float constant) { return textured(place, uv, vec3(constant)).x; }

Material material_at(Surface surface) {
    Material m = fetch_material(surface.material);
    if (HAS_TEXTURES) {
        m.kd = textured(m.map_kd, surface.uv, m.kd);
    }
    if (HAS_DETAIL_TEXTURES) {
        MaterialDetail detail = fetch_material_detail(surface.material);
        m.ks = textured(detail.map_ks, surface.uv, m.ks);
        m.ke = textured(detail.map_ke, surface.uv, m.ke);
    }
    return m;
}

// What else the material of a surface has.
MaterialDetail material_detail_at(Surface surface) {
    MaterialDetail detail = fetch_material_detail(surface.material);
    if (HAS_DETAIL_TEXTURES) {
        // Below that a lobe is as narrow as the rounding of a direction.
        detail.alpha.x = max(textured(detail.map_alpha.x, surface.uv, detail.alpha.x), SMOOTHEST);
        detail.alpha.y = max(textured(detail.map_alpha.y, surface.uv, detail.alpha.y), SMOOTHEST);
        detail.metalness = textured(detail.map_metalness, surface.uv, detail.metalness);
    }
    return detail;
}

// The material that light meets where that of the surface is a blend or has one for each side. `choice` decides between the
// parts of a blend and is uniform again afterwards.
uint part_of_blend(Surface surface, vec3 wo, inout float choice) {
    uint material = surface.material;
    for (uint depth = 0u; depth < MAX_BLENDS; depth++) {
        uint kind = material_surface(material);
        if (kind != SURFACE_BLEND && kind != SURFACE_SIDES) {
            break;
        }
        MaterialDetail detail = fetch_material_detail(material);
        bool takes_second = side_of(surface, wo) < 0.0;
        if (kind == SURFACE_BLEND) {
            float weight = detail.weight;
            if (HAS_DETAIL_TEXTURES) {
                weight = textured(detail.map_weight, surface.uv, weight);
            }
            takes_second = split_sample(choice, weight);
        }
        material = takes_second ? detail.second : detail.first;
    }
    return material;
}

// Whether the material gives light.
bool is_emissive(Material m) {
    bool beside = HAS_SCATTERING_LIGHTS && any(greaterThan(m.ke, vec3(0.0)));
    return HAS_LIGHTS && (m.surface == SURFACE_EMITTER || beside);
}

// Whether it does something else too.
bool scatters_too(Material m) { return HAS_SCATTERING_LIGHTS && m.surface != SURFACE_EMITTER; }

#endif
