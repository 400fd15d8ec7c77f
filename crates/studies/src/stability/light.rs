//! Lamps and skies at the ends of their size, number and brightness.

use std::f64::consts::PI;
use std::path::PathBuf;

use glam::{DMat3, DVec3, Vec3, dvec3};

use super::Plan;
use super::lab::{Lab, tell, trial};
use super::stage::{ball, cube, grey, inside_out, lamp, stage};
use crate::studies::Trial;
use raywave::scene::{Environment, EnvironmentMap, Scene};
use raywave::settings::{Integrator, Settings};

pub const PLANS: &[Plan] = &[
    Plan {
        name: "emission",
        driven: "emission of the Cornell box's lamp, times",
        measure: "share of paths off the oracle's by more than 1e-3 of themselves",
        allowed: 1e-3,
        remark: "radiance is scaled by a power of two on upload",
        reduced: "96² paths a setting",
        trials: emission,
    },
    Plan {
        name: "emission-both",
        driven: "ratio of two lamps in one scene, about 1",
        measure: "share of paths off the oracle's by more than 1e-3 of themselves",
        allowed: 1e-3,
        remark: "variance is known of pixels within 10^19 of the scale alone: squares are f32 too",
        reduced: "96² paths a setting",
        trials: emission_both,
    },
    Plan {
        name: "lamp-size",
        driven: "size of a lamp at the scene's centre, in scene sizes",
        measure: "relative error of the mean against the closed form",
        allowed: 1e-3,
        remark: "",
        reduced: "96² x 16 samples a setting",
        trials: |lab| lamp_size(lab, lab.ladder(&[1e-2, 1e-5, 1e-9], &[1e-13, 1e-17, 1e-21]), DVec3::ZERO),
    },
    Plan {
        name: "lamp-size-off-centre",
        driven: "size of a lamp a quarter of the scene from its centre, in scene sizes",
        measure: "relative error of the mean against the closed form",
        allowed: 1e-2,
        remark: "its corners are rounded to 3e-8 scene sizes: what is smaller has no area and gives no light",
        reduced: "96² x 16 samples a setting",
        trials: |lab| {
            lamp_size(lab, lab.ladder(&[1e-2, 1e-3, 1e-4], &[1e-5, 1e-6, 1e-7, 1e-9]), dvec3(0.23, 0.0, 0.31))
        },
    },
    Plan {
        name: "enclosing-lamp",
        driven: "size of a lamp around a ball of Kd 0.5, in ball sizes",
        measure: "share of samples that are not half its radiance",
        allowed: 0.0,
        remark: "implicit, one bounce",
        reduced: "96² samples a setting",
        trials: enclosing_lamp,
    },
    Plan {
        name: "enclosing-lamp-explicit",
        driven: "size of a lamp around a ball of Kd 0.5, in ball sizes",
        measure: "relative error of the mean",
        allowed: 1e-4,
        remark: "light sampling",
        reduced: "96² x 64 samples a setting",
        trials: enclosing_lamp_explicit,
    },
    Plan {
        name: "many-lamps",
        driven: "triangles of a square lamp",
        measure: "relative error of the mean against the closed form",
        allowed: 1e-3,
        remark: "2^24 is the most that the random numbers tell apart",
        reduced: "96² x 64 samples a setting",
        trials: many_lamps,
    },
    Plan {
        name: "bright-texel",
        driven: "radiance of one texel of a dark sky of 64 x 32",
        measure: "relative error of the mean against a quadrature",
        allowed: 1e-3,
        remark: "",
        reduced: "96² x 64 samples a setting",
        trials: bright_texel,
    },
];

fn emission(lab: &Lab<'_>) -> Vec<Trial> {
    let original = Scene::cornell_box();
    let picture = lab.picture(Integrator::Explicit, 8);
    let run = |(factor, required): (f64, bool)| {
        let mut scene = original.clone();
        scene.materials.iter_mut().for_each(|m| m.emission *= factor as f32);
        trial(tell(factor), required, lab.against_paths(&scene, &picture, (&original, factor), true))
    };
    let low = lab.ladder(&[1.0, 1e-10, 1e-20, 1e-30], &[1e-36]);
    low.into_iter().chain(lab.ladder(&[1e10, 1e20, 1e30], &[1e36])).map(run).collect()
}

fn emission_both(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Implicit, 1);
    let run = |(ratio, required): (f64, bool)| {
        let [bright, dim] = [ratio.sqrt(), 1.0 / ratio.sqrt()].map(|ke| ke as f32);
        let scene = stage(dvec3(0.0, 0.8, 4.0), dvec3(0.0, 0.3, 0.0), 50.0)
            .material(grey(0.8))
            .square(-1.5 * DVec3::X, DVec3::Y, 1.4)
            .square(1.5 * DVec3::X, DVec3::Y, 1.4)
            .material(grey(0.0))
            .square(DVec3::ZERO, DVec3::X, 3.0)
            .material(lamp(bright))
            .square(dvec3(-1.5, 1.2, 0.0), -DVec3::Y, 1.0)
            .material(lamp(dim))
            .square(dvec3(1.5, 1.2, 0.0), -DVec3::Y, 1.0)
            .build();
        trial(tell(ratio), required, lab.against_paths(&scene, &picture, (&scene, 1.0), true))
    };
    lab.ladder(&[1.0, 1e20, 1e40, 1e60], &[1e70, 1e75]).into_iter().map(run).collect()
}

/// A square lamp between two floors, seen from the lower one's middle under it.
fn lamp_size(lab: &Lab<'_>, sizes: Vec<(f64, bool)>, centre: DVec3) -> Vec<Trial> {
    let picture = Settings { samples: 16, ..lab.picture(Integrator::Explicit, 1) };
    let run = |(size, required): (f64, bool)| {
        let ke = 1.0 / (size * size);
        let (turned, half) = (dvec3(0.8, 0.0, 0.6), 0.5 * size);
        let (a, b) = (half * turned, half * dvec3(-0.6, 0.0, 0.8));
        let under = centre - 0.5 * DVec3::Y;
        let scene = stage(under + dvec3(0.1, 0.3, 0.0), under, 1e-6)
            .material(grey(1.0))
            .square(-0.5 * DVec3::Y, DVec3::Y, 0.5)
            .square(0.5 * DVec3::Y, -DVec3::Y, 0.5)
            .material(lamp(ke as f32))
            .polygon(&[centre - a - b, centre + a - b, centre + a + b, centre - a + b])
            .build();
        // Ke, its area, the squared distance of 1/2, and the Lambert floor.
        let small = f64::from(ke as f32) * size * size / (0.25 * PI);
        // The lamp's extent takes the share of size² / d² times two thirds off.
        let exact = small * (1.0 - 2.0 / 3.0 * (size / 0.5).powi(2) * 0.5);
        trial(tell(size), required, lab.mean(&scene, &picture, exact))
    };
    sizes.into_iter().map(run).collect()
}

fn enclosed(size: f64) -> Scene {
    stage(dvec3(0.3, 1.0, 2.8), DVec3::ZERO, 20.0)
        .material(grey(0.5))
        .polygons(ball(DVec3::ONE, 24))
        .material(lamp(2.0))
        .polygons(inside_out(cube(size)))
        .build()
}

fn enclosing_lamp(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Implicit, 1);
    let run = |(size, required): (f64, bool)| {
        trial(tell(size), required, lab.every_sample(&enclosed(size), &picture, 1e-5, |_| 1.0))
    };
    lab.ladder(&[3.0, 1e3, 1e6], &[1e9, 1e12]).into_iter().map(run).collect()
}

fn enclosing_lamp_explicit(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = Settings { samples: lab.by_level(16, 64, 256), ..lab.picture(Integrator::Explicit, 1) };
    let run = |(size, required): (f64, bool)| trial(tell(size), required, lab.mean(&enclosed(size), &picture, 1.0));
    lab.ladder(&[3.0, 1e3, 1e6], &[1e9, 1e12]).into_iter().map(run).collect()
}

fn many_lamps(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = Settings { samples: lab.by_level(16, 64, 256), ..lab.picture(Integrator::Explicit, 1) };
    let run = |(cells, required): (u32, bool)| {
        // A square of half side 1 at distance 1 over the middle of a floor.
        let step = 2.0 / f64::from(cells);
        let at = |i: u32, j: u32| dvec3(-1.0 + step * f64::from(i), 1.0, -1.0 + step * f64::from(j));
        let quads: Vec<Vec<DVec3>> = (0..cells * cells)
            .map(|cell| (cell / cells, cell % cells))
            .map(|(i, j)| vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
            .collect();
        let scene = stage(dvec3(0.2, 0.5, 0.0), DVec3::ZERO, 1e-3)
            .material(grey(1.0))
            .square(DVec3::ZERO, DVec3::Y, 1.0)
            .material(lamp(1.0))
            .polygons(&quads)
            .build();
        // Four corners of side 1 at distance 1 from a point under their common corner. (Howell, catalogue of
        // configuration factors, B-3)
        let exact = 4.0 / PI * (1.0 / 2.0_f64.sqrt()) * (1.0 / 2.0_f64.sqrt()).atan();
        trial(tell(f64::from(2 * cells * cells)), required, lab.mean(&scene, &picture, exact))
    };
    let most = lab.by_level(100, 708, 708);
    lab.ladder(&[1, 32, most], &[]).into_iter().map(run).collect()
}

fn bright_texel(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = Settings { samples: lab.by_level(16, 64, 256), ..lab.picture(Integrator::Explicit, 1) };
    let run = |(radiance, required): (f64, bool)| {
        let (width, height) = (64, 32);
        let mut texels = vec![Vec3::splat(1e-3); width * height];
        texels[6 * width + 20] = Vec3::splat(radiance as f32);
        let exact = 0.5 * irradiance(&texels, width, height) / PI;
        let path = PathBuf::from("sky");
        let map = EnvironmentMap {
            path,
            width: width as u32,
            height: height as u32,
            radiance: texels,
            rotation: DMat3::IDENTITY,
        };
        let scene = stage(2.0 * DVec3::Y, DVec3::ZERO, 20.0)
            .environment(Environment::LatLong(map))
            .material(grey(0.5))
            .square(DVec3::ZERO, DVec3::Y, 1.0)
            .build();
        trial(tell(radiance), required, lab.mean(&scene, &picture, exact))
    };
    lab.ladder(&[1.0, 1e3, 1e6], &[1e12, 1e20, 1e30]).into_iter().map(run).collect()
}

/// Irradiance of a floor under a bilinear lat-long sky: midpoints, many to a texel.
fn irradiance(texels: &[Vec3], width: usize, height: usize) -> f64 {
    const POINTS: usize = 32;
    let texel = |x: i64, y: i64| {
        let (x, y) = (x.rem_euclid(width as i64) as usize, y.clamp(0, height as i64 - 1) as usize);
        f64::from(texels[y * width + x].x)
    };
    let (columns, rows) = (width * POINTS, height / 2 * POINTS);
    let (du, dv) = (1.0 / POINTS as f64, PI / (height * POINTS) as f64);
    let point = |i: usize, j: usize| {
        let (x, y) = ((i as f64 + 0.5) * du - 0.5, (j as f64 + 0.5) * du - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (f, g) = (x - left, y - top);
        let (left, top) = (left as i64, top as i64);
        let above = (1.0 - f) * texel(left, top) + f * texel(left + 1, top);
        let below = (1.0 - f) * texel(left, top + 1) + f * texel(left + 1, top + 1);
        let theta = (j as f64 + 0.5) * dv;
        ((1.0 - g) * above + g * below) * theta.cos() * theta.sin()
    };
    let sum: f64 = (0..rows).map(|j| (0..columns).map(|i| point(i, j)).sum::<f64>()).sum();
    sum * dv * 2.0 * PI / columns as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_white_sky_lights_a_floor_by_pi() {
        assert!((irradiance(&[Vec3::ONE; 64 * 32], 64, 32) - PI).abs() < 1e-3);
    }
}
