// A surface and a material as the input of a probe.
#ifndef SURFACE_QUERY_GLSL
#define SURFACE_QUERY_GLSL
#include "bsdf.glsl"

struct SurfaceQuery {
    vec4 geometric_normal;  // unit, unused
    vec4 shading_normal;    // unit, unused
    vec4 wo;                // unit, unused
    vec4 wi;                // unit, unused
    vec4 u;                 // choice, unused, two numbers of the direction
    uvec4 material;         // index, unused
};

Surface surface_of(SurfaceQuery query) {
    return Surface(vec3(0.0), vec3(0.0), query.geometric_normal.xyz, query.shading_normal.xyz, query.shading_normal.xyz, vec2(0.0),
        vec3(0.0), vec3(0.0), vec3(1.0), no_primitive(), query.material.x);
}

#endif
