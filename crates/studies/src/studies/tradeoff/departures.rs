//! How far renders are from a reference, and how much of that is bias.
//!
//! With D_k the difference of the k-th render and the reference, and ⟨D_k, D_l⟩ the mean of its product over pixels and
//! channels, ⟨D_k, D_k⟩ is the k-th squared error. Noise of two renders is independent, so ⟨D_k, D_l⟩ of two different
//! ones is the squared bias in expectation, and the squared error minus that is the variance: both are unbiased
//! estimates, from as few as two renders (U-statistics; Hoeffding, "A class of statistics with asymptotically normal
//! distribution", 1948). The reference's own noise is in all of the products; its variance is known and subtracted.

use std::borrow::Cow;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::stats::{Bootstrap, DARK, Estimate, Interval};
use raywave::image::Image;
use raywave::parallel;

/// Two-sided quantile of a normal number for 95 %.
const TWO_SIDED_95: f64 = 1.96;

/// The image that the others are compared with.
#[derive(Debug, Clone)]
pub struct Reference {
    /// Its pixels.
    pub image: Arc<Image>,
    /// How well it is known; `None` if nothing says.
    pub noise: Option<ReferenceNoise>,
    /// Where it comes from, for people.
    pub origin: String,
}

/// The noise of a reference that was rendered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceNoise {
    /// Samples of each pixel.
    pub samples_per_pixel: u64,
    /// Independent renders that it is the mean of.
    pub renders: u64,
    /// Mean over pixels and channels of its variance over radiance² + 0.01: its own relMSE.
    pub relative_variance: f64,
    /// Mean over pixels and channels of its variance.
    pub variance: f64,
    /// Root of the mean square of variance over radiance² + 0.01, over pixels and channels.
    pub relative_variance_rms: f64,
    /// Standard error of its mean radiance.
    pub mean_standard_error: f64,
}

/// Renders with different seeds, summed to a reference.
#[derive(Debug, Default)]
pub struct ReferenceSum {
    width: u32,
    height: u32,
    renders: u64,
    sum: Vec<[f64; 3]>,
    squares: Vec<[f64; 3]>,
    means: Vec<f64>,
}

impl ReferenceSum {
    /// Adds a render of the same size.
    pub fn add(&mut self, image: &Image) {
        if self.sum.is_empty() {
            (self.width, self.height) = (image.width, image.height);
            self.sum = vec![[0.0; 3]; image.pixels.len()];
            self.squares = self.sum.clone();
        }
        self.renders += 1;
        let sums = self.sum.par_iter_mut().zip(&mut self.squares);
        image.pixels.par_iter().zip(sums).with_min_len(PART).for_each(|(pixel, (sum, squares))| {
            for (channel, value) in pixel.to_array().map(f64::from).into_iter().enumerate() {
                sum[channel] += value;
                squares[channel] += value * value;
            }
        });
        self.means.push(mean_radiance(image));
    }

    /// Renders so far.
    pub fn renders(&self) -> u64 {
        self.renders
    }

    /// The mean of the renders, of that many samples each, and its noise from their scatter. It needs two.
    pub fn reference(&self, samples: u64) -> Reference {
        let n = self.renders as f64;
        let pixels = self.sum.iter().map(|sum| glam::DVec3::from_array(sum.map(|s| s / n)).as_vec3());
        let image = Image::new(self.width, self.height, pixels.collect());
        let mut noise =
            ReferenceNoise { samples_per_pixel: samples * self.renders, renders: self.renders, ..Default::default() };
        let numbers = 3.0 * self.sum.len() as f64;
        for (sum, squares) in self.sum.iter().zip(&self.squares) {
            for channel in 0..3 {
                let mean = sum[channel] / n;
                let variance = ((squares[channel] / n - mean * mean) / (n - 1.0)).max(0.0);
                let relative = variance / (mean * mean + DARK);
                noise.variance += variance / numbers;
                noise.relative_variance += relative / numbers;
                noise.relative_variance_rms += relative * relative / numbers;
            }
        }
        noise.relative_variance_rms = noise.relative_variance_rms.sqrt();
        noise.mean_standard_error = crate::stats::standard_error(&self.means);
        let origin = format!("{} renders of {samples} samples per pixel", self.renders);
        Reference { image: Arc::new(image), noise: Some(noise), origin }
    }
}

/// Mean over pixels and channels.
pub fn mean_radiance(image: &Image) -> f64 {
    let sums = parallel::map_parts(&image.pixels, PART, &|_, part| total(bytemuck::cast_slice(part)));
    sums.iter().sum::<f64>() / (3.0 * image.pixels.len() as f64)
}

/// Inner products of differences with each other.
#[derive(Debug, Clone, Default)]
pub struct Products {
    /// Row k holds the products with itself and all before.
    rows: Vec<Vec<f64>>,
}

impl Products {
    /// How many differences there are.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Adds the products of one more with all before and itself.
    pub fn push(&mut self, row: Vec<f64>) {
        assert_eq!(row.len(), self.rows.len() + 1, "a product with each before and itself");
        self.rows.push(row);
    }

    /// The square of the k-th.
    pub fn square(&self, k: usize) -> f64 {
        self.rows[k][k]
    }

    /// The weighted mean of the squares.
    fn mean_square(&self, weights: &[f64]) -> f64 {
        let squares = weights.iter().enumerate().map(|(k, weight)| weight * self.square(k));
        squares.sum::<f64>() / weights.iter().sum::<f64>()
    }

    /// The weighted mean of the products of two different ones; NaN where one has all the weight.
    fn mean_product(&self, weights: &[f64]) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for (k, weight) in weights.iter().enumerate() {
            for (l, other) in weights[..k].iter().enumerate() {
                sum += weight * other * self.rows[k][l];
                total += weight * other;
            }
        }
        sum / total
    }

    /// Variance: the mean square less the mean product.
    pub fn variance(&self, weights: &[f64]) -> f64 {
        self.mean_square(weights) - self.mean_product(weights)
    }
}

/// A squared error and its parts. They are estimates, so a bias near 0 may come out negative.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Decomposition {
    /// Expected squared error of one render.
    pub total: Estimate,
    /// Squared bias: what remains however many samples there are.
    pub bias_squared: Estimate,
    /// Variance of one render.
    pub variance: Estimate,
}

impl Decomposition {
    /// From the first `count` differences, at least two, from a reference of that variance, which is known up to that
    /// standard error.
    pub fn of(products: &Products, reference_variance: f64, uncertainty: f64, bootstrap: &Bootstrap) -> Option<Self> {
        let count = products.len();
        (count >= 2).then(|| {
            let estimate = |of: &dyn Fn(&[f64]) -> f64| by_renders(count, bootstrap, of);
            Self {
                total: widened(estimate(&|w| products.mean_square(w) - reference_variance), uncertainty),
                bias_squared: widened(estimate(&|w| products.mean_product(w) - reference_variance), uncertainty),
                variance: estimate(&|w| products.variance(w)),
            }
        })
    }

    /// Whether the bias is significantly above 0.
    pub fn is_biased(&self) -> bool {
        self.bias_squared.surely_above(0.0)
    }
}

/// A statistic of `count` renders, with an interval by resampling them if they are enough: it is given how often each
/// was drawn. Draws of only one render have no statistic and are left out.
pub fn by_renders(count: usize, bootstrap: &Bootstrap, statistic: impl Fn(&[f64]) -> f64) -> Estimate {
    let value = statistic(&vec![1.0; count]);
    let indices: Vec<f64> = (0..count).map(|k| k as f64).collect();
    let drawn = |indices: &[f64]| {
        let mut weights = vec![0.0; count];
        indices.iter().for_each(|k| weights[*k as usize] += 1.0);
        let drawn = statistic(&weights);
        if drawn.is_nan() { value } else { drawn }
    };
    bootstrap.estimate(&indices, drawn)
}

/// An estimate to which an independent error of that standard deviation is added.
pub fn widened(estimate: Estimate, deviation: f64) -> Estimate {
    let (value, more) = (estimate.value, TWO_SIDED_95 * deviation);
    let wider = |Interval { low, high }| Interval {
        low: value - (value - low).hypot(more),
        high: value + (high - value).hypot(more),
    };
    Estimate { value, interval: estimate.interval.map(wider) }
}

/// Pixels whose products a core computes at a time, so that the shared data stay in its cache.
const PART: usize = 1 << 11;
/// Parallel sums, more than a register has so that they do not wait for each other, and how many numbers each adds
/// before it is widened.
const LANES: usize = 16;
const RUN: usize = 32 * LANES;

/// A difference of images whose products with others, and with itself, are wanted. A pair stands for the difference of
/// its images.
#[derive(Debug, Clone)]
pub struct Departure<'a> {
    /// The difference.
    pub own: [&'a Image; 2],
    /// The others.
    pub others: Vec<[&'a Image; 2]>,
    /// Whether products without a weight are wanted too.
    pub absolute: bool,
}

impl<'a> Departure<'a> {
    /// The k-th of some differences, with all up to and including itself.
    pub fn among(k: usize, absolute: bool, pair: impl Fn(usize) -> [&'a Image; 2]) -> Self {
        Self { own: pair(k), others: (0..=k).map(pair).collect(), absolute }
    }
}

/// The results of a [`Departure`]: means over pixels and channels.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ProductRow {
    /// Of the difference.
    pub mean: f64,
    /// Of its product with each of the others, over the reference's radiance² + 0.01.
    pub relative: Vec<f64>,
    /// Of the same product without weight, if that is wanted.
    pub absolute: Vec<f64>,
}

impl ProductRow {
    fn of_zeros(departure: &Departure<'_>) -> Self {
        let zeros = vec![0.0; departure.others.len()];
        Self { mean: 0.0, absolute: if departure.absolute { zeros.clone() } else { Vec::new() }, relative: zeros }
    }

    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        std::iter::once(&mut self.mean).chain(&mut self.relative).chain(&mut self.absolute)
    }
}

/// The products of many differences in one pass over the images: memory bandwidth is what takes the time, and data that
/// several differences share are fetched once. Pixels of the reference that are not finite are left out.
pub fn products<'a>(departures: &[Departure<'a>], reference: &Image) -> Vec<ProductRow> {
    let parts = parallel::map_parts(&reference.pixels, PART, &|first, reference| {
        let finite = reference.iter().filter(|r| r.is_finite()).count();
        // Pixels that are left out are 0 in all of them.
        let kept = |(pixel, reference): (&Vec3, &Vec3)| if reference.is_finite() { *pixel } else { Vec3::ZERO };
        let part = |image: &'a Image| -> Cow<'a, [Vec3]> {
            let pixels = &image.pixels[first..][..reference.len()];
            if finite == reference.len() { pixels.into() } else { pixels.iter().zip(reference).map(kept).collect() }
        };
        let weights: Vec<Vec3> = reference.iter().map(|r| kept((&(r * r + DARK as f32).recip(), r))).collect();
        // With the widest registers that the processor has.
        let processor = pulp::Arch::new();
        let row = |Departure { own: [a, b], others, absolute }: &Departure<'a>| {
            let (a, b) = (part(a), part(b));
            let apart: Vec<f32> = floats(&a).iter().zip(floats(&b)).map(|(a, b)| a - b).collect();
            let weighted: Vec<f32> = apart.iter().zip(floats(&weights)).map(|(apart, weight)| apart * weight).collect();
            let mut row = ProductRow { mean: total(&apart), ..ProductRow::default() };
            for [a, b] in others {
                let (a, b) = (part(a), part(b));
                let sum = |weighted: &[f32]| processor.dispatch(|| sum(weighted, floats(&a), floats(&b)));
                row.relative.push(sum(&weighted));
                row.absolute.extend(absolute.then(|| sum(&apart)));
            }
            row
        };
        (departures.iter().map(row).collect::<Vec<_>>(), finite)
    });
    // Merged in their order: the same numbers on any number of cores.
    let mut rows: Vec<ProductRow> = departures.iter().map(ProductRow::of_zeros).collect();
    let mut numbers = 0.0;
    for (part, finite) in parts {
        numbers += 3.0 * finite as f64;
        for (row, mut more) in rows.iter_mut().zip(part) {
            row.numbers().zip(more.numbers()).for_each(|(sum, more)| *sum += *more);
        }
    }
    rows.iter_mut().flat_map(ProductRow::numbers).for_each(|sum| *sum /= numbers);
    rows
}

fn floats(pixels: &[Vec3]) -> &[f32] {
    bytemuck::cast_slice(pixels)
}

/// The sum of numbers, by several sums in parallel.
fn total(numbers: &[f32]) -> f64 {
    let (runs, rest) = numbers.as_chunks::<LANES>();
    let mut lanes = [0.0_f64; LANES];
    for run in runs {
        for i in 0..LANES {
            lanes[i] += f64::from(run[i]);
        }
    }
    lanes.iter().sum::<f64>() + rest.iter().map(|x| f64::from(*x)).sum::<f64>()
}

/// The sum of `weights` times the difference of `a` and `b`. Inlined to be compiled for the processor.
#[inline(always)]
fn sum(weights: &[f32], a: &[f32], b: &[f32]) -> f64 {
    let mut sum = 0.0;
    for (weights, (a, b)) in weights.chunks(RUN).zip(a.chunks(RUN).zip(b.chunks(RUN))) {
        let (weights, weights_rest) = weights.as_chunks::<LANES>();
        let (a, a_rest) = a.as_chunks::<LANES>();
        let (b, b_rest) = b.as_chunks::<LANES>();
        let mut lanes = [0.0_f32; LANES];
        for (weights, (a, b)) in weights.iter().zip(a.iter().zip(b)) {
            for i in 0..LANES {
                lanes[i] += weights[i] * (a[i] - b[i]);
            }
        }
        let rest = weights_rest.iter().zip(a_rest.iter().zip(b_rest)).map(|(weight, (a, b))| weight * (a - b));
        sum += lanes.into_iter().chain(rest).map(f64::from).sum::<f64>();
    }
    sum
}

impl Reference {
    /// Its own relMSE, and the standard error of the remainder of its noise in an estimate of squared bias.
    pub fn relative_noise(&self) -> (f64, f64) {
        let numbers = 3.0 * self.image.pixels.len() as f64;
        // The square of a normal number of variance v has variance 2 v². Channels share their paths.
        let uncertainty = |rms: f64| (2.0 * 3.0 / numbers).sqrt() * rms;
        self.noise.map_or((0.0, 0.0), |noise| (noise.relative_variance, uncertainty(noise.relative_variance_rms)))
    }

    /// The same of the absolute error.
    pub fn absolute_noise(&self) -> (f64, f64) {
        let (relative, uncertainty) = self.relative_noise();
        let variance = self.noise.map_or(0.0, |noise| noise.variance);
        (variance, if relative > 0.0 { uncertainty * variance / relative } else { 0.0 })
    }
}
