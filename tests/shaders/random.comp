// Four random numbers for each key of pixel, sample, block and seed.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "random.glsl"

vec4 probe(uvec4 key) { return random4(key.x, key.y, key.z, key.w); }

PROBE(uvec4, vec4)
