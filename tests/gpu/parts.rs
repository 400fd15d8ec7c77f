//! Parts of a render add up to the bits of the whole, however it is cut and whoever renders it.

use std::ops::{ControlFlow, Range};
use std::time::Duration;

use crate::common::{assert_silent, device, own_scene, prepare, tries};
use raywave::film::{Film, MergeError, Overlap};
use raywave::gpu::Device;
use raywave::render::{Ending, Kept, PreparedScene, Progress, Session, SessionOptions};
use raywave::settings::{Integrator, Sampler, Scheduler, Settings};

const WIDTH: u32 = 24;
const HEIGHT: u32 = 17;
/// Eleven blocks and a part of one.
const SAMPLES: u32 = 92;
const BLOCK: u32 = 8;
const BLOCKS: u32 = SAMPLES.div_ceil(BLOCK);

/// Goes on with those blocks, in tiles of so many rows, up to so many batches.
fn go_on(
    device: &Device,
    scene: &PreparedScene,
    settings: &Settings,
    film_rows: u32,
    kept: &mut Kept,
    blocks: Range<u32>,
    batches: usize,
) {
    let film_bytes = Some(u64::from(64 * WIDTH * film_rows));
    let options = SessionOptions { film_bytes, ..SessionOptions::default() };
    let mut session = Session::with_options(device, scene, settings, options).expect("the session starts");
    session.take_blocks(blocks);
    let mut done = 0;
    let ends = |_: &Progress<'_>| {
        done += 1;
        if done < batches { ControlFlow::Continue(()) } else { ControlFlow::Break(Ending::Now) }
    };
    session.go_on(kept, ends).expect("it renders");
}

fn part(device: &Device, scene: &PreparedScene, settings: &Settings, film_rows: u32, blocks: Range<u32>) -> Film {
    let mut kept = Kept::default();
    go_on(device, scene, settings, film_rows, &mut kept, blocks, usize::MAX);
    kept.film().expect("it has rendered").clone()
}

/// A part of that many, in numbers that are spread evenly.
fn drawn(case: u32, of: u32) -> u32 {
    ((u64::from(case.wrapping_mul(2_654_435_769)) * u64::from(of)) >> 32) as u32
}

#[test]
fn parts_are_the_whole_to_the_bit() {
    let device = device();
    let mut cases = 0..;
    for name in ["cornell-glass", "textured-sky"] {
        let scene = own_scene(name);
        for (integrator, sampler) in [(Integrator::Mis, Sampler::Sobol), (Integrator::Explicit, Sampler::Independent)] {
            let settings = Settings {
                width: WIDTH,
                height: HEIGHT,
                samples: SAMPLES,
                block_samples: Some(BLOCK),
                integrator,
                sampler,
                ..scene.settings
            };
            let prepared = prepare(&device, &scene, &settings);
            let whole = part(&device, &prepared, &settings, HEIGHT, 0..BLOCKS);
            assert_eq!(whole.strips().len(), 1);
            // Blocks 0 to 7, 8 and 9, 10, and the begun one.
            assert_eq!(whole.strips()[0].runs.iter().map(|run| run.samples).collect::<Vec<_>>(), [64, 16, 8, 4]);
            for case in 0..6 {
                if !cases.next().is_some_and(|case| tries(&device, case, 7)) {
                    continue;
                }
                let cuts = [1 + drawn(case, BLOCKS - 2), 1 + drawn(case + 100, BLOCKS - 2)];
                let (first, second) = (cuts[0].min(cuts[1]), cuts[0].max(cuts[1]));
                let schedulers = [Scheduler::Wavefront, Scheduler::Bounce, Scheduler::Megakernel];
                let mut parts: Vec<Film> = [0..first, first..second, second..BLOCKS]
                    .into_iter()
                    .enumerate()
                    .filter(|(_, blocks)| !blocks.is_empty())
                    .map(|(number, blocks)| {
                        let scheduler = Some(schedulers[(case as usize + number) % 3]);
                        let settings = Settings { scheduler, in_flight: Some(500 + 700 * case), ..settings };
                        part(&device, &prepared, &settings, [5, HEIGHT, 3][number], blocks)
                    })
                    .collect();
                let turn = case as usize % parts.len();
                parts.rotate_left(turn);
                let merged = parts.into_iter().reduce(|mut film, part| {
                    film.merge(part, Overlap::Refused).expect("they have no block in common");
                    film
                });
                assert!(merged == Some(whole.clone()), "{name}, {integrator:?}: cut at {first} and {second}");
            }
        }
    }
    assert_silent(&device);
}

#[test]
fn a_render_goes_on_from_a_film_to_the_bits_of_the_whole() {
    let device = device();
    let scene = own_scene("cornell-box");
    let settings = Settings {
        width: WIDTH,
        height: HEIGHT,
        samples: SAMPLES,
        block_samples: Some(BLOCK),
        in_flight: Some(4 * 3 * WIDTH),
        ..scene.settings
    };
    let prepared = prepare(&device, &scene, &settings);
    let whole = part(&device, &prepared, &settings, HEIGHT, 0..BLOCKS);
    for (case, batches) in [1, 2, 9, 40, 77, 120].into_iter().enumerate() {
        if !tries(&device, case, 3) {
            continue;
        }
        let few = Settings { samples: 20, scheduler: Some(Scheduler::Bounce), ..settings };
        let film_rows = [HEIGHT, 7][case % 2];
        let mut kept = Kept::every(Duration::ZERO);
        // First fewer samples, broken off; then more of another scheduler, broken off; then all.
        go_on(&device, &prepared, &few, film_rows, &mut kept, 0..3, batches);
        let film = kept.film().expect("it has begun").clone();
        let mut kept = Kept::every(Duration::MAX).with_film(film);
        let other = Settings { scheduler: Some(Scheduler::Megakernel), ..settings };
        go_on(&device, &prepared, &other, HEIGHT, &mut kept, 0..BLOCKS, batches);
        let film = kept.film().expect("it has begun").clone();
        let mut kept = Kept::default().with_film(film);
        go_on(&device, &prepared, &settings, 4, &mut kept, 0..BLOCKS, usize::MAX);
        assert!(kept.film() == Some(&whole), "broken off after {batches} batches");
        // Nothing is left to do.
        go_on(&device, &prepared, &settings, HEIGHT, &mut kept, 0..BLOCKS, usize::MAX);
        assert!(kept.film() == Some(&whole));
    }
    assert_silent(&device);
}

#[test]
fn blocks_change_rounding_alone() {
    let device = device();
    let scene = own_scene("cornell-box");
    let settings = Settings { width: WIDTH, height: HEIGHT, samples: SAMPLES, ..scene.settings };
    let prepared = prepare(&device, &scene, &settings);
    let of_blocks = |size: u32| {
        let settings = Settings { block_samples: Some(size), ..settings };
        let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
        let outcome = session.render(|_| ControlFlow::Continue(())).expect("it renders");
        let (image, statistics) = session.render_image().expect("it renders");
        assert!(image.is_identical(&outcome.film.mean()), "blocks of {size}");
        assert_eq!((statistics.samples, statistics.rays()), (SAMPLES, outcome.statistics.rays()));
        outcome.film
    };
    let one = of_blocks(128);
    for size in [1, 2, 16, 64] {
        let film = of_blocks(size);
        for (a, b) in film.sum.iter().zip(&one.sum).chain(film.sum_of_squares.iter().zip(&one.sum_of_squares)) {
            assert!(a.abs_diff_eq(*b, 1e-6 * b.max_element().max(1e-3)), "blocks of {size}: {a} and {b}");
        }
    }
    assert_silent(&device);
}

/// Goes on by rounds to a target, or to the samples of the settings.
fn by_rounds(session: &mut Session, target: Option<f64>) -> (Film, Option<f64>) {
    let mut kept = Kept::default();
    let (_, error) = session.go_on_by_rounds(&mut kept, target, |_| ControlFlow::Continue(())).expect("it renders");
    (kept.film().expect("it has rendered").clone(), error)
}

#[test]
fn halves_are_renders_of_two_seeds() {
    let device = device();
    let scene = own_scene("cornell-box");
    let settings =
        Settings { width: WIDTH, height: HEIGHT, sampler: Sampler::Sobol, samples: 12, seed: 3, ..scene.settings };
    let prepared = prepare(&device, &scene, &settings);
    let sums = |settings: Settings| {
        let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
        by_rounds(&mut session, None).0.strips()[0].runs.iter().map(|run| run.sums.clone()).collect::<Vec<_>>()
    };
    let both = sums(Settings { halves: true, ..settings });
    let first = sums(Settings { samples: 6, ..settings });
    let second = sums(Settings { samples: 6, seed: 3_u32.wrapping_add(0x9e37_79b9), ..settings });
    assert!(both == [first, second].concat());
    assert_silent(&device);
}

#[test]
fn the_difference_of_halves_is_the_error() {
    let device = device();
    let scene = own_scene("cornell-box");
    for sampler in [Sampler::Sobol, Sampler::Independent] {
        let settings = Settings { width: WIDTH, height: HEIGHT, sampler, ..scene.settings };
        let prepared = prepare(&device, &scene, &settings);
        let reference = Settings { samples: 1 << 13, seed: 1_000, ..settings };
        let mut session = Session::new(&device, &prepared, &reference).expect("the session starts");
        let (exact, _) = session.render_image().expect("it renders");
        let halves = Settings { samples: 64, halves: true, ..settings };
        let mut session = Session::new(&device, &prepared, &halves).expect("the session starts");
        const SEEDS: u32 = 24;
        let (mut told, mut found) = (0.0, 0.0);
        for seed in 0..SEEDS {
            session.reseed(&prepared, seed, 64).expect("the device goes on");
            let (film, error) = by_rounds(&mut session, None);
            told += error.expect("halves are equal") / f64::from(SEEDS);
            let image = film.image();
            let off = image.pixels.iter().zip(&exact.pixels).map(|(a, b)| {
                let off = |a: f32, b: f32| f64::from(a - b).powi(2) / (f64::from(b * b) + 0.01);
                off(a.x, b.x) + off(a.y, b.y) + off(a.z, b.z)
            });
            found += off.sum::<f64>() / (3.0 * image.pixels.len() as f64) / f64::from(SEEDS);
        }
        // By the lesser of two means, what is told is rather too much.
        assert!((0.9..1.4).contains(&(told / found)), "{sampler:?}: {told} and {found}");
    }
    assert_silent(&device);
}

#[test]
fn rounds_end_at_the_error_that_is_asked_for() {
    let device = device();
    let scene = own_scene("cornell-box");
    let settings = Settings { width: WIDTH, height: HEIGHT, samples: 1 << 14, halves: true, ..scene.settings };
    let prepared = prepare(&device, &scene, &settings);
    for (target, film_rows) in [(0.1, HEIGHT), (0.01, 5)] {
        let film_bytes = Some(u64::from(64 * WIDTH * film_rows));
        let options = SessionOptions { film_bytes, ..SessionOptions::default() };
        let mut session = Session::with_options(&device, &prepared, &settings, options).expect("the session starts");
        let (film, error) = by_rounds(&mut session, Some(target));
        let error = error.expect("halves are equal");
        assert!(error <= target && error > 0.3 * target, "{error} where {target} is asked for");
        // The same samples at once are the same film.
        session.take_samples(film.most_samples() as u32);
        let mut kept = Kept::default();
        session.go_on(&mut kept, |_| ControlFlow::Continue(())).expect("it renders");
        assert!(kept.film() == Some(&film));
    }
    assert_silent(&device);
}

#[test]
fn what_parts_have_in_common_counts_once() {
    let device = device();
    let scene = own_scene("cornell-box");
    let settings =
        Settings { width: WIDTH, height: HEIGHT, samples: SAMPLES, block_samples: Some(BLOCK), ..scene.settings };
    let prepared = prepare(&device, &scene, &settings);
    let part = |blocks| part(&device, &prepared, &settings, HEIGHT, blocks);
    let whole = part(0..BLOCKS);
    // One that was broken off within a block, so that its upper rows have more.
    let few = Settings { samples: 20, in_flight: Some(4 * 3 * WIDTH), ..settings };
    let mut broken = Kept::every(Duration::ZERO);
    go_on(&device, &prepared, &few, HEIGHT, &mut broken, 0..3, 9);
    let broken = broken.film().expect("it has begun").clone();
    assert!(broken.strips().len() > 1, "rows differ");
    let parts = [part(0..5), part(3..8), part(4..6), part(7..BLOCKS), part(2..3), broken];
    for turn in 0..parts.len() {
        let mut turned = parts.clone();
        turned.rotate_left(turn);
        let merged = turned.into_iter().reduce(|mut film, part| {
            film.merge(part, Overlap::Once).expect("they are parts of one image");
            film
        });
        assert!(merged.as_ref() == Some(&whole), "from part {turn} on");
    }
    assert_silent(&device);
}

#[test]
fn what_both_parts_have_is_refused() {
    let gaps = |film: &Film| film.gaps(&(0..64)).into_iter().map(|gap| (gap.start, gap.end)).collect::<Vec<_>>();
    let device = device();
    let scene = own_scene("cornell-box");
    let settings = Settings { width: WIDTH, height: HEIGHT, samples: 64, block_samples: Some(BLOCK), ..scene.settings };
    let prepared = prepare(&device, &scene, &settings);
    let part = |blocks| part(&device, &prepared, &settings, HEIGHT, blocks);
    let mut film = part(0..4);
    assert_eq!(film.clone().merge(part(2..6), Overlap::Refused), Err(MergeError::Overlap(2..4)));
    assert_eq!(gaps(&film), [(4, 8)]);
    film.merge(part(6..8), Overlap::Refused).expect("they have no block in common");
    assert_eq!(gaps(&film), [(4, 6)]);
    let other = Settings { block_samples: Some(16), ..settings };
    let mut kept = Kept::default();
    go_on(&device, &prepared, &other, HEIGHT, &mut kept, 2..3, usize::MAX);
    assert_eq!(film.merge(kept.film().expect("it has rendered").clone(), Overlap::Refused), Err(MergeError::Differ));
    assert_silent(&device);
}
