// Camera rays of a pixel and a sample, as paths begin.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "path.glsl"

struct Answer {
    vec4 origin;
    vec4 direction;
};

Answer probe(uvec4 query) {
    Ray ray = begin_path(query.x, query.y).ray;
    return Answer(vec4(ray.origin, 0.0), vec4(ray.direction, 0.0));
}

PROBE(uvec4, Answer)
