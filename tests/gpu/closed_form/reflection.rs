//! Mirrors and the Phong lobe.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, dvec3};

use super::check::*;
use super::stage::*;
use crate::common::{device, tries};

/// Two mirrors face each other and a lamp closes the corridor: unfolded, a ray runs straight and
/// crosses a mirror every two units on its way. k reflections leave Ks^k of the lamp, if the path
/// may have k bounces.
#[test]
fn a_corridor_of_mirrors_dims_by_each_reflection() {
    const LENGTH: f64 = 6.0;
    let ks = dvec3(1.0, 0.9, 0.5);
    let mirror = |z: f64, towards: f64| {
        let corners = [dvec3(-50.0, -50.0, z), dvec3(50.0, -50.0, z), dvec3(50.0, 50.0, z), dvec3(-50.0, 50.0, z)];
        if towards > 0.0 { corners } else { [corners[3], corners[2], corners[1], corners[0]] }
    };
    // The far mirror is seen from its back: mirrors have two sides.
    let stage = Stage::new(View::new(DVec3::ZERO, dvec3(1.0, 0.0, 0.4), 80.0))
        .material("illum 3; Ks 1 0.9 0.5")
        .polygon(&mirror(1.0, 1.0))
        .polygon(&mirror(-1.0, 1.0))
        .material("Ke 2")
        .square(dvec3(LENGTH, 0.0, 0.0), -DVec3::X, 60.0);
    let device = device();
    for (_, bounces) in [0, 1, 3, 8].into_iter().enumerate().filter(|(case, _)| tries(&device, *case, 3)) {
        assert_image(&device, &format!("{bounces} bounces"), &stage, settings(64, 32, bounces), 0.0, |d| {
            let reflections = (0.5 * (LENGTH * d.z / d.x + 1.0)).floor().abs();
            if reflections <= f64::from(bounces) { 2.0 * ks.powf(reflections) } else { DVec3::ZERO }
        });
    }
}

/// Colours of vertices multiply the diffuse reflectance. Where they grow in proportion to a distance, so does what a floor
/// shows of a sky of 1.
#[test]
fn a_floor_has_the_colours_of_its_vertices() {
    let device = device();
    let view = View::new(dvec3(0.0, 3.0, 0.0), DVec3::ZERO, 60.0);
    let stage = Stage::new(view).sky(1.0).material("Kd 0.5 0.8 1").square(DVec3::ZERO, DVec3::Y, 4.0);
    let mut scene = stage.scene();
    let colour = |point: DVec3| dvec3(0.5 + 0.1 * point.x, 1.0, 0.4 - 0.05 * point.z);
    scene.mesh.colours = scene.mesh.positions.iter().map(|point| colour(*point).as_vec3()).collect();
    // Colours are halves.
    assert_image_of(&device, "a coloured floor", (&scene, &stage.view), settings(32, 64, 1), 1e-3, |d| {
        dvec3(0.5, 0.8, 1.0) * colour(dvec3(0.0, 3.0, 0.0) + d * (-3.0 / d.y))
    });
}

/// What a Phong lobe of weight 1 reflects of a sky of 1, seen under an angle: the integral of
/// (Ns + 1) / 2π cos^Ns α cos θ over the hemisphere, by midpoints in cos^(Ns+1) α and the angle
/// around the mirror direction.
fn phong_albedo(ns: f64, cos_view: f64) -> f64 {
    const STEPS: u32 = 1000;
    let sin_view = (1.0 - cos_view * cos_view).sqrt();
    let midpoint = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS);
    let rings = (0..STEPS).map(|i| midpoint(i).powf(1.0 / (ns + 1.0)));
    let ring = |cos: f64| {
        let sin = (1.0 - cos * cos).sqrt();
        let around = (0..STEPS).map(|j| (cos * cos_view + sin * sin_view * (TAU * midpoint(j)).cos()).max(0.0));
        around.sum::<f64>() / f64::from(STEPS)
    };
    rings.map(ring).sum::<f64>() / f64::from(STEPS)
}

/// A floor of Kd and Ks under a sky of 1 reads Kd + Ks (Ns + 1) / (Ns + 2) straight from above,
/// and less under an angle, where the horizon cuts the lobe.
#[test]
fn a_phong_floor_reads_its_albedo() {
    let device = device();
    let (kd, ks) = (dvec3(0.5, 0.2, 0.0), dvec3(0.5, 0.4, 1.0));
    let mut cases = 0..;
    for ns in [1.0_f64, 20.0, 300.0] {
        let straight: f64 = (ns + 1.0) / (ns + 2.0);
        assert!((phong_albedo(ns, 1.0) - straight).abs() < 1e-4, "the quadrature is off");
        for (degrees, lobe) in [(0.0, straight), (70.0, phong_albedo(ns, (70.0 * PI / 180.0).cos()))] {
            if !cases.next().is_some_and(|case| tries(&device, case, 5)) {
                continue;
            }
            let (sin, cos) = (degrees * PI / 180.0).sin_cos();
            // A millidegree is one angle.
            let view = View::new(2.0 * dvec3(sin, cos, 0.0), DVec3::ZERO, 1e-3);
            let keys = format!("Kd 0.5 0.2 0; Ks 0.5 0.4 1; Ns {ns}");
            let stage = Stage::new(view).sky(1.0).material(&keys).square(DVec3::ZERO, DVec3::Y, 10.0);
            let case = format!("Ns {ns} at {degrees} degrees");
            assert_image(&device, &case, &stage, settings(16, 256, 1), 1e-4, |_| kd + ks * lobe);
        }
    }
}
