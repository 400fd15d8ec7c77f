// Takes TURNS turns of a loop, each from one state of a generator to the next, so that the last state tells how many
// it was given: a compiler cannot know it without taking them.
// Threads: one. Writes: last state.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
layout(local_size_x = 1) in;
#include "bindings_path.glsl"

// What the push constants stand for here.
#define FIRST_STATE batch.first_pixel
#define TURNS batch.sample_count

layout(set = 2, binding = 4, std430) writeonly buffer LastState { uint last; } last_state;

void main() {
    uint state = FIRST_STATE;
    for (uint turn = 0u; turn < TURNS; turn++) {
        state = state * 1664525u + 1013904223u;
    }
    last_state.last = state;
}
