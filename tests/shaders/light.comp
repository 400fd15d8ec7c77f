// A sample of all light as a surface sees it, and whether anything blocks it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bvh.glsl"
#include "path.glsl"

struct Query {
    vec4 hit;  // triangle as bits, barycentrics, unused
    vec4 wo;   // unit, unused
    vec4 u;
};

struct Answer {
    vec4 origin;     // of the shadow ray, 1 where it is blocked
    vec4 ray;        // direction of the shadow ray, triangle it may touch as bits
    vec4 direction;  // unit, unused
    vec4 radiance;   // over density, unused
    vec4 infinity;   // the environment's radiance along wo, unused
};

Answer probe(Query query) {
    Surface surface = surface_at(Hit(floatBitsToUint(query.hit.x), query.hit.yz, 0.0));
    LightSample light = sample_light(surface, query.wo.xyz, query.u);
    bool blocked = trace_any(light.ray, light.triangle, shadow_limit(light.triangle));
    return Answer(vec4(light.ray.origin, float(blocked)), vec4(light.ray.direction, uintBitsToFloat(light.triangle)),
        vec4(light.direction, 0.0), vec4(light.radiance, 0.0), vec4(environment_radiance(query.wo.xyz), 0.0));
}

PROBE(Query, Answer)
