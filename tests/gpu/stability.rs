//! The operating envelope: what it promises holds at its extremes, and a sample that is not finite is told by pixel,
//! sample and bounce, by every scheduler.

use std::ops::ControlFlow;

use crate::common::{assert_silent, device, prepare, scene_from};
use raywave::render::{Fault, Session, find_faults};
use raywave::scene::Scene;
use raywave::settings::{Integrator, Scheduler, Settings, ShadowRays};
use raywave_studies::stability::{Level, plans};

#[test]
fn all_that_is_promised_holds() {
    let device = device();
    let mut broken = Vec::new();
    for plan in plans() {
        let row = plan.run(&device, Level::Quick);
        assert!(!row.trials.is_empty(), "{} tries nothing", row.name);
        for trial in row.trials.iter().filter(|trial| trial.required && !trial.holds(row.allowed)) {
            broken.push(format!("{} at {}: {trial:?}, {} allowed", row.name, trial.setting, row.allowed));
        }
        assert_silent(&device);
    }
    assert!(broken.is_empty(), "not as promised:\n{}", broken.join("\n"));
}

/// Prisms of a refractive index so small that the square of it is no number's reciprocal: light that gets to one is
/// weighted by infinity. A mirror before them makes paths meet one at bounce 1 as well.
fn faulty() -> Scene {
    scene_from(
        "[camera]\neye = [0.0, 0.0, 3.0]\ntarget = [0.0, 0.0, 0.0]\nvfov = 40\n[[mesh]]\nfile = \"scene.obj\"\n\
         [environment]\nradiance = [1.0, 1.0, 1.0]\n",
        "mtllib scene.mtl\nv -1 -1 0\nv 0 -1 0\nv 0 0 0\nv -1 0 0\nusemtl bad\nf 1 4 3 2\n\
         v 0.1 0.1 0\nv 1 0.1 0\nv 1 1 0\nv 0.1 1 0\nusemtl mirror\nf 5 6 7 8\n\
         v -9 -9 4\nv 9 -9 4\nv 9 9 4\nv -9 9 4\nusemtl bad\nf 9 10 11 12\n",
        "newmtl bad\nillum 6\nNi 1e-30\nnewmtl mirror\nillum 3\nKs 1\n",
    )
}

#[test]
fn faults_are_told_by_pixel_sample_and_bounce() {
    let device = device();
    let scene = faulty();
    let mut first: Option<(u32, Vec<Fault>)> = None;
    for (scheduler, shadow_rays, bvh) in [
        (Scheduler::Wavefront, ShadowRays::Deferred, None),
        (Scheduler::Bounce, ShadowRays::Deferred, None),
        (Scheduler::Bounce, ShadowRays::AtOnce, None),
        (Scheduler::Megakernel, ShadowRays::AtOnce, None),
        (Scheduler::Megakernel, ShadowRays::AtOnce, Some(raywave::bvh::BvhKind::Bvh2)),
    ] {
        let settings = Settings {
            width: 4,
            height: 4,
            samples: 2,
            integrator: Integrator::Implicit,
            max_bounces: Some(4),
            scheduler: Some(scheduler),
            shadow_rays,
            bvh,
            ..scene.settings
        };
        let prepared = prepare(&device, &scene, &settings);
        let outcome =
            Session::new(&device, &prepared, &settings).unwrap().render(|_| ControlFlow::Continue(())).unwrap();
        assert!(outcome.film.sum.iter().all(|sum| sum.is_finite()), "a fault is in the film, {scheduler:?}");
        let faults = find_faults(&device, &prepared, &settings, &outcome.statistics).unwrap();
        let count = outcome.statistics.nonfinite_samples;
        assert_eq!(faults.len(), count.min(16) as usize);
        // The prism of the lower left spoils paths at once, the one behind the eye those that the mirror sends there.
        let of = |bounce| faults.iter().filter(|fault| fault.bounce == Some(bounce)).collect::<Vec<_>>();
        assert!(!of(0).is_empty() && !of(1).is_empty(), "{faults:?}");
        assert_eq!(of(0).len() + of(1).len(), faults.len(), "{faults:?}");
        assert!(of(0).iter().all(|fault| fault.x < 2 && fault.y >= 2), "{faults:?}");
        assert!(of(1).iter().all(|fault| fault.x >= 2 && fault.y < 2), "{faults:?}");
        let (expected, expected_faults) = first.get_or_insert_with(|| (count, faults.clone()));
        assert_eq!((*expected, &*expected_faults), (count, &faults), "{scheduler:?}, {shadow_rays:?}");
    }
    assert_silent(&device);
}
