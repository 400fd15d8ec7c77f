//! Area lights, which are emissive triangles, as light samples pick them, and how often they pick the environment.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::PrepareError;
use super::features::Features;
use super::instances::{Part, Soup};
use super::sky::Sky;
use crate::alias::{AliasCell, alias_table};
use crate::bvh::Bvh;
use crate::constants::*;
use crate::layout::{Instance, Light};
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
    /// The instance that each is of.
    pub(super) instances: Vec<u32>,
    /// Area of each over the probability of its pick, normalised units squared.
    pub(super) areas: Vec<f64>,
    /// Brightness times area of all, times pi.
    power: f64,
}

/// An emissive triangle, as often as it is placed.
struct Emitter<'a> {
    /// Its number in the soup.
    original: u32,
    /// Its place in leaf order.
    place: u32,
    /// The number of its instance, and where that is.
    instance: u32,
    placed: &'a Instance,
}

impl AreaLights {
    /// Share of the picks that go by power. The others go by area, so that a light of little power still has samples
    /// where it is near, or is the only one in sight.
    const BY_POWER: f64 = 0.9;

    /// Of triangles that a tree was built of. It numbers the lights of instances.
    pub(super) fn of(scene: &Scene, bvh: &mut Bvh, soup: &Soup) -> Result<Self, PrepareError> {
        let material = |original: u32| &scene.materials[soup.materials[original as usize] as usize];
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
        let of_part = |part: &Part| {
            let [from, to] = [part.range.start, part.range.end]
                .map(|end| lights.partition_point(|(original, _)| (*original as usize) < end));
            &lights[from..to]
        };
        let count = soup.parts.iter().map(|part| of_part(part).len().saturating_mul(part.instances.len()));
        let count = count.fold(0, usize::saturating_add);
        if count > MAX_CELLS {
            return Err(PrepareError::TooManyLights(count));
        }
        let (mut emitters, mut instance) = (Vec::with_capacity(count), 0);
        for part in &soup.parts {
            for placed in &part.instances {
                if let Some(of_tree) = bvh.instances.get_mut(instance as usize) {
                    of_tree.first_light = emitters.len() as u32;
                }
                let emitter = |&(original, place): &(u32, u32)| Emitter { original, place, instance, placed };
                emitters.extend(of_part(part).iter().map(emitter));
                instance += 1;
            }
        }
        let areas: Vec<f64> = emitters
            .iter()
            .map(|Emitter { original, placed, .. }| {
                let corner = |corner: Vec3| Vec3::from(placed.place(corner.to_array()));
                // In the world they are where they are.
                let corners = soup.corners[*original as usize];
                let corners = if bvh.has_two_levels() { placed.place_corners(corners, corner) } else { corners };
                let [a, b, c] = corners.map(|v| v.as_dvec3());
                0.5 * (b - a).cross(c - a).length()
            })
            .collect();
        let brightnesses: Vec<f64> =
            emitters.iter().map(|emitter| brightness(material(emitter.original).emission)).collect();
        let area: f64 = areas.iter().sum();
        let power: f64 = areas.iter().zip(&brightnesses).map(|(area, brightness)| area * brightness).sum();
        if power == 0.0 {
            return Ok(Self::default());
        }
        // Pdf over area of a light sample among area lights.
        let pdf = |brightness: &f64| Self::BY_POWER * brightness / power + (1.0 - Self::BY_POWER) / area;
        let pdfs: Vec<f64> = brightnesses.iter().map(pdf).collect();
        let weights: Vec<f64> = areas.iter().zip(&pdfs).map(|(area, pdf)| area * pdf).collect();
        let cell = |(emitter, cell): (&Emitter<'_>, AliasCell)| Light {
            triangle: emitter.place,
            threshold: cell.threshold,
            alias: cell.alias,
            unused: 0,
        };
        Ok(Self {
            instances: emitters.iter().map(|emitter| emitter.instance).collect(),
            cells: emitters.iter().zip(alias_table(&weights)).map(cell).collect(),
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
