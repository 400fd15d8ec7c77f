//! The kernels' units: positions in normalised space, radiance times a power of two.

use glam::{DVec3, Vec3};

use crate::scene::{Environment, Light, Scene};

/// The power of two that scales the geometric mean of the brightest and the dimmest light to about 1, so that the sums and
/// squares of samples stay clear of both ends of `f32`. It rounds nothing.
pub(super) fn radiance_scale(scene: &Scene, normalisation: &Normalisation) -> f64 {
    let area_lights =
        scene.materials.iter().zip(scene.shown_materials()).filter(|(_, shown)| *shown).map(|(m, _)| m.emission);
    let environment = match &scene.environment {
        Environment::Black => Vec3::ZERO,
        Environment::Constant(radiance) => *radiance,
        Environment::LatLong(map) => map.radiance.iter().fold(Vec3::ZERO, |peak, texel| peak.max(*texel)),
    };
    let punctual = scene.lights.iter().map(|light| strength(light, normalisation));
    let peaks = area_lights
        .chain([environment])
        .chain(punctual)
        .map(|light| f64::from(light.max_element()))
        .filter(|peak| *peak > 0.0);
    let (low, high) = peaks.fold((f64::INFINITY, 0.0_f64), |(low, high), peak| (low.min(peak), high.max(peak)));
    if high > 0.0 { (-0.5 * (low.log2() + high.log2())).round().exp2() } else { 1.0 }
}

/// What of a light that is no surface reaches a point at a normalised length of 1, or any point if it is far away.
pub(super) fn strength(light: &Light, normalisation: &Normalisation) -> Vec3 {
    match light {
        // By square units.
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } => {
            *intensity * normalisation.scale.powi(2) as f32
        }
        Light::Directional { irradiance, .. } => *irradiance,
    }
}

/// Flushes subnormal numbers to zero, as some devices do and others do not.
pub(super) fn normal_or_zero(v: Vec3) -> Vec3 {
    Vec3::from_array(v.to_array().map(|x| if x.is_subnormal() { 0.0 } else { x }))
}

/// From world to normalised space: bounds to [-1, 1]³, by a power of two so that it is exact.
#[derive(Debug, Clone, Copy)]
pub struct Normalisation {
    /// Middle of the scene's bounds, world units.
    pub centre: DVec3,
    /// Normalised lengths of a world unit, a power of two: normalised = (world - centre) · scale.
    pub scale: f64,
}

impl Normalisation {
    pub(super) fn of(scene: &Scene) -> Self {
        Self::of_bounds(scene.bounds())
    }

    pub(super) fn of_bounds((low, high): (DVec3, DVec3)) -> Self {
        let extent = (0.5 * (high - low)).max_element();
        let scale = if extent > 0.0 { (-extent.log2().ceil()).exp2() } else { 1.0 };
        Self { centre: low.midpoint(high), scale }
    }

    pub(super) fn point(&self, p: DVec3) -> DVec3 {
        (p - self.centre) * self.scale
    }

    pub(super) fn length(&self, length: f64) -> f32 {
        (length * self.scale) as f32
    }
}

/// Radiance in the kernels' unit: the scene's times `radiance_scale`.
pub(super) fn scaled(radiance: Vec3, radiance_scale: f64) -> [f32; 3] {
    (radiance.as_dvec3() * radiance_scale).as_vec3().to_array()
}
