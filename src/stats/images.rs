//! How far an image is from a reference.

use glam::{DVec3, Vec3};
use serde::Serialize;

use super::{Moments, ZTest, z_test};
use crate::film::Image;

/// Keeps relMSE finite where the reference is dark, in radiance squared. The 0.01 of Rousselle,
/// Knaus and Zwicker, "Adaptive sampling and reconstruction using greedy error minimization",
/// ACM TOG 30 (2011).
pub const DARK: f64 = 0.01;

/// Two images that cannot be compared pixel by pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the images differ in size, {} x {} and {} x {} pixels; render both at one size",
    a.0, a.1, b.0, b.1
)]
pub struct SizesDiffer {
    /// Width and height of the image.
    pub a: (u32, u32),
    /// Width and height of the reference.
    pub b: (u32, u32),
}

/// What [`compare_images`] found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImageComparison {
    /// Width of both images in pixels.
    pub width: u32,
    /// Height of both images in pixels.
    pub height: u32,
    /// Pixels that entered `whole` and `channels`: those finite in every channel of both images.
    pub compared_pixels: u64,
    /// Pixels that agree in every bit of every channel. Zeros of unlike sign differ, NaNs of like
    /// bits do not.
    pub identical_pixels: u64,
    /// Share of all pixels, in [0, 1], that are not identical.
    pub share_of_differing_pixels: f64,
    /// Pixels of the image that are not finite.
    pub non_finite_a: NonFinite,
    /// Pixels of the reference that are not finite.
    pub non_finite_b: NonFinite,
    /// The differences over all channels.
    pub whole: Differences,
    /// The differences in red, green and blue.
    pub channels: [Differences; 3],
}

/// Pixels that no statistic can use. A pixel with both counts as both.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct NonFinite {
    /// Pixels with NaN in any channel.
    pub nan_count: u64,
    /// Pixels with plus or minus infinity in any channel.
    pub inf_count: u64,
}

/// Differences image - reference over the finite pixels; NaN where there are none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Differences {
    /// Mean of (a - b)², radiance squared.
    pub mse: f64,
    /// Mean of (a - b)² / (b² + 0.01), b the reference.
    pub rel_mse: f64,
    /// Mean radiance of the image.
    pub mean_a: f64,
    /// Mean radiance of the reference.
    pub mean_b: f64,
    /// Mean of a - b.
    pub mean_difference: f64,
    /// Standard error of `mean_difference`, from the scatter of the pixels' differences; for all
    /// channels together from each pixel's mean over its channels, because the channels of one
    /// pixel share their paths and are not independent.
    pub standard_error: f64,
    /// `mean_difference` over `standard_error`. It judges two unbiased renders of one scene; where
    /// the images differ on purpose it only says how plainly they do.
    pub z: f64,
    /// Two-sided p-value of `z`.
    pub p: f64,
    /// Largest |a - b|.
    pub max_abs_difference: f64,
}

/// Compares image `a` with reference `b`, in `f64`. Pixels that are not finite in either are
/// counted and otherwise left out.
///
/// # Errors
///
/// When the sizes differ.
pub fn compare_images(a: &Image, b: &Image) -> Result<ImageComparison, SizesDiffer> {
    let (size_a, size_b) = ((a.width, a.height), (b.width, b.height));
    if size_a != size_b {
        return Err(SizesDiffer { a: size_a, b: size_b });
    }
    let pairs = || a.pixels.iter().zip(&b.pixels);
    let identical = pairs().filter(|(a, b)| bits(**a) == bits(**b)).count();
    let finite = || pairs().filter(|(a, b)| a.is_finite() && b.is_finite()).map(|(a, b)| (a.as_dvec3(), b.as_dvec3()));
    let channel = |i: usize| Differences::of(finite().map(|(a, b)| ([a[i]], [b[i]])));
    Ok(ImageComparison {
        width: a.width,
        height: a.height,
        compared_pixels: finite().count() as u64,
        identical_pixels: identical as u64,
        share_of_differing_pixels: (a.pixels.len() - identical) as f64 / a.pixels.len() as f64,
        non_finite_a: NonFinite::of(a),
        non_finite_b: NonFinite::of(b),
        whole: Differences::of(finite().map(|(a, b)| (a.to_array(), b.to_array()))),
        channels: [channel(0), channel(1), channel(2)],
    })
}

/// (a - b)² / (b² + 0.01) of one pixel, the mean over its channels; the mean over the pixels is
/// relMSE.
pub fn relative_squared_error(a: Vec3, b: Vec3) -> f64 {
    let (a, b) = (a.as_dvec3(), b.as_dvec3());
    ((a - b) * (a - b) / (b * b + DVec3::splat(DARK))).element_sum() / 3.0
}

fn bits(pixel: Vec3) -> [u32; 3] {
    pixel.to_array().map(f32::to_bits)
}

impl NonFinite {
    fn of(image: &Image) -> Self {
        let count = |is: fn(f32) -> bool| {
            let spoilt = |pixel: &&Vec3| pixel.to_array().into_iter().any(is);
            image.pixels.iter().filter(spoilt).count() as u64
        };
        Self { nan_count: count(f32::is_nan), inf_count: count(f32::is_infinite) }
    }
}

impl Differences {
    /// The differences of pixels of `N` channels each.
    fn of<const N: usize>(pixels: impl Iterator<Item = ([f64; N], [f64; N])>) -> Self {
        let mean_of = |values: [f64; N]| values.iter().sum::<f64>() / N as f64;
        let [mut squared, mut relative, mut mean_a, mut mean_b, mut difference] = [Moments::default(); 5];
        let mut largest = f64::NAN;
        for (a, b) in pixels {
            let apart: [f64; N] = std::array::from_fn(|i| a[i] - b[i]);
            squared.push(mean_of(apart.map(|d| d * d)));
            relative.push(mean_of(std::array::from_fn(|i| apart[i] * apart[i] / (b[i] * b[i] + DARK))));
            mean_a.push(mean_of(a));
            mean_b.push(mean_of(b));
            difference.push(mean_of(apart));
            // `max` takes the number over the NaN it starts with.
            largest = apart.iter().fold(largest, |largest, d| largest.max(d.abs()));
        }
        let ZTest { z, p } = z_test(difference.mean(), difference.standard_error());
        Self {
            mse: squared.mean(),
            rel_mse: relative.mean(),
            mean_a: mean_a.mean(),
            mean_b: mean_b.mean(),
            mean_difference: difference.mean(),
            standard_error: difference.standard_error(),
            z,
            p,
            max_abs_difference: largest,
        }
    }
}
