// One pass of a chain: each word is made of one that another workgroup wrote in the pass before.
// Threads: one a word. Reads and writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

// Two halves of pixel_count words, a power of two: a pass reads one and writes the other.
layout(set = 2, binding = 1, std430) buffer Answers { uint words[]; } answers;

void main() {
    uint count = batch.pixel_count;
    uint index = gl_GlobalInvocationID.x;
    uint from = (index * 5u + batch.bounce * 4099u + count / 2u) & (count - 1u);
    uint word = answers.words[(batch.bounce & 1u) * count + from];
    answers.words[((batch.bounce + 1u) & 1u) * count + index] = (word ^ (word >> 15)) * 747796405u + index;
}
