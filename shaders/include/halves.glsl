// Numbers in fewer bits, for path state that is smaller than it is exact.
#ifndef HALVES_GLSL
#define HALVES_GLSL

// The largest half. What is larger is clamped to it: finite light stays finite.
const float LARGEST_HALF = 65504.0;
// The smallest half above 0.
const float SMALLEST_HALF = 5.9604645e-8;
// The smallest that has all digits.
const float SMALLEST_NORMAL_HALF = 6.1035156e-5;
// Bits of a float's mantissa that a half has no room for.
const uint LOST_BITS = 0x1fffu;

// Three numbers of 13 random bits, by a point that no two paths share: for rounding, not for sampling.
uvec3 dither(vec3 point) {
    uvec3 bits = floatBitsToUint(point);
    uint h = bits.x * 0x9e3779b1u + bits.y * 0x85ebca77u + bits.z * 0xc2b2ae3du;
    h ^= h >> 15u;
    h *= 0x2c1b3c6du;
    h ^= h >> 12u;
    return uvec3(h >> 19u, (h >> 6u) & LOST_BITS, (h * 0x297a2d39u) >> 19u);
}

// Stochastic rounding of three numbers that are not negative to halves: each is rounded up as often as it lies near the
// upper neighbour, so that the mean of many is the number itself. Rounding to the nearest would repeat one error along
// every path that hits the same surfaces.
vec3 round_to_halves(vec3 value, uvec3 random) {
    vec3 normal = uintBitsToFloat((floatBitsToUint(value) + random) & ~LOST_BITS);
    // Below its smallest normal number halves are equally far apart.
    vec3 subnormal = floor(value * (1.0 / SMALLEST_HALF) + vec3(random) * (1.0 / float(LOST_BITS + 1u))) * SMALLEST_HALF;
    vec3 rounded = mix(normal, subnormal, lessThan(value, vec3(SMALLEST_NORMAL_HALF)));
    // NaN and infinities stay what they are, to be counted.
    return mix(min(rounded, LARGEST_HALF), value, greaterThan(uvec3(isnan(value)) | uvec3(isinf(value)), uvec3(0u)));
}

// Largest of the two numbers that stand for a direction: they have 24 bits each, which is what a float's
// mantissa has.
const float DIRECTION_STEPS = 8388607.0;

// A unit vector in 48 bits. (Cigolle et al. 2014, octahedral)
uvec2 encode_direction(vec3 d) {
    vec3 n = d / (abs(d.x) + abs(d.y) + abs(d.z));
    vec2 folded = (1.0 - abs(n.yx)) * mix(vec2(-1.0), vec2(1.0), greaterThanEqual(n.xy, vec2(0.0)));
    vec2 p = n.z < 0.0 ? folded : n.xy;
    uvec2 q = uvec2(ivec2(floor(p * DIRECTION_STEPS + 0.5))) & 0xffffffu;
    return uvec2(q.x | q.y << 24, q.y >> 8);
}

vec3 decode_direction(uvec2 words) {
    // The highest of 24 bits is the sign.
    ivec2 q = ivec2(words.x << 8, ((words.x >> 16) & 0xff00u) | (words.y << 16)) >> 8;
    vec2 p = vec2(q) / DIRECTION_STEPS;
    vec3 n = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    float fold = max(-n.z, 0.0);
    n.x += n.x >= 0.0 ? -fold : fold;
    n.y += n.y >= 0.0 ? -fold : fold;
    return normalize(n);
}

#endif
