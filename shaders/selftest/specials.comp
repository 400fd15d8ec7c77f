// What becomes of NaN, infinities, zeros of both signs and denormals.
// Threads: one a case. Reads: cases. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

struct Answer {
    uvec4 choice;  // relations as bits; bits of min, max and of the larger by a comparison
    uvec4 sign;    // bits of -a, |a|, a * b, and a as it was loaded
};

Answer check(uvec2 bits) {
    float a = uintBitsToFloat(bits.x);
    float b = uintBitsToFloat(bits.y);
    uint relations = uint(a < b) | uint(a <= b) << 1 | uint(a > b) << 2 | uint(a >= b) << 3 | uint(a == b) << 4
        | uint(a != b) << 5 | uint(isnan(a)) << 6 | uint(isinf(a)) << 7;
    float larger = a > b ? a : b;
    return Answer(uvec4(relations, floatBitsToUint(min(a, b)), floatBitsToUint(max(a, b)), floatBitsToUint(larger)),
        uvec4(floatBitsToUint(-a), floatBitsToUint(abs(a)), floatBitsToUint(a * b), floatBitsToUint(a)));
}

CHECK(uvec2, Answer)
