// A BSDF: its value and pdf for a pair of directions, and a sample of it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "surface_query.glsl"

struct Answer {
    vec4 value;      // f cos, pdf
    vec4 direction;  // sampled, its pdf
    vec4 weight;     // of the sample, eta
    uvec4 flags;     // of the BSDF, of the sample, unused
};

Answer probe(SurfaceQuery query) {
    Surface surface = surface_of(query);
    Material material = material_at(surface);
    BsdfValue value = evaluate_bsdf(material, surface, query.wo.xyz, query.wi.xyz);
    BsdfSample drawn = sample_bsdf(material, surface, query.wo.xyz, query.u.x, query.u.zw);
    return Answer(vec4(value.f_cos, value.pdf), vec4(drawn.direction, drawn.pdf), vec4(drawn.weight, drawn.eta),
        uvec4(bsdf_flags(material), drawn.flags, 0u, 0u));
}

PROBE(SurfaceQuery, Answer)
