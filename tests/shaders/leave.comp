// The nearest hit of a ray that leaves a surface.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bvh.glsl"

struct Query {
    uvec4 hit;       // triangle, bits of barycentrics, unused
    vec4 direction;  // unit, unused
};

struct Answer {
    vec4 origin;  // of the ray, distance of the hit
    uvec4 hit;    // triangle, unused
};

Answer probe(Query query) {
    Surface surface = surface_at(Hit(world_primitive(query.hit.x), uintBitsToFloat(query.hit.yz), 0.0));
    Ray ray = spawn_ray(surface, query.direction.xyz);
    Hit hit = trace_closest(ray);
    return Answer(vec4(ray.origin, hit.distance), uvec4(hit.primitive.triangle, 0u, 0u, 0u));
}

PROBE(Query, Answer)
