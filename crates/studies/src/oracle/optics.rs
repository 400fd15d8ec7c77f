//! What the material functions should compute, in f64 and from the textbook.

use std::f64::consts::{FRAC_1_PI, TAU};

use glam::{DVec2, DVec3};
use raywave::scene::{Material, Surface};

/// The mirror direction of `wo`.
pub fn mirrored(n: DVec3, wo: DVec3) -> DVec3 {
    2.0 * n.dot(wo) * n - wo
}

/// Pdf of the Phong lobe, over all directions.
pub fn phong_lobe(m: &Material, n: DVec3, wo: DVec3, wi: DVec3) -> f64 {
    let cosine = mirrored(n, wo).dot(wi);
    let ns = f64::from(m.exponent);
    if cosine > 0.0 { (ns + 1.0) / TAU * cosine.powf(ns) } else { 0.0 }
}

/// Pdf of the Lambert lobe, over all directions.
pub fn lambert_lobe(n: DVec3, wi: DVec3) -> f64 {
    n.dot(wi).max(0.0) * FRAC_1_PI
}

/// Probability with which a sample of a Phong BRDF (Lambert plus lobe) comes from its lobe.
pub fn phong_share(m: &Material) -> f64 {
    let (kd, ks) = (m.diffuse.as_dvec3().element_sum(), m.specular.as_dvec3().element_sum());
    if ks > 0.0 { ks / (kd + ks) } else { 0.0 }
}

/// Pdf of the directions that a Phong BRDF samples, including those below the horizon.
pub fn scatter_density(m: &Material, n: DVec3, wo: DVec3, wi: DVec3) -> f64 {
    let share = phong_share(m);
    share * phong_lobe(m, n, wo, wi) + (1.0 - share) * lambert_lobe(n, wi)
}

/// f cos of a Phong BRDF, above the horizon of `n`.
pub fn glossy(m: &Material, n: DVec3, wo: DVec3, wi: DVec3) -> DVec3 {
    let f = m.diffuse.as_dvec3() * FRAC_1_PI + m.specular.as_dvec3() * phong_lobe(m, n, wo, wi);
    f * n.dot(wi).max(0.0)
}

/// Cosine beyond an interface by Snell's law; `None` under total internal reflection. `eta` is
/// the index beyond over the index before.
pub fn refracted_cosine(cosine: f64, eta: f64) -> Option<f64> {
    // As a sum of small numbers, for indices that are close and for grazing angles.
    let square = ((eta - 1.0) * (eta + 1.0) + cosine * cosine) / (eta * eta);
    (square > 0.0).then(|| square.sqrt())
}

/// Reflectance of unpolarised light. (Fresnel 1823)
pub fn reflectance(cosine: f64, eta: f64) -> f64 {
    let Some(beyond) = refracted_cosine(cosine, eta) else { return 1.0 };
    let perpendicular = (cosine - eta * beyond) / (cosine + eta * beyond);
    let parallel = (eta * cosine - beyond) / (eta * cosine + beyond);
    0.5 * (perpendicular * perpendicular + parallel * parallel)
}

/// Whether the BSDF has one direction, or two, for each other.
pub fn is_specular(material: &Material) -> bool {
    material.surface != Surface::Glossy
}

/// f cos and pdf of a BSDF that is not specular, for a pair of directions.
pub fn evaluate(material: &Material, n: DVec3, wo: DVec3, wi: DVec3) -> (DVec3, f64) {
    (glossy(material, n, wo, wi), scatter_density(material, n, wo, wi))
}

/// A direction and f cos / pdf, at a surface whose front `wo` is on or not. `choice` picks what is specular, `u` a direction.
pub fn scatter(material: &Material, normal: DVec3, wo: DVec3, is_front: bool, choice: f64, u: DVec2) -> (DVec3, DVec3) {
    let mirrored = mirrored(normal, wo);
    match material.surface {
        Surface::Glossy => {
            // The remapped number gives the direction.
            let (by_lobe, x) = falls_below(u.x, phong_share(material));
            let (axis, exponent) = if by_lobe { (mirrored, f64::from(material.exponent)) } else { (normal, 1.0) };
            let wi = cosine_power(axis, exponent, DVec2::new(x, u.y));
            let weight = glossy(material, normal, wo, wi) / scatter_density(material, normal, wo, wi);
            (wi, weight)
        }
        Surface::Mirror => (mirrored, material.specular.as_dvec3()),
        Surface::Refractive | Surface::Dielectric => {
            let index = f64::from(material.ior);
            let eta = if is_front { index } else { 1.0 / index };
            let cosine = wo.dot(normal);
            let Some(beyond) = refracted_cosine(cosine, eta) else { return (mirrored, DVec3::ONE) };
            if material.surface == Surface::Dielectric && choice < reflectance(cosine, eta) {
                return (mirrored, DVec3::ONE);
            }
            let refracted = (cosine / eta - beyond) * normal - wo / eta;
            // Radiance scales with the square of the index.
            (refracted.normalize(), material.transmission.as_dvec3() / (eta * eta))
        }
        other => unreachable!("no path of the reference meets {other:?}"),
    }
}

/// Density of GGX facets with a normal in their frame, over solid angle and projected area. (Walter et al. 2007, eq. 33, for
/// widths along x and across it)
pub fn ggx(m: DVec3, alpha: DVec2) -> f64 {
    let (slope_x, slope_y) = (m.x / m.z / alpha.x, m.y / m.z / alpha.y);
    let cosine4 = m.z.powi(4);
    FRAC_1_PI / (alpha.x * alpha.y * cosine4 * (1.0 + slope_x * slope_x + slope_y * slope_y).powi(2))
}

/// Share of GGX facets that a direction of their frame sees. (The same, eq. 34)
pub fn unmasked(v: DVec3, alpha: DVec2) -> f64 {
    let tangent2 = ((v.x * alpha.x).powi(2) + (v.y * alpha.y).powi(2)) / (v.z * v.z);
    2.0 / (1.0 + (1.0 + tangent2).sqrt())
}

/// Reflectance of a metal for unpolarised light, by complex amplitudes. (Fresnel 1823, with a complex index)
pub fn metal_reflectance(cosine: f64, eta: f64, k: f64) -> f64 {
    // n cos t, the root of n^2 - sin^2 i, and n^2.
    let square = (eta * eta - k * k, 2.0 * eta * k);
    let (re, im) = (square.0 - (1.0 - cosine * cosine), square.1);
    let length = re.hypot(im);
    let root = ((0.5 * (length + re)).max(0.0).sqrt(), (0.5 * (length - re)).max(0.0).sqrt());
    let perpendicular = ((cosine - root.0).powi(2) + root.1 * root.1) / ((cosine + root.0).powi(2) + root.1 * root.1);
    let scaled = (square.0 * cosine, square.1 * cosine);
    let minus = (scaled.0 - root.0).powi(2) + (scaled.1 - root.1).powi(2);
    let plus = (scaled.0 + root.0).powi(2) + (scaled.1 + root.1).powi(2);
    0.5 * (perpendicular + minus / plus)
}

/// f cos of the facets of a metal or of a rough dielectric, by one scattering. Directions are in their frame, and `wo` is
/// above the horizon; `is_front` says whether that is outside.
pub fn facets(material: &Material, wo: DVec3, wi: DVec3, is_front: bool) -> DVec3 {
    let alpha = material.roughness.as_dvec2();
    let masking = unmasked(wo, alpha) * unmasked(wi, alpha);
    match material.surface {
        Surface::Conductor if wi.z > 0.0 => {
            let h = (wo + wi).normalize();
            let shape = ggx(h, alpha) * masking / (4.0 * wo.z);
            let (eta, k) = (material.eta.as_dvec3().to_array(), material.absorption.as_dvec3().to_array());
            let reflectance = [0, 1, 2].map(|i| metal_reflectance(wo.dot(h), eta[i], k[i]));
            material.specular.as_dvec3() * DVec3::from(reflectance) * shape
        }
        Surface::Dielectric => {
            let index = f64::from(material.ior);
            let eta = if is_front { index } else { 1.0 / index };
            if wi.z > 0.0 {
                let h = (wo + wi).normalize();
                return DVec3::splat(reflectance(wo.dot(h), eta) * ggx(h, alpha) * masking / (4.0 * wo.z));
            }
            // The half vector of refraction, and its Jacobian. (The same, eq. 16, 17 and 21)
            let h = -(wo + eta * wi).normalize();
            let h = if h.z < 0.0 { -h } else { h };
            let (cos_o, cos_i) = (wo.dot(h), wi.dot(h));
            if cos_o <= 0.0 || cos_i >= 0.0 {
                return DVec3::ZERO;
            }
            let through = 1.0 - reflectance(cos_o, eta);
            let jacobian = eta * eta * -cos_i / (cos_o + eta * cos_i).powi(2);
            // Radiance scales with the square of the index.
            let value = through * ggx(h, alpha) * masking * cos_o / wo.z * jacobian / (eta * eta);
            material.transmission.as_dvec3() * value
        }
        _ => DVec3::ZERO,
    }
}

/// A direction with the pdf (exponent + 1) / (2 pi) cos^exponent about the axis; exponent 1 is the cosine hemisphere.
fn cosine_power(axis: DVec3, exponent: f64, u: DVec2) -> DVec3 {
    let cosine = (1.0 - u.x).powf(1.0 / (exponent + 1.0));
    let sine = (1.0 - cosine * cosine).sqrt();
    let (x, y) = basis(axis);
    let across = DVec2::from_angle(TAU * u.y);
    sine * (across.x * x + across.y * y) + cosine * axis
}

/// z of normals between the two branches of `basis`, which few walls have.
const BASIS_EDGE: f64 = -0.4375;

/// The basis in which the kernels measure angles. (Duff et al. 2017, Building an Orthonormal Basis, Revisited)
pub fn basis(n: DVec3) -> (DVec3, DVec3) {
    let sign = if n.z >= BASIS_EDGE { 1.0 } else { -1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), DVec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Whether a number in [0, 1) falls below a probability, and the number remapped to [0, 1), uniform again.
pub fn falls_below(u: f64, share: f64) -> (bool, f64) {
    if u < share { (true, u / share) } else { (false, (u - share) / (1.0 - share)) }
}

/// f cos of Disney's BSDF of a body or of a thin sheet. Directions are in the frame of its facets, and `wo` is above the
/// horizon; `is_front` says whether that is outside. (Burley 2012, Physically Based Shading at Disney; 2015, Extending the
/// Disney BRDF to a BSDF with Integrated Subsurface Scattering; both as Mitsuba has them)
pub fn principled(material: &Material, wo: DVec3, wi: DVec3, is_front: bool) -> DVec3 {
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
    let widths = |roughness: f64| {
        let aspect = (1.0 - 0.9 * anisotropy).sqrt();
        (roughness * roughness * DVec2::new(1.0 / aspect, aspect)).max(DVec2::splat(0.001))
    };
    let schlick = |normal: DVec3, cosine: f64| normal + (1.0 - normal) * (1.0 - cosine).powi(5);
    let luminance = colour.dot(DVec3::new(0.212671, 0.715160, 0.072169));
    let hue = if luminance > 0.0 { colour / luminance } else { DVec3::ONE };
    let tinted = |cosine: f64| {
        let normal = hue * ((eta - 1.0) / (eta + 1.0)).powi(2);
        DVec3::splat(reflectance(cosine, eta)).lerp(schlick(normal, cosine), specular_tint)
    };
    let facets =
        |v: DVec3, h: DVec3, alpha: DVec2| ggx(h, alpha) * unmasked(wo, alpha) * unmasked(v, alpha) / (4.0 * wo.z);
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
            return (1.0 - share) * (1.0 - through) * (body + cloth)
                + share * tinted(wo.dot(h)) * facets(wi, h, widths(roughness));
        }
        let passes = if wi.dot(h) < 0.0 { 1.0 - reflectance(wo.dot(h), eta) } else { 0.0 };
        let spread = widths((0.65 * eta - 0.35) * roughness);
        return colour * ((1.0 - share) * through * -wi.z * FRAC_1_PI + share * passes * facets(flat, h, spread));
    }
    let glass = (1.0 - metal) * share;
    if wi.z < 0.0 {
        // Of a dielectric with microfacets, tinted by the root of the colour: light passes the surface twice.
        let (transmission, roughness) = (DVec3::from(colour.to_array().map(f64::sqrt)), widths(roughness));
        let index = if is_inside { 1.0 / eta } else { eta };
        let h = -(wo + index * wi).normalize();
        let h = if h.z < 0.0 { -h } else { h };
        let (cos_o, cos_i) = (wo.dot(h), wi.dot(h));
        if !material.has_inside() || cos_o <= 0.0 || cos_i >= 0.0 {
            return DVec3::ZERO;
        }
        let jacobian = -cos_i / (cos_o + index * cos_i).powi(2);
        let shape = 4.0 * facets(wi, h, roughness) * cos_o;
        return glass * transmission * (1.0 - reflectance(cos_o, index)) * shape * jacobian;
    }
    let h = (wo + wi).normalize();
    let d = wo.dot(h);
    let shape = facets(wi, h, widths(roughness));
    if is_inside {
        return DVec3::splat(glass * reflectance(d, 1.0 / eta) * shape);
    }
    let (body, cloth) = diffuse(h);
    let width = f64::from(material.coat_roughness);
    let square = width * width;
    let long_tails = (square - 1.0) * FRAC_1_PI / (square.ln() * (1.0 + (square - 1.0) * h.z * h.z));
    let masking = unmasked(wo, DVec2::splat(0.25)) * unmasked(wi, DVec2::splat(0.25));
    let coat = 0.25 * f64::from(material.coat) * schlick(DVec3::splat(0.04), d) * long_tails * masking * wi.z;
    tinted(d).lerp(schlick(colour, d), metal) * shape
        + (1.0 - metal) * ((1.0 - share) * body + cloth)
        + if material.coat > 0.0 { coat } else { DVec3::ZERO }
}
