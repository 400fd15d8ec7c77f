// Warps from the unit square, each with its pdf.
#ifndef SAMPLING_GLSL
#define SAMPLING_GLSL

#include "elementary.glsl"

// z of the normals between the branches of `basis`.
const float BASIS_EDGE = -0.4375;

// Two unit vectors that complete n to an orthonormal basis. (Duff et al. 2017, with their two branches parted where
// no wall along an axis has its normal: there the last bit of a normal would turn the basis)
void basis(vec3 n, out vec3 tangent, out vec3 bitangent) {
    float s = n.z >= BASIS_EDGE ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z);
    float b = n.x * n.y * a;
    tangent = vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x);
    bitangent = vec3(b, s + n.y * n.y * a, -n.y);
}

// log(1 - x) for x in [0, 1), good to the last bits where x is small: logarithms near 1 are coarse.
float log_of_rest(float x) {
    return x < 0.015625 ? -x * (1.0 + x * (0.5 + x * (1.0 / 3.0 + x * 0.25))) : logarithm(1.0 - x);
}

float sine_of(float cosine) { return sqrt(max(0.0, 1.0 - cosine * cosine)); }

// A direction at an angle of that cosine and sine from the unit axis, turned about it.
vec3 around(vec3 axis, vec2 angle, float turns) {
    vec3 tangent, bitangent;
    basis(axis, tangent, bitangent);
    vec2 across = angle.y * on_circle(turns);
    return tangent * across.x + bitangent * across.y + axis * angle.x;
}

// The cosine of a direction of pdf cos / pi over solid angle.
float cosine_of(float u) { return sqrt(1.0 - u); }

// Cosine and sine of a direction of pdf (exponent + 1) / (2 pi) cos^exponent over solid angle. In narrow lobes the cosine
// rounds to 1, so both come from 1 - cosine.
vec2 cosine_power_of(float exponent, float u) {
    float x = -log_of_rest(u) / (exponent + 1.0);
    float drop = x < 0.015625 ? x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0)))) : 1.0 - exponential(-x);
    return vec2(1.0 - drop, sqrt(drop * (2.0 - drop)));
}

// A direction of pdf cos / pi over solid angle.
vec3 sample_cosine(vec3 n, vec2 u) { return around(n, vec2(cosine_of(u.x), sine_of(cosine_of(u.x))), u.y); }

// The same about the z axis.
vec3 sample_cosine(vec2 u) { return vec3(sine_of(cosine_of(u.x)) * on_circle(u.y), cosine_of(u.x)); }

// Uniform over the unit disk, in polar coordinates.
vec2 sample_disk(vec2 u) { return sqrt(u.x) * on_circle(u.y); }

// Barycentrics of the second and third vertex, uniform over the triangle's area.
vec2 sample_triangle(vec2 u) {
    float s = sqrt(u.x);
    return vec2(s * (1.0 - u.y), s * u.y);
}

#endif
