// A word for each invocation, found in a loop that lanes leave at different turns, by a return or at its end.
#ifndef WANDER_GLSL
#define WANDER_GLSL
#include "check.glsl"

uint wander(uint index, uint purpose) {
    uint word = words_of(index, purpose).x;
    for (uint turn = 0u; turn < 64u; turn++) {
        word = word * 747796405u + 2891336453u;
        if (word >> 28 == 0u) {
            return word ^ turn;
        }
        word ^= word >> 15;
    }
    return word;
}

#endif
