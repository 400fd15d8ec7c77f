// A surface and a material as the input of a probe.
#ifndef SURFACE_QUERY_GLSL
#define SURFACE_QUERY_GLSL
#include "bsdf.glsl"

struct SurfaceQuery {
    vec4 geometric_normal;  // unit, unused
    vec4 shading_normal;    // unit, material index
    vec4 wo;                // unit, unused
    vec4 wi;                // unit, unused
    vec4 u;                 // choice, unused, two numbers of the direction
};

Surface surface_of(SurfaceQuery query) {
    return Surface(vec3(0.0), vec3(0.0), query.geometric_normal.xyz, query.shading_normal.xyz, vec2(0.0),
        NO_TRIANGLE, floatBitsToUint(query.shading_normal.w));
}

#endif
