//! Rays and pixels against a path tracer on the CPU that shares no code with the kernels: every
//! bounce sends exactly as many rays and shadow rays, and every pixel has the same radiance.
//!
//! Sizes and seeds are such that rounding turns no decision of any path, on lavapipe or on
//! SwiftShader, whose sines are off by 2e-4: a path that hits another triangle is a fault.

use crate::common::{device, own_scene, render_on, scene_from, tries};
use glam::DVec3;
use raywave::constants::COUNTED_BOUNCES;
use raywave::render::Outcome;
use raywave::scene::Scene;
use raywave::settings::{Integrator, RouletteMode, Sampler, Scheduler, Settings, ShadowRays};
use raywave_studies::oracle::{Path, Reference};

/// Largest error of a pixel, as a share of its radiance plus the image's mean. The kernels round
/// positions and directions to 24 bits, and a path adds up such errors and divides them by cosines:
/// 3e-5 is the largest seen on lavapipe, and 9e-5 on SwiftShader with its sines. The mean is there
/// for light that grazes: its relative error has no bound, but it is dim. A sample that is lost or
/// drawn from other numbers is off by its whole radiance.
const TOLERANCE: f64 = 2e-4;

/// Three lamps of unlike areas, seen through a lens.
const LAMPS: [&str; 3] = [
    "[camera]\neye = [0.3, 1.2, 3.1]\ntarget = [0.0, 0.7, 0.0]\nvfov = 55\naperture = 0.05\nfocus = 3\n\
     [[mesh]]\nfile = \"scene.obj\"\n",
    "mtllib scene.mtl\n\
     v -2 0 2\nv 2 0 2\nv 2 0 -2\nv -2 0 -2\nusemtl floor\nf 1 2 3 4\n\
     v -2 2 -2\nv 2 2 -2\nusemtl wall\nf 4 3 6 5\n\
     v -0.7 0.1 0.4\nv 0.1 0.1 -0.5\nv -0.3 1.1 -0.2\nusemtl card\nf 7 8 9\n\
     v 1.7 1.7 0.5\nv 1.6 0.2 -0.3\nv 0.9 1.6 -1.4\nusemtl warm\nf 10 12 11\n\
     v -1.6 1.9 0.3\nv -0.7 1.9 -1.2\nv 0.3 1.9 0.9\nusemtl white\nf 13 14 15\n\
     v 0.4 1.7 1.1\nv 1.0 1.9 0.8\nv 0.7 1.5 0.3\nusemtl cold\nf 16 18 17\n",
    "newmtl floor\nKd 0.7 0.6 0.5\nnewmtl wall\nKd 0.4 0.7 0.6\nnewmtl card\nKd 0.8 0.2 0.2\n\
     newmtl warm\nKe 9 5 2\nnewmtl white\nKe 6 6 6\nnewmtl cold\nKe 20 30 50\n",
];

/// A mirror, a prism of glass, a slab that bends light alone, and a glossy card.
const OPTICS: [&str; 3] = [
    "[camera]\neye = [0.1, 1.3, 3.3]\ntarget = [0.0, 0.6, 0.0]\nvfov = 50\n[[mesh]]\nfile = \"scene.obj\"\n",
    "mtllib scene.mtl\n\
     v -2 0 2\nv 2 0 2\nv 2 0 -2\nv -2 0 -2\nusemtl floor\nf 1 2 3 4\n\
     v -1.8 0.1 -0.4\nv -0.2 0.1 -1.6\nv -0.1 1.6 -1.7\nv -1.7 1.6 -0.5\nusemtl mirror\nf 5 6 7 8\n\
     v -0.8 0.1 0.9\nv -0.1 0.1 0.6\nv -0.6 0.1 0.2\nv -0.8 1.0 0.9\nv -0.1 1.0 0.6\nv -0.6 1.0 0.2\nusemtl glass\n\
     f 9 11 10\nf 12 13 14\nf 9 10 13 12\nf 10 11 14 13\nf 11 9 12 14\n\
     v 0.3 0.1 0.7\nv 1.0 0.1 0.9\nv 1.1 0.1 0.6\nv 0.4 0.1 0.4\nv 0.3 0.8 0.7\nv 1.0 0.8 0.9\nv 1.1 0.8 0.6\nv 0.4 0.8 0.4\n\
     usemtl crystal\nf 15 18 17 16\nf 19 20 21 22\nf 15 16 20 19\nf 16 17 21 20\nf 17 18 22 21\nf 18 15 19 22\n\
     v 0.3 0.1 -1.2\nv 1.6 0.1 -0.5\nv 1.7 1.4 -0.8\nv 0.4 1.4 -1.5\nusemtl glossy\nf 23 24 25 26\n\
     v -1.6 2.2 1.0\nv -1.5 2.3 -1.2\nv 1.3 2.2 -1.1\nv 1.2 2.1 1.1\nusemtl lamp\nf 27 28 29 30\n",
    "newmtl floor\nKd 0.7 0.6 0.5\nnewmtl mirror\nillum 3\nKs 0.9 0.8 0.7\nnewmtl glass\nillum 7\nNi 1.5\nTf 0.8 1 0.9\n\
     newmtl crystal\nillum 6\nNi 1.3\nTf 1 0.7 0.8\nnewmtl glossy\nKd 0.2 0.3 0.1\nKs 0.3 0.2 0.6\nNs 12\nnewmtl lamp\nKe 9 8 7\n",
];

/// Rays and shadow rays of each bounce.
fn rays_by_bounce(paths: &[Vec<Path>]) -> Vec<[u64; 2]> {
    let mut counts = vec![[0; 2]; COUNTED_BOUNCES as usize];
    for path in paths.iter().flatten() {
        for (count, casts_shadow_ray) in counts.iter_mut().zip(&path.casts_shadow_ray) {
            count[0] += 1;
            count[1] += u64::from(*casts_shadow_ray);
        }
    }
    counts
}

fn total(counts: &[[u64; 2]]) -> [u64; 2] {
    counts.iter().fold([0; 2], |[a, b], [c, d]| [a + c, b + d])
}

/// Samples that found light which a surface scattered.
fn lit_surfaces(paths: &[Vec<Path>]) -> usize {
    let scatters = |path: &Path| path.casts_shadow_ray.len() > 1 || path.casts_shadow_ray[0];
    paths.iter().flatten().filter(|path| scatters(path) && path.radiance != DVec3::ZERO).count()
}

/// Fails where a pixel of `actual` is not as expected.
fn assert_pixels(what: &str, actual: &[DVec3], expected: &[DVec3], tolerance: f64) {
    let mean = expected.iter().sum::<DVec3>() / expected.len() as f64;
    for (pixel, (actual, expected)) in actual.iter().zip(expected).enumerate() {
        let error = (*actual - *expected).abs();
        let allowed = tolerance * (*expected + mean);
        assert!(error.cmple(allowed).all(), "{what} of pixel {pixel} is {actual} and should be {expected}");
    }
}

/// Renders the scene with all integrators, short and long paths, every roulette and none, both samplers,
/// and a clamp, by schedulers in turn.
fn check(scene: &Scene, width: u32, height: u32) {
    let device = device();
    let own = Settings {
        width,
        height,
        samples: 2,
        roulette: 0.0,
        sampler: Sampler::Independent,
        roulette_from: 1,
        ..scene.settings
    };
    let bounded = |bounces| Settings { max_bounces: Some(bounces), ..own };
    let constant = |settings| Settings { roulette: 0.3, ..settings };
    let throughput = |settings| Settings { roulette_mode: RouletteMode::Throughput, ..settings };
    let sobol = |settings| Settings { sampler: Sampler::Sobol, ..settings };
    let clamped = |settings| Settings { clamp: Some(0.5), ..settings };
    let unbounded = Settings { max_bounces: None, ..own };
    let kinds = [
        bounded(0),
        bounded(1),
        bounded(4),
        constant(bounded(1)),
        constant(bounded(4)),
        constant(unbounded),
        sobol(bounded(1)),
        sobol(throughput(bounded(4))),
        clamped(throughput(constant(unbounded))),
    ];
    let (mut kind, mut cases) = (0, 0..);
    for integrator in [Integrator::Implicit, Integrator::Explicit, Integrator::Mis] {
        for settings in kinds {
            let settings = Settings { integrator, ..settings };
            let Settings { max_bounces, roulette, roulette_mode, sampler, clamp, .. } = settings;
            // Two of the schedulers in turn: that all give one image is the matter of `schedulers.rs`.
            kind += 1;
            let schedulers = [
                (Scheduler::Wavefront, ShadowRays::Deferred),
                (Scheduler::Bounce, ShadowRays::Deferred),
                (Scheduler::Bounce, ShadowRays::AtOnce),
                (Scheduler::Megakernel, ShadowRays::AtOnce),
            ];
            let mut tried = vec![schedulers[kind % 4], schedulers[(kind + 2) % 4]];
            tried.retain(|_| cases.next().is_some_and(|case| tries(&device, case, 5)));
            if tried.is_empty() {
                continue;
            }
            let reference = Reference::new(scene, &settings).expect("it knows the scene");
            let samples = |pixel| (0..settings.samples).map(|sample| reference.path(pixel, sample)).collect();
            let paths: Vec<Vec<Path>> = (0..width * height).map(samples).collect();
            let counts = rays_by_bounce(&paths);
            let case = format!(
                "{integrator:?}, {max_bounces:?} bounces, roulette {roulette} {roulette_mode:?}, {sampler:?}, clamp {clamp:?}"
            );
            assert_eq!(counts[COUNTED_BOUNCES as usize - 1], [0, 0], "paths too long to be counted by bounce; {case}");
            assert!(max_bounces == Some(0) || lit_surfaces(&paths) > 5, "too dark to tell; {case}");

            let [_, light_rays] = total(&counts);
            let [bounce_rays, _] = total(&counts[1..]);
            let sums = |power: fn(DVec3) -> DVec3| -> Vec<DVec3> {
                paths.iter().map(|samples| samples.iter().map(|path| power(path.radiance)).sum()).collect()
            };
            for (scheduler, shadow_rays) in tried {
                let case = format!("{case}, {scheduler:?}, shadow rays {shadow_rays:?}");
                let settings = Settings { scheduler: Some(scheduler), shadow_rays, ..settings };
                let Outcome { film, statistics } = render_on(&device, scene, &settings);
                if scheduler != Scheduler::Megakernel {
                    let counted: Vec<_> = statistics.ray_counts.iter().map(|c| [c.rays(), c.shadow_rays()]).collect();
                    assert_eq!(counted, counts, "rays and shadow rays by bounce; {case}");
                }
                let counted = [statistics.camera_rays, statistics.bounce_rays, statistics.shadow_rays];
                assert_eq!(counted, [counts[0][0], bounce_rays, light_rays], "camera, bounce, shadow rays; {case}");
                // Two samples are known by their sum and sum of squares, but for their order.
                assert_pixels(&format!("{case}: sum"), &film.sum, &sums(|r| r), TOLERANCE);
                let what = format!("{case}: sum of squares");
                assert_pixels(&what, &film.sum_of_squares, &sums(|r| r * r), 2.0 * TOLERANCE);
            }
        }
    }
}

#[test]
fn cornell_box() {
    check(&own_scene("cornell-box"), 24, 24);
}

#[test]
fn lamps_of_unlike_areas_through_a_lens() {
    let [toml, obj, mtl] = LAMPS;
    check(&scene_from(toml, obj, mtl), 24, 16);
}

#[test]
fn mirror_glass_and_gloss() {
    let [toml, obj, mtl] = OPTICS;
    check(&scene_from(toml, obj, mtl), 16, 16);
}
