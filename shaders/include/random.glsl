// Random numbers keyed by what is sampled, never by who samples: pixel, sample, dimension, seed.
#ifndef RANDOM_GLSL
#define RANDOM_GLSL

// Blocks of four dimensions that a path draws.
const uint CAMERA_BLOCK = 0u;
uint light_block(uint bounce) { return 1u + 2u * bounce; }
uint scatter_block(uint bounce) { return 2u + 2u * bounce; }

// Hashes four words to four. (Jarzynski and Olano 2020, Hash Functions for GPU Rendering, pcg4d)
uvec4 pcg4d(uvec4 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v ^= v >> 16u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

// Four uniform numbers in [0, 1), multiples of 2^-24.
vec4 random4(uint pixel, uint sample_index, uint block, uint seed) {
    return vec4(pcg4d(uvec4(pixel, sample_index, block, seed)) >> 8u) * 5.9604644775390625e-8;
}

#endif
