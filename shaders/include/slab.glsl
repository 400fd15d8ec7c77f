// What slab tests share.
#ifndef SLAB_GLSL
#define SLAB_GLSL

// Reciprocal direction, finite: a zero component becomes tiny, which misses the same boxes.
vec3 safe_inverse(vec3 d) {
    return 1.0 / mix(d, mix(vec3(-1e-20), vec3(1e-20), greaterThanEqual(d, vec3(0.0))), lessThan(abs(d), vec3(1e-20)));
}

// Widens a slab interval over its own rounding and that of triangle distances.
// (Ize 2013, Robust BVH Ray Traversal)
const float SLAB_SLACK = 1.0000008;

// min and max as one instruction each: the built-ins carry a rule for NaN, which no box has.
float lesser(float a, float b) { return a < b ? a : b; }
float greater(float a, float b) { return a > b ? a : b; }

#endif
