// The arithmetic of all kernels, of three numbers each.
// Threads: one a case. Reads: cases. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

// Bits of results.
struct Answer {
    uvec4 binary;  // a + b, a - b, a * b, a / b
    uvec4 other;   // 1 / a, root of a, a * b + c in two roundings, fma of the three
};

Answer check(uvec4 bits) {
    vec3 v = uintBitsToFloat(bits.xyz);
    vec4 binary = vec4(v.x + v.y, v.x - v.y, v.x * v.y, v.x / v.y);
    vec4 other = vec4(1.0 / v.x, sqrt(v.x), v.x * v.y + v.z, fma(v.x, v.y, v.z));
    return Answer(floatBitsToUint(binary), floatBitsToUint(other));
}

CHECK(uvec4, Answer)
