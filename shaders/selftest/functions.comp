// The driver's own functions, one in each launch, by its place in the host's table.
// Threads: one a case. Reads: cases. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

uint check(uvec2 bits) {
    vec2 v = uintBitsToFloat(bits);
    float result = 0.0;
    switch (batch.bounce) {
    case 0u: result = sin(v.x); break;
    case 1u: result = cos(v.x); break;
    case 2u: result = atan(v.x, v.y); break;
    case 3u: result = exp(v.x); break;
    case 4u: result = log(v.x); break;
    case 5u: result = pow(v.x, v.y); break;
    }
    return floatBitsToUint(result);
}

CHECK(uvec2, uint)
