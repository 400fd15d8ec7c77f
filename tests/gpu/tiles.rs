//! A film that does not fit the device is rendered tile after tile. The tiles leave no trace in the
//! image, and a render that is broken off has all samples that were done, by rows.

use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};

use crate::common::{assert_silent, device, floor, own_scene, prepare, tries};
use glam::DVec3;
use raywave::film::FilmMoments;
use raywave::gpu::Device;
use raywave::render::{Ending, Outcome, PreparedScene, Progress, Session, SessionOptions, Statistics};
use raywave::scene::Scene;
use raywave::settings::{Scheduler, Settings};

const WIDTH: u32 = 24;
const HEIGHT: u32 = 17;
const SAMPLES: u32 = 4;

/// Renders with a film of that many rows.
fn render(
    device: &Device,
    scene: &Scene,
    settings: Settings,
    film_rows: u32,
    progress: impl FnMut(&Progress) -> ControlFlow<Ending>,
) -> Outcome {
    let settings = Settings { width: WIDTH, height: HEIGHT, ..settings };
    let film_bytes = Some(u64::from(64 * WIDTH * film_rows));
    let options = SessionOptions { film_bytes, ..SessionOptions::default() };
    let prepared = prepare(device, scene, &settings);
    let mut session = Session::with_options(device, &prepared, &settings, options).expect("the session starts");
    let outcome = session.render(progress).expect("the render ends");
    assert_eq!(outcome.statistics.tile_rows, film_rows.min(HEIGHT));
    assert_eq!(outcome.film.height, outcome.statistics.rows);
    outcome
}

#[test]
fn tiles_leave_no_trace() {
    let device = device();
    let mut cases = 0..;
    for name in ["cornell-glass", "textured-sky"] {
        let scene = own_scene(name);
        for scheduler in [Scheduler::Wavefront, Scheduler::Bounce, Scheduler::Megakernel] {
            let settings = Settings { scheduler: Some(scheduler), samples: SAMPLES, ..scene.settings };
            let whole = render(&device, &scene, settings, HEIGHT, |_| ControlFlow::Continue(()));
            assert!(whole.film.sum[0] != whole.film.sum[(WIDTH * HEIGHT / 2) as usize], "{name} is of one colour");
            // Paths in flight: a part of a tile's pixels, or all samples of one and a part of another's.
            for (film_rows, in_flight) in [(1, 7), (1, 1000), (3, 50), (5, 1000), (16, 300)] {
                if !cases.next().is_some_and(|case| tries(&device, case, 7)) {
                    continue;
                }
                let settings = Settings { in_flight: Some(in_flight), ..settings };
                let mut done = 0;
                let tiled = render(&device, &scene, settings, film_rows, |progress| {
                    assert_eq!(progress.samples_total, u64::from(WIDTH * HEIGHT * SAMPLES));
                    assert!(progress.samples_done > done);
                    done = progress.samples_done;
                    ControlFlow::Continue(())
                });
                let case = format!("{name}, {scheduler:?}, tiles of {film_rows} rows, {in_flight} paths");
                assert_eq!(done, u64::from(WIDTH * HEIGHT * SAMPLES), "{case}");
                assert!(tiled.film == whole.film, "{case}: another image");
                let (tiled, whole) = (tiled.statistics, &whole.statistics);
                assert_eq!((tiled.rays(), tiled.rows, tiled.samples), (whole.rays(), HEIGHT, SAMPLES), "{case}");
            }
        }
    }
    assert_silent(&device);
}

/// Every render with as many samples, of the whole image.
struct Whole<'a> {
    scene: &'a PreparedScene,
    session: Session,
    films: BTreeMap<u32, FilmMoments>,
}

impl Whole<'_> {
    /// The sums of rows by so many samples.
    fn rows(&mut self, samples: u32, rows: Range<u32>) -> &[DVec3] {
        let film = self.films.entry(samples).or_insert_with(|| {
            self.session.reseed(self.scene, 0, samples).expect("the device goes on");
            self.session.render(|_| ControlFlow::Continue(())).expect("the render ends").film
        });
        &film.sum[(rows.start * WIDTH) as usize..(rows.end * WIDTH) as usize]
    }
}

#[test]
fn an_image_alone_and_a_time_alone_are_of_the_same_render() {
    let device = device();
    let scene = own_scene("cornell-box");
    let settings = Settings { width: WIDTH, height: HEIGHT, samples: SAMPLES, ..scene.settings };
    for film_rows in [HEIGHT, 5] {
        let options =
            SessionOptions { film_bytes: Some(u64::from(64 * WIDTH * film_rows)), ..SessionOptions::default() };
        let prepared = prepare(&device, &scene, &settings);
        let mut session = Session::with_options(&device, &prepared, &settings, options).expect("the session starts");
        let whole = session.render(|_| ControlFlow::Continue(())).expect("the render ends");
        let (image, statistics) = session.render_image().expect("the render ends");
        assert!(image.is_identical(&whole.film.mean()), "tiles of {film_rows} rows");
        for other in [statistics, session.time().expect("the render ends")] {
            let counts = |s: &Statistics| (s.rays(), s.rows, s.samples, s.sample_count, s.kernels().len());
            assert_eq!(counts(&other), counts(&whole.statistics), "tiles of {film_rows} rows");
            assert!(other.gpu_seconds > 0.0 && other.idle.between.is_some() && other.idle.before.is_some());
        }
    }
    assert_silent(&device);
}

#[test]
fn a_render_that_is_broken_off_keeps_what_it_has() {
    let device = device();
    let scene = own_scene("cornell-box");
    let samples = 4 * SAMPLES;
    let mut cases = 0..;
    for scheduler in [Scheduler::Wavefront, Scheduler::Bounce, Scheduler::Megakernel] {
        // A batch is four samples of two rows, or of less where the machine is slow.
        let settings = Settings {
            width: WIDTH,
            height: HEIGHT,
            samples,
            in_flight: Some(4 * 2 * WIDTH),
            scheduler: Some(scheduler),
            ..scene.settings
        };
        let prepared = prepare(&device, &scene, &settings);
        let session = Session::new(&device, &prepared, &settings).expect("the session starts");
        let mut whole = Whole { scene: &prepared, session, films: BTreeMap::new() };
        for film_rows in [5, HEIGHT] {
            let options =
                SessionOptions { film_bytes: Some(u64::from(64 * WIDTH * film_rows)), ..SessionOptions::default() };
            let mut session =
                Session::with_options(&device, &prepared, &settings, options).expect("the session starts");
            for last in [1, 2, 3, 4, 7, 12, 13, 20, 25] {
                for end in [Ending::Now, Ending::Even] {
                    if !cases.next().is_some_and(|case| tries(&device, case, 7)) {
                        continue;
                    }
                    let (mut batches, mut done) = (0, 0);
                    let (mut row, mut told) = (0, 0);
                    let statistics = session.render_tiles(
                        |progress| {
                            (batches, done) = (batches + 1, progress.samples_done);
                            if batches < last { ControlFlow::Continue(()) } else { ControlFlow::Break(end) }
                        },
                        |rows| {
                            let case = format!("{scheduler:?}, {film_rows} rows, {end:?} after {last} batches");
                            let expected = whole.rows(rows.samples as u32, row..row + rows.height);
                            assert!(rows.sum == expected, "{case}: rows from {row} on differ");
                            row += rows.height;
                            told += rows.samples * rows.sum.len() as u64;
                        },
                    );
                    let statistics = statistics.expect("the render ends");
                    assert_eq!((told, row), (done, statistics.rows), "all samples that are done are in the image");
                    assert_eq!(done, statistics.sample_count);
                    assert!(batches >= last && done < statistics_total(samples), "it ends early");
                    assert_eq!(Some(statistics.samples), statistics.bands.iter().map(|band| band.samples).min());
                    let bands = statistics.bands.len();
                    let finished = (statistics.rows / film_rows) as usize;
                    match end {
                        Ending::Even => assert!(bands <= finished + 1 && statistics.rows.is_multiple_of(film_rows)),
                        Ending::Now => assert!(bands <= finished + 2),
                    }
                }
            }
        }
    }
    assert_silent(&device);
}

#[test]
fn a_render_can_be_broken_off_before_its_first_batch() {
    let device = device();
    let scene = floor("newmtl floor\nKd 1 1 1\n");
    // So many paths that their cost is sampled beforehand, by more than one batch.
    let settings = Settings { width: 512, height: 512, samples: 1 << 20, shading_cost: 1000, ..scene.settings };
    let prepared = prepare(&device, &scene, &settings);
    let mut session = Session::new(&device, &prepared, &settings).expect("the session starts");
    let mut calls = Vec::new();
    let outcome = session.render(|progress| {
        calls.push(progress.samples_done);
        ControlFlow::Break(Ending::Now)
    });
    let done = outcome.expect("the render ends").statistics.sample_count;
    assert!(calls[0] == 0 && calls[1] > 0, "one sampling, and batches up to the end of a row: {calls:?}");
    assert!(done > 0 && calls.last() == Some(&done), "there is an image: {done} of {calls:?}");
    assert_silent(&device);
}

/// Samples of the whole image.
fn statistics_total(samples: u32) -> u64 {
    u64::from(WIDTH * HEIGHT * samples)
}
