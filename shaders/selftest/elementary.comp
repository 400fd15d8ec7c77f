// raywave's own functions, one in each launch, by its place in the host's table.
// Threads: one a case. Reads: cases. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"
#include "elementary.glsl"

uint check(uvec2 bits) {
    vec2 v = uintBitsToFloat(bits);
    float result = 0.0;
    switch (batch.bounce) {
    case 0u: result = on_circle(v.x).y; break;
    case 1u: result = angle_of(v.y, v.x); break;
    case 2u: result = exponential(v.x); break;
    case 3u: result = logarithm(v.x); break;
    }
    return floatBitsToUint(result);
}

CHECK(uvec2, uint)
