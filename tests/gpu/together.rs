//! Sessions that share an image make the bits of one that renders it alone. Here they are of one device, which is as good:
//! what they share is on the host.

use std::ops::ControlFlow;
use std::time::Duration;

use crate::common::{assert_silent, device, own_scene, prepare};
use raywave::gpu::GpuError;
use raywave::render::{Ending, Kept, RenderError, Session, SessionOptions, render_together};
use raywave::settings::{Scheduler, Settings};

const WIDTH: u32 = 24;
const HEIGHT: u32 = 37;

#[test]
fn an_image_that_is_shared_is_the_same() {
    let device = device();
    let scene = own_scene("cornell-glass");
    let settings = Settings { width: WIDTH, height: HEIGHT, samples: 44, block_samples: Some(8), ..scene.settings };
    let prepared = prepare(&device, &scene, &settings);
    let session = |scheduler: Scheduler, film_rows: u32| {
        let settings = Settings { scheduler: Some(scheduler), ..settings };
        let film_bytes = Some(u64::from(64 * WIDTH * film_rows));
        let options = SessionOptions { film_bytes, ..SessionOptions::default() };
        Session::with_options(&device, &prepared, &settings, options).expect("the session starts")
    };
    let mut alone = Kept::default();
    let cost = session(Scheduler::Bounce, HEIGHT).go_on(&mut alone, |_| ControlFlow::Continue(())).expect("it renders");
    // At once, and broken off and gone on with.
    for batches in [u64::MAX, 3] {
        let sessions = vec![
            session(Scheduler::Wavefront, 5),
            session(Scheduler::Megakernel, HEIGHT),
            session(Scheduler::Bounce, 11),
        ];
        let (mut kept, mut calls) = (Kept::every(Duration::ZERO), 0);
        let (ended, _) = render_together(sessions, &mut kept, |_| {
            calls += 1;
            if calls < batches { ControlFlow::Continue(()) } else { ControlFlow::Break(Ending::Now) }
        });
        assert!(ended.iter().all(Result::is_ok));
        let sessions = vec![session(Scheduler::Bounce, HEIGHT), session(Scheduler::Wavefront, 3)];
        let (ended, statistics) = render_together(sessions, &mut kept, |_| ControlFlow::Continue(()));
        assert!(ended.iter().all(Result::is_ok));
        assert!(kept.film() == alone.film(), "broken off after {batches} calls");
        assert_eq!((statistics.sample_count, statistics.rays()), (cost.sample_count, cost.rays()));
    }
    assert_silent(&device);
}

#[test]
fn others_go_on_where_one_device_is_lost() {
    let (other, lost) = (device(), device());
    let scene = own_scene("cornell-box");
    let settings = Settings { width: WIDTH, height: HEIGHT, samples: 44, block_samples: Some(8), ..scene.settings };
    let prepared = prepare(&other, &scene, &settings);
    let session = |device| Session::new(device, &prepared, &settings).expect("the session starts");
    let mut alone = Kept::default();
    session(&other).go_on(&mut alone, |_| ControlFlow::Continue(())).expect("it renders");
    let sessions = vec![session(&lost), session(&other)];
    lost.lose_after(5);
    let mut kept = Kept::default();
    let (ended, _) = render_together(sessions, &mut kept, |_| ControlFlow::Continue(()));
    assert!(matches!(&ended[0], Err(RenderError::Gpu(GpuError::DeviceLost { .. }))), "{:?}", ended[0].as_ref().err());
    assert!(ended[1].is_ok());
    // What the lost one had begun is lacking, and made up for.
    session(&other).go_on(&mut kept, |_| ControlFlow::Continue(())).expect("it renders");
    assert!(kept.film() == alone.film());
    assert_silent(&other);
}
