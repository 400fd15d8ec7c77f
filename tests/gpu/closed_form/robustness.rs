//! Determinism, and scenes at the edge of what a scene can be.

use glam::{DVec3, dvec3};
use raywave::settings::Settings;

use super::check::*;
use super::stage::*;
use crate::common::{device, own_scene, render_on, tries};

/// A path's random numbers are its own, and the film adds samples in their order: neither a
/// second run nor the number of paths in flight changes a bit.
#[test]
fn paths_in_flight_change_no_bit() {
    let device = device();
    let scene = own_scene("cornell-caustic");
    for integrator in ALL {
        let film = |in_flight| {
            let settings = Settings { width: 40, height: 30, integrator, in_flight, ..unbounded(0, 20, 0.2) };
            render_on(&device, &scene, &settings).film
        };
        let first = film(None);
        // Without a number, a second run.
        let in_flight = [None, Some(1000), Some(4096), Some(65_536)];
        for (_, in_flight) in in_flight.into_iter().enumerate().filter(|(case, _)| tries(&device, *case, 3)) {
            assert!(film(in_flight) == first, "{integrator:?} differs with {in_flight:?} paths in flight");
        }
    }
}

/// However bright the lamps, a clamp in proportion cuts off the same: by powers of two, to the last bit.
#[test]
fn a_clamp_is_in_the_unit_of_the_lamps() {
    let device = device();
    let scene = own_scene("cornell-box");
    let film = |power: i32, clamp: Option<f64>| {
        let mut scene = scene.clone();
        scene.materials.iter_mut().for_each(|material| material.emission *= 2.0_f32.powi(power));
        let settings = Settings { width: 16, height: 16, samples: 4, ..scene.settings };
        let clamp = clamp.map(|clamp| clamp * 2.0_f64.powi(power));
        let film = render_on(&device, &scene, &Settings { clamp, ..settings }).film;
        film.sum.iter().map(|sum| *sum * 2.0_f64.powi(-power)).collect::<Vec<_>>()
    };
    let clamped = film(0, Some(0.05));
    assert!(clamped != film(0, None), "the clamp cuts something off");
    for power in [-100, -1, 64, 100] {
        assert!(film(power, Some(0.05)) == clamped, "lamps times 2^{power}");
    }
}

/// One triangle is a scene.
#[test]
fn one_triangle_is_a_scene() {
    let corners = [dvec3(-9.0, 0.0, -9.0), dvec3(0.0, 0.0, 9.0), dvec3(9.0, 0.0, -9.0)];
    let view = View::new(dvec3(0.0, 2.0, -1.0), dvec3(0.0, 0.0, -1.0), 40.0);
    let stage = Stage::new(view).sky(1.0).material("Kd 0.5").polygon(&corners);
    assert_every_sample(&device(), "one triangle", &stage, settings(32, 1, 8), DVec3::splat(0.5));
}

/// Surfaces that lie in each other do not shade each other, whichever side is the front.
#[test]
fn coincident_floors_are_one_floor() {
    let view = View::new(dvec3(0.3, 2.0, 1.0), DVec3::ZERO, 40.0);
    let floor = |stage: Stage, normal| stage.square(dvec3(0.1, 0.3, 0.7), normal, 9.0);
    let sides = [DVec3::Y, DVec3::Y, -DVec3::Y];
    let stage = sides.into_iter().fold(Stage::new(view).sky(1.0).material("Kd 0.5"), floor);
    assert_every_sample(&device(), "three floors in one", &stage, settings(64, 1, 8), DVec3::splat(0.5));
}

/// A body far from the origin and small is a body: vanishing in the furnace shows its hits.
#[test]
fn small_and_far_bodies_vanish_too() {
    let device = device();
    let centre = dvec3(1e6, -2e6, 3e5);
    let keys = ["Kd 1", "illum 6; Ni 1.5", "illum 7; Ni 1.5"];
    for (_, keys) in keys.into_iter().enumerate().filter(|(case, _)| tries(&device, *case, 2)) {
        let ball = sphere(0.01, 12).into_iter().map(|polygon| polygon.into_iter().map(|p| p + centre).collect());
        let view = View::new(centre + dvec3(0.0, 0.01, 0.03), centre, 50.0);
        let stage = Stage::new(view).sky(1.0).material(keys).polygons(&ball.collect::<Vec<_>>());
        assert_every_sample(&device, &format!("far ball of {keys}"), &stage, settings(64, 1, 1000), DVec3::ONE);
    }
}

/// A camera that lies in a surface and looks along it sees the floor or the sky, and no NaN.
#[test]
fn a_camera_in_a_surface_sees_floor_or_sky() {
    let device = device();
    for (case, keys) in ["Kd 1", "illum 3; Ks 1", "illum 6; Ni 1.5"].into_iter().enumerate() {
        let view = View::new(DVec3::ZERO, -DVec3::Z, 60.0);
        let stage = Stage::new(view).sky(1.0).material(keys).square(DVec3::ZERO, DVec3::Y, 1.0).cube(1.0);
        for (_, integrator) in ALL.into_iter().enumerate().filter(|(i, _)| tries(&device, 3 * case + i, 2)) {
            let film = render_on(&device, &stage.scene(), &Settings { integrator, ..settings(32, 4, 16) }).film;
            assert!(film.sum.iter().all(|sum| sum.is_finite() && sum.min_element() >= 0.0), "{keys}, {integrator:?}");
        }
    }
}

/// Lamps without area give no light and no NaN, alone or beside one that has some.
#[test]
fn lamps_without_area_are_dark() {
    let device = device();
    let view = View::new(dvec3(0.0, 2.0, 0.0), DVec3::ZERO, 40.0);
    let point = dvec3(0.0, 1.0, 0.0);
    let stage = Stage::new(view)
        .material("Kd 0.5")
        .square(DVec3::ZERO, DVec3::Y, 9.0)
        .material("Ke 1")
        .polygon(&[point, point, point])
        .polygon(&[point, point + DVec3::X, point + 2.0 * DVec3::X]);
    assert_every_sample(&device, "lamps of no area", &stage, settings(32, 1, 2), DVec3::ZERO);
    let lit = stage.square(dvec3(0.0, 3.0, 0.0), -DVec3::Y, 1.0).scene();
    let film = render_on(&device, &lit, &settings(32, 4, 2)).film;
    assert!(film.mean_and_standard_error().mean.min_element() > 0.0);
}
