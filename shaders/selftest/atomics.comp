// Atomic operations that all invocations make on few words.
// Threads: one an invocation. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

const uint COUNTERS = 16u;

// Sums, then the largest and the smallest word, all words joined and unused; then how often each ticket was drawn, a
// pixel_count for each counter.
layout(set = 2, binding = 1, std430) buffer Answers { uint words[]; } answers;

void main() {
    uint index = gl_GlobalInvocationID.x;
    uint word = words_of(index, 0u).x;
    uint counter = word % COUNTERS;
    uint ticket = atomicAdd(answers.words[counter], 1u);
    atomicMax(answers.words[COUNTERS], word);
    // Answers begin as zeros, so the smallest is told by its complement.
    atomicMax(answers.words[COUNTERS + 1u], ~word);
    atomicOr(answers.words[COUNTERS + 2u], word & 0x55555555u & (1u << (index & 31u)));
    if (ticket < batch.pixel_count) {
        atomicAdd(answers.words[COUNTERS + 4u + counter * batch.pixel_count + ticket], 1u);
    }
}
