//! Energy: furnaces, in which nothing can be seen, and a lamp in a closed sphere.

use glam::{DVec3, dvec3};
use raywave::settings::Integrator::Implicit;
use raywave::settings::{RouletteMode, Sampler, Settings};

use super::check::*;
use super::stage::*;
use crate::common::{device, own_scene, render_on, tries};

fn outside() -> View {
    View::new(dvec3(0.0, 1.0, 3.0), DVec3::ZERO, 50.0)
}

/// A pixel's samples can all survive the roulette, and then their scatter says nothing: blocks
/// are tested, of which each sees many paths stop.
#[test]
fn the_furnace_is_empty() {
    let device = device();
    let scene = own_scene("furnace");
    for (_, integrator) in ALL.into_iter().enumerate().filter(|(case, _)| tries(&device, *case, 4)) {
        let settings = Settings { integrator, ..unbounded(64, 128, 0.05) };
        let film = render_on(&device, &scene, &settings).film;
        assert_agrees(&format!("furnace, {integrator:?}"), &film, &vec![DVec3::ONE; 64 * 64], 0.0);
        // Five standard errors.
        let mean = film.mean_and_standard_error().mean;
        assert!((mean - 1.0).abs().max_element() < 1e-3, "{integrator:?}: the furnace's mean is {mean}");
    }
}

/// Paths lose nothing, so a roulette by throughput alone stops none, and a bound of 400 bounces few. Each path
/// of the implicit integrator then carries 1, and its mean is 1 to 1e-4; what is left is light that glass holds
/// for longer. The others' samples have noise, which their means keep to.
#[test]
fn the_furnace_is_empty_to_a_ten_thousandth() {
    let device = device();
    let scene = own_scene("furnace");
    let mut cases = 0..;
    for integrator in ALL {
        for sampler in [Sampler::Independent, Sampler::Sobol] {
            if !cases.next().is_some_and(|case| tries(&device, case, 7)) {
                continue;
            }
            let bounded = Settings { integrator, sampler, ..settings(64, 64, 400) };
            let settings = Settings { roulette_mode: RouletteMode::Throughput, roulette_from: 0, ..bounded };
            let mean = render_on(&device, &scene, &settings).film.mean_and_standard_error();
            let (off, error) = ((mean.mean - 1.0).abs().max_element(), mean.standard_error.max_element());
            assert!(error < if integrator == Implicit { 1e-5 } else { 6e-4 }, "{integrator:?}: error {error}");
            assert!(off < 1e-4_f64.max(4.0 * error), "{integrator:?}, {sampler:?}: the furnace's mean is off by {off}");
        }
    }
}

/// Without a roulette every path from a convex body that loses nothing carries exactly 1 to the
/// sky, whichever way it went. Between flat faces light can be reflected totally some hundred
/// times before it gets out.
#[test]
fn convex_bodies_vanish_sample_by_sample() {
    let device = device();
    let keys = ["Kd 1", "illum 3; Ks 1", "illum 6; Ni 1.5", "illum 6; Ni 0.8", "illum 7; Ni 1.5", "illum 7; Ni 2.4"];
    let bodies = keys.into_iter().flat_map(|keys| ["sphere", "cube"].map(|shape| (shape, keys)));
    for (_, (shape, keys)) in bodies.enumerate().filter(|(case, _)| tries(&device, *case, 5)) {
        let stage = Stage::new(outside()).sky(1.0).material(keys);
        let stage = if shape == "cube" { stage.cube(0.7) } else { stage.polygons(&sphere(1.0, 12)) };
        assert_every_sample(&device, &format!("{shape} of {keys}"), &stage, settings(64, 1, 1000), DVec3::ONE);
    }
}

/// A box without a lid: light goes from wall to wall before it leaves.
#[test]
fn a_white_box_without_lid_vanishes() {
    let sides = [DVec3::X, -DVec3::X, DVec3::Z, -DVec3::Z, -DVec3::Y];
    let open = Stage::new(View::new(dvec3(0.4, 3.0, 2.0), DVec3::ZERO, 50.0)).sky(1.0).material("Kd 1");
    let stage = sides.into_iter().fold(open, |stage, side| stage.square(side, side, 1.0));
    assert_image(&device(), "open box", &stage, unbounded(32, 64, 0.2), 0.0, |_| DVec3::ONE);
}

/// One bounce from a convex body under a sky of 1 reads the albedo, none reads black.
#[test]
fn a_convex_body_reads_its_albedo() {
    let device = device();
    let close = View::new(dvec3(0.0, 0.0, 3.0), DVec3::ZERO, 20.0);
    let stage = Stage::new(close).sky(1.0).material("Kd 0.25 0.5 1").polygons(&sphere(1.0, 12));
    assert_every_sample(&device, "albedo", &stage, settings(32, 1, 1), dvec3(0.25, 0.5, 1.0));
    assert_every_sample(&device, "no bounce", &stage, settings(32, 1, 0), DVec3::ZERO);
}

/// A closed wall is dark inside, whichever way its faces turn: no ray slips through an edge.
#[test]
fn no_light_leaks_into_a_closed_sphere() {
    let device = device();
    let within = View::new(dvec3(0.3, 0.2, 0.1), DVec3::ONE, 120.0);
    for wall in [sphere(1.0, 24), inside_out(sphere(1.0, 24))] {
        let stage = Stage::new(within).sky(1.0).material("Kd 0.9").polygons(&wall);
        assert_every_sample(&device, "closed sphere", &stage, settings(64, 1, 8), DVec3::ZERO);
    }
}

/// A lamp of radius r and radiance 1 in the middle of a sphere of radius R and albedo a. From any
/// point of the wall the lamp's form factor is k = (r/R)², so N bounces make the wall read
/// a k (1 + a (1 - k) + ... + (a (1 - k))^(N - 1)), in the limit a k / (1 - a (1 - k)).
/// For flat faces k is the ratio of the areas, by reciprocity exact on the mean; from point to
/// point the distance of the wall varies by 0.1 %, and the light on it by twice that.
#[test]
fn a_lamp_lights_its_sphere() {
    const BIAS: f64 = 2e-3;
    let device = device();
    let (lamp, wall) = (sphere(0.5, 32), sphere(1.0, 48));
    let k = area(&lamp) / area(&wall);
    let away_from_lamp = View::new(dvec3(0.75, 0.0, 0.0), DVec3::X, 60.0);
    let limit = |a: DVec3| a * k / (1.0 - a * (1.0 - k));
    let bounded = |a: DVec3, n: i32| limit(a) * (1.0 - (a * (1.0 - k)).powf(f64::from(n)));
    // The channels are three experiments at once.
    let (dark, bright) = (dvec3(0.2, 0.5, 0.9), dvec3(0.99, 0.8, 0.1));
    let cases = [
        ("unbounded", dark, wall.clone(), unbounded(16, 256, 0.1), limit(dark)),
        ("unbounded, bright", bright, inside_out(wall.clone()), unbounded(16, 256, 0.05), limit(bright)),
        ("one bounce", bright, wall.clone(), settings(16, 128, 1), bounded(bright, 1)),
        ("three bounces", bright, wall, settings(16, 256, 3), bounded(bright, 3)),
    ];
    for (_, case) in cases.into_iter().enumerate().filter(|(case, _)| tries(&device, *case, 3)) {
        let (case, albedo, wall, settings, radiance) = case;
        let keys = format!("Kd {} {} {}", albedo.x, albedo.y, albedo.z);
        let stage = Stage::new(away_from_lamp).material("Ke 1").polygons(&lamp).material(&keys).polygons(&wall);
        assert_image(&device, case, &stage, settings, BIAS, |_| radiance);
    }
}
