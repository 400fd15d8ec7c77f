// The material of a surface, with its texture looked up.
#ifndef MATERIAL_GLSL
#define MATERIAL_GLSL
#include "geometry.glsl"

// Reads one texel of an image, repeated in both directions, of which there are no more than one beyond the image.
vec3 repeated_texel(uint header, ivec2 size, ivec2 at) {
    at = mix(at, at + size, lessThan(at, ivec2(0)));
    at = mix(at, at - size, greaterThanEqual(at, size));
    at = clamp(at, ivec2(0), size - 1);
    return image_texel(header, uint(at.y * size.x + at.x));
}

// Bilinear, repeated; row 0 lies at v = 1.
vec3 texture_at(uint header, vec2 uv) {
    ivec2 size = image_size(header);
    // Only the fraction counts, and taking it first keeps large coordinates from overflowing.
    vec2 p = vec2(fract(uv.x), 1.0 - fract(uv.y)) * vec2(size) - 0.5;
    ivec2 corner = ivec2(floor(p));
    vec2 f = p - vec2(corner);
    vec3 top = mix(repeated_texel(header, size, corner), repeated_texel(header, size, corner + ivec2(1, 0)), f.x);
    vec3 bottom = mix(repeated_texel(header, size, corner + ivec2(0, 1)), repeated_texel(header, size, corner + ivec2(1, 1)), f.x);
    return mix(top, bottom, f.y);
}

Material material_at(Surface surface) {
    Material m = fetch_material(surface.material);
    if (HAS_TEXTURES) {
        uint header = max(m.map_kd, 1u) - 1u;
        m.kd = m.map_kd != 0u ? texture_at(header, surface.uv) : m.kd;
    }
    return m;
}

// Whether the material is an area light, which scatters nothing.
bool is_emissive(Material m) { return HAS_LIGHTS && m.surface == SURFACE_EMITTER; }

#endif
