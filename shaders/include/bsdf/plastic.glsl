// A diffuse base under a dielectric coat, smooth or with microfacets. Light that the base scatters is reflected inside the
// coat any number of times. (As Mitsuba's plastic and roughplastic define them)
#ifndef PLASTIC_GLSL
#define PLASTIC_GLSL
#include "bsdf/microfacet.glsl"

const uint PLASTIC_FLAGS = BSDF_DIFFUSE | BSDF_SPECULAR | BSDF_REFLECT;
const uint ROUGH_PLASTIC_FLAGS = BSDF_DIFFUSE | BSDF_GLOSSY | BSDF_REFLECT;

// f cos of the base by the shares of light that the coat lets in and out.
vec3 base_under_coat(Material m, float in_share, float out_share, float cos_i) {
    vec3 inside = m.detail.nonlinear ? m.kd * m.detail.inner_reflectance : vec3(m.detail.inner_reflectance);
    return m.kd / (1.0 - inside) * (in_share * out_share * cos_i * INVERSE_PI / (m.ni * m.ni));
}

// Probability of drawing the coat's reflection where the coat reflects that share.
float coat_probability(Material m, float reflected) {
    float base = (1.0 - reflected) * mean3(m.kd);
    float coat = reflected * mean3(m.ks);
    return coat > 0.0 ? coat / (coat + base) : 0.0;
}

BsdfValue evaluate_plastic(Material m, Surface surface, vec3 wo, vec3 wi) {
    vec3 n = mirroring_normal(surface, wo);
    float cos_o = min(dot(n, wo), 1.0);
    float cos_i = min(dot(n, wi), 1.0);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (is_reflected(surface, wo, wi, cos_i)) {
        float reflected = dielectric_reflectance(cos_o, m.ni);
        value.f_cos = base_under_coat(m, 1.0 - dielectric_reflectance(cos_i, m.ni), 1.0 - reflected, cos_i);
        value.pdf = (1.0 - coat_probability(m, reflected)) * cos_i * INVERSE_PI;
    }
    return value;
}

BsdfSample sample_plastic(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    vec3 n = mirroring_normal(surface, wo);
    float reflected = dielectric_reflectance(min(dot(n, wo), 1.0), m.ni);
    float probability = coat_probability(m, reflected);
    if (choice < probability) {
        vec3 weight = m.ks * (reflected / probability);
        return BsdfSample(reflect(-wo, n), weight, ONE_DIRECTION, BSDF_SPECULAR | BSDF_REFLECT, 1.0);
    }
    vec3 wi = sample_cosine(n, u);
    return sample_of(evaluate_plastic(m, surface, wo, wi), wi, BSDF_DIFFUSE | BSDF_REFLECT, 1.0);
}

BsdfValue evaluate_rough_coat(Material m, Microfacets facets, vec3 wi) {
    float alpha = table_alpha(facets.alpha);
    vec3 h = normalize(facets.wo + wi);
    float reflectance = dielectric_reflectance(min(dot(facets.wo, h), 1.0), m.ni);
    float out_share = table_at(m.detail.table, facets.wo.z, alpha);
    float in_share = table_at(m.detail.table, wi.z, alpha);
    vec3 f_cos = m.ks * (reflectance * facet_reflection(facets, wi, h));
    f_cos += base_under_coat(m, in_share, out_share, wi.z);
    float probability = coat_probability(m, 1.0 - out_share);
    return BsdfValue(f_cos, mix(wi.z * INVERSE_PI, reflection_pdf(facets, h), probability));
}

BsdfValue evaluate_rough_plastic(Material m, Surface surface, vec3 wo, vec3 wi) {
    Microfacets facets = microfacets_of(surface, m.detail, wo);
    vec3 local = to_facets(facets, wi);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (is_reflected(surface, wo, wi, local.z)) {
        value = evaluate_rough_coat(m, facets, local);
    }
    return value;
}

BsdfSample sample_rough_plastic(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    Microfacets facets = microfacets_of(surface, m.detail, wo);
    float out_share = table_at(m.detail.table, facets.wo.z, table_alpha(facets.alpha));
    bool by_coat = choice < coat_probability(m, 1.0 - out_share);
    vec3 local = sample_cosine(u);
    if (by_coat) {
        local = sample_reflection(facets, u);
    }
    vec3 wi = from_facets(facets, local);
    BsdfValue value = BsdfValue(vec3(0.0), 1.0);
    if (is_reflected(surface, wo, wi, local.z)) {
        value = evaluate_rough_coat(m, facets, local);
    }
    return sample_of(value, wi, BSDF_REFLECT | (by_coat ? BSDF_GLOSSY : BSDF_DIFFUSE), 1.0);
}

#endif
