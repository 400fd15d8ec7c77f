//! Confidence intervals by resampling.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

use super::estimate::{CONFIDENCE, Estimate, FEWEST_ROUNDS, Interval};
use super::summary::quantile_of_sorted;

/// A small generator of uniform random numbers, the same on every machine.
///
/// Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014;
/// constants of Vigna's splitmix64.c.
#[derive(Debug, Clone)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// A generator whose numbers depend only on the seed.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// The next 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// The next number in [0, 1), a multiple of 2^-53.
    pub fn next_f64(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// The next index in 0..`len`, by Lemire's multiplication. Its bias, below len / 2^64, is far below what any number
    /// of draws could show.
    pub fn next_index(&mut self, len: usize) -> usize {
        ((u128::from(self.next_u64()) * len as u128) >> 64) as usize
    }
}

/// The expanded percentile bootstrap: the statistic of many resamples, drawn with replacement, and its quantiles.
/// Resamples of few values scatter less than samples do, so it takes quantiles further out, as far as the mean of
/// normal values needs.
///
/// Source: Efron and Tibshirani, "An Introduction to the Bootstrap" (1993), chapter 13; Hesterberg, "What Teachers
/// Should Know About the Bootstrap", The American Statistician 69 (2015) for the expansion. It assumes no distribution,
/// but it cannot see beyond the sample. Medians do not need it: see [`Estimate::of_median`]. Fewer than
/// [`FEWEST_ROUNDS`] values have no interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bootstrap {
    /// Resamples drawn, at least 1.
    pub resamples: usize,
    /// Seed of the resampling. The same seed gives the same interval.
    pub seed: u64,
}

impl Default for Bootstrap {
    /// 10,000 resamples.
    fn default() -> Self {
        Self { resamples: 10_000, seed: 0 }
    }
}

impl Bootstrap {
    /// Any statistic of independent values. Fewer than [`FEWEST_ROUNDS`] have no interval.
    ///
    /// # Panics
    ///
    /// When there are no resamples.
    pub fn estimate(&self, sample: &[f64], statistic: impl Fn(&[f64]) -> f64) -> Estimate {
        assert!(self.resamples > 0, "a bootstrap needs at least one resample");
        let value = statistic(sample);
        if sample.len() < FEWEST_ROUNDS {
            return Estimate { value, interval: None };
        }
        let mut random = SplitMix64::new(self.seed);
        let mut resample = sample.to_vec();
        let mut statistics: Vec<f64> = (0..self.resamples)
            .map(|_| {
                resample.fill_with(|| sample[random.next_index(sample.len())]);
                statistic(&resample)
            })
            .collect();
        statistics.sort_unstable_by(f64::total_cmp);
        let tail = tail(sample.len());
        let (low, high) = (quantile_of_sorted(&statistics, tail), quantile_of_sorted(&statistics, 1.0 - tail));
        Estimate { value, interval: Some(Interval { low, high }) }
    }
}

/// The share of the resamples of `count` values that an interval excludes on either side.
fn tail(count: usize) -> f64 {
    let n = count as f64;
    let student = StudentsT::new(0.0, 1.0, n - 1.0).expect("there are two values");
    let normal = Normal::standard();
    normal.cdf(student.inverse_cdf((1.0 - CONFIDENCE) / 2.0) * (n / (n - 1.0)).sqrt())
}
