// The Phong BRDF: its value and pdf for a pair of directions, and a sample of it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "surface_query.glsl"

struct Answer {
    vec4 value;      // f cos, pdf
    vec4 direction;  // sampled
    vec4 weight;     // of the sample
};

Answer probe(SurfaceQuery query) {
    Surface surface = surface_of(query);
    Material material = material_at(surface);
    BsdfValue value = evaluate_bsdf(material, surface, query.wo.xyz, query.wi.xyz);
    BsdfSample drawn = sample_bsdf(material, surface, query.wo.xyz, query.u.x, query.u.zw);
    return Answer(vec4(value.f_cos, value.pdf), vec4(drawn.direction, 0.0), vec4(drawn.weight, 0.0));
}

PROBE(SurfaceQuery, Answer)
