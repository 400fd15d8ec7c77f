//! Disney's BSDF of a body and of a thin sheet. (Burley 2012, Physically Based Shading at Disney; 2015, Extending the Disney
//! BRDF to a BSDF with Integrated Subsurface Scattering; both as Mitsuba has them)

use std::f64::consts::FRAC_1_PI;

use glam::{DVec2, DVec3};

use super::microfacets::Facets;
use super::optics::reflectance;
use raywave::scene::{Material, Surface};

/// Widths of the facets of a roughness.
pub fn facets(roughness: f64, anisotropy: f64) -> Facets {
    let aspect = (1.0 - 0.9 * anisotropy).sqrt();
    let alpha = (roughness * roughness * DVec2::new(1.0 / aspect, aspect)).max(DVec2::splat(0.001));
    Facets { alpha, is_beckmann: false }
}

/// The facets by which a sheet transmits: as wide as two refractions make the lobe.
pub fn facets_through(material: &Material) -> Facets {
    let roughness = f64::from(material.roughness.x).sqrt();
    facets((0.65 * f64::from(material.ior) - 0.35) * roughness, material.principled.anisotropy.into())
}

/// Width of the distribution of the coat's facets.
pub fn coat_width(material: &Material) -> f64 {
    f64::from(material.coat_roughness).clamp(1e-6, 0.99)
}

/// f cos of Disney's BSDF of a body or of a thin sheet. Directions are in the frame of its facets, and `wo` is above the
/// horizon; `is_front` says whether that is outside. (Burley 2012, Physically Based Shading at Disney; 2015, Extending the
/// Disney BRDF to a BSDF with Integrated Subsurface Scattering; both as Mitsuba has them)
pub fn value(material: &Material, wo: DVec3, wi: DVec3, is_front: bool) -> DVec3 {
    let colour = material.diffuse.as_dvec3();
    let [sheen, sheen_tint, specular_tint, share, flatness, anisotropy] = [
        material.principled.sheen,
        material.principled.sheen_tint,
        material.principled.specular_tint,
        material.principled.specular_share,
        material.principled.flatness,
        material.principled.anisotropy,
    ]
    .map(f64::from);
    let (metal, eta) = (f64::from(material.metalness), f64::from(material.ior));
    let is_thin = material.surface == Surface::PrincipledThin;
    let is_inside = material.has_inside() && !is_front;
    let roughness = f64::from(material.roughness.x).sqrt();
    let schlick = |normal: DVec3, cosine: f64| normal + (1.0 - normal) * (1.0 - cosine).powi(5);
    let luminance = colour.dot(DVec3::new(0.212671, 0.715160, 0.072169));
    let hue = if luminance > 0.0 { colour / luminance } else { DVec3::ONE };
    let tinted = |cosine: f64| {
        let normal = hue * ((eta - 1.0) / (eta + 1.0)).powi(2);
        DVec3::splat(reflectance(cosine, eta)).lerp(schlick(normal, cosine), specular_tint)
    };
    let own = facets(roughness, anisotropy);
    let diffuse = |h: DVec3| {
        let (o, i, d) = ((1.0 - wo.z).powi(5), (1.0 - wi.z).powi(5), wo.dot(h));
        // Burley's factor of 2012, with F_D90.
        let grazing = 0.5 + 2.0 * roughness * d * d;
        let plain = (1.0 + (grazing - 1.0) * o) * (1.0 + (grazing - 1.0) * i);
        let below = roughness * d * d;
        let both = (1.0 + (below - 1.0) * o) * (1.0 + (below - 1.0) * i);
        let subsurface = 1.25 * (both * (1.0 / (wo.z + wi.z) - 0.5) + 0.5);
        let body = colour * FRAC_1_PI * (plain + flatness * (subsurface - plain));
        let cloth = DVec3::ONE.lerp(hue, sheen_tint) * sheen * (1.0 - d).powi(5);
        (body * wi.z, cloth * wi.z)
    };
    if is_thin {
        let through = f64::from(material.principled.diffuse_transmission);
        let flat = DVec3::new(wi.x, wi.y, wi.z.abs());
        let h = (wo + flat).normalize();
        if wi.z > 0.0 {
            let (body, cloth) = diffuse(h);
            return (1.0 - share) * (1.0 - through) * (body + cloth) + share * tinted(wo.dot(h)) * own.mirrored(wo, wi);
        }
        let passes = if wi.dot(h) < 0.0 { 1.0 - reflectance(wo.dot(h), eta) } else { 0.0 };
        let passed = facets_through(material).mirrored(wo, flat);
        return colour * ((1.0 - share) * through * -wi.z * FRAC_1_PI + share * passes * passed);
    }
    let glass = (1.0 - metal) * share;
    if wi.z < 0.0 {
        // Of a dielectric with microfacets, tinted by the root of the colour: light passes the surface twice. Radiance scales
        // with the square of the index.
        let tint = DVec3::from(colour.to_array().map(f64::sqrt));
        let index = if is_inside { 1.0 / eta } else { eta };
        if !material.has_inside() {
            return DVec3::ZERO;
        }
        let passes = 1.0 - reflectance(wo.dot(Facets::between(wo, wi, index)).max(0.0), index);
        return glass * tint * passes * own.refracted(wo, wi, index) / (index * index);
    }
    let h = (wo + wi).normalize();
    let d = wo.dot(h);
    let shape = own.mirrored(wo, wi);
    if is_inside {
        return DVec3::splat(glass * reflectance(d, 1.0 / eta) * shape);
    }
    let (body, cloth) = diffuse(h);
    let width = coat_width(material);
    let square = width * width;
    let long_tails = (square - 1.0) * FRAC_1_PI / (square.ln() * (1.0 + (square - 1.0) * h.z * h.z));
    let masking = Facets::round(0.25).unmasked(wo) * Facets::round(0.25).unmasked(wi);
    let coat = 0.25 * f64::from(material.coat) * schlick(DVec3::splat(0.04), d) * long_tails * masking * wi.z;
    tinted(d).lerp(schlick(colour, d), metal) * shape
        + (1.0 - metal) * ((1.0 - share) * body + cloth)
        + if material.coat > 0.0 { coat } else { DVec3::ZERO }
}
