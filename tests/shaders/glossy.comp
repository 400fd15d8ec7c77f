// The glossy BRDF: its value and density for a pair of directions, and a sample of it.
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
    Material material = fetch_material(surface.material, surface.uv);
    float pdf;
    vec3 value = evaluate_glossy(material, surface, query.wo.xyz, query.wi.xyz, pdf);
    Scatter scatter = scatter_glossy(material, surface, query.wo.xyz, query.u.zw);
    return Answer(vec4(value, pdf), vec4(scatter.direction, 0.0), vec4(scatter.weight, 0.0));
}

PROBE(SurfaceQuery, Answer)
