//! How far an image is from a reference.

use glam::{DVec3, Vec3};
use serde::Serialize;

use super::{Moments, ZTest, sidak_level, z_test};
use raywave::image::Image;
use raywave::parallel;

pub use raywave::image::DARK;

/// Pixels that a core compares at a time.
const PART: usize = 1 << 14;

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
    /// Pixels that agree in every bit of every channel. Zeros of different sign differ, NaNs of the same bits do not.
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

/// Differences image - reference over the finite pixels; NaN without finite pixels.
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
    /// `mean_difference` over `standard_error`. It judges two unbiased renders of one scene; if the images differ on
    /// purpose it only says how clearly they do.
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
    // Parts of a fixed size, merged in their order: the same numbers on any number of cores.
    let parts = parallel::map_parts(&a.pixels, PART, &|first, part| Part::of(part, &b.pixels[first..][..part.len()]));
    let all = parts.iter().fold(Part::default(), Part::with);
    let pixels = a.pixels.len() as u64;
    Ok(ImageComparison {
        width: a.width,
        height: a.height,
        compared_pixels: all.difference.count(),
        identical_pixels: all.identical,
        share_of_differing_pixels: (pixels - all.identical) as f64 / pixels as f64,
        non_finite_a: all.non_finite[0],
        non_finite_b: all.non_finite[1],
        whole: all.whole().differences(),
        channels: all.channels.map(|channel| channel.differences()),
    })
}

/// What [`test_pixels`] found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PixelTest {
    /// Values that were tested: three a pixel.
    pub values: u64,
    /// Values whose deviation noise explains.
    pub explained: u64,
    /// Their share of all, in [0, 1].
    pub share: f64,
    /// The level of significance of each value.
    pub level: f64,
    /// Largest deviation, in standard errors.
    pub largest_z: f64,
}

/// Tests of each pixel whether an image is the reference but for noise, as the tests of Mitsuba 3's renders do
/// (`test_renders.py`): in CIE XYZ, by the variance of one sample in the reference, at least 1e-4, and the number of samples
/// in the image, at a level of 0.01 for all pixels together (Šidák). The reference counts as free of noise.
///
/// # Errors
///
/// When the sizes differ.
pub fn test_pixels(image: &Image, reference: &Image, variance: &Image, samples: u32) -> Result<PixelTest, SizesDiffer> {
    const LEVEL: f64 = 0.01;
    const LEAST_VARIANCE: f64 = 1e-4;
    for other in [reference, variance] {
        let (a, b) = ((image.width, image.height), (other.width, other.height));
        if a != b {
            return Err(SizesDiffer { a, b });
        }
    }
    let level = sidak_level(LEVEL, image.pixels.len());
    let mut test = PixelTest { values: 0, explained: 0, share: 0.0, level, largest_z: 0.0 };
    for ((image, reference), variance) in image.pixels.iter().zip(&reference.pixels).zip(&variance.pixels) {
        let [image, reference, variance] = [image, reference, variance].map(|pixel| xyz(*pixel));
        for channel in 0..3 {
            let error = (variance[channel].max(LEAST_VARIANCE) / f64::from(samples)).sqrt();
            let ZTest { z, p } = z_test(image[channel] - reference[channel], error);
            test.values += 1;
            // What is no number is explained by nothing.
            test.explained += u64::from(p > level);
            test.largest_z = test.largest_z.max(z.abs());
        }
    }
    test.share = test.explained as f64 / test.values as f64;
    Ok(test)
}

/// CIE XYZ of linear sRGB.
fn xyz(rgb: Vec3) -> DVec3 {
    let rows = [
        DVec3::new(0.412453, 0.357580, 0.180423),
        DVec3::new(0.212671, 0.715160, 0.072169),
        DVec3::new(0.019334, 0.119193, 0.950227),
    ];
    DVec3::from_array(rows.map(|row| row.dot(rgb.as_dvec3())))
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
    fn note(&mut self, pixel: Vec3) {
        let has = |is: fn(f32) -> bool| u64::from(pixel.to_array().into_iter().any(is));
        self.nan_count += has(f32::is_nan);
        self.inf_count += has(f32::is_infinite);
    }
}

/// Results for a part of two images.
#[derive(Debug, Clone, Copy, Default)]
struct Part {
    identical: u64,
    non_finite: [NonFinite; 2],
    channels: [Channel; 3],
    /// Differences of the pixels' means over their channels.
    difference: Moments,
}

impl Part {
    fn of(a: &[Vec3], b: &[Vec3]) -> Self {
        let mut part = Self::default();
        let mut differences = [ShiftedSums::default(); 4];
        for (a, b) in a.iter().zip(b) {
            part.identical += u64::from(bits(*a) == bits(*b));
            if !(a.is_finite() && b.is_finite()) {
                part.non_finite[0].note(*a);
                part.non_finite[1].note(*b);
                continue;
            }
            let (a, b) = (a.as_dvec3(), b.as_dvec3());
            let apart = a - b;
            let squared = apart * apart;
            let relative = squared / (b * b + DVec3::splat(DARK));
            for (i, channel) in part.channels.iter_mut().enumerate() {
                channel.squared += squared[i];
                channel.relative += relative[i];
                channel.a += a[i];
                channel.b += b[i];
                channel.largest = channel.largest.max(apart[i].abs());
                differences[i].add(apart[i]);
            }
            differences[3].add(apart.element_sum() / 3.0);
        }
        for (channel, differences) in part.channels.iter_mut().zip(&differences) {
            channel.difference = differences.moments();
        }
        part.difference = differences[3].moments();
        part
    }

    fn with(self, other: &Self) -> Self {
        let both = |i: usize| {
            let (a, b) = (self.non_finite[i], other.non_finite[i]);
            NonFinite { nan_count: a.nan_count + b.nan_count, inf_count: a.inf_count + b.inf_count }
        };
        let mut difference = self.difference;
        difference.merge(&other.difference);
        Self {
            identical: self.identical + other.identical,
            non_finite: [both(0), both(1)],
            channels: std::array::from_fn(|i| self.channels[i].with(&other.channels[i])),
            difference,
        }
    }

    /// All channels as one: their means, and the largest of their differences.
    fn whole(&self) -> Channel {
        let mean = |of: fn(&Channel) -> f64| self.channels.iter().map(of).sum::<f64>() / 3.0;
        Channel {
            squared: mean(|channel| channel.squared),
            relative: mean(|channel| channel.relative),
            a: mean(|channel| channel.a),
            b: mean(|channel| channel.b),
            difference: self.difference,
            largest: self.channels.iter().map(|channel| channel.largest).fold(0.0, f64::max),
        }
    }
}

/// Numbers summed with their squares, relative to the first of them, so that equal ones have no variance.
#[derive(Debug, Clone, Copy, Default)]
struct ShiftedSums {
    count: u64,
    first: f64,
    sum: f64,
    squares: f64,
}

impl ShiftedSums {
    fn add(&mut self, value: f64) {
        if self.count == 0 {
            self.first = value;
        }
        let value = value - self.first;
        self.count += 1;
        self.sum += value;
        self.squares += value * value;
    }

    fn moments(&self) -> Moments {
        Moments::of_sums(self.count, self.first, self.sum, self.squares)
    }
}

/// Sums over the pixels of a channel.
#[derive(Debug, Clone, Copy, Default)]
struct Channel {
    squared: f64,
    relative: f64,
    a: f64,
    b: f64,
    difference: Moments,
    /// 0 if all are.
    largest: f64,
}

impl Channel {
    fn with(self, other: &Self) -> Self {
        let mut difference = self.difference;
        difference.merge(&other.difference);
        Self {
            squared: self.squared + other.squared,
            relative: self.relative + other.relative,
            a: self.a + other.a,
            b: self.b + other.b,
            difference,
            largest: self.largest.max(other.largest),
        }
    }

    fn differences(&self) -> Differences {
        let count = self.difference.count() as f64;
        let (mean, standard_error) = (self.difference.mean(), self.difference.standard_error());
        let ZTest { z, p } = z_test(mean, standard_error);
        Differences {
            mse: self.squared / count,
            rel_mse: self.relative / count,
            mean_a: self.a / count,
            mean_b: self.b / count,
            mean_difference: mean,
            standard_error,
            z,
            p,
            max_abs_difference: if count > 0.0 { self.largest } else { f64::NAN },
        }
    }
}
