// Work that takes a while, for the clocks.
// Threads: one an invocation. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

layout(set = 2, binding = 1, std430) writeonly buffer Answers { uint words[]; } answers;

void main() {
    uint word = gl_GlobalInvocationID.x;
    for (uint turn = 0u; turn < batch.sample_count; turn++) {
        word = (word ^ (word >> 15)) * 747796405u + turn;
    }
    answers.words[gl_GlobalInvocationID.x] = word;
}
