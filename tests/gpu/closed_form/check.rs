//! Renders a stage and holds it against its closed form.

use glam::DVec3;
use raywave::film::FilmMoments;
use raywave::gpu::Device;
use raywave::scene::Scene;
use raywave::settings::Integrator::{self, Explicit, Implicit, Mis};
use raywave::settings::{Sampler, Settings};
use raywave_studies::stats::{sidak_level, z_test};

use super::stage::{Stage, View};
use crate::common::render_on;

pub const ALL: [Integrator; 3] = [Implicit, Explicit, Mis];

/// Rounding of a sample, relative: a few dozen operations of 6e-8 each, and the trigonometry of
/// the device.
pub const ROUNDING: f64 = 1e-5;

/// Probability that one render of a right renderer fails. Some hundred renders are compared.
const LEVEL: f64 = 1e-4;

/// Pixels along the side of a block: enough samples for its mean to be normal.
const BLOCK: u32 = 8;

/// Points along the side of a pixel at which the closed form is taken.
const POINTS: u32 = 16;

/// A square image of paths of at most `bounces` bounces.
pub fn settings(size: u32, samples: u32, bounces: u32) -> Settings {
    Settings {
        width: size,
        height: size,
        samples,
        max_bounces: Some(bounces),
        sampler: Sampler::Independent,
        seed: 1,
        ..Settings::default()
    }
}

/// The same image of unbounded paths that stop with probability `roulette`.
pub fn unbounded(size: u32, samples: u32, roulette: f64) -> Settings {
    Settings { max_bounces: None, roulette, ..settings(size, samples, 0) }
}

/// Checks every sample, with all integrators: one a pixel, so that no mean hides it.
pub fn assert_every_sample(device: &Device, case: &str, stage: &Stage, settings: Settings, expected: DVec3) {
    assert_eq!(settings.samples, 1);
    let scene = stage.scene();
    for integrator in ALL {
        let film = render_on(device, &scene, &Settings { integrator, ..settings }).film;
        let allowed = ROUNDING * expected.max_element().max(f64::MIN_POSITIVE);
        for (pixel, sample) in film.sum.iter().enumerate() {
            let off = (sample - expected).abs().max_element();
            assert!(off <= allowed, "{case}, {integrator:?}: pixel {pixel} is {sample}, not {expected}");
        }
    }
}

/// Checks the image, with all integrators, against the radiance that arrives from a direction.
/// `bias` is how far the closed form itself may be off, relative.
pub fn assert_image(
    device: &Device,
    case: &str,
    stage: &Stage,
    settings: Settings,
    bias: f64,
    radiance: impl Fn(DVec3) -> DVec3,
) {
    assert_image_of(device, case, (&stage.scene(), &stage.view), settings, bias, radiance);
}

/// The same of a scene that something was done to.
pub fn assert_image_of(
    device: &Device,
    case: &str,
    (scene, view): (&Scene, &View),
    settings: Settings,
    bias: f64,
    radiance: impl Fn(DVec3) -> DVec3,
) {
    let expected = pixel_means(view, settings.width, radiance);
    for integrator in ALL {
        let film = render_on(device, scene, &Settings { integrator, ..settings }).film;
        assert_agrees(&format!("{case}, {integrator:?}"), &film, &expected, bias);
    }
}

/// The closed form averaged over each pixel of a square image: midpoints, whose error at an edge
/// is a thirtieth of a pixel, far under the noise of a pixel's samples.
fn pixel_means(view: &View, size: u32, radiance: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    let at =
        |pixel: u32, point: u32| (f64::from(pixel) + (f64::from(point) + 0.5) / f64::from(POINTS)) / f64::from(size);
    let mean = |x: u32, y: u32| {
        let points = (0..POINTS * POINTS).map(|i| view.direction(at(x, i % POINTS), at(y, i / POINTS)));
        points.map(&radiance).sum::<DVec3>() / f64::from(POINTS * POINTS)
    };
    (0..size * size).map(|i| mean(i % size, i / size)).collect()
}

/// Compares a film with the image it should show.
pub fn assert_agrees(case: &str, film: &FilmMoments, expected: &[DVec3], bias: f64) {
    let right = Estimate { mean: expected.to_vec(), variance: vec![DVec3::ZERO; expected.len()] };
    assert_same(case, film.width, &Estimate::of(film), &right, bias, film.samples as f64);
}

/// Compares two films of one scene.
pub fn assert_same_mean(case: &str, a: &FilmMoments, b: &FilmMoments) {
    let samples = a.samples.min(b.samples) as f64;
    assert_same(case, a.width, &Estimate::of(a), &Estimate::of(b), 0.0, samples);
}

/// What is known of each pixel.
struct Estimate {
    mean: Vec<DVec3>,
    variance: Vec<DVec3>,
}

impl Estimate {
    fn of(film: &FilmMoments) -> Self {
        let variance = film.variance_of_mean().pixels.iter().map(|v| v.as_dvec3()).collect();
        Self { mean: film.sum.iter().map(|sum| sum / film.samples as f64).collect(), variance }
    }
}

/// Compares the sums of blocks and of the whole image, each channel. All of them together fail a
/// right image with probability [`LEVEL`]. What rounding and `bias` explain is no deviation.
fn assert_same(case: &str, width: u32, found: &Estimate, right: &Estimate, bias: f64, samples: f64) {
    let columns = width.div_ceil(BLOCK) as usize;
    let block_of = |pixel: usize| {
        let (x, y) = (pixel % width as usize, pixel / width as usize);
        x / BLOCK as usize + columns * (y / BLOCK as usize)
    };
    let whole = block_of(found.mean.len() - 1) + 1;
    let allowed = sidak_level(LEVEL, 3 * (whole + 1));
    // Samples that all agree may still hide one that would not have.
    let one_sample = right.mean.iter().fold(DVec3::ZERO, |peak, mean| peak.max(*mean)) / samples;
    for block in 0..=whole {
        let pixels = || (0..found.mean.len()).filter(|&pixel| block == whole || block_of(pixel) == block);
        let sum = |of: &dyn Fn(usize) -> DVec3| pixels().map(of).sum::<DVec3>();
        let (is, should) = (sum(&|i| found.mean[i]), sum(&|i| right.mean[i]));
        let error = (one_sample * one_sample + sum(&|i| found.variance[i] + right.variance[i])).map(f64::sqrt);
        let off = ((is - should).abs() - (bias + ROUNDING) * should).max(DVec3::ZERO);
        let name = if block == whole { "the whole image".to_owned() } else { format!("block {block}") };
        for channel in 0..3 {
            let test = z_test(off[channel], error[channel]);
            assert!(
                test.p >= allowed,
                "{case}: {name} sums to {is} and should to {should}; channel {channel} has z {:.2} and p {:.1e}, under {allowed:.1e}",
                test.z,
                test.p
            );
        }
    }
}
