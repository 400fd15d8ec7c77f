// Shading normals that images turn.
#ifndef NORMAL_MAP_GLSL
#define NORMAL_MAP_GLSL
#include "material.glsl"

// Light that slopes of a turned normal block before it reaches the surface, where the slope itself would still be lit: without
// it the terminator is hard. `wi` is the direction of the light. (Conty Estevez, Lecocq and Stein 2019, A Microfacet-Based
// Shadowing Function to Solve the Bump Terminator Problem)
float bump_shadowing(Surface surface, vec3 wi) {
    // Where no image turns it, nothing is lost to rounding.
    if (!is_turned(surface)) {
        return 1.0;
    }
    float between = min(abs(dot(surface.smooth_normal, surface.shading_normal)), 1.0);
    float tan2 = (1.0 - between * between) / max(between * between, 1e-6);
    float alpha2 = clamp(0.125 * tan2, 0.0, 1.0);
    float cos_i = clamp(abs(dot(surface.smooth_normal, wi)), 1e-6, 1.0);
    float tan2_i = (1.0 - cos_i * cos_i) / (cos_i * cos_i);
    return 2.0 / (1.0 + sqrt(1.0 + alpha2 * tan2_i));
}

// Whether a turned normal sends a direction to the wrong side of the surface: light that is reflected must stay on its side,
// and light that is transmitted must not.
bool is_misled(Surface surface, vec3 wo, vec3 wi, bool passes) {
    return is_turned(surface) && (side_of(surface, wo) != side_of(surface, wi)) != passes;
}

// The surface with its shading normal turned by the images of its material, as `wo` sees it.
Surface with_normal_map(Surface surface, vec3 wo) {
    uint map_normal = material_map(surface.material, MAP_NORMAL);
    uint map_height = material_map(surface.material, MAP_HEIGHT);
    vec3 n = surface.shading_normal;
    vec3 along_u = surface.along_u - dot(surface.along_u, n) * n;
    float len2 = dot(along_u, along_u);
    bool has_tangent = len2 > 0.0;
    vec3 turned = n;
    if (map_normal != 0u) {
        vec3 tangent = along_u / sqrt(max(len2, 1e-30));
        // The second axis points where v grows.
        float handed = dot(cross(surface.along_u, surface.along_v), n) < 0.0 ? -1.0 : 1.0;
        vec3 local = 2.0 * texture_at(map_normal - 1u, surface.uv) - 1.0;
        turned = tangent * local.x + cross(n, tangent) * (handed * local.y) + n * local.z;
    } else if (map_height != 0u) {
        // The surface lifted by the height, along both texture coordinates. (Blinn 1978, Simulation of Wrinkled Surfaces)
        vec2 slope = texture_slope(map_height - 1u, surface.uv) * frame.height_scale;
        vec3 along_v = surface.along_v - dot(surface.along_v, n) * n;
        vec3 lifted_u = along_u + slope.x * n;
        vec3 lifted_v = along_v + slope.y * n;
        turned = cross(lifted_u, lifted_v);
        turned = dot(turned, n) < 0.0 ? -turned : turned;
    }
    float turned2 = dot(turned, turned);
    bool is_turned = has_tangent && (map_normal != 0u || map_height != 0u) && turned2 > 1e-20;
    if (is_turned) {
        vec3 unit = turned / sqrt(turned2);
        // A normal that faces away from the viewer leans the other way. (Schüssler et al. 2017, Microfacet-Based Normal
        // Mapping for Robust Monte Carlo Path Tracing, on flipped normals)
        bool faces_away = dot(unit, wo) * dot(n, wo) <= 0.0;
        surface.shading_normal = faces_away ? 2.0 * dot(unit, n) * n - unit : unit;
    }
    return surface;
}

#endif
