// Loops of as many turns as each case says.
// Threads: one a case. Reads: cases. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

// Turns that were taken, and what they made of a word.
uvec2 check(uint turns) {
    uvec2 state = uvec2(0u, turns);
    for (uint turn = 0u; turn < turns; turn++) {
        state.y = (state.y ^ (state.y >> 15)) * 747796405u + turn;
        state.x++;
    }
    return state;
}

CHECK(uint, uvec2)
