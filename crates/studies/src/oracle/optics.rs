//! What the material functions should compute, in f64 and from the textbook.

use std::f64::consts::{FRAC_1_PI, TAU};

use glam::DVec3;
use raywave::scene::Material;

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
