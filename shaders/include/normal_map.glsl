// Shading normals that images turn.
#ifndef NORMAL_MAP_GLSL
#define NORMAL_MAP_GLSL
#include "material.glsl"

// A shading normal that a viewer can see: bent towards the geometric normal until the mirror direction of `wo` about it is
// above the surface. Without that facets of a normal map are black from where they face away, or lit through. (The remedy
// of Cycles, `ensure_valid_specular_reflection`, in the plane of both normals)
vec3 valid_normal(vec3 n, vec3 geometric_normal, vec3 wo) {
    // Mirror directions just above the surface, or as high as `wo` itself where it grazes.
    float least = min(0.9 * dot(geometric_normal, wo), 0.01);
    vec3 mirrored = reflect(-wo, n);
    float height = dot(geometric_normal, mirrored);
    if (height >= least) {
        return n;
    }
    // The mirror direction is lifted to that height, and the normal lies between it and `wo`.
    vec3 flat_part = mirrored - height * geometric_normal;
    float len2 = dot(flat_part, flat_part);
    vec3 lifted = flat_part * (sqrt(1.0 - least * least) / sqrt(max(len2, 1e-20))) + least * geometric_normal;
    vec3 between = wo + lifted;
    float between2 = dot(between, between);
    return between2 > 1e-12 ? between / sqrt(between2) : geometric_normal;
}

// The surface with its shading normal turned by the images of its material, as `wo` sees it.
Surface with_normal_map(Surface surface, vec3 wo) {
    MaterialDetail detail = fetch_material_detail(surface.material);
    vec3 n = surface.shading_normal;
    vec3 along_u = surface.along_u - dot(surface.along_u, n) * n;
    float len2 = dot(along_u, along_u);
    bool has_tangent = len2 > 0.0;
    vec3 turned = n;
    if (detail.map_normal != 0u) {
        vec3 tangent = along_u / sqrt(max(len2, 1e-30));
        // The second axis points where v grows.
        float handed = dot(cross(surface.along_u, surface.along_v), n) < 0.0 ? -1.0 : 1.0;
        vec3 local = 2.0 * texture_at(detail.map_normal - 1u, surface.uv) - 1.0;
        turned = tangent * local.x + cross(n, tangent) * (handed * local.y) + n * local.z;
    } else if (detail.map_height != 0u) {
        // The surface lifted by the height, along both texture coordinates. (Blinn 1978, Simulation of Wrinkled Surfaces)
        vec2 slope = texture_slope(detail.map_height - 1u, surface.uv) * frame.height_scale;
        vec3 along_v = surface.along_v - dot(surface.along_v, n) * n;
        vec3 lifted_u = along_u + slope.x * n;
        vec3 lifted_v = along_v + slope.y * n;
        turned = cross(lifted_u, lifted_v);
        turned = dot(turned, n) < 0.0 ? -turned : turned;
    }
    float turned2 = dot(turned, turned);
    bool is_turned = has_tangent && (detail.map_normal != 0u || detail.map_height != 0u) && turned2 > 1e-20;
    if (is_turned) {
        float side = side_of(surface, wo);
        vec3 unit = turned / sqrt(turned2);
        surface.shading_normal = side * valid_normal(side * unit, side * surface.geometric_normal, wo);
    }
    return surface;
}

#endif
