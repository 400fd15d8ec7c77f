//! Estimates with confidence intervals, and those of medians.

use serde::ser::{Serialize, SerializeStruct, Serializer};
use statrs::distribution::{Binomial, DiscreteCDF};

use super::summary::median;

/// Share of intervals that cover the true value, at least.
pub const CONFIDENCE: f64 = 0.95;
/// Fewest values whose interval can have [`CONFIDENCE`]: the range of n values misses the median of their distribution
/// with a probability of 2^(1 - n).
pub const FEWEST_ROUNDS: usize = 6;
/// The verdict on a quantity that was not measured often enough for an interval.
pub const TOO_FEW_ROUNDS: &str = "too few rounds";

/// A value and, if it was measured often enough, the interval that covers the true one with the stated confidence. As
/// JSON: `value`, `low`, `high`, and `verdict`, which is "too few rounds" if there is no interval, otherwise null.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The statistic of the sample itself.
    pub value: f64,
    /// `None` for a sample that is too small for the confidence.
    pub interval: Option<Interval>,
}

/// The range that covers the true value with the stated confidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Estimate {
    /// The median of independent values of one distribution, NaN without values, with an interval that covers the
    /// median of the distribution with at least [`CONFIDENCE`], whatever the distribution is.
    ///
    /// It runs from the k-th least value to the k-th greatest, with the largest k that keeps the promise: the median is
    /// below the former, or above the latter, with the probability that fewer than k of n coin tosses are heads. Since
    /// k is an integer, small samples cover with more than was promised: 96.9 % for six, 98.4 % for seven.
    ///
    /// Source: David and Nagaraja, "Order Statistics" (2003), section 7.1; the interval belongs to the sign test.
    pub fn of_median(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let interval =
            median_rank(sorted.len()).map(|rank| Interval { low: sorted[rank - 1], high: sorted[sorted.len() - rank] });
        Self { value: median(values), interval }
    }

    /// Whether the true value is below that one, with the interval's confidence.
    pub fn surely_below(&self, bound: f64) -> bool {
        self.interval.is_some_and(|interval| interval.high < bound)
    }

    /// Whether the true value is above that one, with the interval's confidence.
    pub fn surely_above(&self, bound: f64) -> bool {
        self.interval.is_some_and(|interval| interval.low > bound)
    }

    /// Width of the interval as a share of the value; infinite without an interval.
    pub fn relative_width(&self) -> f64 {
        self.interval.map_or(f64::INFINITY, |Interval { low, high }| (high - low) / self.value)
    }

    /// Lower end of the interval, or the value without one: for the range of a plot.
    pub fn lowest(&self) -> f64 {
        self.interval.map_or(self.value, |interval| interval.low)
    }

    /// Upper end of the interval, or the value without one: for the range of a plot.
    pub fn highest(&self) -> f64 {
        self.interval.map_or(self.value, |interval| interval.high)
    }
}

/// The rank, from 1, of the value of `count` ascending ones at which the interval of their median begins; `None` if not
/// even the least is far enough out.
fn median_rank(count: usize) -> Option<usize> {
    let heads = Binomial::new(0.5, count as u64).expect("a coin is a fair one");
    let tail = (1.0 - CONFIDENCE) / 2.0;
    let rank = (0..count as u64).take_while(|fewer| heads.cdf(*fewer) <= tail).count();
    (rank > 0).then_some(rank)
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
