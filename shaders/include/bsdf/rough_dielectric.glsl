// A dielectric with microfacets, which reflect and transmit. (Walter et al. 2007)
#ifndef ROUGH_DIELECTRIC_GLSL
#define ROUGH_DIELECTRIC_GLSL
#include "bsdf/microfacet.glsl"

const uint ROUGH_DIELECTRIC_FLAGS = BSDF_GLOSSY | BSDF_REFLECT | BSDF_TRANSMIT;

// An interface as a direction sees it.
struct RoughInterface {
    Microfacets facets;
    float eta;         // the index beyond over the index before
    uint table;        // of the light that facets lose on this side; 0 where it is not made up for
    uint other_table;  // on the other side
};

RoughInterface rough_interface_of(Material m, Surface surface, vec3 wo) {
    bool outside = side_of(surface, wo) > 0.0;
    RoughInterface seen;
    seen.facets = microfacets_of(surface, m.detail, wo);
    seen.eta = outside ? m.ni : 1.0 / m.ni;
    seen.table = 0u;
    seen.other_table = 0u;
    if (compensates(m.detail.table, m.detail.alpha)) {
        uint inner = next_table(m.detail.table);
        seen.table = outside ? m.detail.table : inner;
        seen.other_table = outside ? inner : m.detail.table;
    }
    return seen;
}

// Share of the light that facets lose which leaves on the other side. The inside of a dense body loses more than its
// outside; it is what makes both directions of a path alike.
float lost_through(RoughInterface seen) {
    float alpha = table_alpha(seen.facets.alpha);
    float own = table_mean(seen.table, alpha);
    float other = table_mean(seen.other_table, alpha);
    // Of diffuse light as much gets in, by solid angle times index squared, as gets out.
    float through = 0.5 * min(1.0, seen.eta * seen.eta);
    return through * other / max(max(own, other), 1e-9);
}

// f cos and pdf of a direction beyond, by a facet m between it and `wo`. Radiance scales with the square of the index.
BsdfValue facet_transmission(Material m, RoughInterface seen, vec3 wi, vec3 facet) {
    vec3 wo = seen.facets.wo;
    float cos_o = dot(wo, facet);
    float cos_i = dot(wi, facet);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (cos_o > 0.0 && cos_i < 0.0) {
        float share = 1.0 - dielectric_reflectance(min(cos_o, 1.0), seen.eta);
        float sum = cos_o + seen.eta * cos_i;
        float spread = -cos_i * seen.eta * seen.eta / max(sum * sum, 1e-16);
        Microfacets facets = seen.facets;
        value.pdf = share * normal_pdf(facets, facet) * spread;
        float seen_both = unmasked(facets, wo) * unmasked(facets, wi) * facet_density(facets, facet) * cos_o / wo.z;
        value.f_cos = m.tf * (share * seen_both * spread / (seen.eta * seen.eta));
    }
    return value;
}

BsdfValue evaluate_rough_interface(Material m, RoughInterface seen, vec3 wi, vec3 facet) {
    Microfacets facets = seen.facets;
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (wi.z > 0.0) {
        float cos_o = max(dot(facets.wo, facet), 1e-12);
        float share = dielectric_reflectance(min(cos_o, 1.0), seen.eta);
        value.f_cos = vec3(share * facet_reflection(facets, wi, facet));
        value.pdf = share * normal_pdf(facets, facet) / (4.0 * cos_o);
    } else {
        value = facet_transmission(m, seen, wi, facet);
    }
    if (HAS_COMPENSATION && seen.table != 0u) {
        float alpha = table_alpha(facets.alpha);
        float lost = table_at(seen.table, facets.wo.z, alpha);
        float through = lost_through(seen);
        float cosine = abs(wi.z);
        bool back = wi.z > 0.0;
        uint table = back ? seen.table : seen.other_table;
        float share = back ? 1.0 - through : through;
        float spread = table_at(table, cosine, alpha) / max(table_mean(table, alpha), 1e-9);
        vec3 tint = back ? vec3(1.0) : m.tf / (seen.eta * seen.eta);
        value.f_cos += tint * (share * lost * spread * cosine * INVERSE_PI);
        value.pdf = mix(value.pdf, share * lost_pdf(alpha, cosine), lost);
    }
    return value;
}

// The normal of the facet by which light gets from `wi` to `wo`.
vec3 facet_between(RoughInterface seen, vec3 wi) {
    vec3 h = seen.facets.wo + wi * (wi.z > 0.0 ? 1.0 : seen.eta);
    h = normalize(h);
    return h.z < 0.0 ? -h : h;
}

BsdfValue evaluate_rough_dielectric(Material m, Surface surface, vec3 wo, vec3 wi) {
    RoughInterface seen = rough_interface_of(m, surface, wo);
    vec3 local = to_facets(seen.facets, wi);
    bool same_side = side_of(surface, wo) == side_of(surface, wi);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (local.z != 0.0 && (local.z > 0.0) == same_side) {
        value = evaluate_rough_interface(m, seen, local, facet_between(seen, local));
    }
    return value;
}

// Where a facet refracts `wo`, by its cosine at the facet.
vec3 refracted_at(RoughInterface seen, vec3 facet, float cos_o) {
    float squared = (seen.eta - 1.0) * (seen.eta + 1.0) + cos_o * cos_o;
    vec3 refracted = facet * ((cos_o - sqrt(max(squared, 0.0))) / seen.eta) - seen.facets.wo / seen.eta;
    return normalize(refracted);
}

BsdfSample sample_rough_dielectric(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    RoughInterface seen = rough_interface_of(m, surface, wo);
    vec3 out_direction = seen.facets.wo;
    vec3 facet = sample_visible_normal(seen.facets, 1.0, u);
    float cos_o = min(dot(out_direction, facet), 1.0);
    bool by_facet = true;
    if (HAS_COMPENSATION && seen.table != 0u) {
        by_facet = split_sample(choice, table_at(seen.table, out_direction.z, table_alpha(seen.facets.alpha)));
    }
    bool reflects = choice < dielectric_reflectance(cos_o, seen.eta);
    vec3 local = reflects ? 2.0 * cos_o * facet - out_direction : refracted_at(seen, facet, cos_o);
    if (HAS_COMPENSATION && !by_facet) {
        reflects = choice >= lost_through(seen);
        local = sample_lost(table_alpha(seen.facets.alpha), u);
        local.z = reflects ? local.z : -local.z;
        facet = facet_between(seen, local);
    }
    vec3 wi = from_facets(seen.facets, local);
    bool same_side = side_of(surface, wo) == side_of(surface, wi);
    BsdfValue value = BsdfValue(vec3(0.0), 1.0);
    // Rounding of a grazing direction, or a bent normal, may put it on the wrong side.
    if (local.z != 0.0 && (local.z > 0.0) == reflects && same_side == reflects) {
        value = evaluate_rough_interface(m, seen, local, facet);
    }
    float eta = side_of(surface, wi) < 0.0 ? m.ni : 1.0;
    return sample_of(value, wi, BSDF_GLOSSY | (reflects ? BSDF_REFLECT : BSDF_TRANSMIT), eta);
}

#endif
