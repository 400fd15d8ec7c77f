//! Confidence intervals by resampling.

use serde::ser::{Serialize, SerializeStruct, Serializer};

use super::summary::{median, quantile_of_sorted};

/// A small generator of uniform random numbers, the same on every machine.
///
/// Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014;
/// constants of Vigna's splitmix64.c.
#[derive(Debug, Clone)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// A generator whose numbers depend on the seed alone.
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

    /// The next index in 0..`len`, by Lemire's multiplication. Its bias, below len / 2^64, is far
    /// under what any number of draws could show.
    pub fn next_index(&mut self, len: usize) -> usize {
        ((u128::from(self.next_u64()) * len as u128) >> 64) as usize
    }
}

/// What is said of a quantity that was not measured often enough for an interval.
pub const TOO_FEW_ROUNDS: &str = "too few rounds";

/// A value and, where it was measured often enough, the interval that covers the true one with the
/// stated confidence. As JSON: `value`, `low`, `high`, and `verdict`, which is "too few rounds" where
/// there is no interval, and else null.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The statistic of the sample itself.
    pub value: f64,
    /// `None` of a sample that is too small to hold the confidence.
    pub interval: Option<Interval>,
}

/// From where to where the true value lies, with the stated confidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Estimate {
    /// Whether the true value is below that one, as surely as the interval is.
    pub fn surely_below(&self, bound: f64) -> bool {
        self.interval.is_some_and(|interval| interval.high < bound)
    }

    /// Whether the true value is above that one, as surely as the interval is.
    pub fn surely_above(&self, bound: f64) -> bool {
        self.interval.is_some_and(|interval| interval.low > bound)
    }

    /// Width of the interval as a share of the value; infinite where there is none.
    pub fn relative_width(&self) -> f64 {
        self.interval.map_or(f64::INFINITY, |Interval { low, high }| (high - low) / self.value)
    }

    /// Lower end of the interval, or the value where there is none: for the range of a plot.
    pub fn lowest(&self) -> f64 {
        self.interval.map_or(self.value, |interval| interval.low)
    }

    /// Upper end of the interval, or the value where there is none: for the range of a plot.
    pub fn highest(&self) -> f64 {
        self.interval.map_or(self.value, |interval| interval.high)
    }
}

impl Serialize for Estimate {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_struct("Estimate", 4)?;
        fields.serialize_field("value", &self.value)?;
        fields.serialize_field("low", &self.interval.map(|interval| interval.low))?;
        fields.serialize_field("high", &self.interval.map(|interval| interval.high))?;
        fields.serialize_field("verdict", &self.interval.is_none().then_some(TOO_FEW_ROUNDS))?;
        fields.end()
    }
}

/// The percentile bootstrap: the statistic of many resamples, drawn with replacement, and its
/// quantiles.
///
/// Source: Efron and Tibshirani, "An Introduction to the Bootstrap" (1993), chapter 13. It asks for
/// no distribution, but it cannot see beyond the sample. So a sample whose very range would not hold
/// the median with the confidence has no interval ([`Bootstrap::enough`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bootstrap {
    /// Share of intervals that cover the true value, in (0, 1).
    pub confidence: f64,
    /// Resamples drawn, at least 1.
    pub resamples: usize,
    /// Seed of the resampling. The same seed gives the same interval.
    pub seed: u64,
}

impl Default for Bootstrap {
    /// 95 % by 10,000 resamples.
    fn default() -> Self {
        Self { confidence: 0.95, resamples: 10_000, seed: 0 }
    }
}

impl Bootstrap {
    /// Fewest values that can hold the confidence: the range of n values leaves the median of their
    /// distribution out with a probability of 2^(1 - n), so that 95 % takes six.
    pub fn enough(&self) -> usize {
        (1.0 - (1.0 - self.confidence).log2()).ceil() as usize
    }

    /// The median of the values; NaN of none.
    pub fn median(&self, values: &[f64]) -> Estimate {
        self.estimate([values], |[values]| median(values))
    }

    /// The median of `numerator` over the median of `denominator`, two samples that were drawn
    /// independently: how many times as long one takes as the other.
    pub fn ratio_of_medians(&self, numerator: &[f64], denominator: &[f64]) -> Estimate {
        self.estimate([numerator, denominator], |[numerator, denominator]| median(numerator) / median(denominator))
    }

    /// Any statistic of independent samples, each resampled by itself. There is no interval where one of
    /// them has fewer values than [`Bootstrap::enough`].
    ///
    /// # Panics
    ///
    /// When `confidence` or `resamples` is out of range.
    pub fn estimate<const N: usize>(&self, samples: [&[f64]; N], statistic: impl Fn([&[f64]; N]) -> f64) -> Estimate {
        assert!(
            self.confidence > 0.0 && self.confidence < 1.0 && self.resamples > 0,
            "a bootstrap needs a confidence in (0, 1) and at least one resample: {self:?}"
        );
        let value = statistic(samples);
        if samples.iter().any(|sample| sample.len() < self.enough()) {
            return Estimate { value, interval: None };
        }
        let mut random = SplitMix64::new(self.seed);
        let mut resamples = samples.map(<[f64]>::to_vec);
        let mut statistics: Vec<f64> = (0..self.resamples)
            .map(|_| {
                for (resample, sample) in resamples.iter_mut().zip(samples) {
                    resample.fill_with(|| sample[random.next_index(sample.len())]);
                }
                statistic(resamples.each_ref().map(Vec::as_slice))
            })
            .collect();
        statistics.sort_unstable_by(f64::total_cmp);
        let tail = (1.0 - self.confidence) / 2.0;
        let (low, high) = (quantile_of_sorted(&statistics, tail), quantile_of_sorted(&statistics, 1.0 - tail));
        Estimate { value, interval: Some(Interval { low, high }) }
    }
}
