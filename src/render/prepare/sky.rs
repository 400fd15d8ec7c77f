//! The environment as light samples pick directions of it.

use std::f64::consts::PI;

use super::PrepareError;
use super::lights::{MAX_CELLS, brightness};
use super::space::scaled;
use crate::layout::{EnvironmentSplit, EnvironmentTexel};
use crate::scene::EnvironmentMap;

/// The environment, as light samples pick directions of it.
#[derive(Debug, Default)]
pub(super) struct Sky {
    /// Texels of a lat-long image with the probability of each: in proportion to the brightness of the
    /// bilinear image over the texel, times its solid angle.
    pub(super) texels: Vec<EnvironmentTexel>,
    /// See [`splits`].
    pub(super) splits: Vec<EnvironmentSplit>,
    /// Brightness over all directions.
    pub(super) power: f64,
}

impl Sky {
    pub(super) fn of(map: &EnvironmentMap, radiance_scale: f64) -> Result<Self, PrepareError> {
        let (width, height) = (map.width as usize, map.height as usize);
        if map.radiance.len() > MAX_CELLS {
            return Err(PrepareError::TooManyTexels(map.radiance.len()));
        }
        let brightness = |x: usize, y: usize| brightness(map.radiance[y * width + x]);
        // A bilinear image integrated over a texel: weights 1/8, 3/4, 1/8 in each direction.
        let across = |x: usize, y: usize| {
            0.125 * (brightness((x + width - 1) % width, y) + brightness((x + 1) % width, y)) + 0.75 * brightness(x, y)
        };
        let weights: Vec<f64> = (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let mean =
                    0.125 * (across(x, y.saturating_sub(1)) + across(x, (y + 1).min(height - 1))) + 0.75 * across(x, y);
                let angle = |row: usize| PI * row as f64 / height as f64;
                mean * (libm::cos(angle(y)) - libm::cos(angle(y + 1)))
            })
            .collect();
        let total: f64 = weights.iter().sum();
        let texels = map
            .radiance
            .iter()
            .zip(&weights)
            .map(|(radiance, weight)| EnvironmentTexel {
                radiance: scaled(*radiance, radiance_scale),
                probability: (weight / total) as f32,
            })
            .collect();
        Ok(Self { texels, splits: splits(&weights, width), power: 2.0 * PI / width as f64 * total })
    }
}

/// The hierarchy by which a texel is sampled in proportion to its weight. Level by level, from the one block that holds
/// the image down to blocks of two by two texels, it has the probabilities of the halves of each block, in rows; blocks
/// without texels are left out. `weights` are those of the texels, in rows of `width`.
fn splits(weights: &[f64], width: usize) -> Vec<EnvironmentSplit> {
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole) as f32 } else { 0.5 };
    let mut levels = Vec::new();
    let (mut sums, mut size) = (weights.to_vec(), [width, weights.len() / width]);
    while size != [1, 1] {
        let sum = |x: usize, y: usize| if x < size[0] && y < size[1] { sums[y * size[0] + x] } else { 0.0 };
        let blocks = size.map(|side| side.div_ceil(2));
        let corners = (0..blocks[1]).flat_map(|y| (0..blocks[0]).map(move |x| [2 * x, 2 * y]));
        let (level, halved): (Vec<_>, Vec<_>) = corners
            .map(|[x, y]| {
                let [upper, lower] = [y, y + 1].map(|y| [sum(x, y), sum(x + 1, y)]);
                let [up, down] = [upper, lower].map(|[left, right]| left + right);
                let left = [share(upper[0], up), share(lower[0], down)];
                (EnvironmentSplit { upper: share(up, up + down), left, unused: 0 }, up + down)
            })
            .unzip();
        levels.push(level);
        (sums, size) = (halved, blocks);
    }
    levels.into_iter().rev().flatten().collect()
}
