// The BSDF of a material: which one it is, and its answers. The contract is that of bsdf/contract.glsl.
#ifndef BSDF_GLSL
#define BSDF_GLSL
#include "bsdf/conductor.glsl"
#include "bsdf/dielectric.glsl"
#include "bsdf/metal_rough.glsl"
#include "bsdf/mirror.glsl"
#include "bsdf/nothing.glsl"
#include "bsdf/phong.glsl"
#include "bsdf/plastic.glsl"
#include "bsdf/principled.glsl"
#include "bsdf/principled_thin.glsl"
#include "bsdf/rough_dielectric.glsl"
#include "bsdf/thin_dielectric.glsl"
#include "normal_map.glsl"

// The order in which kinds are asked for. Whether kernels have code for any that come after each:
const bool HAS_GLASS = HAS_REFRACTIVE || HAS_DIELECTRIC;
const bool AFTER_NOTHING = HAS_GLASS;
const bool AFTER_PRINCIPLED_THIN = HAS_NOTHING || AFTER_NOTHING;
const bool AFTER_PRINCIPLED = HAS_PRINCIPLED_THIN || AFTER_PRINCIPLED_THIN;
const bool AFTER_METAL_ROUGH = HAS_PRINCIPLED || AFTER_PRINCIPLED;
const bool AFTER_ROUGH_PLASTIC = HAS_METAL_ROUGH || AFTER_METAL_ROUGH;
const bool AFTER_PLASTIC = HAS_ROUGH_PLASTIC || AFTER_ROUGH_PLASTIC;
const bool AFTER_THIN_DIELECTRIC = HAS_PLASTIC || AFTER_PLASTIC;
const bool AFTER_ROUGH_DIELECTRIC = HAS_THIN_DIELECTRIC || AFTER_THIN_DIELECTRIC;
const bool AFTER_CONDUCTOR = HAS_ROUGH_DIELECTRIC || AFTER_ROUGH_DIELECTRIC;
const bool AFTER_SMOOTH_CONDUCTOR = HAS_CONDUCTOR || AFTER_CONDUCTOR;
const bool AFTER_MIRROR = HAS_SMOOTH_CONDUCTOR || AFTER_SMOOTH_CONDUCTOR;
const bool AFTER_PHONG = HAS_MIRROR || AFTER_MIRROR;

#define IS(KIND) IS_KIND(KIND, AFTER_##KIND, m)

// All components of the BSDF: BSDF_*.
uint bsdf_flags(Material m) {
    return IS(PHONG) ? PHONG_FLAGS
        : IS(MIRROR) ? MIRROR_FLAGS
        : IS(SMOOTH_CONDUCTOR) ? SMOOTH_CONDUCTOR_FLAGS
        : IS(CONDUCTOR) ? CONDUCTOR_FLAGS
        : IS(ROUGH_DIELECTRIC) ? ROUGH_DIELECTRIC_FLAGS
        : IS(THIN_DIELECTRIC) ? THIN_DIELECTRIC_FLAGS
        : IS(PLASTIC) ? PLASTIC_FLAGS
        : IS(ROUGH_PLASTIC) ? ROUGH_PLASTIC_FLAGS
        : IS(METAL_ROUGH) ? METAL_ROUGH_FLAGS
        : IS(PRINCIPLED) ? principled_flags(m)
        : IS(PRINCIPLED_THIN) ? PRINCIPLED_THIN_FLAGS
        : IS(NOTHING) ? NOTHING_FLAGS
        : DIELECTRIC_FLAGS;
}

// Draws a direction: a component by `choice` where some are specular, the direction of any other by `u`.
BsdfSample sample_bsdf(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    BsdfSample drawn;
    if (IS(PHONG)) {
        drawn = sample_phong(m, surface, wo, u);
    } else if (IS(MIRROR)) {
        drawn = sample_mirror(m, surface, wo);
    } else if (IS(SMOOTH_CONDUCTOR)) {
        drawn = sample_smooth_conductor(m, surface, wo);
    } else if (IS(CONDUCTOR)) {
        drawn = sample_conductor(m, surface, wo, choice, u);
    } else if (IS(ROUGH_DIELECTRIC)) {
        drawn = sample_rough_dielectric(m, surface, wo, choice, u);
    } else if (IS(THIN_DIELECTRIC)) {
        drawn = sample_thin_dielectric(m, surface, wo, choice);
    } else if (IS(PLASTIC)) {
        drawn = sample_plastic(m, surface, wo, choice, u);
    } else if (IS(ROUGH_PLASTIC)) {
        drawn = sample_rough_plastic(m, surface, wo, choice, u);
    } else if (IS(METAL_ROUGH)) {
        drawn = sample_metal_rough(m, surface, wo, choice, u);
    } else if (IS(PRINCIPLED)) {
        drawn = sample_principled(m, surface, wo, choice, u);
    } else if (IS(PRINCIPLED_THIN)) {
        drawn = sample_principled_thin(m, surface, wo, choice, u);
    } else if (IS(NOTHING)) {
        drawn = sample_nothing(wo);
    } else {
        drawn = sample_dielectric(m, surface, wo, choice);
    }
    if (HAS_NORMAL_TEXTURES) {
        bool misled = is_misled(surface, wo, drawn.direction, (drawn.flags & BSDF_TRANSMIT) != 0u);
        drawn.weight = misled ? vec3(0.0) : drawn.weight * bump_shadowing(surface, drawn.direction);
    }
    return drawn;
}

// The value for a pair of directions, and the pdf of drawing `wi`; zero of what is specular.
BsdfValue evaluate_bsdf(Material m, Surface surface, vec3 wo, vec3 wi) {
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (IS(PHONG)) {
        value = evaluate_phong(m, surface, wo, wi);
    } else if (IS(CONDUCTOR)) {
        value = evaluate_conductor(m, surface, wo, wi);
    } else if (IS(ROUGH_DIELECTRIC)) {
        value = evaluate_rough_dielectric(m, surface, wo, wi);
    } else if (IS(PLASTIC)) {
        value = evaluate_plastic(m, surface, wo, wi);
    } else if (IS(ROUGH_PLASTIC)) {
        value = evaluate_rough_plastic(m, surface, wo, wi);
    } else if (IS(METAL_ROUGH)) {
        value = evaluate_metal_rough(m, surface, wo, wi);
    } else if (IS(PRINCIPLED)) {
        value = evaluate_principled(m, surface, wo, wi);
    } else if (IS(PRINCIPLED_THIN)) {
        value = evaluate_principled_thin(m, surface, wo, wi);
    }
    if (HAS_NORMAL_TEXTURES) {
        value.f_cos *= bump_shadowing(surface, wi);
    }
    return value;
}

#endif
