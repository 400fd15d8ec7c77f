//! Area lights, which are emissive triangles, as light samples pick them, and how often they pick the environment.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::PrepareError;
use super::features::Features;
use super::sky::Sky;
use crate::alias::{AliasCell, alias_table};
use crate::bvh::Bvh;
use crate::constants::*;
use crate::layout::Light;
use crate::scene::Scene;

/// Most cells of an alias table: random numbers have 24 bits.
pub(super) const MAX_CELLS: usize = 1 << 24;

/// How bright a radiance is: its luminance by Rec. 709, plus a part of the sum, which keeps it above zero for colours
/// without luminance.
pub(super) fn brightness(radiance: Vec3) -> f64 {
    let c = radiance.as_dvec3();
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722)) + 1e-3 * c.element_sum()
}

/// Area lights, as light samples pick them.
#[derive(Debug, Default)]
pub(super) struct AreaLights {
    /// Cells of the alias table, in the scene's order.
    pub(super) cells: Vec<Light>,
    /// Area of each over the probability of its pick, normalised units squared.
    pub(super) areas: Vec<f64>,
    /// Brightness times area of all, times pi.
    power: f64,
}

impl AreaLights {
    /// Share of the picks that go by power. The others go by area, so that a light of little power still has samples
    /// where it is near, or is the only one in sight.
    const BY_POWER: f64 = 0.9;

    pub(super) fn of(scene: &Scene, bvh: &Bvh, corners: &[[Vec3; 3]]) -> Result<Self, PrepareError> {
        let material = |original: u32| &scene.materials[scene.mesh.triangles[original as usize].material as usize];
        let emits = |original: u32| material(original).is_emitter();
        let mut lights: Vec<(u32, u32)> = bvh
            .order
            .iter()
            .enumerate()
            .filter(|(_, original)| emits(**original))
            .map(|(place, original)| (*original, place as u32))
            .collect();
        // The scene's order, so that random numbers pick the same light whatever the BVH is.
        lights.sort_unstable();
        let originals = || lights.iter().map(|(original, _)| *original);
        let areas: Vec<f64> = originals()
            .map(|original| {
                let [a, b, c] = corners[original as usize].map(|v| v.as_dvec3());
                0.5 * (b - a).cross(c - a).length()
            })
            .collect();
        let brightnesses: Vec<f64> = originals().map(|original| brightness(material(original).emission)).collect();
        let area: f64 = areas.iter().sum();
        let power: f64 = areas.iter().zip(&brightnesses).map(|(area, brightness)| area * brightness).sum();
        if lights.len() > MAX_CELLS {
            return Err(PrepareError::TooManyLights(lights.len()));
        }
        if power == 0.0 {
            return Ok(Self::default());
        }
        // Pdf over area of a light sample among area lights.
        let pdf = |brightness: &f64| Self::BY_POWER * brightness / power + (1.0 - Self::BY_POWER) / area;
        let pdfs: Vec<f64> = brightnesses.iter().map(pdf).collect();
        let weights: Vec<f64> = areas.iter().zip(&pdfs).map(|(area, pdf)| area * pdf).collect();
        let cell = |((_, triangle), cell): (&(u32, u32), AliasCell)| Light {
            triangle: *triangle,
            threshold: cell.threshold,
            alias: cell.alias,
            unused: 0,
        };
        Ok(Self {
            cells: lights.iter().zip(alias_table(&weights)).map(cell).collect(),
            areas: pdfs.iter().map(|pdf| 1.0 / pdf).collect(),
            power: PI * power,
        })
    }
}

/// Probability that a light sample is of the environment: its share of the power that the scene receives, supposing that
/// half of the environment is hidden. It and the area lights get a tenth at least. `size` is that of the scene's bounds.
pub(super) fn sky_probability(features: Features, lights: &AreaLights, sky: &Sky, size: DVec3) -> f32 {
    let shines = features.environment != ENVIRONMENT_BLACK;
    if !shines || lights.cells.is_empty() {
        return if shines { 1.0 } else { 0.0 };
    }
    share(0.5 * sky.power * disk(size), lights.power)
}

/// Probability that a light sample is of the lights that are no surfaces: their share of the power that the scene receives,
/// but a tenth at least where there are others, and as much for the others. `power` is their strength as the middle of the
/// scene receives it.
pub(super) fn punctual_probability(power: f64, lights: &AreaLights, sky: &Sky, size: DVec3) -> f32 {
    let received = power * disk(size);
    let others = lights.power + 0.5 * sky.power * disk(size);
    match received {
        0.0 => 0.0,
        _ if others == 0.0 => 1.0,
        _ => share(received, others),
    }
}

/// Area of the disk through which light from far away arrives at the sphere of bounds of that size.
fn disk(size: DVec3) -> f64 {
    PI * 0.25 * size.length_squared()
}

/// Share of one power in two, between a tenth and nine, exact in the 24 bits of a random number.
fn share(own: f64, others: f64) -> f32 {
    let share = (own / (own + others)).clamp(0.1, 0.9);
    ((share * 256.0).round() / 256.0) as f32
}
