// A sample of all light as a surface sees it, and whether anything blocks it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bvh.glsl"
#include "path.glsl"

struct Query {
    uvec4 hit;  // triangle, bits of barycentrics, unused
    vec4 wo;    // unit, unused
    vec4 u;
};

struct Answer {
    vec4 origin;     // of the shadow ray, density of the sample
    vec4 ray;        // direction of the shadow ray, density that the lat-long image has there
    vec4 direction;  // unit
    vec4 radiance;   // over density
    vec4 infinity;   // the environment's radiance along wo
    uvec4 light;     // triangle that it may touch, 1 where another blocks it, unused
};

Answer probe(Query query) {
    Surface surface = surface_at(Hit(query.hit.x, uintBitsToFloat(query.hit.yz), 0.0));
    LightSample light = sample_light(surface, query.wo.xyz, query.u);
    bool blocked = trace_any(light.ray, light.triangle, shadow_limit(light.triangle));
    float sky_density = environment_is(ENVIRONMENT_LAT_LONG) ? lat_long_density(light.direction) : 0.0;
    return Answer(vec4(light.ray.origin, light.density), vec4(light.ray.direction, sky_density), vec4(light.direction, 0.0),
        vec4(light.radiance, 0.0), vec4(environment_radiance(query.wo.xyz), 0.0),
        uvec4(light.triangle, uint(blocked), 0u, 0u));
}

PROBE(Query, Answer)
