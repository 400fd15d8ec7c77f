// What slab tests share.
#ifndef SLAB_GLSL
#define SLAB_GLSL

// Reciprocal direction, finite: a zero component becomes tiny, which misses the same boxes.
vec3 safe_inverse(vec3 d) {
    return 1.0 / mix(d, mix(vec3(-1e-20), vec3(1e-20), greaterThanEqual(d, vec3(0.0))), lessThan(abs(d), vec3(1e-20)));
}

// min and max of bits, one instruction each: the built-ins carry a rule for NaN, which no box has.
// Of two negative numbers they give the wrong one. That does not show: where a box is entered behind
// the origin is 0, and a box that is left behind it is missed.
float lesser(float a, float b) { return intBitsToFloat(min(floatBitsToInt(a), floatBitsToInt(b))); }
float greater(float a, float b) { return intBitsToFloat(max(floatBitsToInt(a), floatBitsToInt(b))); }
vec4 lesser(vec4 a, vec4 b) { return intBitsToFloat(min(floatBitsToInt(a), floatBitsToInt(b))); }
vec4 greater(vec4 a, vec4 b) { return intBitsToFloat(max(floatBitsToInt(a), floatBitsToInt(b))); }

// How far on boxes are entered of which only triangles nearer than `limit` count.
//
// The distance that is computed of a triangle is off by roundings of its size and of the way to its plane, and by more
// the thinner it is. One that would be found just before the limit may lie in a box beyond it; were the box passed
// over, what a ray hits would depend on the tree. So the limit is taken to be a 65,536th further, and a 32,768th of
// the scene: few boxes begin there.
const float LIMIT_SLACK = 1.0 + 1.0 / 65536.0;
const float LIMIT_MARGIN = 1.0 / 16384.0;
float reach_of(float limit, vec3 inverse) {
    vec3 lengths = abs(inverse);
    return limit * LIMIT_SLACK + LIMIT_MARGIN * lesser(lengths.x, lesser(lengths.y, lengths.z));
}

#endif
