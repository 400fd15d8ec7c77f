// Appends to a list in each of some rounds, by lanes that left a loop at different turns.
// Threads: one an invocation. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#define CONTROL_ACCESS
#include "wander.glsl"
#include "append.glsl"

// A count for each round, then a list for each, of pixel_count places: one more than the invocation in each place,
// added up where a place is given twice.
layout(set = 2, binding = 1, std430) buffer Answers { uint words[]; } answers;

void main() {
    uint index = gl_GlobalInvocationID.x;
    for (uint round = 0u; round < batch.sample_count; round++) {
        bool wanted = (wander(index, round) & 0x300u) != 0u;
        uint place;
        APPEND(answers.words[round], wanted, place)
        if (wanted && place < batch.pixel_count) {
            atomicAdd(answers.words[batch.sample_count + round * batch.pixel_count + place], index + 1u);
        }
    }
}
