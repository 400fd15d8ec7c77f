// The BSDF of a material: which one it is, and its answers. The contract is that of bsdf/contract.glsl.
#ifndef BSDF_GLSL
#define BSDF_GLSL
#include "bsdf/dielectric.glsl"
#include "bsdf/mirror.glsl"
#include "bsdf/phong.glsl"

const bool HAS_GLASS = HAS_REFRACTIVE || HAS_DIELECTRIC;
const bool HAS_SPECULAR = HAS_MIRROR || HAS_GLASS;

// All components of the BSDF: BSDF_*.
uint bsdf_flags(Material m) {
    return IS_KIND(PHONG, HAS_SPECULAR, m) ? PHONG_FLAGS : IS_KIND(MIRROR, HAS_GLASS, m) ? MIRROR_FLAGS : DIELECTRIC_FLAGS;
}

// Draws a direction: a component by `choice` where it is specular, the direction of any other by `u`.
BsdfSample sample_bsdf(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    BsdfSample drawn;
    if (IS_KIND(PHONG, HAS_SPECULAR, m)) {
        drawn = sample_phong(m, surface, wo, u);
    } else if (IS_KIND(MIRROR, HAS_GLASS, m)) {
        drawn = sample_mirror(m, surface, wo);
    } else {
        drawn = sample_dielectric(m, surface, wo, choice);
    }
    return drawn;
}

// The value for a pair of directions, and the pdf of drawing `wi`; zero of what is specular.
BsdfValue evaluate_bsdf(Material m, Surface surface, vec3 wo, vec3 wi) {
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (IS_KIND(PHONG, HAS_SPECULAR, m)) {
        value = evaluate_phong(m, surface, wo, wi);
    }
    return value;
}

#endif
