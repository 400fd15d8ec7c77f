//! A film that does not fit the device is rendered tile after tile. The tiles leave no trace in the
//! image, and a render that is broken off has equal samples in the rows that it finished.

mod common;

use std::ops::ControlFlow;

use common::{assert_silent, device, own_scene, tries};
use raywave::gpu::Device;
use raywave::render::{Outcome, PreparedScene, Progress, Scheduler, Session, SessionOptions, Settings};
use raywave::scene::Scene;

const WIDTH: u32 = 24;
const HEIGHT: u32 = 17;
const SAMPLES: u32 = 4;

/// Renders with a film of that many rows.
fn render(
    device: &Device,
    scene: &Scene,
    settings: Settings,
    film_rows: u32,
    progress: impl FnMut(&Progress) -> ControlFlow<()>,
) -> Outcome {
    let settings = Settings { width: WIDTH, height: HEIGHT, ..settings };
    let film_bytes = Some(u64::from(64 * WIDTH * film_rows));
    let options = SessionOptions { film_bytes, ..SessionOptions::default() };
    let prepared = PreparedScene::for_lanes(scene, &settings, device.description().subgroup_size);
    let mut session = Session::with_options(device, &prepared.expect("the scene fits"), &settings, options)
        .expect("the session starts");
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
            let settings = Settings { scheduler: Some(scheduler), samples: SAMPLES, ..Settings::of(&scene) };
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

#[test]
fn a_render_that_is_broken_off_keeps_the_tiles_that_are_finished() {
    let device = device();
    let scene = own_scene("cornell-box");
    // A batch is four samples of a tile of five rows.
    let settings = Settings { samples: 4 * SAMPLES, in_flight: Some(4 * 5 * WIDTH), ..Settings::of(&scene) };
    let whole = render(&device, &scene, settings, HEIGHT, |_| ControlFlow::Continue(())).film;
    // The last batch before the end, then rows and samples of the image.
    for (last, rows, samples) in
        [(1, 5, 4), (3, 5, 12), (4, 5, 16), (6, 5, 16), (8, 10, 16), (13, 15, 16), (14, 17, 16)]
    {
        let mut batches = 0;
        let outcome = render(&device, &scene, settings, 5, |_| {
            batches += 1;
            if batches < last { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        assert_eq!(batches, last, "the render goes on after its end");
        assert_eq!((outcome.statistics.rows, outcome.statistics.samples), (rows, samples), "after {last} batches");
        assert_eq!(outcome.film.samples, u64::from(samples));
        let kept = &whole.sum[..(WIDTH * rows) as usize];
        assert_eq!(outcome.film.sum == kept, samples == 4 * SAMPLES, "after {last} batches");
    }
    assert_silent(&device);
}
