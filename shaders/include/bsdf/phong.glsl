// The Phong BRDF: a Lambert part and a modified Phong lobe about the mirror direction. (Lafortune and Willems 1994)
#ifndef PHONG_GLSL
#define PHONG_GLSL
#include "bsdf/contract.glsl"
#include "random.glsl"
#include "sampling.glsl"

const uint PHONG_FLAGS = BSDF_REFLECT | BSDF_DIFFUSE | (HAS_PHONG_LOBES ? BSDF_GLOSSY : 0u);

// Share of scattered directions that come from the lobe.
float lobe_probability(Material m) {
    float d = mean3(m.kd);
    float s = mean3(m.ks);
    return s > 0.0 ? s / (d + s) : 0.0;
}

// (Ns + 1) / (2 pi) cos^Ns about the mirror direction. Also its own pdf.
float phong_lobe(Material m, vec3 n, vec3 wo, vec3 wi) {
    // The angle comes from the distance of the two directions: a cosine near 1 has lost it.
    vec3 apart = reflect(-wo, n) - wi;
    float drop = 0.5 * dot(apart, apart);
    return drop < 1.0 ? (m.ns + 1.0) * INVERSE_TWO_PI * exponential(m.ns * log_of_rest(drop)) : 0.0;
}

// Zero below the horizon.
BsdfValue evaluate_phong(Material m, Surface surface, vec3 wo, vec3 wi) {
    vec3 n = normal_towards(surface, wo);
    float cos_theta = dot(n, wi);
    bool above = is_reflected(surface, wo, wi, cos_theta);
    vec3 f = m.kd * INVERSE_PI;
    float pdf = cos_theta * INVERSE_PI;
    if (HAS_PHONG_LOBES) {
        float lobe = phong_lobe(m, n, wo, wi);
        f += m.ks * lobe;
        pdf = mix(pdf, lobe, lobe_probability(m));
    }
    return BsdfValue(above ? f * cos_theta : vec3(0.0), above ? pdf : 0.0);
}

// Picks a component by its weight, then a direction by the component.
BsdfSample sample_phong(Material m, Surface surface, vec3 wo, vec2 u) {
    vec3 n = normal_towards(surface, wo);
    float probability = HAS_PHONG_LOBES ? lobe_probability(m) : 0.0;
    bool lobe = HAS_PHONG_LOBES && !split_sample(u.x, probability);
    // One direction for both: a device that runs both sides of an `if` turns the axis once.
    float cos_theta = cosine_of(u.x);
    float sin_theta = sine_of(cos_theta);
    vec3 axis = n;
    if (HAS_PHONG_LOBES) {
        vec2 in_lobe = cosine_power_of(m.ns, u.x);
        cos_theta = lobe ? in_lobe.x : cos_theta;
        sin_theta = lobe ? in_lobe.y : sin_theta;
        axis = lobe ? reflect(-wo, n) : n;
    }
    vec3 wi = around(axis, vec2(cos_theta, sin_theta), u.y);
    BsdfValue value = evaluate_phong(m, surface, wo, wi);
    // Without a lobe f cos / pdf is Kd, the same bits as in kernels that have no lobes.
    vec3 weight = side_of(surface, wo) == side_of(surface, wi) ? m.kd : vec3(0.0);
    if (HAS_PHONG_LOBES) {
        weight = probability > 0.0 ? (value.pdf > 0.0 ? value.f_cos / value.pdf : vec3(0.0)) : weight;
    }
    // Rounding must not make a direction that was drawn one that cannot be.
    float pdf = max(value.pdf, 1e-20);
    return BsdfSample(wi, weight, pdf, BSDF_REFLECT | (lobe ? BSDF_GLOSSY : BSDF_DIFFUSE), 1.0);
}

#endif
