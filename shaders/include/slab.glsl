// What slab tests share.
#ifndef SLAB_GLSL
#define SLAB_GLSL

// Reciprocal direction, finite: a zero component becomes tiny, which misses the same boxes.
vec3 safe_inverse(vec3 d) {
    return 1.0 / mix(d, mix(vec3(-1e-20), vec3(1e-20), greaterThanEqual(d, vec3(0.0))), lessThan(abs(d), vec3(1e-20)));
}

// min and max without the built-ins' rule for NaN, which no box has: one instruction each. Of two negative numbers they
// give the wrong one. That does not show: a box that is entered behind the origin is entered at 0, and one that is left
// behind it is missed.
float min_bits(float a, float b) { return intBitsToFloat(min(floatBitsToInt(a), floatBitsToInt(b))); }
float max_bits(float a, float b) { return intBitsToFloat(max(floatBitsToInt(a), floatBitsToInt(b))); }
vec4 min_bits(vec4 a, vec4 b) { return intBitsToFloat(min(floatBitsToInt(a), floatBitsToInt(b))); }
vec4 max_bits(vec4 a, vec4 b) { return intBitsToFloat(max(floatBitsToInt(a), floatBitsToInt(b))); }

// How far boxes are entered where triangles count up to `t_max`.
//
// The computed distance of a triangle is off by roundings of its size and of the way to its plane, and by more the
// thinner it is. A triangle that would be found just before t_max may lie in a box beyond it; were the box skipped,
// what a ray hits would depend on the tree. So boxes are entered a 65,536th of t_max and a 32,768th of the scene
// further: few boxes begin there.
const float T_MAX_SLACK = 1.0 + 1.0 / 65536.0;
const float T_MAX_MARGIN = 1.0 / 16384.0;
float box_t_max(float t_max, vec3 inverse) {
    vec3 lengths = abs(inverse);
    return t_max * T_MAX_SLACK + T_MAX_MARGIN * min_bits(lengths.x, min_bits(lengths.y, lengths.z));
}

#endif
