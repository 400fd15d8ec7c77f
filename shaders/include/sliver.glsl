// Thin triangles, and on which side of one a point lies.
#ifndef SLIVER_GLSL
#define SLIVER_GLSL
#include "records.glsl"

// Roundings of its vertices move a triangle by no more than rays are offset from their surface, unless its longest edge
// times its aspect, that edge over the height on it, is more than this: then it is thin. In normalised lengths, as in
// src/bvh/sliver.rs.
const float THIN = 32.0;

bool is_thin(Triangle t) {
    vec3 a = t.v1 - t.v0;
    vec3 b = t.v2 - t.v0;
    vec3 c = t.v2 - t.v1;
    float longest = max(max(dot(a, a), dot(b, b)), dot(c, c));
    // The normal is as long as the longest edge times its height.
    vec3 normal = cross(a, b);
    return THIN * THIN * dot(normal, normal) < longest * longest * longest;
}

// Numbers as unevaluated sums of two floats, the second below half a last place of the first. (Dekker 1971, A
// Floating-Point Technique for Extending the Available Precision)
struct Sum {
    float high;
    float low;
};

Sum normalised(float high, float low) {
    float sum = high + low;
    return Sum(sum, low - (sum - high));
}

// The leading half of a number's bits: products of halves are exact.
float leading_half(float x) { return uintBitsToFloat(floatBitsToUint(x) & 0xfffff000u); }

Sum exact_product(float a, float b) {
    float product = a * b;
    float a_high = leading_half(a);
    float b_high = leading_half(b);
    float a_low = a - a_high;
    float b_low = b - b_high;
    return Sum(product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low);
}

Sum add(Sum a, Sum b) {
    float sum = a.high + b.high;
    float of_b = sum - a.high;
    float lost = (a.high - (sum - of_b)) + (b.high - of_b);
    return normalised(sum, lost + a.low + b.low);
}

// a b - c d.
Sum difference_of_products(float a, float b, float c, float d) { return add(exact_product(a, b), exact_product(-c, d)); }

Sum times(Sum a, float b) {
    Sum product = exact_product(a.high, b);
    return normalised(product.high, product.low + a.low * b);
}

// Six volumes of the tetrahedron of three points and the origin: a . (b x c), to some 2^-44 of its terms. Its sign says
// on which side of the triangle the origin lies.
float signed_volume(vec3 a, vec3 b, vec3 c) {
    Sum x = times(difference_of_products(b.y, c.z, b.z, c.y), a.x);
    Sum y = times(difference_of_products(b.z, c.x, b.x, c.z), a.y);
    Sum z = times(difference_of_products(b.x, c.y, b.y, c.x), a.z);
    return add(add(x, y), z).high;
}

#endif
