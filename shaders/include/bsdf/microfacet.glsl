// Microfacets: rough surfaces whose facets are smooth, with normals of the GGX or the Beckmann distribution. (Walter et al.
// 2007, Microfacet Models for Refraction through Rough Surfaces) Masking and shadowing are Smith's, each by itself.
#ifndef MICROFACET_GLSL
#define MICROFACET_GLSL
#include "bsdf/fresnel.glsl"
#include "material.glsl"
#include "sampling.glsl"

// The microfacets of a surface, in a frame whose z axis is the shading normal on the side of `wo`.
struct Microfacets {
    vec3 tangent;
    vec3 bitangent;
    vec3 normal;
    vec2 alpha;  // widths along the tangent and across it
    vec3 wo;     // in the frame, above the horizon
    bool beckmann;
};

vec3 to_facets(Microfacets facets, vec3 direction) {
    return vec3(dot(direction, facets.tangent), dot(direction, facets.bitangent), dot(direction, facets.normal));
}

vec3 from_facets(Microfacets facets, vec3 direction) {
    return facets.tangent * direction.x + facets.bitangent * direction.y + facets.normal * direction.z;
}

Microfacets microfacets_of(Surface surface, MaterialDetail detail, vec3 wo) {
    Microfacets facets;
    facets.normal = mirroring_normal(surface, wo);
    facets.alpha = detail.alpha;
    facets.beckmann = HAS_BECKMANN && detail.beckmann;
    basis(facets.normal, facets.tangent, facets.bitangent);
    if (HAS_ANISOTROPY) {
        vec3 along = surface.along_u - dot(surface.along_u, facets.normal) * facets.normal;
        float len2 = dot(along, along);
        if (len2 > 0.0) {
            facets.tangent = along / sqrt(len2);
            facets.bitangent = cross(facets.normal, facets.tangent);
        }
    }
    facets.wo = to_facets(facets, wo);
    return facets;
}

// A vector's length when the facets are stretched to those of a sphere.
float stretched_length(vec3 v, vec2 alpha) { return length(vec3(alpha * v.xy, v.z)); }

// Density of facets with the normal m, over solid angle and projected area.
float facet_density(Microfacets facets, vec3 m) {
    vec2 slope = m.xy / facets.alpha;
    float area = facets.alpha.x * facets.alpha.y;
    if (HAS_BECKMANN && facets.beckmann) {
        float cos2 = m.z * m.z;
        return exponential(-dot(slope, slope) / max(cos2, 1e-12)) * INVERSE_PI / (area * max(cos2 * cos2, 1e-12));
    }
    float q = dot(slope, slope) + m.z * m.z;
    return INVERSE_PI / (area * (q * q));
}

// Share of the facets that a direction sees. (Smith 1967; of Beckmann's the rational approximation of Walter et al.)
float unmasked(Microfacets facets, vec3 v) {
    float cosine = abs(v.z);
    if (HAS_BECKMANN && facets.beckmann) {
        float a = cosine / max(length(facets.alpha * v.xy), 1e-12);
        float a2 = a * a;
        return a < 1.6 ? (3.535 * a + 2.181 * a2) / (1.0 + 2.276 * a + 2.577 * a2) : 1.0;
    }
    return 2.0 * cosine / (cosine + stretched_length(v, facets.alpha));
}

// How far down the caps of visible normals reach which reflect upwards. (Eto and Tokuyoshi 2023, Bounded VNDF Sampling for
// Smith-GGX Reflections)
float cap_bound(vec3 wo, vec2 alpha) {
    float a = min(min(alpha.x, alpha.y), 1.0);
    float a2 = a * a;
    float s = 1.0 + length(wo.xy);
    float s2 = s * s;
    return (1.0 - a2) * s2 / (s2 + a2 * (wo.z * wo.z));
}

// Pdf over solid angle of a reflected direction whose half vector is m.
float reflection_pdf(Microfacets facets, vec3 m) {
    vec3 wo = facets.wo;
    if (HAS_BECKMANN && facets.beckmann) {
        return facet_density(facets, m) * m.z / (4.0 * max(dot(wo, m), 1e-12));
    }
    return facet_density(facets, m) / (2.0 * (cap_bound(wo, facets.alpha) * wo.z + stretched_length(wo, facets.alpha)));
}

// Pdf of a facet's normal m as `sample_visible_normal` draws it without a bound.
float normal_pdf(Microfacets facets, vec3 m) {
    vec3 wo = facets.wo;
    if (HAS_BECKMANN && facets.beckmann) {
        return facet_density(facets, m) * m.z;
    }
    return 2.0 * facet_density(facets, m) * max(dot(wo, m), 0.0) / (wo.z + stretched_length(wo, facets.alpha));
}

// A normal of the facets that `wo` sees, below none of the cap's `bound`. (Dupuy and Benyoub 2023, Sampling Visible GGX
// Normals with Spherical Caps; a bound of 1 gives all) Of Beckmann's distribution it is any normal, seen or not.
vec3 sample_visible_normal(Microfacets facets, float bound, vec2 u) {
    if (HAS_BECKMANN && facets.beckmann) {
        vec2 slope = sqrt(-log_of_rest(u.x)) * facets.alpha * on_circle(u.y);
        return normalize(vec3(slope, 1.0));
    }
    vec3 stretched = normalize(vec3(facets.wo.xy * facets.alpha, facets.wo.z));
    float low = bound * stretched.z;
    float z = (1.0 - u.y) * (1.0 + low) - low;
    vec3 on_cap = vec3(sine_of(z) * on_circle(u.x), z);
    vec3 m = on_cap + stretched;
    return normalize(vec3(m.xy * facets.alpha, max(m.z, 0.0)));
}

// Draws a reflected direction, in the frame; below the horizon nothing is reflected.
vec3 sample_reflection(Microfacets facets, vec2 u) {
    vec3 m = sample_visible_normal(facets, cap_bound(facets.wo, facets.alpha), u);
    return 2.0 * dot(facets.wo, m) * m - facets.wo;
}

// Reflection by facets that reflect everything, f cos: D G / (4 cos_o), for a half vector m.
float facet_reflection(Microfacets facets, vec3 wi, vec3 m) {
    vec3 wo = facets.wo;
    float seen = facet_density(facets, m) * unmasked(facets, wi);
    if (HAS_BECKMANN && facets.beckmann) {
        return 0.25 * seen * unmasked(facets, wo) / wo.z;
    }
    return 0.5 * seen / (wo.z + stretched_length(wo, facets.alpha));
}

// Light that one scattering by facets of a reflectance loses, f cos, scattered diffusely: so much that facets which reflect
// everything lose nothing. `mean` is the reflectance's mean. (Kulla and Conty 2017, Revisiting Physically Based Shading)
vec3 lost_reflection(uint table, float alpha, float cos_o, float cos_i, vec3 mean) {
    float mean_lost = table_mean(table, alpha);
    vec3 between = mean * mean * (1.0 - mean_lost) / max(vec3(1.0) - mean * mean_lost, vec3(1e-6));
    float lost = table_at(table, cos_o, alpha) * table_at(table, cos_i, alpha) / max(mean_lost, 1e-9);
    return between * (lost * cos_i * INVERSE_PI);
}

// The roughness of a table's rows.
float table_alpha(vec2 alpha) { return sqrt(alpha.x * alpha.y); }

// Below that roughness facets lose light at grazing angles alone, and it is not made up for.
const float COMPENSATED_FROM = 0.01;

bool compensates(uint table, vec2 alpha) { return HAS_COMPENSATION && table != 0u && table_alpha(alpha) >= COMPENSATED_FROM; }

// Light that facets lose is drawn about as they lose it: its cosine's square x with a pdf in proportion to
// 1 / (alpha^2 + x), as masking by slopes of alpha grows towards the horizon.
float lost_spread(float alpha) { return logarithm(1.0 + 1.0 / (alpha * alpha)); }

vec3 sample_lost(float alpha, vec2 u) {
    float x = alpha * alpha * (exponential(u.x * lost_spread(alpha)) - 1.0);
    float cosine = sqrt(clamp(x, 0.0, 1.0));
    return vec3(sine_of(cosine) * on_circle(u.y), cosine);
}

float lost_pdf(float alpha, float cosine) {
    return cosine * INVERSE_PI / ((alpha * alpha + cosine * cosine) * lost_spread(alpha));
}

#endif
