// Where an invocation's traversal stack lies in memory: its first four blocks.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "stack.glsl"

uvec4 probe(uvec4 unused) { return uvec4(block_place(0u), block_place(1u), block_place(2u), block_place(3u)); }

PROBE(uvec4, uvec4)
