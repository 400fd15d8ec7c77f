//! The film: how many samples each pixel has, their sum and the sum of their squares, and what
//! follows from these: the image and its variance.
//!
//! [`Film`] holds the sums by blocks of samples, so that parts add up to the bits of the whole.
//! It knows nothing of scenes or of the GPU.

mod blocks;
mod file;

use glam::{DVec3, Vec3};

use crate::image::Image;

pub use blocks::{Film, MergeError, Missing, Overlap, PixelSums, Run, Strip, Sums, block_range};
pub use file::{FilmError, FilmFile, FilmLock, read_film, write_film};

/// Raw moments of the radiance samples of every pixel, taken to be independent between samples
/// and between pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmMoments {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Samples in every pixel.
    pub samples: u64,
    /// Sum of the radiance samples, `width * height` entries, row 0 at the top.
    pub sum: Vec<DVec3>,
    /// Sum of the squared radiance samples, in the order of `sum`.
    pub sum_of_squares: Vec<DVec3>,
}

/// The mean radiance of a whole image and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageMean {
    /// Mean radiance over all pixels, per channel.
    pub mean: DVec3,
    /// Standard error of `mean`, per channel; infinite below two samples.
    pub standard_error: DVec3,
}

/// The mean over all pixels of an image that comes in parts.
#[derive(Debug, Clone, Copy, Default)]
pub struct MeanSum {
    pixels: u64,
    mean: DVec3,
    variance: DVec3,
}

impl MeanSum {
    /// Adds the pixels of a part.
    pub fn add(&mut self, part: &FilmMoments) {
        for pixel in 0..part.sum.len() {
            self.mean += part.pixel_mean(pixel);
            self.variance += part.pixel_variance_of_mean(pixel);
        }
        self.pixels += part.sum.len() as u64;
    }

    /// The mean of all parts. Its standard error is that of an average of independent estimates,
    /// sqrt(sum of the pixels' variances) / pixels: the image's own contrast is no part of it.
    pub fn mean(&self) -> ImageMean {
        let pixels = self.pixels as f64;
        ImageMean { mean: self.mean / pixels, standard_error: self.variance.map(f64::sqrt) / pixels }
    }
}

impl FilmMoments {
    /// Adds the rows of `below` under its own.
    ///
    /// # Panics
    /// When they are of another width or other samples.
    pub fn append(&mut self, below: Self) {
        assert_eq!((self.width, self.samples), (below.width, below.samples), "an image is of one width and samples");
        self.height += below.height;
        self.sum.extend(below.sum);
        self.sum_of_squares.extend(below.sum_of_squares);
    }

    /// The image: the mean radiance of every pixel. Without samples nothing is known and every
    /// pixel is NaN.
    pub fn mean(&self) -> Image {
        self.image(|pixel| self.pixel_mean(pixel))
    }

    /// The variance of every pixel of [`mean`](Self::mean): the unbiased sample variance over the
    /// number of samples, in radiance squared. Infinite below two samples.
    pub fn variance_of_mean(&self) -> Image {
        self.image(|pixel| self.pixel_variance_of_mean(pixel))
    }

    /// The mean over all pixels, as [`MeanSum`] has it.
    pub fn mean_and_standard_error(&self) -> ImageMean {
        let mut sum = MeanSum::default();
        sum.add(self);
        sum.mean()
    }

    fn pixel_mean(&self, pixel: usize) -> DVec3 {
        self.sum[pixel] / self.samples as f64
    }

    fn pixel_variance_of_mean(&self, pixel: usize) -> DVec3 {
        if self.samples < 2 {
            return DVec3::INFINITY;
        }
        let n = self.samples as f64;
        let mean = self.pixel_mean(pixel);
        let variance = (self.sum_of_squares[pixel] / n - mean * mean) / (n - 1.0);
        // Cancellation may leave a hair below zero where all samples agree. Not `max`, which would
        // turn the NaN of a pixel with a non-finite sample into a confident 0.
        variance.map(|v| if v < 0.0 { 0.0 } else { v })
    }

    fn image(&self, pixel: impl Fn(usize) -> DVec3) -> Image {
        let pixels: Vec<Vec3> = (0..self.sum.len()).map(|i| pixel(i).as_vec3()).collect();
        Image::new(self.width, self.height, pixels)
    }
}
