// A plate of a dielectric that is so thin that light goes straight through it, with all that is reflected inside.
#ifndef THIN_DIELECTRIC_GLSL
#define THIN_DIELECTRIC_GLSL
#include "bsdf/fresnel.glsl"

const uint THIN_DIELECTRIC_FLAGS = BSDF_SPECULAR | BSDF_REFLECT | BSDF_TRANSMIT;

BsdfSample sample_thin_dielectric(Material m, Surface surface, vec3 wo, float choice) {
    vec3 n = mirroring_normal(surface, wo);
    float once = dielectric_reflectance(min(dot(wo, n), 1.0), m.ni);
    // The geometric series of reflections inside: R + T R T + T R R R T + ...
    float reflectance = 2.0 * once / (1.0 + once);
    bool reflects = choice < reflectance;
    uint flags = BSDF_SPECULAR | (reflects ? BSDF_REFLECT : BSDF_TRANSMIT);
    return BsdfSample(reflects ? reflect(-wo, n) : -wo, reflects ? vec3(1.0) : m.tf, ONE_DIRECTION, flags, 1.0);
}

#endif
