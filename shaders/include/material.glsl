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

// A height in two halves: the second has what rounding took from the first.
float height_of(vec3 texel) { return texel.x + texel.y; }

// How the height that an image gives grows with both texture coordinates.
vec2 texture_slope(uint header, vec2 uv) {
    ivec2 size = image_size(header);
    FourTexels four = texels_at(header, size, uv);
    vec2 left = vec2(height_of(four.top_left), height_of(four.bottom_left));
    vec2 right = vec2(height_of(four.top_right), height_of(four.bottom_right));
    vec2 across = right - left;
    vec2 down = vec2(left.y - left.x, right.y - right.x);
    vec2 slope = vec2(mix(across.x, across.y, four.at.y), -mix(down.x, down.y, four.at.x)) * vec2(size);
    if (HAS_LOOKUPS) {
        vec2 origin = image_coordinates(header, vec2(0.0));
        vec2 along_u = image_coordinates(header, vec2(1.0, 0.0)) - origin;
        vec2 along_v = image_coordinates(header, vec2(0.0, 1.0)) - origin;
        slope = vec2(dot(slope, along_u), dot(slope, along_v));
    }
    return slope;
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
        bool takes_second = side_of(surface, wo) < 0.0;
        if (kind == SURFACE_BLEND) {
            float weight = blend_weight(material);
            uint map = material_map(material, MAP_WEIGHT);
            if (HAS_DETAIL_TEXTURES && map != 0u) {
                weight = texture_at(map - 1u, surface.uv).x;
            }
            takes_second = split_sample(choice, weight);
        }
        uvec2 parts = blend_parts(material);
        material = takes_second ? parts.y : parts.x;
    }
    return material;
}

// Sets a parameter that only principled materials have images of.
void set_principled(uint parameter, float value, inout MaterialDetail detail) {
    Principled p = detail.principled;
    p.anisotropy = parameter == MAP_ANISOTROPY ? value : p.anisotropy;
    p.sheen = parameter == MAP_SHEEN ? value : p.sheen;
    p.sheen_tint = parameter == MAP_SHEEN_TINT ? value : p.sheen_tint;
    p.specular_tint = parameter == MAP_SPECULAR_TINT ? value : p.specular_tint;
    p.specular_share = parameter == MAP_SPECULAR_SHARE ? value : p.specular_share;
    p.flatness = parameter == MAP_FLATNESS ? value : p.flatness;
    p.diffuse_transmission = parameter == MAP_DIFFUSE_TRANSMISSION ? value : p.diffuse_transmission;
    detail.principled = p;
    detail.coat = parameter == MAP_COAT ? value : detail.coat;
}

// Looks up what images give of the material that has them.
void look_up_details(uint index, vec2 uv, inout Material m) {
    const uint maps = HAS_ANY_PRINCIPLED ? MAPS_OF_PRINCIPLED : MAPS_OF_SCATTERING;
    // A loop, so that a kernel has one lookup for all of them.
    for (uint parameter = 0u; parameter < maps; parameter++) {
        uint map = material_map(index, parameter);
        if (map != 0u) {
            vec3 value = texture_at(map - 1u, uv);
            // Below that a lobe is as narrow as the rounding of a direction.
            float alpha = max(value.x, SMOOTHEST);
            m.ks = parameter == MAP_KS ? value : m.ks;
            m.detail.alpha.x = parameter == MAP_ALPHA_X ? alpha : m.detail.alpha.x;
            m.detail.alpha.y = parameter == MAP_ALPHA_Y ? alpha : m.detail.alpha.y;
            m.detail.metalness = parameter == MAP_METALNESS ? value.x : m.detail.metalness;
            if (HAS_ANY_PRINCIPLED) {
                set_principled(parameter, value.x, m.detail);
            }
        }
    }
}

// Radiance that the front of a material emits at texture coordinates.
vec3 emission_at(uint index, vec2 uv, vec3 constant) {
    vec3 emission = constant;
    if (HAS_DETAIL_TEXTURES) {
        uint map = material_map(index, MAP_KE);
        if (map != 0u) {
            emission = texture_at(map - 1u, uv);
        }
    }
    return emission;
}

Material material_at(Surface surface) {
    Material m = fetch_material(surface.material);
    if (HAS_TEXTURES) {
        uint header = max(m.map_kd, 1u) - 1u;
        m.kd = m.map_kd != 0u ? texture_at(header, surface.uv) : m.kd;
    }
    if (HAS_VERTEX_COLOURS) {
        m.kd *= surface.colour;
    }
    if (HAS_DETAIL_TEXTURES) {
        look_up_details(surface.material, surface.uv, m);
    }
    return m;
}

// The material that a ray meets at a surface. What emits is the surface as a whole: parts of a blend do not.
Material material_towards(inout Surface surface, vec3 wo, inout float choice) {
    uint whole = surface.material;
    if (HAS_BLENDS) {
        surface.material = part_of_blend(surface, wo, choice);
    }
    Material m = material_at(surface);
    if (HAS_BLENDS) {
        m.ke = material_emission(whole);
    }
    m.ke = emission_at(whole, surface.uv, m.ke);
    return m;
}

// Whether the material gives light.
bool is_emissive(Material m) {
    bool beside = HAS_SCATTERING_LIGHTS && any(greaterThan(m.ke, vec3(0.0)));
    return HAS_LIGHTS && (m.surface == SURFACE_EMITTER || beside);
}

// Whether it does something else too.
bool scatters_too(Material m) { return HAS_SCATTERING_LIGHTS && m.surface != SURFACE_EMITTER; }

#endif
