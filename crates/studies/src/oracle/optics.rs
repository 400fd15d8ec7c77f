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

/// A direction and f cos / pdf of what MTL describes, drawn as the kernels draw it, at a surface whose front `wo` is on or
/// not. `choice` picks what is specular, `u` a direction.
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
        other => unreachable!("{other:?} draws directions in `bsdf`"),
    }
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
