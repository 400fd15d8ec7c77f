// Reflectances of smooth interfaces for unpolarised light. (Fresnel 1823)
#ifndef FRESNEL_GLSL
#define FRESNEL_GLSL
#include "bsdf/contract.glsl"

// Of dielectrics. `eta` is the index beyond over the index before, and the cosines are those on the two sides.
float fresnel(float cos_i, float cos_t, float eta) {
    float perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    float parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    return 0.5 * (perpendicular * perpendicular + parallel * parallel);
}

// The same by the cosine before alone, 1 under total reflection.
float dielectric_reflectance(float cos_i, float eta) {
    float squared = (eta - 1.0) * (eta + 1.0) + cos_i * cos_i;
    return squared <= 0.0 ? 1.0 : fresnel(cos_i, sqrt(squared) / eta, eta);
}

// Of a metal with the index eta + i k. (Born and Wolf, Principles of Optics, 14.2)
float metal_reflectance(float cosine, float eta, float k) {
    float cos2 = cosine * cosine;
    float sin2 = 1.0 - cos2;
    float difference = eta * eta - k * k - sin2;
    float sum = sqrt(difference * difference + 4.0 * eta * eta * k * k);
    float double_a_cos = 2.0 * cosine * sqrt(max(0.0, 0.5 * (sum + difference)));
    float perpendicular = (sum + cos2 - double_a_cos) / (sum + cos2 + double_a_cos);
    float before = cos2 * sum + sin2 * sin2;
    float ratio = (before - double_a_cos * sin2) / (before + double_a_cos * sin2);
    return perpendicular * (0.5 + 0.5 * ratio);
}

vec3 metal_reflectance(float cosine, vec3 eta, vec3 k) {
    return vec3(metal_reflectance(cosine, eta.r, k.r), metal_reflectance(cosine, eta.g, k.g), metal_reflectance(cosine, eta.b, k.b));
}

// An approximation by the reflectance at normal incidence. (Schlick 1994)
vec3 schlick_reflectance(float cosine, vec3 at_normal) {
    float rest = 1.0 - cosine;
    float rest2 = rest * rest;
    return at_normal + (1.0 - at_normal) * (rest2 * rest2 * rest);
}

#endif
