// Disney's BSDF of a body: diffuse with sheen, microfacets, a clear coat, and refraction by a share. (Burley 2012,
// Physically Based Shading at Disney; 2015, Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering; as
// Mitsuba's principled defines it)
#ifndef PRINCIPLED_GLSL
#define PRINCIPLED_GLSL
#include "bsdf/rough_dielectric.glsl"

// Only what light gets into transmits, so that other materials gather light from one side.
uint principled_flags(Material m) {
    uint transmits = m.detail.transmits ? BSDF_TRANSMIT : 0u;
    return BSDF_DIFFUSE | BSDF_GLOSSY | BSDF_REFLECT | transmits;
}

// How much of its rise from normal to grazing incidence a reflectance has made. (Schlick 1994)
float rise_at(float cosine) {
    float rest = 1.0 - min(cosine, 1.0);
    float rest2 = rest * rest;
    return rest2 * rest2 * rest;
}

// A colour at a luminance of 1.
vec3 hue_of(vec3 colour) {
    float luminance = dot(colour, vec3(0.212671, 0.715160, 0.072169));
    return luminance > 0.0 ? colour / luminance : vec3(1.0);
}

// Widths of microfacets by the square of a roughness.
vec2 principled_alpha(float alpha, float anisotropy) {
    float aspect = sqrt(1.0 - 0.9 * anisotropy);
    return max(vec2(alpha / aspect, alpha * aspect), vec2(0.001));
}

// Reflectance of the interface, which the base colour may tint.
vec3 tinted_reflectance(Material m, float cosine, float reflectance) {
    float root = (m.ni - 1.0) / (m.ni + 1.0);
    vec3 tinted = schlick_reflectance(cosine, hue_of(m.kd) * (root * root));
    return mix(vec3(reflectance), tinted, m.detail.principled.specular_tint);
}

// f cos of a white body by the cosine of half the angle between both directions: diffuse, brighter along both horizons if
// it is rough, or as light from below the surface would be.
float principled_diffuse(Material m, float cos_o, float cos_i, float cos_h) {
    float rise_o = rise_at(cos_o);
    float rise_i = rise_at(cos_i);
    float retro = 2.0 * sqrt(m.detail.alpha.x) * cos_h * cos_h;
    float on_surface = (1.0 - 0.5 * rise_o) * (1.0 - 0.5 * rise_i) + retro * (rise_o + rise_i + rise_o * rise_i * (retro - 1.0));
    float flattened = mix(1.0, 0.5 * retro, rise_o) * mix(1.0, 0.5 * retro, rise_i);
    float below = 1.25 * (flattened * (1.0 / (cos_o + cos_i) - 0.5) + 0.5);
    return mix(on_surface, below, m.detail.principled.flatness) * cos_i * INVERSE_PI;
}

// f cos of the sheen.
vec3 principled_sheen(Material m, float cos_i, float cos_h) {
    vec3 tint = mix(vec3(1.0), hue_of(m.kd), m.detail.principled.sheen_tint);
    return tint * (m.detail.principled.sheen * rise_at(cos_h) * cos_i);
}

// What of the light the diffuse part and the sheen send back, roughly.
float principled_brightness(Material m) { return mean3(m.kd) + 0.25 * m.detail.principled.sheen; }

// Facets of the coat have long tails: a generalised Trowbridge-Reitz distribution of exponent 1. (Burley 2012, B.2)
float coat_width(Material m) { return min(m.detail.coat_alpha, 0.99); }

float coat_density(float alpha, vec3 facet) {
    float a2 = alpha * alpha;
    return (a2 - 1.0) * INVERSE_PI / (logarithm(a2) * (dot(facet.xy, facet.xy) + a2 * facet.z * facet.z));
}

vec3 sample_coat_normal(float alpha, vec2 u) {
    float a2 = alpha * alpha;
    float sine2 = clamp((exponential((1.0 - u.x) * logarithm(a2)) - a2) / (1.0 - a2), 0.0, 1.0);
    return vec3(sqrt(sine2) * on_circle(u.y), sqrt(1.0 - sine2));
}

// Masking by facets as wide as those of no coat: the width is the same for all.
float coat_unmasked(vec3 v) { return 2.0 * v.z / (v.z + stretched_length(v, vec2(0.25))); }

// The body as a direction sees it.
struct PrincipledBody {
    RoughInterface seen;
    bool inside;
    float dielectric;     // share of what is no metal
    float glass;          // share of what refracts
    float diffuse_share;  // of directions that are drawn
    float coat_share;
    float facets_share;
};

// Reflectance at a facet.
vec3 principled_reflectance(Material m, PrincipledBody body, float cosine) {
    float reflectance = dielectric_reflectance(cosine, body.seen.eta);
    vec3 outside = mix(tinted_reflectance(m, cosine, reflectance), schlick_reflectance(cosine, m.kd), m.detail.metalness);
    return body.inside ? vec3(body.glass * reflectance) : outside;
}

// Probability that light which meets a facet is drawn to be reflected.
float reflection_probability(PrincipledBody body, float cosine) {
    float reflectance = dielectric_reflectance(cosine, body.seen.eta);
    return body.inside ? reflectance : 1.0 - body.glass * (1.0 - reflectance);
}

PrincipledBody principled_of(Material m, Surface surface, vec3 wo) {
    MaterialDetail detail = m.detail;
    detail.alpha = principled_alpha(detail.alpha.x, detail.principled.anisotropy);
    PrincipledBody body;
    // What no light gets into is alike from both sides.
    body.inside = detail.transmits && side_of(surface, wo) < 0.0;
    body.seen.facets = microfacets_of(surface, detail, wo);
    body.seen.eta = body.inside ? 1.0 / m.ni : m.ni;
    body.seen.table = 0u;
    body.seen.other_table = 0u;
    body.dielectric = 1.0 - detail.metalness;
    body.glass = body.dielectric * detail.principled.specular_share;
    body.diffuse_share = 0.0;
    body.coat_share = 0.0;
    if (!body.inside) {
        float cos_o = min(body.seen.facets.wo.z, 1.0);
        float facets = mean3(principled_reflectance(m, body, cos_o)) + body.glass;
        float coat = detail.coat * (0.04 + 0.96 * rise_at(cos_o));
        float diffuse = body.dielectric * principled_brightness(m);
        float sum = facets + coat + diffuse + 1e-9;
        body.diffuse_share = diffuse / sum;
        body.coat_share = coat / sum;
    }
    body.facets_share = max(1.0 - body.diffuse_share - body.coat_share, 0.0);
    return body;
}

BsdfValue evaluate_body(Material m, PrincipledBody body, vec3 wi, vec3 facet) {
    Microfacets facets = body.seen.facets;
    vec3 wo = facets.wo;
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (wi.z <= 0.0) {
        m.tf = body.glass * vec3(sqrt(m.kd.r), sqrt(m.kd.g), sqrt(m.kd.b));
        value = facet_transmission(m, body.seen, wi, facet);
        value.pdf *= body.inside ? 1.0 : body.glass * body.facets_share;
        return value;
    }
    float cos_h = clamp(dot(wo, facet), 1e-12, 1.0);
    value.f_cos = principled_reflectance(m, body, cos_h) * facet_reflection(facets, wi, facet);
    value.pdf = body.facets_share * reflection_probability(body, cos_h) * normal_pdf(facets, facet) / (4.0 * cos_h);
    if (!body.inside) {
        float diffuse = principled_diffuse(m, min(wo.z, 1.0), min(wi.z, 1.0), cos_h);
        value.f_cos += m.kd * ((body.dielectric - body.glass) * diffuse);
        value.f_cos += body.dielectric * principled_sheen(m, wi.z, cos_h);
        float density = coat_density(coat_width(m), facet);
        float seen = density * coat_unmasked(wo) * coat_unmasked(wi);
        value.f_cos += 0.25 * m.detail.coat * (0.04 + 0.96 * rise_at(cos_h)) * seen * wi.z;
        value.pdf += body.diffuse_share * wi.z * INVERSE_PI + body.coat_share * density * facet.z / (4.0 * cos_h);
    }
    return value;
}

BsdfValue evaluate_principled(Material m, Surface surface, vec3 wo, vec3 wi) {
    PrincipledBody body = principled_of(m, surface, wo);
    vec3 local = to_facets(body.seen.facets, wi);
    bool same_side = side_of(surface, wo) == side_of(surface, wi);
    BsdfValue value = BsdfValue(vec3(0.0), 0.0);
    if (local.z != 0.0 && (local.z > 0.0) == same_side && (same_side || m.detail.transmits)) {
        value = evaluate_body(m, body, local, facet_between(body.seen, local));
    }
    return value;
}

BsdfSample sample_principled(Material m, Surface surface, vec3 wo, float choice, vec2 u) {
    PrincipledBody body = principled_of(m, surface, wo);
    vec3 out_direction = body.seen.facets.wo;
    bool reflects = true;
    bool is_diffuse = !split_sample(choice, body.diffuse_share);
    vec3 local = sample_cosine(u);
    vec3 facet = vec3(0.0, 0.0, 1.0);
    if (is_diffuse) {
        facet = facet_between(body.seen, local);
    } else {
        bool by_coat = !split_sample(choice, body.coat_share / max(1.0 - body.diffuse_share, 1e-9));
        if (by_coat) {
            facet = sample_coat_normal(coat_width(m), u);
        } else {
            facet = sample_visible_normal(body.seen.facets, 1.0, u);
        }
        float cos_o = min(dot(out_direction, facet), 1.0);
        reflects = by_coat || choice < reflection_probability(body, max(cos_o, 0.0));
        local = reflects ? 2.0 * cos_o * facet - out_direction : refracted_at(body.seen, facet, cos_o);
    }
    vec3 wi = from_facets(body.seen.facets, local);
    bool same_side = side_of(surface, wo) == side_of(surface, wi);
    BsdfValue value = BsdfValue(vec3(0.0), 1.0);
    if (local.z != 0.0 && (local.z > 0.0) == reflects && same_side == reflects) {
        value = evaluate_body(m, body, local, facet);
    }
    float eta = m.detail.transmits && side_of(surface, wi) < 0.0 ? m.ni : 1.0;
    uint flags = (is_diffuse ? BSDF_DIFFUSE : BSDF_GLOSSY) | (reflects ? BSDF_REFLECT : BSDF_TRANSMIT);
    return sample_of(value, wi, flags, eta);
}

#endif
