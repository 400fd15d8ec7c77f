// Operations that drivers compute each in their way, as kernels have them.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"

struct Query {
    vec4 a;
    vec4 b;
};

struct Answer {
    float quotient;    // a.x / b.x
    float reciprocal;  // 1 / b.x
    float root;        // of a.x
    float inverse_root;
    vec3 quotients;  // a / b
    float dot_product;
    vec3 cross_product;
    float len;  // of a.xyz
    vec3 unit;
    float smaller;  // of a.x and b.x
    vec3 reflected;
    float larger;
    vec3 mixed;
    uint half_bits;  // of a.x and b.x
    vec3 reciprocals;
    float fraction;
    vec2 halves;  // of the bits of a.x
    vec2 snorms;
    uint is_nan;
    uint is_inf;
    uint unused_a;
    uint unused_b;
};

Answer probe(Query q) {
    uint bits = floatBitsToUint(q.a.x);
    return Answer(q.a.x / q.b.x, 1.0 / q.b.x, sqrt(q.a.x), inversesqrt(q.a.x), q.a.xyz / q.b.xyz, dot(q.a.xyz, q.b.xyz),
        cross(q.a.xyz, q.b.xyz), length(q.a.xyz), normalize(q.a.xyz), min(q.a.x, q.b.x), reflect(q.a.xyz, q.b.xyz),
        max(q.a.x, q.b.x), mix(q.a.xyz, q.b.xyz, q.b.w), packHalf2x16(vec2(q.a.x, q.b.x)), 1.0 / q.b.xyz, fract(q.a.x),
        unpackHalf2x16(bits), unpackSnorm2x16(bits), isnan(q.a.x) ? 1u : 0u, isinf(q.a.x) ? 1u : 0u, 0u, 0u);
}

PROBE(Query, Answer)
