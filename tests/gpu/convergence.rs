//! How the error of an image falls with its samples: as 1/√n for independent ones, and faster for a Sobol
//! sequence where the light is smooth. `bench/convergence` shows the same at length.

use crate::common::{device, own_scene, render_on, tries};
use raywave::gpu::Device;
use raywave::image::Image;
use raywave::scene::Scene;
use raywave::settings::{Integrator, Sampler, Settings};
use raywave_studies::stats::Moments;

const SAMPLES: [u32; 4] = [4, 16, 64, 256];
/// Parts of the pixels that each show a slope of their own.
const PARTS: usize = 8;
/// Two-sided 95 % quantile of Student's t with 7 degrees of freedom.
const STUDENT: f64 = 2.365;

/// Slope of the logarithm of the error over that of the samples, and half of its 95 % interval.
///
/// Half of the squared difference of two seeds is a pixel's variance. Pixels know nothing of each other, so
/// parts of them are repeated experiments.
fn order(device: &Device, scene: &Scene, integrator: Integrator, sampler: Sampler) -> (f64, f64) {
    let variances = SAMPLES.map(|samples| {
        let [a, b]: [Image; 2] = [1, 2].map(|seed| {
            let own = Settings { width: 32, height: 32, samples, seed, ..scene.settings };
            render_on(device, scene, &Settings { integrator, sampler, ..own }).film.mean()
        });
        let mut parts = [0.0; PARTS];
        for (pixel, (a, b)) in a.pixels.iter().zip(&b.pixels).enumerate() {
            parts[pixel % PARTS] += 0.5 * f64::from((*a - *b).length_squared());
        }
        parts
    });
    let x = SAMPLES.map(|samples| f64::from(samples).ln());
    let middle = x.iter().sum::<f64>() / x.len() as f64;
    let spread: f64 = x.iter().map(|x| (x - middle).powi(2)).sum();
    let mut slopes = Moments::default();
    for part in 0..PARTS {
        let rise = |(x, variances): (&f64, &[f64; PARTS])| (x - middle) * 0.5 * variances[part].ln();
        slopes.push(x.iter().zip(&variances).map(rise).sum::<f64>() / spread);
    }
    (slopes.mean(), STUDENT * slopes.standard_error())
}

#[test]
fn errors_fall_by_the_order_of_their_sampler() {
    let device = device();
    let scene = own_scene("smooth");
    let cases = [
        (Integrator::Implicit, Sampler::Independent),
        (Integrator::Explicit, Sampler::Independent),
        (Integrator::Mis, Sampler::Independent),
        (Integrator::Explicit, Sampler::Sobol),
        (Integrator::Mis, Sampler::Sobol),
    ];
    for (_, (integrator, sampler)) in cases.into_iter().enumerate().filter(|(case, _)| tries(&device, *case, 3)) {
        let (slope, half) = order(&device, &scene, integrator, sampler);
        let what = format!("{integrator:?}, {sampler:?}: {slope:.3} ± {half:.3}");
        println!("{what}");
        if sampler == Sampler::Independent {
            assert!(half < 0.05 && (slope + 0.5).abs() < half + 0.01, "{what} is not -1/2");
        } else {
            assert!(slope + half < -0.52, "{what} is no faster than -1/2");
        }
    }
}
