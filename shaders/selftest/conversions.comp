// A word as an integer, as a float and as a half, each converted to the others.
// Threads: one a case. Reads: cases. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

struct Answer {
    uvec4 floats;    // bits of the unsigned integer, the signed one, the float's floor, and the lower half, as floats
    uvec4 integers;  // the float as an unsigned and a signed integer, and as a half in the lower and in the upper place
};

Answer check(uint bits) {
    float number = uintBitsToFloat(bits);
    vec4 floats = vec4(float(bits), float(int(bits)), floor(number), unpackHalf2x16(bits).x);
    uvec4 integers = uvec4(uint(number), uint(int(number)), packHalf2x16(vec2(number, 0.0)) & 0xffffu,
        packHalf2x16(vec2(0.0, number)) >> 16);
    return Answer(floatBitsToUint(floats), integers);
}

CHECK(uint, Answer)
