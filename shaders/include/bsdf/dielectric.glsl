// Smooth glass: a Fresnel dielectric, which reflects and transmits, or one that only refracts (by Snell's law without
// Fresnel's split, but for total reflection).
#ifndef DIELECTRIC_GLSL
#define DIELECTRIC_GLSL
#include "bsdf/fresnel.glsl"

const uint DIELECTRIC_FLAGS = BSDF_SPECULAR | BSDF_REFLECT | BSDF_TRANSMIT;

// Picks reflection or transmission by the number `choice`. Geometry says which side is inside.
BsdfSample sample_dielectric(Material m, Surface surface, vec3 wo, float choice) {
    float side = side_of(surface, wo);
    vec3 n = mirroring_normal(surface, wo);
    float inverse_ni = 1.0 / m.ni;
    float eta = side > 0.0 ? m.ni : inverse_ni;
    float inverse_eta = side > 0.0 ? inverse_ni : m.ni;
    float cos_i = min(dot(wo, n), 1.0);
    vec3 along = wo - cos_i * n;
    // The squared cosine beyond, times eta squared, as a sum of small numbers: at grazing angles of nearly equal indices,
    // so that matched glass is invisible, and at steep angles, where little escapes, so that very dense glass does not
    // trap its light.
    float squared = cos_i < 0.7 ? (eta - 1.0) * (eta + 1.0) + cos_i * cos_i : eta * eta - dot(along, along);
    float cos_t = sqrt(max(0.0, squared)) * inverse_eta;
    float reflectance = squared <= 0.0 ? 1.0 : 0.0;
    if (IS_KIND(DIELECTRIC, HAS_REFRACTIVE, m)) {
        reflectance = squared <= 0.0 ? 1.0 : fresnel(cos_i, cos_t, eta);
    }
    vec3 refracted = normalize(-along * inverse_eta - cos_t * n);
    bool reflects = choice < reflectance;
    vec3 wi = reflects ? reflect(-wo, n) : refracted;
    // Radiance scales with the square of the index.
    vec3 weight = reflects ? vec3(1.0) : m.tf * (inverse_eta * inverse_eta);
    uint flags = BSDF_SPECULAR | (reflects ? BSDF_REFLECT : BSDF_TRANSMIT);
    return BsdfSample(wi, weight, ONE_DIRECTION, flags, side_of(surface, wi) < 0.0 ? m.ni : 1.0);
}

#endif
