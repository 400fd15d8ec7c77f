// A sample of a mirror or of glass.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "surface_query.glsl"

struct Answer {
    vec4 direction;
    vec4 weight;
};

Answer probe(SurfaceQuery query) {
    Surface surface = surface_of(query);
    Material material = material_at(surface);
    BsdfSample drawn = sample_bsdf(material, surface, query.wo.xyz, query.u.x, query.u.zw);
    return Answer(vec4(drawn.direction, 0.0), vec4(drawn.weight, 0.0));
}

PROBE(SurfaceQuery, Answer)
