// glTF's mixture of a metal and of a diffuse body under a dielectric interface, perhaps under a clear coat. (Khronos, glTF
// 2.0, appendix B, and KHR_materials_ior, _specular and _clearcoat) What passes an interface is weighed on its way in and
// out, so that no more comes back than arrived. (Ashikhmin and Shirley 2000, An Anisotropic Phong BRDF Model)
#ifndef METAL_ROUGH_GLSL
#define METAL_ROUGH_GLSL
#include "bsdf/microfacet.glsl"

const uint METAL_ROUGH_FLAGS = BSDF_DIFFUSE | BSDF_GLOSSY | BSDF_REFLECT;

// Shares of the directions that are drawn from the coat, from the facets below it, and for the light that those lose.
struct MetalRoughShares {
    float coat;
    float facets;
    float lost;
};

// The mixture as a direction sees it.
struct MetalRough {
    Microfacets facets;
    Microfacets coat_facets;
    vec3 at_normal;  // reflectance of the facets at normal incidence
    vec3 of_body;    // of those over the diffuse body
    vec3 diffuse;
    float coat;
    uint table;
    MetalRoughShares shares;
};

// Reflectance of the clear coat, whose index is 1.5.
float coat_reflectance(float cosine) { return schlick_reflectance(cosine, vec3(0.04)).x; }

MetalRough metal_rough_of(Material m, Surface surface, vec3 wo) {
    MetalRough mixture;
    mixture.facets = microfacets_of(surface, m.detail, wo);
    float root = (m.ni - 1.0) / (m.ni + 1.0);
    mixture.of_body = min(m.ks * (root * root), vec3(1.0));
    mixture.at_normal = mix(mixture.of_body, m.kd, m.detail.metalness);
    mixture.diffuse = m.kd * (1.0 - m.detail.metalness);
    mixture.coat = 0.0;
    mixture.table = compensates(m.detail.table, m.detail.alpha) ? m.detail.table : 0u;
    float cos_o = mixture.facets.wo.z;
    float seen = mean3(schlick_reflectance(min(cos_o, 1.0), mixture.at_normal));
    float below = mean3(mixture.diffuse) * (1.0 - seen);
    float facets = seen / max(seen + below, 1e-9);
    mixture.shares = MetalRoughShares(0.0, facets, 0.0);
    if (HAS_COMPENSATION && mixture.table != 0u) {
        float lost = table_at(mixture.table, cos_o, table_alpha(m.detail.alpha));
        mixture.shares.lost = facets * lost;
        mixture.shares.facets = facets * (1.0 - lost);
    }
    if (HAS_COAT) {
        mixture.coat = m.detail.coat;
        mixture.coat_facets = mixture.facets;
        mixture.coat_facets.alpha = vec2(m.detail.coat_alpha);
        float reflected = m.detail.coat * coat_reflectance(min(cos_o, 1.0));
        mixture.shares.coat = reflected / (reflected + (1.0 - reflected) * (seen + below) + 1e-9);
        mixture.shares.facets *= 1.0 - mixture.shares.coat;
        mixture.shares.lost *= 1.0 - mixture.shares.coat;
    }
    return mixture;
}

BsdfValue evaluate_mixture(MetalRough mixture, vec3 wi) {
    Microfacets facets = mixture.facets;
    MetalRoughShares shares = mixture.shares;
    vec3 h = normalize(facets.wo + wi);
    float cos_h = min(dot(facets.wo, h), 1.0);
    vec3 reflectance = schlick_reflectance(cos_h, mixture.at_normal);
    float diffuse = wi.z * INVERSE_PI;
    vec3 f_cos = reflectance * facet_reflection(facets, wi, h);
    // The mean of Schlick's reflectance is its value at normal incidence and a 21st of the rest.
    vec3 out_share = 1.0 - schlick_reflectance(min(facets.wo.z, 1.0), mixture.of_body);
    vec3 in_share = 1.0 - schlick_reflectance(min(wi.z, 1.0), mixture.of_body);
    vec3 mean_share = max((1.0 - mixture.of_body) * (20.0 / 21.0), vec3(1e-6));
    f_cos += mixture.diffuse * (out_share * in_share / mean_share) * diffuse;
    float rest = max(1.0 - shares.coat - shares.facets - shares.lost, 0.0);
    float pdf = shares.facets * reflection_pdf(facets, h) + rest * diffuse;
    if (HAS_COMPENSATION && mixture.table != 0u) {
        vec3 mean = mixture.at_normal + (1.0 - mixture.at_normal) * (1.0 / 21.0);
        float alpha = table_alpha(facets.alpha);
        f_cos += lost_reflection(mixture.table, alpha, facets.wo.z, wi.z, mean);
        pdf += shares.lost * lost_pdf(alpha, wi.z);
    }
    if (HAS_COAT) {
        float through_out = 1.0 - mixture.coat * coat_reflectance(min(facets.wo.z, 1.0));
        float through_in = 1.0 - mixture.coat * coat_reflectance(min(wi.z, 1.0));
        f_cos *= through_out * through_in;
        f_cos += mixture.coat * coat_reflectance(cos_h) * facet_reflection(mixture.coat_facets, wi, h);
        pdf += shares.coat * reflection_pdf(mixture.coat_facets, h);
    }
    return BsdfValue(f_cos, pdf);
}

BsdfValue evaluate_metal_rough(Material m, Surface surface, vec3 wo, vec3 wi) {
    MetalRough mixture = metal_rough_of(m, surface, wo);
    vec3 local = to_facets(mixture.facets, wi);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (is_reflected(surface, wo, wi, local.z)) {
        value = evaluate_mixture(mixture, local);
    }
    return value;
}

BsdfSample sample_metal_rough(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    MetalRough mixture = metal_rough_of(m, surface, wo);
    MetalRoughShares shares = mixture.shares;
    bool by_coat = HAS_COAT && choice < shares.coat;
    bool by_facets = by_coat || choice < shares.coat + shares.facets;
    vec3 local = sample_cosine(u);
    if (by_facets) {
        Microfacets facets = mixture.facets;
        if (by_coat) {
            facets = mixture.coat_facets;
        }
        local = sample_reflection(facets, u);
    } else if (HAS_COMPENSATION && choice < shares.coat + shares.facets + shares.lost) {
        local = sample_lost(table_alpha(mixture.facets.alpha), u);
    }
    vec3 wi = from_facets(mixture.facets, local);
    BsdfValue value = BsdfValue(vec3(0.0), 1.0);
    if (is_reflected(surface, wo, wi, local.z)) {
        value = evaluate_mixture(mixture, local);
    }
    return sample_of(value, wi, BSDF_REFLECT | (by_facets ? BSDF_GLOSSY : BSDF_DIFFUSE), 1.0);
}

#endif
