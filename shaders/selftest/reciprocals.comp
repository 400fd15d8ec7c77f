// The reciprocal of every significand.
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
            tally_quotient(1.0, x, 1.0 / x, number, t);
        }
    }
    add(t);
}
