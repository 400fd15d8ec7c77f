//! A device that is lost costs no more than what came after the last look at its film: another session goes on from
//! there, to the same bits.

use std::ops::ControlFlow;
use std::time::Duration;

use crate::common::{assert_silent, device, own_scene, prepare, tries};
use raywave::film::FilmMoments;
use raywave::gpu::{Device, GpuError};
use raywave::render::{Kept, PreparedScene, RenderError, Session, SessionOptions, Statistics};
use raywave::settings::{Scheduler, Settings};

const WIDTH: u32 = 24;
const HEIGHT: u32 = 17;

/// Goes on with a render on a device, which may be lost after so many submissions; adds the rows that it finishes to the film.
fn go_on(
    device: &Device,
    submissions: Option<u64>,
    scene: &PreparedScene,
    settings: &Settings,
    kept: &mut Kept,
    film: &mut Vec<FilmMoments>,
) -> Result<Statistics, RenderError> {
    // Tiles of seven rows.
    let options = SessionOptions { film_bytes: Some(u64::from(64 * WIDTH * 7)), ..SessionOptions::default() };
    let mut session = Session::with_options(device, scene, settings, options)?;
    submissions.into_iter().for_each(|submissions| device.lose_after(submissions));
    session.go_on_by_tiles(kept, |_| ControlFlow::Continue(()), |rows| film.push(rows))
}

/// The image of rows that were handed over one under the other.
fn joined(film: Vec<FilmMoments>) -> FilmMoments {
    let join = |mut above: FilmMoments, below| {
        above.append(below);
        above
    };
    film.into_iter().reduce(join).expect("there are rows")
}

fn assert_lost(result: Result<Statistics, RenderError>) {
    let error = result.expect_err("the device is lost");
    assert!(matches!(&error, RenderError::Gpu(GpuError::DeviceLost { pass }) if !pass.is_empty()), "{error}");
}

#[test]
fn a_render_goes_on_where_its_device_was_lost() {
    let other = device();
    let scene = own_scene("cornell-glass");
    let mut cases = 0..;
    for scheduler in [Scheduler::Wavefront, Scheduler::Bounce, Scheduler::Megakernel] {
        let settings = Settings {
            width: WIDTH,
            height: HEIGHT,
            samples: 16,
            scheduler: Some(scheduler),
            in_flight: Some(4 * 3 * WIDTH),
            ..scene.settings
        };
        let prepared = prepare(&other, &scene, &settings);
        let mut undisturbed = Vec::new();
        let whole =
            go_on(&other, None, &prepared, &settings, &mut Kept::default(), &mut undisturbed).expect("it renders");
        for every in [Duration::ZERO, Duration::MAX] {
            // A render has 23 batches at least.
            for submissions in [0, 1, 2, 7, 13, 20] {
                if !cases.next().is_some_and(|case| tries(&other, case, 7)) {
                    continue;
                }
                let device = device();
                let (mut kept, mut film) = (Kept::every(every), Vec::new());
                assert_lost(go_on(&device, Some(submissions), &prepared, &settings, &mut kept, &mut film));
                assert!(every > Duration::ZERO || submissions < 3 || kept.sample_count() > 0);
                let case = format!("{scheduler:?}, lost after {submissions} submissions, looks every {every:?}");
                let statistics = go_on(&other, None, &prepared, &settings, &mut kept, &mut film).expect("it goes on");
                assert!(joined(film) == joined(undisturbed.clone()), "{case}: another image");
                assert_eq!(statistics.ray_counts, whole.ray_counts, "{case}");
                let counts = |s: &Statistics| (s.sample_count, s.rays(), s.rows, s.samples);
                assert_eq!(counts(&statistics), counts(&whole), "{case}");
                assert_silent(&device);
            }
        }
    }
    assert_silent(&other);
}

#[test]
fn what_was_kept_is_an_image() {
    let other = device();
    let scene = own_scene("cornell-box");
    let settings = Settings {
        width: WIDTH,
        height: HEIGHT,
        samples: 16,
        scheduler: Some(Scheduler::Bounce),
        in_flight: Some(4 * 3 * WIDTH),
        ..scene.settings
    };
    let prepared = prepare(&other, &scene, &settings);
    let mut undisturbed = Session::new(&other, &prepared, &settings).expect("the session starts");
    for (case, submissions) in [11, 0, 1, 5, 20].into_iter().enumerate() {
        if !tries(&other, case, 4) {
            continue;
        }
        let device = device();
        let (mut kept, mut film) = (Kept::every(Duration::ZERO), Vec::new());
        assert_lost(go_on(&device, Some(submissions), &prepared, &settings, &mut kept, &mut film));
        let samples = kept.sample_count();
        let Some(statistics) = kept.end(|rows| film.push(rows)) else {
            assert_eq!((samples, film.len()), (0, 0));
            continue;
        };
        assert_eq!(samples, film.iter().map(|rows| rows.samples * rows.sum.len() as u64).sum::<u64>());
        assert_eq!((samples, statistics.rows), (statistics.sample_count, film.iter().map(|rows| rows.height).sum()));
        // Each row is that of a render by as many samples.
        let mut row = 0;
        for rows in film {
            undisturbed.reseed(&prepared, settings.seed, rows.samples as u32).expect("the device goes on");
            let whole = undisturbed.render(|_| ControlFlow::Continue(())).expect("it renders").film;
            let of_rows = whole.sum.iter().skip((row * WIDTH) as usize).take(rows.sum.len());
            assert!(rows.sum.iter().eq(of_rows), "after {submissions} submissions");
            row += rows.height;
        }
        assert_silent(&device);
    }
    assert_silent(&other);
}
