//! What can be wrong with a list of repeated timings: outliers and drift.

use crate::stats::{Moments, SplitMix64, mean, median};

/// |modified z| above which a run is an outlier.
///
/// Source: Iglewicz and Hoaglin, "How to Detect and Handle Outliers" (1993), section 3.2.
const OUTLIER_Z: f64 = 3.5;

/// Permutations drawn to find the p-value of a trend; the smallest p is 1 / (this number + 1).
const PERMUTATIONS: usize = 9_999;

/// How far each value is from the median, in units that are standard deviations if the values are
/// normal, and that outliers cannot stretch: 0.6745 (x - median) / MAD, MAD being the median of
/// |x - median|.
///
/// If more than half of the values are equal MAD is 0 and the mean of |x - median| replaces it, scaled alike; if all
/// are equal every z is 0.
///
/// Source: Iglewicz and Hoaglin (1993), section 3.2.
pub fn modified_z_scores(values: &[f64]) -> Vec<f64> {
    let middle = median(values);
    let distances: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    let (by_median, by_mean) = (median(&distances) / 0.6745, mean(&distances) * 1.253_314);
    let scale = if by_median > 0.0 { by_median } else { by_mean };
    values.iter().map(|value| if scale > 0.0 { (value - middle) / scale } else { 0.0 }).collect()
}

/// Indices of values whose modified z-score is beyond 3.5, in ascending order.
pub fn outliers(values: &[f64]) -> Vec<usize> {
    let scores = modified_z_scores(values);
    (0..values.len()).filter(|&i| scores[i].abs() > OUTLIER_Z).collect()
}

/// Spearman's rank correlation of two lists of one length, in [-1, 1]; NaN if either has fewer than two different
/// values. Equal values share the mean of their ranks.
pub fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    correlation(&ranks(a), &ranks(b))
}

/// Whether values rise or fall with their position: Spearman's rank correlation with it, and the
/// two-sided p-value of such a correlation or a stronger one if their order were by chance.
///
/// The p-value is by random permutation (seeded, so it can be repeated) and holds for any distribution and any number
/// of values; with fewer than six it is never below 0.01. It is 1 if there is no correlation.
pub fn trend(values: &[f64]) -> (f64, f64) {
    let positions: Vec<f64> = (0..values.len()).map(|i| i as f64).collect();
    let mut ranks = ranks(values);
    let observed = correlation(&ranks, &positions);
    if !observed.is_finite() {
        return (observed, 1.0);
    }
    let mut random = SplitMix64::new(0);
    // A permutation of the same ranks counts as equal despite rounding.
    let bar = observed.abs() - 1e-12;
    let as_strong = (0..PERMUTATIONS)
        .filter(|_| {
            shuffle(&mut ranks, &mut random);
            correlation(&ranks, &positions).abs() >= bar
        })
        .count();
    (observed, (as_strong + 1) as f64 / (PERMUTATIONS + 1) as f64)
}

/// Puts a list into a random order, every order as likely as any other (Fisher and Yates; Knuth,
/// TAOCP 2, algorithm P).
pub fn shuffle<T>(list: &mut [T], random: &mut SplitMix64) {
    for i in (1..list.len()).rev() {
        list.swap(i, random.next_index(i + 1));
    }
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    for tied in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let rank = first as f64 + (tied.len() - 1) as f64 / 2.0;
        tied.iter().for_each(|&i| ranks[i] = rank);
        first += tied.len();
    }
    ranks
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let moments = |values: &[f64]| Moments::from_iter(values.iter().copied());
    let (a_moments, b_moments) = (moments(a), moments(b));
    let products = a.iter().zip(b).map(|(a, b)| (a - a_moments.mean()) * (b - b_moments.mean()));
    let covariance = products.sum::<f64>() / (a.len() as f64 - 1.0);
    covariance / (a_moments.variance() * b_moments.variance()).sqrt()
}
