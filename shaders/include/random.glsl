// Pseudo-random numbers keyed by what is sampled, never by who samples: pixel, sample, dimension, seed.
#ifndef RANDOM_GLSL
#define RANDOM_GLSL
#include "specialization.glsl"

// What random numbers are multiples of: 2^-24.
const float RANDOM_STEP = 5.9604644775390625e-8;
const float ONE_BELOW = 1.0 - RANDOM_STEP;

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

// An Owen scramble of reversed bits: a hash of the bits under each says whether it is flipped. (Laine
// and Karras 2011; constants of Vegdahl 2021, Building a Better LK Hash)
uint scramble_reversed(uint bits, uint seed) {
    bits ^= bits * 0x3d20adeau;
    bits += seed;
    bits *= (seed >> 16u) | 1u;
    bits ^= bits * 0x05526c56u;
    bits ^= bits * 0x53a22864u;
    return bits;
}

// The second Sobol dimension of an index, its bits reversed. Its matrix is Pascal's triangle modulo 2:
// bit j is the sum of the bits k of the index whose number has all ones of j. (After Lucas 1878)
uint sobol_second_reversed(uint index) {
    index ^= index >> 16u;
    index ^= (index >> 8u) & 0x00ff00ffu;
    index ^= (index >> 4u) & 0x0f0f0f0fu;
    index ^= (index >> 2u) & 0x33333333u;
    index ^= (index >> 1u) & 0x55555555u;
    return index;
}

// Two numbers of 32 bits: a point of the Sobol sequence in two dimensions, of which the first is the
// index reversed. Its points are shuffled in an order that keeps every 2^k together, and scrambled.
// (Burley 2020, Practical Hash-based Owen Scrambling)
uvec2 sobol_pair(uint reversed_index, uint order, uint scramble_x, uint scramble_y) {
    uint index = bitfieldReverse(scramble_reversed(reversed_index, order));
    uint x = scramble_reversed(index, scramble_x);
    uint y = scramble_reversed(sobol_second_reversed(index), scramble_y);
    return bitfieldReverse(uvec2(x, y));
}

// Four numbers of 32 bits: two pairs of a block, each from a sequence that belongs to the pixel.
uvec4 sobol4(uint pixel, uint sample_index, uint block, uint seed) {
    uvec4 a = pcg4d(uvec4(pixel, block, seed, 0u));
    uvec4 b = pcg4d(uvec4(pixel, block, seed, 1u));
    uint reversed_index = bitfieldReverse(sample_index);
    return uvec4(sobol_pair(reversed_index, a.x, a.y, a.z), sobol_pair(reversed_index, b.x, b.y, b.z));
}

// Four uniform numbers in [0, 1), multiples of RANDOM_STEP. With the Sobol sampler the first two and the last two are
// stratified over the samples of a pixel.
vec4 random4(uint pixel, uint sample_index, uint block, uint seed) {
    uvec4 bits;
    if (SAMPLER == SAMPLER_SOBOL) {
        // The second half is the same sequence under a scramble of its own.
        if (HALVES) {
            seed += (sample_index >> SECOND_HALF_BIT) * 0x9e3779b9u;
            sample_index &= (1u << SECOND_HALF_BIT) - 1u;
        }
        bits = sobol4(pixel, sample_index, block, seed);
    } else {
        bits = pcg4d(uvec4(pixel, sample_index, block, seed));
    }
    return vec4(bits >> 8u) * RANDOM_STEP;
}

// Chooses by a number in [0, 1): false below the split, true above it. The number is remapped to be uniform in [0, 1)
// again, so that it can be used once more.
bool split_sample(inout float u, float split) {
    bool above = u >= split;
    u = min(above ? (u - split) / (1.0 - split) : u / split, ONE_BELOW);
    return above;
}

// Chooses one of `count` equal cells by a number in [0, 1). The number is remapped to be uniform in [0, 1) again, with
// `digits` in place of those that the choice used up.
uint split_sample_evenly(inout float u, uint count, float digits) {
    float at = u * float(count);
    uint cell = min(uint(at), count - 1u);
    u = min(at - float(cell) + digits * (float(count) * RANDOM_STEP), ONE_BELOW);
    return cell;
}

#endif
