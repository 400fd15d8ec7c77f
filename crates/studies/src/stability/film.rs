//! Films, cameras and many samples.

use std::ops::ControlFlow;

use glam::{DVec3, dvec3};

use super::Plan;
use super::lab::{Lab, Measured, tell, trial};
use super::stage::{grey, lamp, stage, stage_with_up};
use crate::studies::Trial;
use raywave::render::{RenderError, Renderer};
use raywave::scene::Scene;
use raywave::settings::{Integrator, Settings};

pub const PLANS: &[Plan] = &[
    Plan {
        name: "samples",
        driven: "samples of one pixel of radiance 0.1",
        measure: "relative error of the mean",
        allowed: 1e-7,
        remark: "a running sum in f32 is off by 1e-2 at 2^20 and by more than half at 2^24",
        reduced: "",
        trials: samples,
    },
    Plan {
        name: "film-size",
        driven: "size of the film",
        measure: "share of pixels that show the wrong half of the picture",
        allowed: 0.0,
        remark: "one sample a pixel, by tiles where the film is large",
        reduced: "up to 4096 x 4096",
        trials: film_size,
    },
    Plan {
        name: "vfov-narrow",
        driven: "vertical field of view, degrees, of stripes that fill it",
        measure: "share of samples that see what the oracle does not",
        allowed: 1e-3,
        remark: "the eye stands as far away as fits the view",
        reduced: "96² samples a setting",
        trials: |lab| vfov(lab, lab.ladder(&[60.0, 1.0, 1e-3], &[1e-6, 1e-9]), true),
    },
    Plan {
        name: "vfov-zoom",
        driven: "vertical field of view, degrees, of stripes one unit from the eye",
        measure: "share of samples that see what the oracle does not",
        allowed: 2e-2,
        remark: "directions are rounded to 6e-8",
        reduced: "96² samples a setting",
        trials: |lab| vfov(lab, lab.ladder(&[60.0, 1.0, 1e-2, 1e-3], &[1e-4, 1e-5]), false),
    },
    Plan {
        name: "vfov-wide",
        driven: "vertical field of view, degrees, of stripes that fill it",
        measure: "share of samples that see what the oracle does not",
        allowed: 1e-3,
        remark: "",
        reduced: "96² samples a setting",
        trials: |lab| vfov(lab, lab.ladder(&[90.0, 170.0, 179.0, 179.9], &[179.99, 179.9999]), false),
    },
    Plan {
        name: "up",
        driven: "angle between the view and the camera's up, radians",
        measure: "relative error of the share of the view that a disc covers",
        allowed: 1e-3,
        remark: "parallel, another axis is taken",
        reduced: "96² x 16 samples a setting",
        trials: up,
    },
];

/// A view of a lamp alone.
fn facing_a_lamp(radiance: f32) -> Scene {
    stage(DVec3::Z, DVec3::ZERO, 10.0).material(lamp(radiance)).square(DVec3::ZERO, DVec3::Z, 1.0).build()
}

fn samples(lab: &Lab<'_>) -> Vec<Trial> {
    let run = |(log, required): (u32, bool)| {
        let picture = Settings { width: 1, height: 1, samples: 1 << log, ..lab.picture(Integrator::Implicit, 0) };
        let outcome = lab.mean(&facing_a_lamp(0.1), &picture, f64::from(0.1_f32));
        // All samples are alike, so what the film takes for their error is rounding.
        trial(format!("2^{log}"), required, outcome.map(|measured| Measured { standard_error: 0.0, ..measured }))
    };
    let most = lab.by_level(20, 24, 24);
    lab.ladder(&[0, 12, 20, most], &[]).into_iter().map(run).collect()
}

fn film_size(lab: &Lab<'_>) -> Vec<Trial> {
    let largest = lab.by_level((1, 1024), (4096, 4096), (16_384, 16_384));
    let run = |((width, height), required): ((u32, u32), bool)| {
        trial(format!("{width} x {height}"), required, halves(lab, width, height))
    };
    lab.ladder(&[(1, 1), (1, 16_384), (16_384, 1), largest], &[]).into_iter().map(run).collect()
}

/// Looks at a lamp of radiance 1 left above the diagonal of the film, and of 2 right below it.
fn halves(lab: &Lab<'_>, width: u32, height: u32) -> Result<Measured, RenderError> {
    let aspect = f64::from(width) / f64::from(height);
    let corner = |x: f64, y: f64| dvec3(1.1 * aspect * x, 1.1 * y, 0.0);
    let scene = stage(DVec3::Z, DVec3::ZERO, 90.0)
        .material(lamp(1.0))
        .polygon(&[corner(-1.0, 1.0), corner(-1.0, -1.0), corner(1.0, 1.0)])
        .material(lamp(2.0))
        .polygon(&[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)])
        .build();
    let settings = Settings { width, height, samples: 1, ..lab.picture(Integrator::Implicit, 0) };
    let mut session = Renderer::new(lab.device)?.session(&scene, &settings)?;
    let (mut row, mut wrong) = (0, 0);
    let statistics = session.render_tiles(
        |_| ControlFlow::Continue(()),
        |tile| {
            for (i, sum) in tile.sum.iter().enumerate() {
                let (x, y) = (i as u64 % u64::from(width), row + i as u64 / u64::from(width));
                // Of the pixel's corners, in lengths of the film: where both lie on one side of the diagonal from
                // lower left to upper right, so does the sample.
                let (left, right) = (x as f64 / f64::from(width), (x + 1) as f64 / f64::from(width));
                let (top, bottom) = (y as f64 / f64::from(height), (y + 1) as f64 / f64::from(height));
                const ROUNDING: f64 = 1e-6;
                let right_one = if right + bottom < 1.0 - ROUNDING {
                    sum.x == 1.0
                } else if left + top > 1.0 + ROUNDING {
                    sum.x == 2.0
                } else {
                    sum.x == 1.0 || sum.x == 2.0
                };
                wrong += u64::from(!right_one);
            }
            row += u64::from(tile.height);
        },
    )?;
    let checked = u64::from(width) * u64::from(height);
    let value = (wrong + checked - row * u64::from(width)) as f64 / checked as f64;
    Ok(Measured { value, standard_error: 0.0, checked, nonfinite: statistics.nonfinite_samples.into() })
}

fn vfov(lab: &Lab<'_>, angles: Vec<(f64, bool)>, steps_back: bool) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Implicit, 0);
    let run = |(angle, required): (f64, bool)| {
        // Half of the view at distance 1, or 1 as far away as it takes.
        let slope = (0.5 * angle.to_radians()).tan();
        let (distance, half) = if steps_back { (1.0 / slope, 1.0) } else { (1.0, slope) };
        let towards = dvec3(0.48, 0.6, 0.64);
        let across = half * towards.any_orthonormal_vector();
        let along = towards.cross(across);
        let stripe = |i: i32| {
            let (left, right) = (f64::from(2 * i) / 5.0, f64::from(2 * i + 1) / 5.0);
            vec![
                left * across - 2.0 * along,
                right * across - 2.0 * along,
                right * across + 2.0 * along,
                left * across + 2.0 * along,
            ]
        };
        let stripes: Vec<_> = (-3..3).map(stripe).collect();
        let scene = stage(distance * towards, DVec3::ZERO, angle)
            .material(lamp(1.0))
            .polygons(&stripes)
            .material(grey(0.0))
            .square(-towards, towards, 4.0 * half)
            .build();
        trial(tell(angle), required, lab.against_paths(&scene, &picture, (&scene, 1.0), false))
    };
    angles.into_iter().map(run).collect()
}

fn up(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = Settings { samples: 16, ..lab.picture(Integrator::Implicit, 0) };
    let run = |(angle, required): (f64, bool)| {
        let towards = dvec3(0.48, 0.6, 0.64);
        let u = towards.any_orthonormal_vector();
        let v = towards.cross(u);
        const SIDES: u32 = 360;
        let corner = |i: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(SIDES)).sin_cos();
            0.5 * (cos * u + sin * v)
        };
        let disc: Vec<DVec3> = (0..SIDES).map(corner).collect();
        let scene = stage_with_up(towards, DVec3::ZERO, 90.0, angle.cos() * towards + angle.sin() * u)
            .material(lamp(1.0))
            .polygon(&disc);
        // A disc of radius 1/2 in a view of 2 x 2.
        trial(tell(angle), required, lab.mean(&scene.build(), &picture, std::f64::consts::PI / 16.0))
    };
    lab.ladder(&[1.0, 1e-6, 1e-12, 1e-15, 0.0], &[]).into_iter().map(run).collect()
}
