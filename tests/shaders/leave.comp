// The nearest hit of a ray that leaves a surface.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bvh.glsl"

struct Query {
    vec4 hit;        // triangle as bits, barycentrics, unused
    vec4 direction;  // unit, unused
};

struct Answer {
    vec4 origin;    // of the ray, triangle that it hits as bits
    vec4 position;  // of the surface, distance of the hit
    vec4 normal;    // geometric, unit, unused
};

Answer probe(Query query) {
    Surface surface = surface_at(Hit(floatBitsToUint(query.hit.x), query.hit.yz, 0.0));
    Ray ray = leave(surface, query.direction.xyz);
    Hit hit = trace_closest(ray);
    return Answer(vec4(ray.origin, uintBitsToFloat(hit.triangle)), vec4(surface.position, hit.distance),
        vec4(surface.geometric_normal, 0.0));
}

PROBE(Query, Answer)
