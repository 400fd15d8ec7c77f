// Every warp of the unit square.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "sampling.glsl"

struct Query {
    vec4 axis;  // unit, exponent
    vec4 u;     // two numbers
};

struct Answer {
    vec4 cosine;
    vec4 cosine_power;
    vec4 planar;  // disk, triangle
};

Answer probe(Query query) {
    vec2 u = query.u.xy;
    return Answer(
        vec4(sample_cosine(query.axis.xyz, u), 0.0),
        vec4(around(query.axis.xyz, cosine_power_of(query.axis.w, u.x), u.y), 0.0),
        vec4(sample_disk(u), sample_triangle(u)));
}

PROBE(Query, Answer)
