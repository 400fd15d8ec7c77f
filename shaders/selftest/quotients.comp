// Quotients of pairs that hashes make: significands of 23 random bits, exponents from -32 to 31.
// Threads: one for sample_count pairs. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "tally.glsl"

float positive(uint word) { return uintBitsToFloat((word & 0x7fffffu) | ((word >> 26) + 95u) << 23); }

void main() {
    uint invocation = gl_GlobalInvocationID.x;
    Tally t = no_tally();
    if (invocation < batch.pixel_count) {
        for (uint i = 0u; i < batch.sample_count; i += 2u) {
            uint number = invocation * batch.sample_count + i;
            uvec4 words = words_of(number, 0u);
            vec4 v = vec4(positive(words.x), positive(words.y), positive(words.z), positive(words.w));
            tally_quotient(v.x, v.y, v.x / v.y, number, t);
            tally_quotient(v.z, v.w, v.z / v.w, number + 1u, t);
        }
    }
    add(t);
}
