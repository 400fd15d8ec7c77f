//! Sweeps over a fake renderer whose times, biases and variances are known: what the analysis makes of them, and
//! what is written.

use std::collections::BTreeMap;
use std::error::Error;
use std::ops::ControlFlow;

use crate::fake_renderer::normal;
use clap::Parser;
use glam::Vec3;
use raywave::image::Image;
use raywave::scene::Scene;
use raywave::settings::{RouletteMode, Sampler, Scheduler, Settings};
use raywave_cli::compare;
use raywave_cli::picture::PictureArguments;
use raywave_cli::tradeoff::{self, TradeoffArguments};
use raywave_studies::export::{Document, Page};
use raywave_studies::stats::{Bootstrap, DARK, Interval, SplitMix64, mean};
use raywave_studies::studies::tradeoff::departures::{self, Departure, ProductRow, Products, ReferenceSum};
use raywave_studies::studies::tradeoff::{
    Base, Decomposition, KnobReport, Reference, ReferenceKeeper, Sweep, SweepEvent, TradeoffReport, Worth, knobs,
};
use raywave_studies::studies::{
    Configuration, Factor, Measurement, Provenance, Purpose, Renderer, SceneFacts, StudyError,
};

const SIZE: u32 = 32;
/// relMSE of a sample in the base.
const VARIANCE: f64 = 0.5;
/// Seconds of a sample of every pixel in the base.
const SECONDS: f64 = 0.1;

/// What a level does: time and variance as shares of the base's, and squared bias in relMSE.
fn effects(factor: &str, level: &str) -> (f64, f64, f64) {
    match (factor, level) {
        ("integrator", "implicit") => (0.8, 6.0, 0.0),
        ("integrator", "mis") => (1.1, 0.5, 0.0),
        ("sampler", "sobol") => (1.05, 0.6, 0.0),
        ("max-bounces", "1") => (0.3, 0.3, 0.2),
        ("max-bounces", "2") => (0.5, 0.6, 0.05),
        ("max-bounces", "3") => (0.65, 0.8, 0.01),
        ("max-bounces", "4") => (0.7, 0.9, 1e-3),
        ("roulette", "0.1" | "0.2" | "0.4") => (0.95, 1.5, 0.0),
        ("roulette-mode", "throughput") => (0.8, 1.6, 0.0),
        ("path-state", "f16") => (0.9, 1.0, 0.0),
        ("bvh", "bvh2") => (1.3, 1.0, 0.0),
        // The rest of the clamps does nothing.
        ("clamp", "off") | ("clamp", _) if level.parse::<f64>().map_or(true, |clamp| clamp > 2.0) => (1.0, 1.0, 0.0),
        ("clamp", _) => (1.0, 0.6, 4e-3),
        _ => (1.0, 1.0, 0.0),
    }
}

/// All levels of a configuration together.
fn all_effects(configuration: &Configuration) -> (f64, f64, f64) {
    let each = configuration.iter().filter(|(factor, _)| *factor != "samples");
    each.map(|(factor, level)| effects(factor, level))
        .fold((1.0, 1.0, 0.0), |(time, variance, bias), (t, v, b)| (time * t, variance * v, bias + b))
}

/// A picture with dark and bright pixels.
fn truth(pixel: u32) -> f64 {
    0.05 + f64::from(pixel % SIZE) / f64::from(SIZE) * 1.5
}

/// A render: the truth, a bias of either sign by pixel, and noise, both in proportion to what relMSE divides by.
fn picture(bias_squared: f64, variance: f64, random: &mut SplitMix64) -> Image {
    let pixel = |i: u32| {
        let scale = (truth(i) * truth(i) + DARK).sqrt();
        let sign = if (i / SIZE).is_multiple_of(2) { 1.0 } else { -1.0 };
        let mut channel =
            || (truth(i) + scale * (sign * bias_squared.sqrt() + variance.sqrt() * normal(random))) as f32;
        Vec3::new(channel(), channel(), channel())
    };
    Image::new(SIZE, SIZE, (0..SIZE * SIZE).map(pixel).collect())
}

fn exact_truth() -> Image {
    picture(0.0, 0.0, &mut SplitMix64::new(0))
}

struct KnownRenderer {
    /// What the scene is rendered with where no knob is turned.
    base: Settings,
    time_noise: SplitMix64,
}

impl Renderer for KnownRenderer {
    fn open(&mut self, scene: &str) -> Result<SceneFacts, Box<dyn Error + Send + Sync>> {
        if scene == "missing" {
            return Err("no such file".into());
        }
        Ok(SceneFacts {
            scene: "known <scene>".to_owned(),
            scene_hash: "ab".repeat(32),
            width_pixels: SIZE,
            height_pixels: SIZE,
            samples_per_pixel: 256,
            settings: self.base,
            ..SceneFacts::default()
        })
    }

    fn run(
        &mut self,
        configuration: &Configuration,
        purpose: Purpose,
    ) -> Result<Measurement, Box<dyn Error + Send + Sync>> {
        if configuration.level("bvh") == Some("bvh4") {
            return Err("the device is out of memory".into());
        }
        let samples = configuration.count("samples").expect("points have samples") as f64;
        let (time, variance, bias) = all_effects(configuration);
        let seconds = SECONDS * samples * time * (0.01 * normal(&mut self.time_noise)).exp();
        let seed = if let Purpose::Seeded(seed) = purpose { u64::from(seed) } else { 1 << 40 };
        // Other estimators and other numbers of samples have other noise by the same seed.
        let stream = (samples as u64) << 34 | u64::from(configuration.level("integrator").is_some()) << 33 | seed;
        let mut measurement = Measurement {
            wall_seconds: 1.02 * seconds,
            gpu_seconds: seconds,
            image: Some(picture(
                bias,
                VARIANCE * variance / samples,
                &mut SplitMix64::new(stream.wrapping_mul(0x9e37)),
            )),
            ..Measurement::default()
        };
        if purpose == Purpose::First {
            let settings = r#"{"width_pixels": 32, "height_pixels": 32, "integrator": "explicit", "max_bounces": 8,
                "roulette": 0.0, "roulette_mode": "constant", "sampler": "independent", "clamp_radiance": null,
                "path_state": "f32", "offsets": "robust", "fast_math": false, "bvh": "cwbvh"}"#;
            measurement.settings = serde_json::from_str(settings).expect("JSON");
        }
        Ok(measurement)
    }
}

/// Has what it is given, and keeps what there is.
#[derive(Default)]
struct Kept(Option<Reference>);

impl ReferenceKeeper for Kept {
    fn load(&mut self, _: &SceneFacts, _: &Base) -> Result<Option<Reference>, StudyError> {
        Ok(self.0.clone())
    }

    fn store(&mut self, _: &SceneFacts, _: &Base, reference: &Reference) {
        self.0 = Some(reference.clone());
    }
}

fn renderer() -> KnownRenderer {
    let base =
        Settings { width: SIZE, height: SIZE, samples: 256, sampler: Sampler::Independent, ..Settings::default() };
    KnownRenderer { base, time_noise: SplitMix64::new(3) }
}

fn sweep() -> Sweep {
    Sweep {
        scene: "known".to_owned(),
        load_flags: "--lenient --up 0,0,1".to_owned(),
        budget_seconds: 4000.0,
        rounds: 8,
        fixed_samples: false,
        reference_error: 1e-4,
        target: Some(5e-3),
        bootstrap: Bootstrap { resamples: 300, ..Bootstrap::default() },
        seed: 1,
    }
}

fn run(sweep: &Sweep, keeper: &mut Kept) -> TradeoffReport {
    sweep.run(&mut renderer(), keeper, &mut |_| ControlFlow::Continue(())).expect("the fake renderer renders")
}

fn knob<'a>(report: &'a TradeoffReport, factor: &str, level: &str) -> &'a KnobReport {
    report.knobs.iter().find(|knob| knob.factor == factor && knob.level == level).expect("the knob was turned")
}

#[test]
fn every_knob_is_a_factor_of_compare() {
    for (setting, _) in knobs() {
        assert!(Factor::parse(setting.flag).is_ok(), "{}", setting.flag);
    }
    for text in ["roulette=0,0.5", "clamp=off,3", "samples=4,16", "max-bounces=1,2", "path-state", "offsets"] {
        assert!(Factor::parse(text).is_ok(), "{text}");
    }
    for text in ["roulette=1", "roulette=x", "clamp=0", "clamp=-1", "clamp=inf", "samples=0", "roulette=0.1,0.10"] {
        assert!(Factor::parse(text).is_err(), "{text}");
    }
}

#[test]
fn bias_and_variance_are_told_apart() {
    let truth = exact_truth();
    let bootstrap = Bootstrap { resamples: 400, ..Bootstrap::default() };
    for (bias, variance) in [(0.0, 0.1), (1e-4, 0.1), (0.02, 0.1), (0.3, 0.01)] {
        let (mut covered, mut bias_sum, mut variance_sum) = ([0; 3], 0.0, 0.0);
        const REPEATS: u64 = 60;
        for repeat in 0..REPEATS {
            let mut random = SplitMix64::new(repeat * 77 + 5);
            let images: Vec<Image> = (0..8).map(|_| picture(bias, variance, &mut random)).collect();
            let mut products = Products::default();
            for k in 0..images.len() {
                let departure = Departure::among(k, true, |k| [&images[k], &truth]);
                products.push(departures::products(&[departure], &truth).remove(0).relative);
            }
            let found = Decomposition::of(&products, 0.0, 0.0, &bootstrap).expect("there are eight");
            let all = [(found.bias_squared, bias), (found.variance, variance), (found.total, bias + variance)];
            for (covered, (estimate, known)) in covered.iter_mut().zip(all) {
                let Interval { low, high } = estimate.interval.expect("eight are enough");
                *covered += u64::from((low..=high).contains(&known));
            }
            bias_sum += found.bias_squared.value;
            variance_sum += found.variance.value;
            assert_eq!(found.is_biased(), bias > 1e-3 || found.bias_squared.surely_above(0.0));
        }
        // Eight renders make an interval of 95 % a little too narrow.
        assert!(covered.iter().all(|covered| covered * 100 >= 80 * REPEATS), "{bias} {variance}: {covered:?}");
        let (bias_mean, variance_mean) = (bias_sum / REPEATS as f64, variance_sum / REPEATS as f64);
        let numbers = f64::from(3 * SIZE * SIZE);
        // Four standard errors of a mean of products and of products with the bias.
        let error = 4.0 * ((variance * variance / 28.0 + bias * variance / 2.0) / numbers / REPEATS as f64).sqrt();
        assert!((bias_mean - bias).abs() < error, "{bias} {variance}: bias² {bias_mean}, error {error}");
        assert!((variance_mean / variance - 1.0).abs() < 0.01, "{bias} {variance}: variance {variance_mean}");
    }
}

/// As `departures::products` of one, one number after the other in `f64`.
fn plain_product(a: [&Image; 2], b: [&Image; 2], reference: &Image) -> (f64, f64) {
    let (mut relative, mut absolute, mut numbers) = (0.0, 0.0, 0.0);
    for (i, own) in reference.pixels.iter().enumerate().filter(|(_, own)| own.is_finite()) {
        for channel in 0..3 {
            let value = |image: &Image| f64::from(image.pixels[i][channel]);
            let product = (value(a[0]) - value(a[1])) * (value(b[0]) - value(b[1]));
            absolute += product;
            relative += product / (f64::from(own[channel]).powi(2) + DARK);
            numbers += 1.0;
        }
    }
    (relative / numbers, absolute / numbers)
}

/// As the mean of a difference that `departures::products` has.
fn plain_mean([a, b]: [&Image; 2], reference: &Image) -> f64 {
    let finite = (0..reference.pixels.len()).filter(|i| reference.pixels[*i].is_finite());
    let apart = finite.flat_map(|i| (0..3).map(move |c| f64::from(a.pixels[i][c]) - f64::from(b.pixels[i][c])));
    mean(&apart.collect::<Vec<_>>())
}

#[test]
fn products_on_all_cores_are_those_of_one() {
    let mut random = SplitMix64::new(4);
    // More pixels than a core takes at once, and none of the numbers that it likes.
    let mut noisy = |scale: f32| {
        let pixel = |_| Vec3::from_array(std::array::from_fn(|_| scale * (1.0 + 0.3 * normal(&mut random) as f32)));
        Image::new(71, 67, (0..71 * 67).map(pixel).collect())
    };
    let [mut reference, a, b, c] = [0.7; 4].map(&mut noisy);
    let mut spoilt = c.clone();
    for holes in [false, true] {
        if holes {
            for (i, value) in [(0, f32::NAN), (2047, f32::INFINITY), (2048, f32::NAN), (4756, f32::NAN)] {
                reference.pixels[i].y = value;
                spoilt.pixels[i].z = f32::NAN;
            }
        }
        let others = [[&a, &reference], [&b, &reference], [&b, &spoilt]];
        let departures = [[&a, &reference], [&a, &b]].map(|own| Departure {
            own,
            others: others[usize::from(own[1] == &b)..].to_vec(),
            absolute: true,
        });
        for (departure, row) in departures.iter().zip(departures::products(&departures, &reference)) {
            let close = |found: f64, known: f64| {
                assert!((found - known).abs() < 1e-6 * known.abs().max(0.01), "{found} for {known}");
            };
            assert_eq!((row.relative.len(), row.absolute.len()), (departure.others.len(), departure.others.len()));
            for (i, other) in departure.others.iter().enumerate() {
                let known = plain_product(departure.own, *other, &reference);
                close(row.relative[i], known.0);
                close(row.absolute[i], known.1);
            }
            close(row.mean, plain_mean(departure.own, &reference));
        }
    }
    let same = Departure { own: [&a, &a], others: vec![[&b, &c]], absolute: true };
    let none = ProductRow { mean: 0.0, relative: vec![0.0], absolute: vec![0.0] };
    assert_eq!(departures::products(&[same], &reference), [none], "equal images do not differ");
}

#[test]
fn a_reference_knows_its_own_noise() {
    let mut sum = ReferenceSum::default();
    let mut random = SplitMix64::new(9);
    (0..40).for_each(|_| sum.add(&picture(0.0, 0.2, &mut random)));
    let reference = sum.reference(16);
    let noise = reference.noise.expect("it was rendered");
    assert_eq!((noise.renders, noise.samples_per_pixel), (40, 640));
    assert!((noise.relative_variance / (0.2 / 40.0) - 1.0).abs() < 0.05, "{noise:?}");
    // What is held against it has its noise in it, and the estimates do not.
    let truth = exact_truth();
    let own = departures::products(&[Departure::among(0, true, |_| [&reference.image, &truth])], &truth)[0].relative[0];
    assert!((own / noise.relative_variance - 1.0).abs() < 0.2, "{own} of {noise:?}");
}

#[test]
fn knobs_are_worth_what_they_do() {
    let mut keeper = Kept::default();
    let report = run(&sweep(), &mut keeper);
    assert!(report.complete && keeper.0.is_some(), "the reference is kept");
    for knob in &report.knobs {
        let (time, variance, bias) = effects(knob.factor, &knob.level);
        let what = format!("{} {}: {knob:?}", knob.factor, knob.level);
        // Widened by half: some 40 intervals are looked at.
        let holds = |e: raywave_studies::stats::Estimate, known: f64, slack: f64| {
            let Interval { low, high } = e.interval.expect("there are rounds enough");
            known >= e.value - 1.5 * (e.value - low) - slack && known <= e.value + 1.5 * (high - e.value) + slack
        };
        assert!(holds(knob.time_ratio, time, 0.01), "time {time}: {what}");
        assert!(holds(knob.cost_ratio, time * variance, 0.02 * time * variance), "cost {}: {what}", time * variance);
        assert!(holds(knob.bias_squared, bias, 0.02 * bias), "bias {bias}: {what}");
    }
    for (factor, level, worth) in [
        ("integrator", "mis", Worth::Free),
        ("sampler", "sobol", Worth::Free),
        ("path-state", "f16", Worth::Free),
        ("max-bounces", "4", Worth::Trade),
        ("integrator", "implicit", Worth::Never),
        ("bvh", "bvh2", Worth::Never),
        ("roulette", "0.4", Worth::Never),
    ] {
        assert_eq!(knob(&report, factor, level).worth, worth, "{factor} {level}");
    }
    assert!(knob(&report, "path-state", "f16").identical && !knob(&report, "sampler", "sobol").identical);
    let pays_above = knob(&report, "max-bounces", "4").pays_above.expect("it trades");
    assert!((pays_above / (1e-3 / (1.0 - 0.63)) - 1.0).abs() < 0.3, "{pays_above}");
    assert!(report.knobs.iter().all(|knob| knob.level != "bvh4"), "what does not render is not judged");
    let failed = report.points.iter().find(|point| point.failed.is_some()).expect("bvh4 fails");
    assert!(failed.label == "bvh4" && failed.runs.is_empty());
}

#[test]
fn the_front_is_what_nothing_beats() {
    let report = run(&sweep(), &mut Kept::default());
    let known: Vec<(usize, f64, f64)> = (report.points.iter().enumerate())
        .filter_map(|(i, point)| Some((i, point.seconds?.value, point.rel_mse?.total.value)))
        .collect();
    for (i, time, error) in &known {
        let beaten = known.iter().any(|(_, t, e)| t <= time && e <= error && (t < time || e < error));
        assert_eq!(report.front.contains(i), !beaten, "{}", report.points[*i].full_label());
    }
    let times: Vec<f64> = report.front.iter().map(|i| report.points[*i].seconds.expect("timed").value).collect();
    assert!(times.is_sorted() && times.len() > 2);
    let mut labels: Vec<String> = report.points.iter().map(|point| point.full_label()).collect();
    labels.sort();
    labels.dedup();
    assert_eq!(labels.len(), report.points.len(), "every point is there once");
}

#[test]
fn the_target_is_reached_by_what_is_soonest() {
    let target = 5e-3;
    let report = run(&sweep(), &mut Kept::default());
    let answer = report.target.as_ref().expect("a target was asked for");
    let configuration = answer.configuration.as_ref().expect("it can be reached");
    let (time, variance, bias) = all_effects(configuration);
    let samples = f64::from(answer.samples);
    let error = bias + VARIANCE * variance / samples;
    assert!(error < 1.1 * target, "{} has {error}", answer.label);
    assert!((answer.seconds / (SECONDS * samples * time) - 1.0).abs() < 0.05, "{answer:?}");
    // Of all that the knobs can be together, none is much sooner.
    let free = Configuration::default().with("integrator", "mis").with("sampler", "sobol").with("path-state", "f16");
    let soonest = |configuration: Configuration| {
        let (time, variance, bias) = all_effects(&configuration);
        SECONDS * time * VARIANCE * variance / (target - bias)
    };
    let ways = [free.clone(), free.with("max-bounces", "4"), free.with("max-bounces", "4").with("clamp", "1")];
    let best = ways.into_iter().map(soonest).filter(|time| *time > 0.0).fold(f64::INFINITY, f64::min);
    assert!(answer.seconds < 1.1 * best, "{} takes {} and {best} would do", answer.label, answer.seconds);
    assert!(answer.measured, "it was rendered");
    for flag in [
        "--integrator mis",
        "--sampler sobol",
        "--path-state f16",
        "--width 32",
        &format!("--samples {}", answer.samples),
    ] {
        assert!(answer.flags.contains(flag), "{flag} in {}", answer.flags);
    }
    let unreachable =
        run(&Sweep { target: Some(1e-30), rounds: 4, budget_seconds: 400.0, ..sweep() }, &mut Kept::default());
    assert!(unreachable.target.is_some(), "it is answered all the same");
}

/// The part of `raywave render` that a sweep prints.
#[derive(Debug, Parser)]
struct RenderLine {
    #[command(flatten)]
    picture: PictureArguments,
}

#[test]
fn flags_make_the_render_that_was_measured() {
    let base = Settings {
        roulette_mode: RouletteMode::Throughput,
        roulette_from: 0,
        seed: 7,
        scheduler: Some(Scheduler::Wavefront),
        in_flight: Some(4096),
        shading_cost: 64,
        specialize: false,
        ..renderer().base
    };
    let mut renderer = KnownRenderer { base, ..renderer() };
    let report = sweep().run(&mut renderer, &mut Kept::default(), &mut |_| ControlFlow::Continue(()));
    let report = report.expect("the fake renderer renders");
    let target = report.target.as_ref().expect("a target was asked for");
    let points = report.points.iter().map(|point| (&point.configuration, &point.flags));
    for (configuration, flags) in points.chain(target.configuration.iter().map(|c| (c, &target.flags))) {
        let words = ["render"].into_iter().chain(flags.split(' '));
        let line = RenderLine::try_parse_from(words).unwrap_or_else(|error| panic!("{flags}: {error}"));
        let settings = line.picture.settings(&Scene::cornell_box()).expect("the flags make sense");
        assert_eq!(Ok(settings), configuration.of(base), "{flags}");
        assert!(flags.starts_with("--lenient --up 0,0,1 "), "{flags}");
    }
}

#[test]
fn a_plan_is_told_and_a_budget_is_kept() {
    let (mut plans, mut first_render) = (Vec::new(), None);
    let sweep = Sweep { budget_seconds: 600.0, target: None, ..sweep() };
    let report = sweep
        .run(&mut renderer(), &mut Kept::default(), &mut |event| {
            match event {
                SweepEvent::Planned(plan) => plans.push(plan.clone()),
                SweepEvent::Rendering { label, round } if round.is_some() && first_render.is_none() => {
                    first_render = Some((label.to_owned(), plans.len()));
                }
                _ => {}
            }
            ControlFlow::Continue(())
        })
        .expect("the fake renderer renders");
    assert_eq!(first_render.expect("there were rounds").1, 2, "the stage is told of before it begins");
    assert_eq!(plans[0].stage, "reference");
    let rendered: f64 = report.points.iter().flat_map(|point| &point.runs).map(|run| run.wall_seconds).sum();
    assert!(rendered < 600.0, "{rendered} s");
    assert!(report.points.iter().filter(|p| p.failed.is_none()).all(|point| point.runs.len() >= 6), "rounds enough");
    let seeds: Vec<Vec<u32>> = (report.points.iter().filter(|p| p.failed.is_none()))
        .map(|point| point.runs.iter().map(|run| run.seed).collect())
        .collect();
    assert!(seeds.iter().all(|seeds| seeds.iter().copied().eq(0..seeds.len() as u32)), "all points share seeds");
}

#[test]
fn what_is_broken_off_keeps_what_it_has() {
    let mut few = 0;
    for renders in [3, 30, 90, 130] {
        let mut left = renders;
        let report = sweep()
            .run(&mut renderer(), &mut Kept::default(), &mut |event| {
                if matches!(event, SweepEvent::Rendering { .. }) {
                    left -= 1;
                }
                if left <= 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })
            .expect("to break off is no error");
        assert!(!report.complete, "{renders}");
        let document = Document { provenance: &Provenance::default(), report: &report };
        let json: serde_json::Value = serde_json::from_str(&document.json()).expect("it is JSON");
        assert_eq!(json["complete"], false);
        let text = document.markdown();
        assert!(text.contains("not finished"));
        // Points that have two renders or three are told without an interval.
        for point in report.points.iter().filter(|point| (2..6).contains(&point.runs.len())) {
            assert!(point.seconds.expect("it was timed").interval.is_none() && text.contains("too few rounds"));
            assert!(document.csv().contains("too few rounds"));
            assert!(document.html(&mut Page::new(0.0)).contains("too few rounds"));
        }
        for knob in report.knobs.iter().filter(|knob| knob.cost_ratio.interval.is_none()) {
            assert_eq!(knob.worth, Worth::TooFewRounds);
        }
        few += report.knobs.iter().filter(|knob| knob.worth == Worth::TooFewRounds).count();
    }
    assert!(few > 0, "some knob had been turned too few times");
}

#[derive(Parser)]
struct CommandLine {
    #[command(flatten)]
    arguments: TradeoffArguments,
}

fn command_line(text: &str) -> Result<TradeoffArguments, clap::Error> {
    let words = std::iter::once("tradeoff").chain(text.split_whitespace());
    CommandLine::try_parse_from(words).map(|line| line.arguments)
}

#[test]
fn arguments_become_a_sweep() {
    let sweep =
        tradeoff::sweep(&command_line("box.toml --budget 5m --target-error 1e-3 --samples 16").expect("parses"));
    assert_eq!((sweep.budget_seconds, sweep.target, sweep.fixed_samples), (300.0, Some(1e-3), true));
    assert!(!tradeoff::sweep(&command_line("").expect("parses")).fixed_samples);
    for bad in [
        "--budget soon",
        "--budget 0",
        "--target-error 0",
        "--rounds 0",
        "--reference a.exr --reference-error 1",
        "a b",
    ] {
        assert!(command_line(bad).is_err(), "{bad}");
    }
}

#[test]
fn files_hold_what_was_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str| folder.path().join(name).display().to_string();
    let reference = folder.path().join("reference.exr");
    raywave::image::write_image(&reference, &exact_truth(), &raywave::image::WriteOptions::default())
        .expect("it is written");
    let arguments = command_line(&format!(
        "known --quiet --budget 300s --target-error 1e-2 --reference {} --json {} --csv {} --markdown {} --html {}",
        reference.display(),
        file("a.json"),
        file("a.csv"),
        file("a.md"),
        file("a.html")
    ))
    .expect("parses");
    tradeoff::run(&arguments, |_| Ok((Box::new(renderer()), compare::provenance()))).expect("all is well");
    let text = |name: &str| std::fs::read_to_string(file(name)).expect("it is written");
    let json: serde_json::Value = serde_json::from_str(&text("a.json")).expect("it is JSON");
    let points = json["points"].as_array().expect("points");
    assert!(json["complete"] == true && json["knobs"].as_array().is_some_and(|knobs| knobs.len() > 15));
    assert!(json["reference_noise"].is_null() && json["target"]["flags"].is_string());
    assert_eq!(text("a.csv").matches("\r\n").count(), 1 + points.len());
    assert!(text("a.md").contains("raywave render SCENE -o FILE") && text("a.md").contains("free, less time"));
    assert!(text("a.md").contains("known \\<scene>"));
    let page = text("a.html");
    assert!(page.ends_with("</html>\n") && page.contains("id=\"curve\"") && page.contains("data:image/png"));
    assert!(page.contains("known &lt;scene&gt;") && !page.contains("<scene>"));
    let by_name: BTreeMap<&str, usize> = ["http://", "https://", "NaN"]
        .map(|s| (s, page.split("<script").next().unwrap_or("").matches(s).count()))
        .into();
    assert!(by_name.values().all(|count| *count == 0), "{by_name:?}");
}
