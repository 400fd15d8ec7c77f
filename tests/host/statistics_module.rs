//! The statistics by which renders and timings are judged, judged themselves: against tables,
//! against other formulas, and by simulation of what they promise.

use glam::{Vec3, vec3};
use proptest::prelude::*;
use raywave::image::Image;
use raywave_studies::stats::{
    Bootstrap, CONFIDENCE, Estimate, FEWEST_ROUNDS, Interval, Moments, SplitMix64, chi_square, compare_images, mean,
    median, normal_cdf, normal_quantile, quantile, relative_squared_error, sidak_adjusted, sidak_level, standard_error,
    test_pixels, variance, z_test,
};

fn assert_close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b} within {tolerance}");
}

/// A standard normal number.
fn normal(random: &mut SplitMix64) -> f64 {
    normal_quantile(random.next_f64().max(f64::MIN_POSITIVE))
}

/// The share of `trials` in which `event` happens, and the standard error of such a share where
/// the probability is `p`.
fn share(trials: u32, p: f64, mut event: impl FnMut() -> bool) -> (f64, f64) {
    let happened = (0..trials).filter(|_| event()).count() as f64;
    let trials = f64::from(trials);
    (happened / trials, (p * (1.0 - p) / trials).sqrt())
}

// Summaries

#[test]
fn mean_and_variance_of_known_lists() {
    let values = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0];
    assert_close(mean(&values), 5.0, 1e-15);
    assert_close(variance(&values), 32.0 / 7.0, 1e-14);
    assert_close(standard_error(&values), (32.0f64 / 7.0 / 8.0).sqrt(), 1e-14);
    assert_eq!(median(&values), 4.5);
    assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
}

#[test]
fn quantiles_interpolate_as_numpy_does() {
    let values = [40.0, 15.0, 35.0, 20.0, 50.0];
    for (q, expected) in [(0.0, 15.0), (0.05, 16.0), (0.25, 20.0), (0.4, 29.0), (1.0, 50.0)] {
        assert_close(quantile(&values, q), expected, 1e-12);
    }
    assert_eq!(quantile(&[7.0], 0.3), 7.0);
    assert_eq!(quantile(&[1.0, f64::INFINITY, f64::INFINITY], 0.9), f64::INFINITY);
}

#[test]
fn too_few_values_are_nan() {
    for value in [mean(&[]), median(&[]), variance(&[]), variance(&[1.0])] {
        assert!(value.is_nan());
    }
    assert!(standard_error(&[1.0]).is_nan());
    assert!(median(&[1.0, f64::NAN, 2.0]).is_nan());
    assert!(median(&[1.0, -f64::NAN, 2.0]).is_nan());
    assert_eq!(mean(&[3.0]), 3.0);
}

#[test]
#[should_panic(expected = "a quantile is in [0, 1]")]
fn quantiles_outside_the_unit_interval_panic() {
    quantile(&[1.0], 1.5);
}

#[test]
fn variance_survives_a_large_offset() {
    // Raw sums of squares would lose every digit of the variance here.
    let values: Vec<f64> = [4.0, 7.0, 13.0, 16.0].map(|v| v + 1e9).to_vec();
    assert_close(variance(&values), 30.0, 1e-9);
}

proptest! {
    #[test]
    fn merged_moments_are_moments_of_all(
        a in prop::collection::vec(-1e3..1e3f64, 0..40),
        b in prop::collection::vec(-1e3..1e3f64, 2..40),
    ) {
        let mut merged: Moments = a.iter().copied().collect();
        merged.merge(&b.iter().copied().collect());
        let all: Moments = a.iter().chain(&b).copied().collect();
        prop_assert_eq!(merged.count(), all.count());
        prop_assert!((merged.mean() - all.mean()).abs() < 1e-9);
        prop_assert!((merged.variance() / all.variance() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn quantiles_rise_and_stay_in_range(
        values in prop::collection::vec(-1e3..1e3f64, 1..40), p in 0.0..1.0f64, q in 0.0..1.0f64,
    ) {
        let (low, high) = (quantile(&values, p.min(q)), quantile(&values, p.max(q)));
        prop_assert!(low <= high);
        prop_assert!(quantile(&values, 0.0) <= low && high <= quantile(&values, 1.0));
    }
}

// Tests of hypotheses

#[test]
fn the_normal_distribution_has_its_table_values() {
    for (z, p) in [
        (0.0, 0.5),
        (1.0, 0.841_344_746_068_543),
        (1.959_963_984_540_054, 0.975),
        (-3.0, 0.001_349_898_031_630_09),
        (-8.0, 6.220_960_574_271_78e-16),
    ] {
        assert_close(normal_cdf(z) / p, 1.0, 1e-9);
        assert_close(normal_quantile(p), z, 1e-9);
    }
    assert_eq!(normal_quantile(0.0), f64::NEG_INFINITY);
    assert_eq!(normal_quantile(1.0), f64::INFINITY);
}

#[test]
fn z_tests_have_their_table_values() {
    for (z, p) in [
        (0.0, 1.0),
        (1.0, 0.317_310_507_862_914),
        (2.575_829_303_548_901, 0.01),
        (5.0, 5.733_031_437_583_87e-7),
        (10.0, 1.523_970_604_832_1e-23),
    ] {
        for sign in [1.0, -1.0] {
            let test = z_test(sign * z * 0.25, 0.25);
            assert_eq!(test.z, sign * z);
            assert_close(test.p / p, 1.0, 1e-9);
        }
    }
    let certain = z_test(1.0, 0.0);
    assert_eq!((certain.z, certain.p), (f64::INFINITY, 0.0));
    let nothing = z_test(0.0, 0.0);
    assert_eq!((nothing.z, nothing.p), (0.0, 1.0));
    assert!(z_test(f64::NAN, 1.0).p.is_nan());
}

#[test]
fn sidak_shares_a_level_among_tests() {
    assert_close(sidak_level(0.05, 1), 0.05, 1e-15);
    assert_close(sidak_level(0.05, 10), 0.005_116_196_891_823_74, 1e-15);
    // So many tests that 1 - level rounds to 1.
    let tests = 10_000_000;
    assert_close(sidak_level(0.01, tests) * tests as f64, -(0.99f64.ln()), 1e-8);
    for tests in [1, 3, 10_000_000] {
        assert_close(sidak_adjusted(sidak_level(0.01, tests), tests), 0.01, 1e-12);
    }
    assert_eq!(sidak_adjusted(0.0, 5), 0.0);
    assert_eq!(sidak_adjusted(1.0, 5), 1.0);
}

#[test]
fn sidak_keeps_the_level_of_many_tests() {
    let mut random = SplitMix64::new(1);
    let level = sidak_level(0.1, 20);
    let (rejected, error) = share(5000, 0.1, || (0..20).any(|_| z_test(normal(&mut random), 1.0).p < level));
    assert_close(rejected, 0.1, 4.0 * error);
}

#[test]
fn chi_square_has_its_table_values() {
    // Two cells, statistic 3.841...: the 95 % point of one degree of freedom.
    let apart = (3.841_458_820_694_124f64 / 2.0 * 100.0).sqrt();
    let test = chi_square(&[100.0 + apart, 100.0 - apart], &[100.0, 100.0]);
    assert_eq!(test.degrees_of_freedom, 1);
    assert_close(test.statistic, 3.841_458_820_694_124, 1e-12);
    assert_close(test.p, 0.05, 1e-10);

    // A die thrown 60 times: 13.4 on 5 degrees of freedom.
    let test = chi_square(&[5.0, 8.0, 9.0, 8.0, 10.0, 20.0], &[10.0; 6]);
    assert_eq!(test.degrees_of_freedom, 5);
    assert_close(test.statistic, 13.4, 1e-12);
    assert_close(test.p, 0.019_905_220, 1e-8);

    // With two degrees of freedom p is exp(-x / 2), far into the tail.
    let test = chi_square(&[1300.0, 850.0, 850.0], &[1000.0; 3]);
    assert_close(test.p.ln(), -test.statistic / 2.0, 1e-9);
}

/// With thousands of cells, as in a sampler's test, against the cube-root normal approximation of
/// Wilson and Hilferty (1931).
#[test]
fn chi_square_holds_for_many_cells() {
    for cells in [500, 4000, 300_000] {
        let wilson_hilferty = |statistic: f64, dof: f64| {
            let v = 2.0 / (9.0 * dof);
            normal_cdf(-((statistic / dof).cbrt() - (1.0 - v)) / v.sqrt())
        };
        for apart in [0.01, 5.0, 9.9, 10.0, 10.2, 11.0, 30.0] {
            let observed: Vec<f64> = (0..cells).map(|i| 100.0 + apart * f64::from(i % 2 * 2 - 1)).collect();
            let test = chi_square(&observed, &vec![100.0; cells as usize]);
            let expected = wilson_hilferty(test.statistic, test.degrees_of_freedom as f64);
            assert_close(test.p, expected, 1e-4);
        }
    }
}

#[test]
fn chi_square_pools_bins_that_expect_little() {
    // Sorted: 1 + 2 + 3 make a cell of 6, then 10, 20; the order of the bins is no matter.
    let test = chi_square(&[12.0, 4.0, 18.0, 1.0, 1.0], &[10.0, 3.0, 20.0, 1.0, 2.0]);
    assert_eq!(test.degrees_of_freedom, 2);
    assert_close(test.statistic, 0.4 + 0.2, 1e-12);
    // The tail end of 4 is too little for a cell and joins the last.
    let test = chi_square(&[5.0, 5.0, 4.0], &[2.5, 2.5, 4.0]);
    assert_eq!(test.degrees_of_freedom, 0);
    assert_eq!(test.p, 1.0);
    assert_eq!(chi_square(&[], &[]).p, 1.0);
    assert_eq!(chi_square(&[3.0], &[3.0]).p, 1.0);
}

#[test]
fn chi_square_rejects_the_impossible() {
    let test = chi_square(&[50.0, 50.0, 1.0], &[50.0, 51.0, 0.0]);
    assert_eq!((test.statistic, test.p), (f64::INFINITY, 0.0));
    let test = chi_square(&[50.0, 50.0, 0.0], &[50.0, 50.0, 0.0]);
    assert_eq!((test.statistic, test.p), (0.0, 1.0));
}

/// Counts of `draws` numbers over bins with the given weights.
fn throw(random: &mut SplitMix64, weights: &[f64], draws: usize) -> Vec<f64> {
    let total: f64 = weights.iter().sum();
    let mut counts = vec![0.0; weights.len()];
    for _ in 0..draws {
        let mut u = random.next_f64() * total;
        let bin = weights.iter().position(|w| {
            u -= w;
            u < 0.0
        });
        counts[bin.unwrap_or(weights.len() - 1)] += 1.0;
    }
    counts
}

#[test]
fn chi_square_p_values_are_uniform_when_all_is_well_and_small_when_not() {
    let mut random = SplitMix64::new(2);
    // Bins from plenty to far below five counts, so that pooling takes part.
    let weights: Vec<f64> = (0..30).map(|i| 0.8f64.powi(i)).collect();
    let total: f64 = weights.iter().sum();
    let draws = 1000;
    let expected: Vec<f64> = weights.iter().map(|w| w / total * draws as f64).collect();
    let trials = 2000;
    let mut deciles = [0.0; 10];
    for _ in 0..trials {
        let p = chi_square(&throw(&mut random, &weights, draws), &expected).p;
        deciles[((p * 10.0) as usize).min(9)] += 1.0;
    }
    let uniform = chi_square(&deciles, &[f64::from(trials) / 10.0; 10]);
    assert!(uniform.p > 1e-4, "{deciles:?} {uniform:?}");

    let skewed: Vec<f64> = (0..30).map(|i| 0.77f64.powi(i)).collect();
    let p =
        chi_square(&throw(&mut random, &skewed, 20 * draws), &expected.iter().map(|e| e * 20.0).collect::<Vec<_>>()).p;
    assert!(p < 1e-6, "{p}");
}

// The generator

#[test]
fn splitmix64_gives_its_published_numbers() {
    let mut random = SplitMix64::new(1_234_567);
    let first: Vec<u64> = (0..5).map(|_| random.next_u64()).collect();
    assert_eq!(
        first,
        [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ]
    );
}

#[test]
fn splitmix64_is_uniform_over_indices_and_the_unit_interval() {
    let mut random = SplitMix64::new(3);
    let mut indices = [0.0; 13];
    let mut tenths = [0.0; 10];
    for _ in 0..100_000 {
        indices[random.next_index(13)] += 1.0;
        let x = random.next_f64();
        assert!((0.0..1.0).contains(&x));
        tenths[(x * 10.0) as usize] += 1.0;
    }
    assert!(chi_square(&indices, &[100_000.0 / 13.0; 13]).p > 1e-4, "{indices:?}");
    assert!(chi_square(&tenths, &[10_000.0; 10]).p > 1e-4, "{tenths:?}");
}

// Intervals

#[test]
fn medians_lie_between_order_statistics() {
    // The k-th least and greatest of n: the most that 2 P(fewer than k heads of n coins) <= 5 % allows, as in the tables of
    // the sign test (Conover, "Practical Nonparametric Statistics", 1999, table A3).
    for (n, k) in [(6, 1), (7, 1), (8, 1), (9, 2), (11, 2), (12, 3), (14, 3), (15, 4), (17, 5), (20, 6), (50, 18)] {
        // In an order of no consequence.
        let values: Vec<f64> = (0..n).map(|i| f64::from(i * 7 % n) + 1.0).collect();
        let values = if n % 7 == 0 { (1..=n).map(f64::from).collect() } else { values };
        let estimate = Estimate::of_median(&values);
        assert_eq!(estimate.value, median(&values));
        let Interval { low, high } = estimate.interval.expect("six are enough");
        assert_eq!((low, high), (f64::from(k), f64::from(n + 1 - k)), "{n}");
    }
    // A number of rounds at which powers of two underflow.
    let many = Estimate::of_median(&(0..3000).map(f64::from).collect::<Vec<_>>()).interval.expect("3000 are enough");
    assert!((many.low - (1500.0 - 0.98 * 3000_f64.sqrt())).abs() < 2.0, "{many:?}");
}

#[test]
fn no_interval_is_claimed_of_fewer_values_than_hold_it() {
    // The range of n values leaves the median out with a probability of 2^(1 - n).
    assert!(0.5_f64.powi(FEWEST_ROUNDS as i32 - 1) <= 1.0 - CONFIDENCE);
    assert!(0.5_f64.powi(FEWEST_ROUNDS as i32 - 2) > 1.0 - CONFIDENCE);
    for n in 0..12 {
        let values: Vec<f64> = (0..n).map(|i| i as f64).collect();
        let bootstrapped = Bootstrap { resamples: 10, seed: 0 }.estimate(&values, mean);
        for estimate in [Estimate::of_median(&values), bootstrapped] {
            assert_eq!(estimate.interval.is_some(), n >= FEWEST_ROUNDS, "{n}");
            assert!(n > 0 || estimate.value.is_nan());
        }
    }
    let few = Estimate::of_median(&[1.75, 2.25]);
    assert!(!few.surely_above(1.0) && !few.surely_below(3.0) && few.relative_width() == f64::INFINITY);
    let json = serde_json::to_value(few).expect("it becomes JSON");
    assert_eq!(json, serde_json::json!({ "value": 2.0, "low": null, "high": null, "verdict": "too few rounds" }));
    let json = serde_json::to_value(Estimate::of_median(&[2.0; 6])).expect("it becomes JSON");
    assert_eq!(json, serde_json::json!({ "value": 2.0, "low": 2.0, "high": 2.0, "verdict": null }));
}

/// Intervals of medians hold what they say from the fewest rounds on, however the times are spread.
#[test]
fn intervals_of_medians_cover_as_they_say() {
    type Draw = fn(&mut SplitMix64) -> f64;
    let distributions: [(&str, f64, Draw); 5] = [
        ("normal", 3.0, |random| 3.0 + normal(random)),
        ("exponential", std::f64::consts::LN_2, |random| -(1.0 - random.next_f64()).ln()),
        ("lognormal", 1.0, |random| (0.5 * normal(random)).exp()),
        // Most times are alike and one in five is disturbed.
        ("disturbed", 1.0 + 0.1 * (0.5 / 0.8), |random| {
            let disturbed = if random.next_index(5) == 0 { 1.0 + 9.0 * random.next_f64() } else { 0.0 };
            1.0 + 0.1 * random.next_f64() + disturbed
        }),
        // Tails without a mean.
        ("Cauchy", 0.0, |random| (std::f64::consts::PI * (random.next_f64() - 0.5)).tan()),
    ];
    let mut random = SplitMix64::new(5);
    for (name, truth, draw) in distributions {
        for n in FEWEST_ROUNDS..=20 {
            let (covered, error) = share(4000, CONFIDENCE, || {
                let sample: Vec<f64> = (0..n).map(|_| draw(&mut random)).collect();
                let Interval { low, high } = Estimate::of_median(&sample).interval.expect("they are enough");
                (low..=high).contains(&truth)
            });
            // 75 cases: four standard errors are exceeded in one of 400 of such tests.
            assert!(covered >= CONFIDENCE - 4.0 * error, "{name}, {n}: {covered}");
            // Not by being wide without need: the next narrower one would not hold it.
            assert!(covered <= 0.995 + 4.0 * error, "{name}, {n}: {covered}");
        }
    }
}

#[test]
fn bootstrap_repeats_itself_and_orders_its_ends() {
    let values = [3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0];
    let bootstrap = Bootstrap::default();
    let estimate = bootstrap.estimate(&values, mean);
    assert_eq!(estimate, bootstrap.estimate(&values, mean));
    assert_ne!(estimate.interval, Bootstrap { seed: 1, ..bootstrap }.estimate(&values, mean).interval);
    assert_eq!(estimate.value, mean(&values));
    let Interval { low, high } = estimate.interval.expect("seven are enough");
    assert!(1.0 <= low && low <= estimate.value && estimate.value <= high && high <= 9.0);
}

/// The largest of six draws from six values is the k-th or less with probability (k / 6)^6.
#[test]
fn bootstrap_finds_the_exact_quantiles_of_a_tiny_sample() {
    let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let found = Bootstrap { resamples: 20_000, seed: 4 }.estimate(&values, largest).interval;
    // Of six values Student's 0.025 is normal 0.0024: (2/6)^6 = 0.0014 < 0.0024 < (3/6)^6 = 0.016.
    assert_eq!(found, Some(Interval { low: 3.0, high: 6.0 }));
}

#[test]
fn bootstrap_intervals_of_a_mean_cover_as_they_say() {
    let mut random = SplitMix64::new(5);
    let mut covered = |n: usize, draw: fn(&mut SplitMix64) -> f64| {
        let bootstrap = Bootstrap { resamples: 2000, seed: 0 };
        share(1000, CONFIDENCE, || {
            let sample: Vec<f64> = (0..n).map(|_| draw(&mut random)).collect();
            let Interval { low, high } = bootstrap.estimate(&sample, mean).interval.expect("they are enough");
            (low..=high).contains(&1.0)
        })
    };
    // Without the expansion 87 % of six, 89 % of eight and 91 % of twelve.
    for n in [6, 8, 12, 41] {
        let (share, error) = covered(n, |random| 1.0 + normal(random));
        assert_close(share, CONFIDENCE, 0.01 + 4.0 * error);
    }
    // Skewed, as run times are; the mean of an exponential is 1. The method is within three points of its promise.
    let (share, error) = covered(41, |random| -(1.0 - random.next_f64()).ln());
    assert_close(share, CONFIDENCE, 0.03 + 4.0 * error);
}

// Images

fn image(pixels: &[Vec3]) -> Image {
    Image::new(pixels.len() as u32, 1, pixels.to_vec())
}

#[test]
fn large_images_are_compared_whole() {
    // More pixels than a core takes at once: a part of them differs, by a ramp whose moments are known.
    const PIXELS: usize = 40_000;
    let b = image(&[Vec3::splat(1.0); PIXELS]);
    let mut a = b.clone();
    for (i, pixel) in a.pixels.iter_mut().enumerate().skip(PIXELS / 2) {
        pixel.y += (i - PIXELS / 2 + 1) as f32 / 1024.0;
    }
    a.pixels[7].x = f32::NAN;
    let mut spoilt = b.clone();
    spoilt.pixels[PIXELS - 1].z = f32::INFINITY;
    let found = compare_images(&a, &spoilt).expect("they are of one size");
    let differing = (PIXELS / 2) as u64;
    assert_eq!((found.compared_pixels, found.identical_pixels), (PIXELS as u64 - 2, PIXELS as u64 - differing - 1));
    assert_eq!((found.non_finite_a.nan_count, found.non_finite_b.inf_count), (1, 1));
    // The last one of the ramp is left out.
    let n = differing as f64 - 1.0;
    let (sum, squares) = (n * (n + 1.0) / 2.0, n * (n + 1.0) * (2.0 * n + 1.0) / 6.0);
    let pixels = PIXELS as f64 - 2.0;
    let green = found.channels[1];
    assert_close(green.mean_difference, sum / 1024.0 / pixels, 1e-9);
    assert_close(green.mse / (squares / 1024.0_f64.powi(2) / pixels), 1.0, 1e-12);
    assert_eq!(green.max_abs_difference, n / 1024.0);
    let variance = (squares / 1024.0_f64.powi(2) - pixels * green.mean_difference.powi(2)) / (pixels - 1.0);
    assert_close(green.standard_error / (variance / pixels).sqrt(), 1.0, 1e-9);
    assert_close(found.whole.mean_difference, green.mean_difference / 3.0, 1e-9);
    assert_eq!((found.channels[0].mse, found.channels[2].max_abs_difference), (0.0, 0.0));
}

#[test]
fn images_are_identical_by_their_bits() {
    let own = image(&[Vec3::new(0.0, f32::NAN, 1.0), Vec3::ONE]);
    assert!(own.is_identical(&own.clone()));
    let mut other = own.clone();
    other.pixels[0].x = -0.0;
    assert!(!own.is_identical(&other));
    assert!(!own.is_identical(&Image::new(1, 2, own.pixels.clone())), "of another shape");
}

#[test]
fn comparison_of_a_small_pair_by_hand() {
    let a = image(&[vec3(1.0, 2.0, 0.0), vec3(3.0, 2.0, 0.0)]);
    let b = image(&[vec3(1.0, 1.0, 0.0), vec3(1.0, 1.0, 0.0)]);
    let comparison = compare_images(&a, &b).unwrap();
    let whole = comparison.whole;
    // Differences: (0, 1, 0) and (2, 1, 0).
    assert_close(whole.mse, 6.0 / 6.0, 1e-15);
    assert_close(whole.rel_mse, 6.0 / 1.01 / 6.0, 1e-15);
    assert_close(whole.mean_a, 8.0 / 6.0, 1e-15);
    assert_close(whole.mean_b, 4.0 / 6.0, 1e-15);
    assert_close(whole.mean_difference, 2.0 / 3.0, 1e-15);
    // The pixels' mean differences are 1/3 and 1: variance 2/9, of the mean 1/9.
    assert_close(whole.standard_error, 1.0 / 3.0, 1e-15);
    assert_close(whole.z, 2.0, 1e-12);
    assert_eq!(whole.max_abs_difference, 2.0);
    assert_eq!(comparison.share_of_differing_pixels, 1.0);

    let [red, green, blue] = comparison.channels;
    assert_close(red.mse, 2.0, 1e-15);
    assert_close(red.mean_difference, 1.0, 1e-15);
    assert_close(red.standard_error, 1.0, 1e-15);
    assert_eq!((green.mean_difference, green.standard_error), (1.0, 0.0));
    assert_eq!((green.z, green.p), (f64::INFINITY, 0.0));
    assert_eq!((blue.mse, blue.z, blue.p), (0.0, 0.0, 1.0));

    // b is the reference: the other way round the denominator is another.
    let reversed = compare_images(&b, &a).unwrap();
    assert!(reversed.whole.rel_mse < whole.rel_mse);
    assert_close(reversed.whole.mean_difference, -2.0 / 3.0, 1e-15);
    let per_pixel = a.pixels.iter().zip(&b.pixels);
    let sum: f64 = per_pixel.map(|(a, b)| relative_squared_error(*a, *b)).sum();
    assert_close(sum / 2.0, whole.rel_mse, 1e-15);
}

#[test]
fn noise_of_a_known_variance_is_told_from_a_difference() {
    const SAMPLES: u32 = 100;
    let mut random = SplitMix64::new(7);
    let mut noisy = |bias: f32| {
        // Of equal channels, XYZ varies as each of them, but for the white point.
        let pixel = |_| Vec3::splat(1.0 + bias + (0.3 * normal(&mut random) / f64::from(SAMPLES).sqrt()) as f32);
        Image::new(40, 25, (0..1000).map(pixel).collect())
    };
    let flat = |value: f32| Image::new(40, 25, vec![Vec3::splat(value); 1000]);
    let (reference, variance) = (flat(1.0), flat(0.09));
    let test = test_pixels(&noisy(0.0), &reference, &variance, SAMPLES).unwrap();
    assert_eq!((test.values, test.share), (3000, 1.0), "{test:?}");
    assert_close(test.level, 0.01 / 1000.0, 1e-7);
    let test = test_pixels(&noisy(0.3), &reference, &variance, SAMPLES).unwrap();
    assert!(test.share < 0.01 && test.largest_z > 10.0, "{test:?}");
    // A reference without noise is still allowed some.
    let test = test_pixels(&flat(1.001), &reference, &flat(0.0), SAMPLES).unwrap();
    assert_eq!(test.share, 1.0, "{test:?}");
    assert!(test_pixels(&flat(f32::NAN), &reference, &variance, SAMPLES).unwrap().share == 0.0);
    assert!(test_pixels(&Image::new(1, 1, vec![Vec3::ONE]), &reference, &variance, 1).is_err());
}

#[test]
fn an_image_equals_itself() {
    let strange = image(&[vec3(1.0, f32::NAN, f32::INFINITY), Vec3::ONE]);
    let comparison = compare_images(&strange, &strange).unwrap();
    assert_eq!(comparison.share_of_differing_pixels, 0.0);
    assert_eq!(comparison.whole.mse, 0.0);
    assert_eq!(comparison.whole.max_abs_difference, 0.0);
}

#[test]
fn what_is_not_finite_is_counted_and_left_out() {
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let a = image(&[vec3(nan, nan, 1.0), vec3(-inf, nan, 1.0), Vec3::ONE, Vec3::splat(3.0)]);
    let b = image(&[Vec3::ONE, Vec3::ONE, vec3(1.0, inf, 1.0), Vec3::ONE]);
    let comparison = compare_images(&a, &b).unwrap();
    let (in_a, in_b) = (comparison.non_finite_a, comparison.non_finite_b);
    assert_eq!((in_a.nan_count, in_a.inf_count), (2, 1));
    assert_eq!((in_b.nan_count, in_b.inf_count), (0, 1));
    assert_eq!(comparison.compared_pixels, 1);
    assert_eq!(comparison.whole.mse, 4.0);
    assert_eq!(comparison.share_of_differing_pixels, 1.0);

    let nothing = compare_images(&image(&[Vec3::NAN]), &image(&[Vec3::ONE])).unwrap();
    assert_eq!(nothing.compared_pixels, 0);
    assert!(nothing.whole.mse.is_nan() && nothing.whole.max_abs_difference.is_nan());
}

#[test]
fn one_bit_is_a_difference() {
    let next = f32::from_bits(1.0f32.to_bits() + 1);
    let a = image(&[Vec3::ONE, vec3(1.0, next, 1.0), Vec3::ZERO, Vec3::ZERO]);
    let b = image(&[Vec3::ONE, Vec3::ONE, vec3(0.0, 0.0, -0.0), Vec3::ZERO]);
    let comparison = compare_images(&a, &b).unwrap();
    assert_eq!((comparison.identical_pixels, comparison.share_of_differing_pixels), (2, 0.5));
    assert_close(comparison.whole.max_abs_difference, f64::from(f32::EPSILON), 1e-20);
}

#[test]
fn sizes_that_differ_are_an_error_that_says_both() {
    let error = compare_images(&image(&[Vec3::ONE; 2]), &image(&[Vec3::ONE; 3])).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("2 x 1") && message.contains("3 x 1"), "{message}");
}

#[test]
fn small_differences_survive_large_images_and_large_values() {
    // In f32 the sum of a million such values is off by more than the difference.
    let pixels = 1 << 20;
    let a = Image::new(1024, 1024, vec![Vec3::splat(1000.001); pixels]);
    let b = Image::new(1024, 1024, vec![Vec3::splat(1000.0); pixels]);
    let exact = f64::from(1000.001f32) - 1000.0;
    let whole = compare_images(&a, &b).unwrap().whole;
    assert_close(whole.mean_difference / exact, 1.0, 1e-9);
    assert_close(whole.mse / (exact * exact), 1.0, 1e-9);
}

/// Two noisy images of one scene: z is standard normal, so |z| > 1.96 in one of twenty pairs, for
/// all channels together as for each, though the channels go together.
#[test]
fn mean_differences_of_like_images_are_standard_normal() {
    let mut random = SplitMix64::new(8);
    let mut noisy = || {
        let pixel = |i: u32| {
            let shared = normal(&mut random);
            Vec3::splat(i as f32) + (i as f32 / 100.0) * (shared as f32) * vec3(1.0, 0.9, 0.8)
        };
        Image::new(200, 1, (0..200).map(pixel).collect())
    };
    let (mut whole, mut red) = (0.0, 0.0);
    let trials = 2000;
    for _ in 0..trials {
        let comparison = compare_images(&noisy(), &noisy()).unwrap();
        whole += f64::from(comparison.whole.p < 0.05);
        red += f64::from(comparison.channels[0].p < 0.05);
    }
    let error = (0.05f64 * 0.95 / f64::from(trials)).sqrt();
    assert_close(whole / f64::from(trials), 0.05, 4.0 * error);
    assert_close(red / f64::from(trials), 0.05, 4.0 * error);
}
