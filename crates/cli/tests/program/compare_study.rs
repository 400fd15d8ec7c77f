//! Studies over a fake renderer: the design, its conduct, the gate, and whether the statistics say
//! what is true of distributions that are known.

use std::cell::Cell;
use std::collections::BTreeSet;
use std::ops::ControlFlow;

use clap::Parser;
use glam::Vec3;
use raywave::image::Image;
use raywave::settings::parse_count;
use raywave_cli::compare::{self, CompareArguments};
use raywave_studies::export::{Document, Exports, Format};
use raywave_studies::stats::{Estimate, Interval, SplitMix64};
use raywave_studies::studies::{
    Clock, Contract, Crossing, CrossingDirection, Design, Event, Factor, Measurement, Provenance, Purpose, Ratio,
    RatioVerdict, Report, Rounds, Run, Study, StudyError, Verdict, WarmUpRow, Warning, find_crossings, judge,
    modified_z_scores, outliers, rank_correlation, trend,
};

use crate::fake_renderer::{Call, FakeClocks, FakeRenderer, gradient, normal, study};

fn go_on(_: Event<'_>) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn run(study: &Study, renderer: &mut FakeRenderer) -> Report {
    study.run(renderer, &mut go_on).expect("the fake renderer renders")
}

/// 1 s, and that much of it for a megakernel, with lognormal noise.
fn megakernel_takes(factor: f64, sigma: f64) -> impl FnMut(&Call<'_>, &mut SplitMix64) -> f64 {
    move |call, random| {
        let mean = if call.configuration.level("scheduler") == Some("megakernel") { factor } else { 1.0 };
        mean * (sigma * normal(random)).exp()
    }
}

// The design.

#[test]
fn counts_have_suffixes_of_1024() {
    for (text, count) in [("0", Some(0)), ("64", Some(64)), ("16k", Some(16_384)), ("1M", Some(1 << 20))] {
        assert_eq!(parse_count(text), count, "{text}");
    }
    for text in ["", "k", "-1", "+1", "1.5k", "1 k", "1G", "99999999999999999999", "18446744073709551615k", "1é", "é"]
    {
        assert_eq!(parse_count(text), None, "{text}");
    }
}

#[test]
fn a_design_is_every_combination_once() {
    let factors =
        Factor::parse_list("scheduler=wavefront,megakernel,in-flight=16k,64k,1M,workgroup=64,256").expect("parses");
    let design = Design::new(factors, None).expect("makes sense");
    let all: Vec<String> = design.combinations().iter().map(ToString::to_string).collect();
    assert_eq!(all.len(), 2 * 3 * 2);
    assert_eq!(all[0], "scheduler=wavefront in-flight=16k workgroup=64");
    assert_eq!(all[1], "scheduler=wavefront in-flight=16k workgroup=256");
    assert_eq!(all[11], "scheduler=megakernel in-flight=1M workgroup=256");
    assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), 12);
    assert_eq!(design.baseline().to_string(), all[0]);
    assert_eq!(design.combinations()[4].count("in-flight"), Some(1 << 20));
    assert_eq!(design.label(&design.combinations()[11]), "megakernel, in-flight 1M, workgroup 256");
}

#[test]
fn a_baseline_is_named_by_any_of_its_levels() {
    let factors = Factor::parse_list("scheduler=wavefront,megakernel,in-flight=16k,64k").expect("parses");
    let design = Design::new(factors, Some("in-flight=65536")).expect("makes sense");
    assert_eq!(design.baseline().to_string(), "scheduler=wavefront in-flight=64k");
}

#[test]
fn bad_designs_are_refused_in_one_line_that_helps() {
    let design = |vary: &str, baseline| Design::new(Factor::parse_list(vary)?, baseline);
    for (vary, baseline, said) in [
        ("speed", None, "use one of: scheduler"),
        ("scheduler=turbo", None, "use wavefront or bounce or megakernel"),
        ("in-flight=0", None, "from 1 on"),
        ("in-flight=", None, "from 1 on"),
        ("in-flight=64k,65536", None, "twice"),
        ("scheduler,scheduler", None, "twice"),
        ("scheduler", Some("megakernel"), "factor=level"),
        ("scheduler", Some("workgroup=64"), "--vary workgroup"),
        ("in-flight=16k,64k", Some("in-flight=32k"), "16k or 64k"),
    ] {
        let error = design(vary, baseline).expect_err(vary).to_string();
        assert!(error.contains(said) && !error.contains('\n'), "{vary}: {error}");
    }
    let many = (1..=5000).map(|n| n.to_string()).collect::<Vec<_>>().join(",");
    let error = design(&format!("in-flight={many}"), None).expect_err("too many");
    assert!(matches!(error, StudyError::TooManyCombinations(5000)));
}

// The conduct.

#[test]
fn every_round_renders_every_combination_in_an_order_of_its_own() {
    let study = study(&["scheduler=wavefront,megakernel,in-flight=16k,64k,256k"], 20);
    let mut renderer = FakeRenderer::new(megakernel_takes(0.8, 0.01));
    let report = run(&study, &mut renderer);
    let combinations = study.design.combinations();
    let first: Vec<_> = renderer.log.iter().take(12).map(|(_, _, purpose)| *purpose).collect();
    assert_eq!(first, [Purpose::First, Purpose::Counting].repeat(6), "first renders come before all rounds");

    let timed: Vec<_> = renderer.log[12..]
        .iter()
        .map(|(_, configuration, purpose)| {
            assert_eq!(*purpose, Purpose::Timed);
            combinations.iter().position(|c| c == configuration).expect("a combination of the design")
        })
        .collect();
    let rounds: Vec<&[usize]> = timed.chunks(6).collect();
    assert_eq!(rounds.len(), 20);
    for round in &rounds {
        assert_eq!(round.iter().collect::<BTreeSet<_>>().len(), 6, "all of them, once: {round:?}");
    }
    assert!(rounds.iter().collect::<BTreeSet<_>>().len() > 15, "orders vary");
    // Each place is had by each combination about as often: 20 / 6 times, never in all of them.
    for combination in 0..6 {
        let places: BTreeSet<_> = rounds.iter().map(|round| round.iter().position(|&c| c == combination)).collect();
        assert!(places.len() >= 4, "combination {combination} had the places {places:?}");
    }
    assert!(report.complete);
    let again = &mut FakeRenderer::new(megakernel_takes(0.8, 0.01));
    run(&study, again);
    assert_eq!(again.log, renderer.log, "the same seed gives the same orders");
}

#[test]
fn first_renders_are_reported_apart_and_counted_ones_are_not_timed() {
    let mut renderer = FakeRenderer::new(|call, _| match call.purpose {
        Purpose::First => 10.0,
        Purpose::Counting => 99.0,
        Purpose::Timed | Purpose::Seeded(_) => 1.0,
    });
    let report = run(&study(&["scheduler=wavefront,megakernel"], 6), &mut renderer);
    for combination in &report.scenes[0].combinations {
        let first = combination.first.as_ref().expect("there was a first render");
        assert_eq!(first.wall_seconds, 10.0);
        let kernels = first.kernels.len() as f64;
        for (cached, each) in [(false, 0.04), (true, 0.002)] {
            let all = first.pipeline_seconds(cached).expect("they were told");
            assert!((all - kernels * each).abs() < 1e-12 && all > 0.0, "{all} of {kernels} kernels");
        }
        assert_eq!((first.cold_start_up_seconds, first.cached_start_up_seconds), (Some(0.61), Some(0.29)));
        let seconds = combination.seconds.expect("it was timed");
        assert_eq!((seconds.value, seconds.interval), (1.0, Some(Interval { low: 1.0, high: 1.0 })));
        assert_eq!(combination.runs.len(), 6);
        assert_eq!(combination.counters.as_ref().expect("it was counted").nodes_per_ray(), 23.4);
    }
}

#[test]
fn a_study_goes_on_until_its_intervals_are_narrow() {
    let mut study = study(&["scheduler=wavefront,megakernel"], 6);
    study.rounds = Rounds { min: 6, max: 200, until: Some(0.03) };
    let report = run(&study, &mut FakeRenderer::new(megakernel_takes(0.9, 0.03)));
    let rounds = report.scenes[0].combinations[0].runs.len();
    assert!((7..200).contains(&rounds), "{rounds} rounds");
    assert!(report.scenes[0].widest_interval() <= 0.03);
    // Noise that no number of rounds can mend ends at the most.
    study.rounds.max = 12;
    let report = run(&study, &mut FakeRenderer::new(megakernel_takes(0.9, 0.5)));
    assert_eq!(report.scenes[0].combinations[0].runs.len(), 12);
}

#[test]
fn the_rounds_that_are_needed_are_foretold() {
    let report =
        run(&study(&["scheduler=wavefront,megakernel"], 20), &mut FakeRenderer::new(megakernel_takes(0.9, 0.1)));
    // The interval of a median has the width 2 * 1.96 * 1.2533 σ √(1/n): 3 % of σ = 10 % takes 268
    // rounds for one time. The ratio's is wider by up to √2, so 537; from 20 runs, within a factor.
    let needed = report.scenes[0].combinations[1].rounds_needed.expect("it was timed");
    assert!((130..1400).contains(&needed), "{needed} rounds");
    let report = run(&study(&["scheduler=wavefront,megakernel"], 20), &mut FakeRenderer::new(|_, _| 1.0));
    assert_eq!(report.scenes[0].combinations[1].rounds_needed, Some(0), "no noise, no rounds");
}

#[test]
fn a_configuration_that_does_not_run_leaves_the_others_alone() {
    let mut renderer = FakeRenderer::new(megakernel_takes(0.8, 0.01));
    renderer.failure = Box::new(|call, _| {
        (call.configuration.level("workgroup") == Some("512")).then(|| "512 invocations are too many".to_owned())
    });
    let report = run(&study(&["scheduler=wavefront,megakernel,workgroup=64,512"], 6), &mut renderer);
    for combination in &report.scenes[0].combinations {
        let failed = combination.configuration.level("workgroup") == Some("512");
        assert_eq!(matches!(combination.verdict, Verdict::Failed { .. }), failed);
        assert_eq!(combination.seconds.is_none(), failed);
    }
    // Nothing is asked of it again.
    let asked = renderer.log.iter().filter(|(_, c, _)| c.level("workgroup") == Some("512")).count();
    assert_eq!(asked, 2);
}

#[test]
fn a_baseline_that_does_not_run_ends_the_study() {
    let mut renderer = FakeRenderer::new(|_, _| 1.0);
    renderer.failure = Box::new(|call, _| {
        (call.configuration.level("scheduler") == Some("wavefront")).then(|| "out of memory".to_owned())
    });
    let error = study(&["scheduler=wavefront,megakernel"], 6).run(&mut renderer, &mut go_on).expect_err("no baseline");
    assert!(error.to_string().contains("out of memory"), "{error}");
    let mut elsewhere = study(&["scheduler=wavefront,megakernel"], 6);
    elsewhere.scenes = vec!["missing".to_owned()];
    let error = elsewhere.run(&mut FakeRenderer::new(|_, _| 1.0), &mut go_on).expect_err("no scene");
    assert_eq!(error.to_string(), "missing: no such file");
}

// The gate.

#[test]
fn a_wrong_image_is_wrong_and_never_fast() {
    let mut renderer = FakeRenderer::new(megakernel_takes(0.01, 0.01));
    renderer.image = Box::new(|call, _| {
        let mut image = gradient(8, 8);
        if call.configuration.level("scheduler") == Some("megakernel") {
            image.pixels[5].y += f32::EPSILON;
        }
        Some(image)
    });
    let report = run(&study(&["scheduler=wavefront,megakernel"], 6), &mut renderer);
    let [wavefront, megakernel] = &report.scenes[0].combinations[..] else { panic!("two combinations") };
    assert_eq!(wavefront.rank, Some(1));
    let Verdict::Wrong { reason, comparison } = &megakernel.verdict else { panic!("{:?}", megakernel.verdict) };
    assert!(reason.contains("1.562 %") || reason.contains("1.563 %"), "one of 64 pixels: {reason}");
    assert!(comparison.is_some());
    assert!(megakernel.seconds.is_none() && megakernel.ratio.is_none() && megakernel.rank.is_none());
    assert!(megakernel.runs.is_empty(), "it is not even timed");
    assert!(report.has_wrong());
}

#[test]
fn a_rerun_that_differs_is_wrong() {
    let mut renderer = FakeRenderer::new(megakernel_takes(0.5, 0.01));
    renderer.image = Box::new(|call, _| {
        let mut image = gradient(8, 8);
        if call.configuration.level("scheduler") == Some("megakernel") && call.before == 3 {
            image.pixels[0].x = 9.0;
        }
        Some(image)
    });
    let report = run(&study(&["scheduler=wavefront,megakernel"], 6), &mut renderer);
    let megakernel = &report.scenes[0].combinations[1];
    assert!(
        matches!(&megakernel.verdict, Verdict::Wrong { reason, .. } if reason.contains("from one run to the next"))
    );
    assert_eq!(megakernel.runs.len(), 4, "it is dropped once it is found out");
    assert!(megakernel.seconds.is_none());
}

#[test]
fn a_missing_image_and_another_size_are_wrong() {
    for image in [None, Some(gradient(4, 8))] {
        let mut renderer = FakeRenderer::new(|_, _| 1.0);
        renderer.image = Box::new(move |call, _| match call.configuration.level("scheduler") {
            Some("megakernel") => image.clone(),
            _ => Some(gradient(8, 8)),
        });
        let report = run(&study(&["scheduler=wavefront,megakernel"], 6), &mut renderer);
        assert!(matches!(report.scenes[0].combinations[1].verdict, Verdict::Wrong { .. }));
    }
}

#[test]
fn estimators_are_held_to_statistics() {
    let noisy = |seed, shift: f32| {
        let mut random = SplitMix64::new(seed);
        let pixel = |_| Vec3::splat(0.5 + 0.1 * normal(&mut random) as f32 + shift);
        Image::new(32, 32, (0..1024).map(pixel).collect())
    };
    let reference = noisy(0, 0.0);
    let false_alarms = (1..=300).filter(|&seed| !judge(Contract::Statistics, &noisy(seed, 0.0), &reference).counts());
    assert!(false_alarms.count() <= 3, "at 1 in 1000");
    for seed in 1..=20 {
        assert!(!judge(Contract::Statistics, &noisy(seed, 0.04), &reference).counts(), "9 standard errors");
    }
    let mut broken = noisy(1, 0.0);
    broken.pixels[3].x = f32::NAN;
    assert!(!judge(Contract::Statistics, &broken, &reference).counts());
    assert!(matches!(judge(Contract::Statistics, &noisy(1, 0.0), &reference), Verdict::Agrees { .. }));
    // The same random numbers in other arithmetic: an ulp here and there, all to one side.
    let mut rounded = reference.clone();
    rounded.pixels.iter_mut().step_by(30).for_each(|pixel| *pixel *= 1.0 + f32::EPSILON);
    assert!(matches!(judge(Contract::Statistics, &rounded, &reference), Verdict::Agrees { .. }));
    rounded.pixels.iter_mut().for_each(|pixel| *pixel *= 1.0 + 3e-6);
    assert!(!judge(Contract::Statistics, &rounded, &reference).counts(), "more than rounding");

    let design = Design::new(Factor::parse_list("scheduler=wavefront,megakernel,integrator").expect("parses"), None)
        .expect("makes sense");
    let contracts: Vec<_> = design.combinations().iter().map(|c| design.contract(c)).collect();
    // The baseline's integrator, and two others, by each scheduler.
    assert_eq!(contracts, [Contract::Bits, Contract::Statistics, Contract::Statistics].repeat(2));
}

#[test]
fn other_work_is_compared_with_a_baseline_of_its_own() {
    let mut renderer = FakeRenderer::new(|call, _| {
        let cost = call.configuration.count("shading-cost").unwrap_or(0) as f64;
        if call.configuration.level("scheduler") == Some("megakernel") {
            1.0 + cost / 100.0
        } else {
            1.5 + cost / 200.0
        }
    });
    // The image depends on the work, not on how it is done.
    renderer.image = Box::new(|call, _| {
        let mut image = gradient(8, 8);
        image.pixels[0].x = call.configuration.count("shading-cost").unwrap_or(0) as f32;
        Some(image)
    });
    let report = run(&study(&["scheduler=wavefront,megakernel,shading-cost=0,200,50"], 6), &mut renderer);
    let scene = &report.scenes[0];
    for combination in &scene.combinations {
        assert!(combination.verdict.counts(), "{}: {:?}", combination.label, combination.verdict);
    }
    assert_eq!(scene.combinations.iter().filter(|c| matches!(c.verdict, Verdict::Baseline)).count(), 3);
    let ratios: Vec<_> = scene.combinations[3..].iter().map(|c| c.ratio.expect("timed").estimate.value).collect();
    assert_eq!(ratios, [1.0 / 1.5, 3.0 / 2.5, 1.5 / 1.75]);

    let [crossover] = &scene.crossovers[..] else { panic!("one crossover: {:?}", scene.crossovers) };
    assert_eq!((crossover.a.as_str(), crossover.b.as_str()), ("wavefront", "megakernel"));
    assert_eq!(crossover.points.iter().map(|p| p.cost).collect::<Vec<_>>(), [0.0, 50.0, 200.0]);
    let [crossing] = &crossover.crossings[..] else { panic!("one crossing") };
    assert!((crossing.cost.value - 100.0).abs() < 1e-9, "1 + K/100 = 1.5 + K/200 at K = 100: {crossing:?}");
    assert_eq!((crossing.direction, crossing.certain), (CrossingDirection::AFasterBeyond, true));
}

#[test]
fn shared_settings_are_those_that_all_renders_had() {
    let keys = |vary: &str| {
        let report = run(&study(&[vary], 1), &mut FakeRenderer::new(|_, _| 1.0));
        report.shared_settings().keys().cloned().collect::<Vec<_>>()
    };
    assert_eq!(keys("scheduler=wavefront,megakernel,in-flight=16k"), ["in-flight", "max_bounces"]);
    assert_eq!(keys("scheduler=wavefront,megakernel,in-flight=16k,64k"), ["max_bounces"]);
    let mut broken_off = FakeRenderer::new(|_, _| 1.0);
    let report = study(&["scheduler=wavefront,megakernel"], 1).run(&mut broken_off, &mut |_| ControlFlow::Break(()));
    assert!(report.expect("nothing fails").shared_settings().is_empty(), "nothing was rendered");
}

// The statistics.

fn covers(estimate: &Estimate, truth: f64) -> bool {
    let Interval { low, high } = estimate.interval.expect("there are rounds enough");
    (low..=high).contains(&truth)
}

fn runs(seconds: impl IntoIterator<Item = f64>) -> Vec<Run> {
    let run = |(round, wall_seconds)| Run {
        round,
        position: 0,
        measurement: Measurement { wall_seconds, ..Measurement::default() },
    };
    seconds.into_iter().enumerate().map(run).collect()
}

/// That a share of so many cases is as large as was promised, but for four standard errors.
fn assert_covers(share: f64, cases: usize, what: &str) {
    let error = (0.95 * 0.05 / cases as f64).sqrt();
    println!("{what}: covers {share}");
    assert!(share >= 0.95 - 4.0 * error, "{what}: covers {share}");
}

#[test]
fn ratios_cover_the_truth() {
    const STUDIES: usize = 2000;
    // Rounds that have nothing in common, half, and nearly all of their noise in common.
    for shared in [0.0, 0.5, 0.95_f64] {
        let mut random = SplitMix64::new(3);
        for rounds in [6, 8, 12_u32] {
            let (mut covered, mut width) = (0, 0.0);
            for _ in 0..STUDIES {
                let (mut a, mut b) = (Vec::new(), Vec::new());
                for _ in 0..rounds {
                    let common = shared.sqrt() * normal(&mut random);
                    let mut own = || (0.05 * (common + (1.0 - shared).sqrt() * normal(&mut random))).exp();
                    a.push(0.9 * own());
                    b.push(own());
                }
                let ratio = Ratio::of(&runs(a), &runs(b), Clock::Wall).expect("there are runs");
                covered += usize::from(covers(&ratio.estimate, 0.9));
                width += ratio.estimate.relative_width() / STUDIES as f64;
            }
            assert_covers(covered as f64 / STUDIES as f64, STUDIES, &format!("{rounds} rounds, {shared} shared"));
            // What is shared cancels: of all but all of the noise a fifth is left.
            assert!(shared < 0.9 || width < 0.06, "{rounds} rounds that share {shared}: {width}");
        }
    }
}

#[test]
fn runs_are_held_against_those_of_their_round() {
    let (mut a, b) = (runs([2.0, 6.0, 3.0, 8.0, 10.0, 12.0, 14.0]), runs([1.0, 3.0, 99.0, 4.0, 5.0, 6.0, 7.0]));
    // A run that is missing takes its partner along.
    a.remove(2);
    let ratio = Ratio::of(&a, &b, Clock::Wall).expect("six rounds are in both");
    assert_eq!(ratio.estimate, Estimate { value: 2.0, interval: Some(Interval { low: 2.0, high: 2.0 }) });
    assert!(Ratio::of(&a[..0], &b, Clock::Wall).is_none());
}

#[test]
fn medians_cover_the_truth() {
    for rounds in [6, 7, 15_usize] {
        let covered = (0..400).filter(|&seed| {
            let mut study = study(&["scheduler=wavefront,megakernel"], rounds);
            study.counting = false;
            let mut renderer = FakeRenderer::new(megakernel_takes(0.8, 0.1));
            renderer.random = SplitMix64::new(seed);
            let report = run(&study, &mut renderer);
            let seconds = report.scenes[0].combinations[1].seconds.expect("timed");
            // The median of a lognormal is e to the mean of its logarithm.
            covers(&seconds, 0.8)
        });
        assert_covers(covered.count() as f64 / 400.0, 400, &format!("{rounds} rounds"));
    }
}

#[test]
fn equal_speeds_are_within_noise_and_others_are_not() {
    let equal = (0..100).filter(|&seed| {
        let mut renderer = FakeRenderer::new(megakernel_takes(1.0, 0.03));
        renderer.random = SplitMix64::new(1000 + seed);
        let report = run(&study(&["scheduler=wavefront,megakernel"], 12), &mut renderer);
        report.scenes[0].combinations[1].ratio.expect("timed").verdict() == RatioVerdict::WithinNoise
    });
    let equal = equal.count();
    assert!(equal >= 88, "{equal} of 100");
    let report =
        run(&study(&["scheduler=wavefront,megakernel"], 12), &mut FakeRenderer::new(megakernel_takes(0.8, 0.03)));
    assert_eq!(report.scenes[0].combinations[1].ratio.expect("timed").verdict(), RatioVerdict::Faster);
    assert_eq!(report.scenes[0].combinations[1].rank, Some(1));
    assert_eq!(report.scenes[0].combinations[0].rank, Some(2));
}

#[test]
fn modified_z_scores_are_those_of_the_book() {
    // Median 3, MAD 1.
    let scores = modified_z_scores(&[1.0, 2.0, 3.0, 4.0, 100.0]);
    assert!((scores[4] - 0.6745 * 97.0).abs() < 1e-9, "{scores:?}");
    assert_eq!(outliers(&[1.0, 2.0, 3.0, 4.0, 100.0]), [4]);
    assert!(outliers(&[2.0; 9]).is_empty());
    // MAD is 0 here.
    let mut mostly_equal = vec![2.0; 9];
    mostly_equal[4] = 3.0;
    assert_eq!(outliers(&mostly_equal), [4]);
    // In normal noise one value in 2,000 is beyond 3.5.
    let mut random = SplitMix64::new(5);
    let many: Vec<f64> = (0..20_000).map(|_| normal(&mut random)).collect();
    assert!((2..30).contains(&outliers(&many).len()));
}

#[test]
fn trends_have_the_p_values_of_permutations() {
    assert!((rank_correlation(&[1.0, 2.0, 3.0, 4.0], &[10.0, 20.0, 40.0, 30.0]) - 0.8).abs() < 1e-12);
    assert!((rank_correlation(&[1.0, 1.0, 2.0], &[1.0, 1.0, 5.0]) - 1.0).abs() < 1e-12, "ties share a rank");
    assert_eq!(trend(&[1.0; 10]).1, 1.0);
    // All in order: 2 of 5! = 120 orders are as strong.
    let (correlation, p) = trend(&[1.0, 2.0, 3.0, 4.0, 5.0]);
    assert!((correlation - 1.0).abs() < 1e-12 && (p - 2.0 / 120.0).abs() < 0.005, "{p}");
    let mut random = SplitMix64::new(11);
    let false_alarms = (0..1000).filter(|_| trend(&(0..15).map(|_| random.next_f64()).collect::<Vec<_>>()).1 < 0.01);
    let false_alarms = false_alarms.count();
    assert!((2..=22).contains(&false_alarms), "{false_alarms} of 1000, 10 expected");
}

#[test]
fn drift_outliers_and_a_slow_start_are_found() {
    let warnings = |seconds: fn(usize) -> f64| {
        let mut renderer = FakeRenderer::new(move |call, random| {
            let mega = call.configuration.level("scheduler") == Some("megakernel") && call.purpose == Purpose::Timed;
            (if mega { seconds(call.before) } else { 1.0 }) * (1.0 + 0.004 * random.next_f64())
        });
        let report = run(&study(&["scheduler=wavefront,megakernel"], 16), &mut renderer);
        let [wavefront, megakernel] = &report.scenes[0].combinations[..] else { panic!("two combinations") };
        assert!(wavefront.warnings.is_empty(), "{:?}", wavefront.warnings);
        megakernel.warnings.clone()
    };
    let drift = warnings(|round| 1.0 + 0.002 * round as f64);
    assert!(
        matches!(drift[..], [Warning::Drift(drift)] if drift.rank_correlation > 0.5 && drift.p < 0.01),
        "{drift:?}"
    );
    assert_eq!(warnings(|round| if round == 9 { 1.4 } else { 1.0 }), [Warning::Outliers { rounds: vec![9] }]);
    let slow = warnings(|round| if round == 0 { 1.4 } else { 1.0 });
    assert!(matches!(slow[..], [Warning::SlowFirstRound { times_the_median }] if times_the_median > 1.3), "{slow:?}");
    assert!(warnings(|_| 1.0).is_empty());
}

#[test]
fn too_few_rounds_and_kernels_that_do_not_add_up_are_told() {
    let report = run(&study(&["scheduler=wavefront,megakernel"], 3), &mut FakeRenderer::new(|_, _| 1.0));
    assert_eq!(report.scenes[0].combinations[0].warnings, [Warning::FewRounds { rounds: 3, enough: 6 }]);
}

#[test]
fn too_few_rounds_claim_no_interval() {
    for rounds in 1..=7 {
        let report = run(
            &study(&["scheduler=wavefront,megakernel,shading-cost=0,64"], rounds),
            &mut FakeRenderer::new(|call, random| {
                let cost = call.configuration.count("shading-cost").unwrap_or(0) as f64;
                let slope = if call.configuration.level("scheduler") == Some("megakernel") { 0.02 } else { 0.0 };
                (0.5 + slope * cost) * (1.0 + 0.01 * random.next_f64()) + if slope == 0.0 { 0.2 } else { 0.0 }
            }),
        );
        let enough = rounds >= 6;
        let scene = &report.scenes[0];
        for combination in &scene.combinations {
            assert_eq!(combination.seconds.expect("it was timed").interval.is_some(), enough, "{rounds}");
            assert_eq!(combination.rounds_needed.is_some(), enough, "{rounds}");
            if let Some(ratio) = combination.ratio {
                assert_eq!(ratio.verdict() != RatioVerdict::TooFewRounds, enough, "{rounds}");
            }
        }
        assert_eq!(scene.widest_interval().is_finite(), enough, "{rounds}");
        let [crossing] = scene.crossovers[0].crossings[..] else { panic!("one crossing in {rounds} rounds") };
        assert_eq!((crossing.cost.interval.is_some(), crossing.certain), (enough, enough), "{rounds}");
    }
}

#[test]
fn a_study_that_waits_for_narrow_intervals_waits_until_there_are_some() {
    let mut study = study(&["scheduler=wavefront,megakernel"], 1);
    study.rounds = Rounds { min: 1, max: 50, until: Some(0.5) };
    let report = run(&study, &mut FakeRenderer::new(|_, _| 1.0));
    assert_eq!(report.scenes[0].combinations[0].runs.len(), 6);
}

/// A study of four rounds of two combinations, whose clock is read twice a render: first renders and counting ones read
/// it eight times, then each round four times.
fn study_with_clocks(megahertz: Vec<u32>, reasons: &[&str]) -> Report {
    let mut renderer = FakeRenderer::new(|_, _| 1.0);
    let reasons = reasons.iter().map(|&reason| reason.to_owned()).collect();
    renderer.clocks = Some(FakeClocks { megahertz, reasons, readings: Cell::default() });
    run(&study(&["scheduler=wavefront,megakernel"], 6), &mut renderer)
}

#[test]
fn rounds_at_another_clock_are_flagged() {
    let mut clocks = vec![1980; 8 + 6 * 4];
    // A card that had fallen asleep in the third round, and one that boosts by less than 2 % in the fifth.
    clocks[8 + 2 * 4..8 + 3 * 4].fill(345);
    clocks[8 + 4 * 4..8 + 5 * 4].fill(2010);
    let report = study_with_clocks(clocks, &[]);
    for combination in &report.scenes[0].combinations {
        let flagged = Warning::OtherClock { rounds: vec![2], median_megahertz: 1980.0 };
        assert_eq!(combination.warnings, [flagged]);
        let told = combination.warnings[0].to_string();
        assert!(told.contains("1980 MHz") && told.ends_with("in round 3"), "{told}");
        assert_eq!(combination.megahertz(), Some(1980.0));
    }
    let json = serde_json::to_value(&report).expect("it becomes JSON");
    let run = &json["scenes"][0]["combinations"][0]["runs"][2];
    assert_eq!(run["clocks_before"]["sm_megahertz"], 345);
    assert_eq!(
        (&run["clocks_after"]["power_watts"], &run["clocks_after"]["temperature_celsius"]),
        (&250.5.into(), &61.into())
    );
    assert!(run["clocks_after"]["memory_megahertz"].is_null() && run["clocks_after"]["throttle_reasons"].is_array());
}

#[test]
fn throttling_is_told_and_idling_is_none() {
    let warnings = |reasons: &[&str]| study_with_clocks(vec![1500], reasons).scenes[0].combinations[0].warnings.clone();
    assert!(warnings(&["gpu_idle", "applications_clocks_setting"]).is_empty());
    let throttled = warnings(&["gpu_idle", "sw_power_cap"]);
    assert_eq!(throttled, [Warning::Throttled { rounds: (0..6).collect(), reasons: vec!["sw_power_cap".to_owned()] }]);
}

#[test]
fn a_device_that_tells_no_clocks_has_null() {
    let report = run(&study(&["scheduler=wavefront,megakernel"], 6), &mut FakeRenderer::new(|_, _| 1.0));
    assert_eq!(report.scenes[0].combinations[0].megahertz(), None);
    assert!(report.scenes[0].combinations[0].warnings.is_empty());
    let json = serde_json::to_value(&report).expect("it becomes JSON");
    let run = &json["scenes"][0]["combinations"][0]["runs"][0];
    for key in ["clocks_before", "clocks_after", "idle_seconds", "idle_before_seconds", "warm_up"] {
        assert!(run.get(key).is_some_and(serde_json::Value::is_null), "{key} in {run}");
    }
}

#[test]
fn a_device_that_did_not_settle_is_told() {
    let mut renderer = FakeRenderer::new(|_, _| 1.0);
    renderer.warm_up = Box::new(|call, _| match (call.purpose, call.before) {
        (Purpose::Timed, 0) => Some(WarmUpRow { seconds: 0.1, steady: Some(true) }),
        (Purpose::Timed, 2) => Some(WarmUpRow { seconds: 5.0, steady: None }),
        (Purpose::Timed, 3) => Some(WarmUpRow { seconds: 3.0, steady: Some(false) }),
        _ => None,
    });
    let report = run(&study(&["scheduler=wavefront,megakernel"], 6), &mut renderer);
    for combination in &report.scenes[0].combinations {
        assert_eq!(combination.warnings, [Warning::Unsteady { rounds: vec![3] }]);
        assert!(combination.warnings[0].to_string().ends_with("before round 4"));
    }
}

#[test]
fn long_studies_are_analysed_now_and_then_and_at_their_end() {
    let mut heard = Vec::new();
    let report = study(&["scheduler=wavefront,megakernel"], 60)
        .run(&mut FakeRenderer::new(megakernel_takes(0.8, 0.01)), &mut |event| {
            if let Event::Updated { report } = event {
                heard.push(report.scenes[0].combinations[0].runs.len());
            }
            ControlFlow::Continue(())
        })
        .expect("it renders");
    heard.retain(|rounds| *rounds > 0);
    assert_eq!(heard[..8], [1, 2, 3, 4, 5, 6, 7, 8]);
    assert!(heard.len() < 30 && heard.windows(2).all(|pair| pair[1] <= pair[0] + pair[0].div_ceil(8)), "{heard:?}");
    // The last one follows the end of the study.
    assert_eq!(heard[heard.len() - 2..], [60, 60]);
    let typical = report.scenes[0].combinations[0].seconds.expect("it was timed");
    let seconds: Vec<f64> = report.scenes[0].combinations[0].runs.iter().map(|run| run.seconds(Clock::Wall)).collect();
    assert_eq!(typical.value, raywave_studies::stats::median(&seconds), "all rounds are in it");
}

#[test]
fn crossings_are_found_with_intervals_that_cover_them() {
    // a = 2 + K/100, b = 1 + K/50: equal at K = 100.
    let costs = [0.0, 64.0, 256.0];
    let mut random = SplitMix64::new(2);
    for rounds in [6, 10] {
        const SWEEPS: usize = 1000;
        let covered = (0..SWEEPS).filter(|_| {
            let mut sample = |k: f64| -> Vec<f64> {
                let mut noisy = |mean: f64| mean * (1.0 + 0.02 * normal(&mut random));
                (0..rounds).map(|_| noisy(2.0 + k / 100.0) - noisy(1.0 + k / 50.0)).collect()
            };
            let crossings = find_crossings(&costs, &costs.map(&mut sample));
            let [crossing] = crossings[..] else { panic!("one crossing: {crossings:?}") };
            assert_eq!((crossing.direction, crossing.certain), (CrossingDirection::AFasterBeyond, true));
            covers(&crossing.cost, 100.0)
        });
        assert_covers(covered.count() as f64 / SWEEPS as f64, SWEEPS, &format!("crossings of {rounds} rounds"));
    }

    // The interval is where the differences' contains 0, between straight lines.
    let lists = |spread: f64, values: &[f64]| -> Vec<Vec<f64>> {
        values.iter().map(|value| (0..6).map(|i| value + spread * (i as f64 - 2.5) / 2.5).collect()).collect()
    };
    let whole = |crossings: &[Crossing]| {
        let [Crossing { cost, direction, certain }] = crossings[..] else { panic!("one crossing: {crossings:?}") };
        let Interval { low, high } = cost.interval.expect("six are enough");
        ([low, cost.value, high].map(|cost| cost.round()), direction, certain)
    };
    let (a_beyond, b_beyond) = (CrossingDirection::AFasterBeyond, CrossingDirection::BFasterBeyond);
    let rises = [-64.0, 0.0, 192.0];
    assert_eq!(whole(&find_crossings(&costs, &lists(32.0, &rises))), ([32.0, 64.0, 96.0], b_beyond, true));
    assert_eq!(whole(&find_crossings(&costs, &lists(32.0, &rises.map(|d| -d)))), ([32.0, 64.0, 96.0], a_beyond, true));
    // Where one is not surely faster even at an end, the interval goes on to there and says so.
    assert_eq!(whole(&find_crossings(&costs, &lists(100.0, &rises))), ([0.0, 64.0, 164.0], b_beyond, false));
    assert_eq!(whole(&find_crossings(&costs, &lists(200.0, &rises))), ([0.0, 64.0, 256.0], b_beyond, false));

    assert!(find_crossings(&costs, &lists(0.0, &[-1.0, -1.0, -1.0])).is_empty());
    // Equal at a measured cost: one crossing, not two and not none.
    let touching = find_crossings(&costs, &lists(0.0, &[1.0, 0.0, -1.0]));
    assert_eq!(touching.len(), 1);
}

// Broken-off studies and files.

#[test]
fn a_study_that_is_broken_off_keeps_what_it_has() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("study.json");
    let provenance = Provenance::default();
    let total: usize = 2 * 2 + 2 * 10;
    for stop in 1..=total {
        let mut exports = Exports::open(vec![(Format::Json, path.clone())], 0.0).expect("can be written");
        let mut renders = 0;
        let mut written = 0;
        let report = study(&["scheduler=wavefront,megakernel"], 10)
            .run(&mut FakeRenderer::new(megakernel_takes(0.8, 0.01)), &mut |event| {
                match event {
                    Event::Updated { report } => {
                        exports.write(&Document { provenance: &provenance, report }).expect("is written");
                        written += 1;
                    }
                    Event::Rendering { .. } if renders == stop => return ControlFlow::Break(()),
                    Event::Rendering { .. } => renders += 1,
                    _ => (),
                }
                ControlFlow::Continue(())
            })
            .expect("an interruption is no error");
        assert_eq!(report.complete, stop == total, "stopped before render {stop}");
        if written == 0 {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("there is a file");
        let json: serde_json::Value = serde_json::from_str(&text).expect("the file is whole");
        assert_eq!(json["complete"], stop == total);
        let combinations = json["scenes"][0]["combinations"].as_array().expect("combinations");
        let runs: usize = combinations.iter().map(|c| c["runs"].as_array().expect("runs").len()).sum();
        assert_eq!(runs, stop.saturating_sub(4), "every timed run is in the file, whole rounds or not");
    }
}

// The command line.

#[derive(Debug, clap::Parser)]
struct CommandLine {
    #[command(flatten)]
    compare: CompareArguments,
}

fn command_line(arguments: &str) -> CompareArguments {
    CommandLine::try_parse_from(["compare"].into_iter().chain(arguments.split_whitespace())).expect(arguments).compare
}

#[test]
fn arguments_become_a_study() {
    let combinations = |arguments: &str| {
        let study = compare::study(&command_line(arguments)).expect(arguments);
        study.design.combinations().len()
    };
    assert_eq!(combinations(""), 3, "schedulers, where nothing is said");
    assert_eq!(combinations("--vary scheduler,workgroup=64,256 --vary in-flight=16k,64k,1M"), 3 * 6);
    assert_eq!(combinations("--crossover"), 3 * 5);
    assert_eq!(combinations("--crossover shading-cost"), 3 * 5);
    assert_eq!(combinations("--crossover --vary shading-cost=0,64"), 3 * 2);
    let study = compare::study(&command_line("a.toml b.toml --rounds 8 --until 3% --max-rounds 50")).expect("fits");
    assert_eq!(study.rounds, Rounds { min: 8, max: 50, until: Some(0.03) });
    assert_eq!(study.scenes, ["a.toml", "b.toml"]);
    assert!(compare::study(&command_line("--rounds 80 --until 0.03 --max-rounds 50")).is_err());
    for bad in ["--until 0", "--until 100%", "--until soon", "--rounds 0", "--crossover scheduler", "--clock sun"] {
        let arguments = ["compare"].into_iter().chain(bad.split(' '));
        assert!(CommandLine::try_parse_from(arguments).is_err(), "{bad}");
    }
}

#[test]
fn a_wrong_image_is_an_error_once_all_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str| folder.path().join(name).display().to_string();
    let arguments = command_line(&format!(
        "box --rounds 6 --quiet --json {} --csv {} --markdown {} --html {}",
        file("a.json"),
        file("a.csv"),
        file("a.md"),
        file("a.html")
    ));
    let error = compare::run(&arguments, |_| {
        let mut renderer = FakeRenderer::new(|_, _| 1.0);
        renderer.image = Box::new(|call, _| {
            let mut image = gradient(8, 8);
            image.pixels[0].x = f32::from(call.configuration.level("scheduler") == Some("megakernel"));
            Some(image)
        });
        Ok((Box::new(renderer), compare::provenance()))
    })
    .expect_err("the megakernel's image is wrong");
    assert!(error.to_string().starts_with("box, megakernel: wrong image: "), "{error}");
    for name in ["a.json", "a.csv", "a.md", "a.html"] {
        let text = std::fs::read_to_string(file(name)).expect("it is written");
        assert!(text.contains("megakernel") && text.contains("wrong"), "{name}");
    }
}
