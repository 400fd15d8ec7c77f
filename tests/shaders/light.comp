// A sample of all light as a surface sees it, and whether it is occluded.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "occlusion.glsl"

struct Query {
    uvec4 hit;  // triangle, bits of barycentrics, unused
    vec4 wo;    // unit, unused
    vec4 u;
};

struct Answer {
    vec4 origin;     // of the shadow ray, pdf of the sample
    vec4 ray;        // direction of the shadow ray, pdf that the lat-long image has there
    vec4 direction;  // unit
    vec4 radiance;   // over pdf
    vec4 infinity;   // the environment's radiance along wo
    uvec4 light;     // triangle that it may touch, 1 where it is occluded, unused
};

Answer probe(Query query) {
    Surface surface = surface_at(Hit(world_primitive(query.hit.x), uintBitsToFloat(query.hit.yz), 0.0));
    LightSample light = sample_light(surface, query.wo.xyz, BSDF_DIFFUSE | BSDF_REFLECT, query.u);
    bool occluded = is_occluded(ShadowRay(light.ray, light.light, light.radiance));
    float environment_pdf = environment_is(ENVIRONMENT_LAT_LONG) ? lat_long_pdf(light.direction) : 0.0;
    return Answer(vec4(light.ray.origin, light.pdf), vec4(light.ray.direction, environment_pdf), vec4(light.direction, 0.0),
        vec4(light.radiance, 0.0), vec4(environment_radiance(query.wo.xyz), 0.0),
        uvec4(light.light.triangle, uint(occluded), 0u, 0u));
}

PROBE(Query, Answer)
