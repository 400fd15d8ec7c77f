// The root of every significand, with an even and an odd exponent.
// Threads: one for sample_count numbers. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "tally.glsl"

void main() {
    uint invocation = gl_GlobalInvocationID.x;
    Tally t = no_tally();
    if (invocation < batch.pixel_count) {
        for (uint i = 0u; i < batch.sample_count; i++) {
            uint number = invocation * batch.sample_count + i;
            float x = uintBitsToFloat(0x3f800000u + number);
            tally_root(x, sqrt(x), number, t);
        }
    }
    add(t);
}
