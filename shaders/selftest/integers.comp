// The arithmetic of bits that random numbers, queues and trees are made by.
// Threads: one a case. Reads: cases. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

struct Answer {
    uvec4 sums;  // a * b, carry of a + b, a << b, and the signed a >> b, by the lower five bits of b
    uvec4 bits;  // of a: reversed, its highest, its lowest, how many
};

Answer check(uvec2 pair) {
    uint carry;
    uint sum = uaddCarry(pair.x, pair.y, carry);
    uint shift = pair.y & 31u;
    return Answer(uvec4(pair.x * pair.y, carry ^ (sum ^ (pair.x + pair.y)), pair.x << shift, uint(int(pair.x) >> shift)),
        uvec4(bitfieldReverse(pair.x), uint(findMSB(pair.x)), uint(findLSB(pair.x)), uint(bitCount(pair.x))));
}

CHECK(uvec2, Answer)
