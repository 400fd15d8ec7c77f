// Functions that raywave computes in its own way, of two numbers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "elementary.glsl"

struct Answer {
    vec2 on_circle;     // of x
    float exponential;  // of x
    float logarithm;    // of the magnitude of y
    float angle;        // of (x, y)
    float unused_a;
    vec2 unused_b;
};

Answer probe(vec4 query) {
    float x = query.x;
    float y = query.y;
    return Answer(on_circle(x), exponential(x), logarithm(abs(y)), angle_of(x, y), 0.0, vec2(0.0));
}

PROBE(vec4, Answer)
