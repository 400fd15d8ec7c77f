// A metal, smooth or with microfacets.
#ifndef CONDUCTOR_GLSL
#define CONDUCTOR_GLSL
#include "bsdf/microfacet.glsl"

const uint SMOOTH_CONDUCTOR_FLAGS = BSDF_SPECULAR | BSDF_REFLECT;
const uint CONDUCTOR_FLAGS = BSDF_GLOSSY | BSDF_REFLECT;

BsdfSample sample_smooth_conductor(Material m, Surface surface, vec3 wo) {
    vec3 n = mirroring_normal(surface, wo);
    vec3 weight = m.ks * metal_reflectance(min(dot(wo, n), 1.0), m.detail.eta, m.detail.absorption);
    return BsdfSample(reflect(-wo, n), weight, ONE_DIRECTION, BSDF_SPECULAR | BSDF_REFLECT, 1.0);
}

BsdfValue evaluate_facets_of_metal(Material m, Microfacets facets, vec3 wi) {
    vec3 h = normalize(facets.wo + wi);
    vec3 reflectance = m.ks * metal_reflectance(min(dot(facets.wo, h), 1.0), m.detail.eta, m.detail.absorption);
    vec3 f_cos = reflectance * facet_reflection(facets, wi, h);
    float pdf = reflection_pdf(facets, h);
    if (compensates(m.detail.table, facets.alpha)) {
        float alpha = table_alpha(facets.alpha);
        f_cos += lost_reflection(m.detail.table, alpha, facets.wo.z, wi.z, m.detail.mean_reflectance);
        pdf = mix(pdf, lost_pdf(alpha, wi.z), table_at(m.detail.table, facets.wo.z, alpha));
    }
    return BsdfValue(f_cos, pdf);
}

BsdfValue evaluate_conductor(Material m, Surface surface, vec3 wo, vec3 wi) {
    Microfacets facets = microfacets_of(surface, m.detail, wo);
    vec3 local = to_facets(facets, wi);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (is_reflected(surface, wo, wi, local.z)) {
        value = evaluate_facets_of_metal(m, facets, local);
    }
    return value;
}

BsdfSample sample_conductor(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    Microfacets facets = microfacets_of(surface, m.detail, wo);
    vec3 local = sample_reflection(facets, u);
    if (compensates(m.detail.table, facets.alpha)) {
        float alpha = table_alpha(facets.alpha);
        if (choice < table_at(m.detail.table, facets.wo.z, alpha)) {
            local = sample_lost(alpha, u);
        }
    }
    vec3 wi = from_facets(facets, local);
    BsdfValue value = BsdfValue(vec3(0.0), 1.0);
    if (is_reflected(surface, wo, wi, local.z)) {
        value = evaluate_facets_of_metal(m, facets, local);
    }
    return sample_of(value, wi, BSDF_GLOSSY | BSDF_REFLECT, 1.0);
}

#endif
