//! Tests of hypotheses: normal, chi-square, and the correction for many tests at once.

use statrs::{
    distribution::{ContinuousCDF, Normal},
    function::{erf::erfc, gamma::gamma_ur},
};

/// Fewest counts expected in a cell for the chi-square approximation to hold (Cochran 1954).
const MIN_EXPECTED: f64 = 5.0;

/// The standard normal distribution function.
pub fn normal_cdf(z: f64) -> f64 {
    0.5 * erfc(-z / std::f64::consts::SQRT_2)
}

/// The z below which a standard normal number lies with probability `p` in [0, 1]; infinite at
/// the ends.
///
/// # Panics
///
/// When `p` is outside [0, 1].
pub fn normal_quantile(p: f64) -> f64 {
    Normal::standard().inverse_cdf(p)
}

/// A deviation in standard errors and how likely one as large is by chance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZTest {
    /// Deviation over its standard error.
    pub z: f64,
    /// Two-sided p-value: the probability of |z| or more if the true deviation is zero.
    pub p: f64,
}

/// Tests whether a deviation is zero, given its standard error, by the normal distribution.
///
/// Two estimates are compared by their difference and sqrt(e1² + e2²). If the standard error is zero, a deviation of
/// zero gives z = 0, any other infinity.
pub fn z_test(deviation: f64, standard_error: f64) -> ZTest {
    let z = if deviation == 0.0 && standard_error == 0.0 { 0.0 } else { deviation / standard_error };
    // erfc keeps its digits far out in the tail, where 1 - cdf loses them all.
    let p = erfc(z.abs() / std::f64::consts::SQRT_2);
    ZTest { z, p }
}

/// The level that each of `tests` independent tests must be held to for all of them together to
/// reject a true hypothesis with probability `level`: 1 - (1 - level)^(1 / tests).
///
/// Source: Šidák, "Rectangular confidence regions for the means of multivariate normal
/// distributions", JASA 62 (1967).
pub fn sidak_level(level: f64, tests: usize) -> f64 {
    // exp(ln) with the 1 split off: for a million pixels the level is near the rounding of 1.
    -((-level).ln_1p() / tests as f64).exp_m1()
}

/// The p-value of the smallest of `tests` independent p-values: 1 - (1 - p)^tests, the inverse of
/// [`sidak_level`].
pub fn sidak_adjusted(smallest_p: f64, tests: usize) -> f64 {
    -((-smallest_p).ln_1p() * tests as f64).exp_m1()
}

/// The outcome of a chi-square test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChiSquare {
    /// Sum over the cells of (observed - expected)² / expected.
    pub statistic: f64,
    /// Cells after pooling, less one.
    pub degrees_of_freedom: usize,
    /// Probability of such a statistic or a larger one if the counts follow what was expected.
    pub p: f64,
}

/// Pearson's test of goodness of fit: do the counts `observed` follow `expected`?
///
/// Bins with fewer than five expected counts are pooled, smallest first, until every cell has five; which bins share a
/// cell depends only on the expectation. The expected counts must add up to the observed number. With fewer than two
/// cells there is nothing to test and p is 1. A count in a cell where exactly none was expected is impossible: the
/// statistic is infinite and p is 0.
///
/// # Panics
///
/// When the lists differ in length, or a count is negative or not finite.
pub fn chi_square(observed: &[f64], expected: &[f64]) -> ChiSquare {
    assert_eq!(observed.len(), expected.len(), "each bin has an observed and an expected count");
    let counts = |list: &[f64]| list.iter().all(|&n| n >= 0.0 && n.is_finite());
    assert!(counts(observed) && counts(expected), "counts are finite and at least 0");
    let cells = pool(observed, expected);
    let degrees_of_freedom = cells.len().saturating_sub(1);
    let impossible = observed.iter().zip(expected).any(|(&o, &e)| e == 0.0 && o > 0.0);
    if impossible {
        return ChiSquare { statistic: f64::INFINITY, degrees_of_freedom, p: 0.0 };
    }
    let statistic: f64 = cells.iter().map(|(o, e)| (o - e).powi(2) / e).sum();
    let p = if degrees_of_freedom == 0 || statistic == 0.0 {
        1.0
    } else {
        // The upper tail of chi-square is the upper regularised incomplete gamma function.
        gamma_ur(degrees_of_freedom as f64 / 2.0, statistic / 2.0)
    };
    ChiSquare { statistic, degrees_of_freedom, p }
}

/// Observed and expected counts of cells that each expect at least [`MIN_EXPECTED`], if there are
/// enough counts for even one.
fn pool(observed: &[f64], expected: &[f64]) -> Vec<(f64, f64)> {
    let mut bins: Vec<_> = observed.iter().copied().zip(expected.iter().copied()).collect();
    bins.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut cells = Vec::new();
    let mut open = (0.0, 0.0);
    for (o, e) in bins {
        open = (open.0 + o, open.1 + e);
        if open.1 >= MIN_EXPECTED {
            cells.push(std::mem::take(&mut open));
        }
    }
    // The rest expects too few counts for a cell of its own.
    if let Some(last) = cells.last_mut() {
        *last = (last.0 + open.0, last.1 + open.1);
    }
    cells
}
