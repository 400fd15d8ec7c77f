// Disney's BSDF of a thin sheet, which light passes unbent: microfacets that reflect and transmit, and diffuse reflection and
// transmission. It is alike on both sides. (Burley 2015, Extending the Disney BRDF to a BSDF with Integrated Subsurface
// Scattering; as Mitsuba's principledthin defines it)
#ifndef PRINCIPLED_THIN_GLSL
#define PRINCIPLED_THIN_GLSL
#include "bsdf/principled.glsl"

const uint PRINCIPLED_THIN_FLAGS = BSDF_DIFFUSE | BSDF_GLOSSY | BSDF_REFLECT | BSDF_TRANSMIT;

// Shares of the directions that are drawn from each component.
struct SheetShares {
    float reflection;
    float transmission;
    float diffuse;
    float diffuse_transmission;
};

// The sheet as a direction sees it.
struct PrincipledSheet {
    Microfacets facets;   // by which it reflects
    Microfacets through;  // by which it transmits: as wide as two refractions make the lobe
    SheetShares shares;
};

PrincipledSheet principled_sheet_of(Material m, Surface surface, vec3 wo) {
    MaterialDetail detail = m.detail;
    Principled p = detail.principled;
    PrincipledSheet sheet;
    float spread = 0.65 * m.ni - 0.35;
    detail.alpha = principled_alpha(m.detail.alpha.x, p.anisotropy);
    sheet.facets = microfacets_of(surface, detail, wo);
    sheet.through = sheet.facets;
    sheet.through.alpha = principled_alpha(m.detail.alpha.x * spread * spread, p.anisotropy);
    float cos_o = min(sheet.facets.wo.z, 1.0);
    float reflectance = dielectric_reflectance(cos_o, m.ni);
    SheetShares shares;
    shares.reflection = p.specular_share * mean3(tinted_reflectance(m, cos_o, reflectance));
    // At grazing angles the facets that are seen lean towards `wo`, and transmit more than a smooth sheet.
    shares.transmission = p.specular_share * max(1.0 - reflectance, 0.5) * mean3(m.kd);
    shares.diffuse = (1.0 - p.specular_share) * (1.0 - p.diffuse_transmission) * principled_brightness(m);
    shares.diffuse_transmission = (1.0 - p.specular_share) * p.diffuse_transmission * mean3(m.kd);
    float scale = 1.0 / (shares.reflection + shares.transmission + shares.diffuse + shares.diffuse_transmission + 1e-9);
    shares.reflection *= scale;
    shares.transmission *= scale;
    shares.diffuse *= scale;
    shares.diffuse_transmission *= scale;
    sheet.shares = shares;
    return sheet;
}

// `facet` mirrors `wo` to `wi`, or to what `wi` would be on the side of `wo`.
BsdfValue evaluate_sheet(Material m, PrincipledSheet sheet, vec3 wi, vec3 facet) {
    Principled p = m.detail.principled;
    vec3 wo = sheet.facets.wo;
    float cos_h = clamp(dot(wo, facet), 1e-12, 1.0);
    float cosine = min(abs(wi.z), 1.0);
    float reflectance = dielectric_reflectance(cos_h, m.ni);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (wi.z > 0.0) {
        vec3 diffuse = m.kd * principled_diffuse(m, min(wo.z, 1.0), cosine, cos_h) + principled_sheen(m, cosine, cos_h);
        value.f_cos = diffuse * ((1.0 - p.specular_share) * (1.0 - p.diffuse_transmission));
        value.f_cos += tinted_reflectance(m, cos_h, reflectance) * (p.specular_share * facet_reflection(sheet.facets, wi, facet));
        value.pdf = sheet.shares.diffuse * cosine * INVERSE_PI;
        value.pdf += sheet.shares.reflection * normal_pdf(sheet.facets, facet) / (4.0 * cos_h);
    } else {
        value.f_cos = m.kd * ((1.0 - p.specular_share) * p.diffuse_transmission * cosine * INVERSE_PI);
        value.pdf = sheet.shares.diffuse_transmission * cosine * INVERSE_PI;
        // A facet transmits to its other side.
        if (dot(wi, facet) < 0.0) {
            float through = facet_reflection(sheet.through, vec3(wi.xy, -wi.z), facet);
            value.f_cos += m.kd * (p.specular_share * (1.0 - reflectance) * through);
            value.pdf += sheet.shares.transmission * normal_pdf(sheet.through, facet) / (4.0 * cos_h);
        }
    }
    return value;
}

BsdfValue evaluate_principled_thin(Material m, Surface surface, vec3 wo, vec3 wi) {
    PrincipledSheet sheet = principled_sheet_of(m, surface, wo);
    vec3 local = to_facets(sheet.facets, wi);
    bool same_side = side_of(surface, wo) == side_of(surface, wi);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (local.z != 0.0 && (local.z > 0.0) == same_side) {
        value = evaluate_sheet(m, sheet, local, normalize(sheet.facets.wo + vec3(local.xy, abs(local.z))));
    }
    return value;
}

BsdfSample sample_principled_thin(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    PrincipledSheet sheet = principled_sheet_of(m, surface, wo);
    SheetShares shares = sheet.shares;
    vec3 out_direction = sheet.facets.wo;
    bool is_diffuse = !split_sample(choice, shares.diffuse + shares.diffuse_transmission);
    bool reflects = false;
    vec3 local = sample_cosine(u);
    vec3 facet = normalize(out_direction + local);
    if (is_diffuse) {
        reflects = choice * (shares.diffuse + shares.diffuse_transmission) < shares.diffuse;
    } else {
        reflects = choice * (shares.reflection + shares.transmission) < shares.reflection;
        Microfacets facets = sheet.through;
        if (reflects) {
            facets = sheet.facets;
        }
        facet = sample_visible_normal(facets, 1.0, u);
        local = 2.0 * dot(out_direction, facet) * facet - out_direction;
    }
    bool is_above = local.z > 0.0;
    local.z = reflects ? local.z : -local.z;
    vec3 wi = from_facets(sheet.facets, local);
    BsdfValue value = BsdfValue(vec3(0.0), 1.0);
    // The pdf knows of no facet that would transmit to its own side.
    bool passes = is_diffuse || reflects || dot(local, facet) < 0.0;
    if (is_above && passes && (side_of(surface, wo) == side_of(surface, wi)) == reflects) {
        value = evaluate_sheet(m, sheet, local, facet);
    }
    uint flags = (is_diffuse ? BSDF_DIFFUSE : BSDF_GLOSSY) | (reflects ? BSDF_REFLECT : BSDF_TRANSMIT);
    return sample_of(value, wi, flags, 1.0);
}

#endif
