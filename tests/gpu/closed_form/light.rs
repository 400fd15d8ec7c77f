//! Light on surfaces: rectangles, skies, shading normals, and the integrators against each other.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, dvec3};
use raywave::image::{Image, WriteOptions, write_image};
use raywave::settings::Integrator::{Explicit, Implicit, Mis};
use raywave::settings::Settings;
use tempfile::tempdir;

use super::check::*;
use super::stage::*;
use crate::common::{device, own_scene, render_on, samples_on, tries};

/// Irradiance at `point` from a polygon of radiance 1 that is whole above the horizon. (Lambert,
/// Photometria, 1760)
fn irradiance(point: DVec3, normal: DVec3, polygon: &[DVec3]) -> f64 {
    let corners = polygon.iter().map(|corner| (corner - point).normalize());
    let next = corners.clone().cycle().skip(1);
    let edges = corners.zip(next).map(|(a, b)| a.angle_between(b) * a.cross(b).normalize().dot(normal));
    0.5 * edges.sum::<f64>().abs()
}

/// A rectangle of 1.2 by 0.8 over the floor, its front down, turned about its long side.
fn lamp(degrees: f64) -> Vec<DVec3> {
    let turn = DQuat::from_rotation_x(degrees * PI / 180.0);
    let corners = [(-0.6, -0.4), (0.6, -0.4), (0.6, 0.4), (-0.6, 0.4)];
    corners.map(|(x, z)| dvec3(0.2, 2.0, 0.1) + turn * dvec3(x, 0.0, z)).to_vec()
}

/// Looks down on the floor from under the lamps.
fn under_the_lamp() -> View {
    View::new(dvec3(0.1, 1.2, 0.0), dvec3(0.1, 0.0, 0.0), 90.0)
}

fn floor_point(view: &View, direction: DVec3) -> DVec3 {
    view.eye - direction * (view.eye.y / direction.y)
}

/// Below a rectangle and off its centre, flat and tilted. Another lamp shows the floor its back
/// and gives nothing.
#[test]
fn a_rectangle_lights_the_floor() {
    let device = device();
    let view = under_the_lamp();
    let (kd, ke) = (dvec3(0.8, 0.5, 0.2), dvec3(2.0, 3.0, 5.0));
    for degrees in [0.0, 35.0] {
        let lamp = lamp(degrees);
        let stage = Stage::new(view)
            .material("Kd 0.8 0.5 0.2")
            .square(DVec3::ZERO, DVec3::Y, 10.0)
            .material("Ke 2 3 5")
            .polygon(&lamp)
            .square(dvec3(3.5, 1.8, 0.0), DVec3::Y, 1.0);
        let case = format!("lamp at {degrees} degrees");
        assert_image(&device, &case, &stage, settings(32, 128, 1), 0.0, |d| {
            kd / PI * ke * irradiance(floor_point(&view, d), DVec3::Y, &lamp)
        });
    }
}

/// The same lamp on a floor whose corners have normals of their own: the interpolated one counts.
/// They are kept in 16 bits a coordinate, which may turn light of 70 degrees by 1e-4.
#[test]
fn shading_normals_turn_the_surface() {
    let view = under_the_lamp();
    let floor = [dvec3(-9.0, 0.0, 6.0), dvec3(9.0, 0.0, 6.0), dvec3(0.0, 0.0, -12.0)];
    let normals = [dvec3(-0.4, 1.0, 0.0), dvec3(0.5, 1.0, 0.1), dvec3(0.0, 1.0, 0.6)].map(|n: DVec3| n.normalize());
    let lamp = lamp(0.0);
    let stage = Stage::new(view).material("Kd 0.5").shaded_polygon(&floor, &normals).material("Ke 2").polygon(&lamp);
    let part =
        |a: DVec3, b: DVec3, p: DVec3| (b - a).cross(p - a).y / (floor[1] - floor[0]).cross(floor[2] - floor[0]).y;
    assert_image(&device(), "shading normals", &stage, settings(32, 128, 1), 1e-4, |d| {
        let p = floor_point(&view, d);
        let weights = [part(floor[1], floor[2], p), part(floor[2], floor[0], p), part(floor[0], floor[1], p)];
        let normal = normals.iter().zip(weights).map(|(n, w)| *n * w).sum::<DVec3>().normalize();
        DVec3::splat(0.5 / PI * 2.0 * irradiance(p, normal, &lamp))
    });
}

/// A sky whose colour is its direction, 1.5 + d: seen to all sides it shows that it is neither
/// turned nor mirrored. A floor of normal n under it reads Kd (1.5 + 2/3 n), since the cosine
/// lobe's mean direction is 2/3 n. Texels are 2.8 degrees wide, so that bilinear reading is off by
/// 3e-4 at most.
#[test]
fn the_sky_stands_where_it_should() {
    const BIAS: f64 = 1e-3;
    let (width, height) = (128, 64);
    let folder = tempdir().expect("a temporary folder");
    let file = folder.path().join("sky.exr");
    let texel = |i: u32| {
        // The centre column looks along -z and columns go on towards +x.
        let azimuth = 2.0 * PI * ((f64::from(i % width) + 0.5) / f64::from(width) - 0.5);
        let (sin, cos) = (PI * (f64::from(i / width) + 0.5) / f64::from(height)).sin_cos();
        (1.5 + dvec3(sin * azimuth.sin(), cos, -sin * azimuth.cos())).as_vec3()
    };
    let sky = Image::new(width, height, (0..width * height).map(texel).collect());
    write_image(&file, &sky, &WriteOptions::default()).expect("the folder can be written");
    let device = device();
    let speck = |view| {
        let far = [dvec3(9.0, 9.0, 9.0), dvec3(9.01, 9.0, 9.0), dvec3(9.0, 9.01, 9.0)];
        Stage::new(view).sky_image(&file).material("Kd 0").polygon(&far)
    };
    let sides = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    for (_, side) in sides.enumerate().filter(|(case, _)| tries(&device, *case, 5)) {
        let case = format!("sky towards {side}");
        let stage = speck(View::new(DVec3::ZERO, side, 60.0));
        assert_image(&device, &case, &stage, settings(16, 16, 0), BIAS, |d| 1.5 + d);
    }
    let normals = [DVec3::Y, dvec3(0.6, 0.0, 0.8), dvec3(0.0, -0.8, -0.6)];
    for (_, normal) in normals.into_iter().enumerate().filter(|(case, _)| tries(&device, *case, 2)) {
        let view = View::new(normal + 0.1 * normal.any_orthonormal_vector(), DVec3::ZERO, 40.0);
        let stage = speck(view).material("Kd 0.8").square(DVec3::ZERO, normal, 10.0);
        let case = format!("floor towards {normal}");
        assert_image(&device, &case, &stage, settings(16, 256, 1), BIAS, |_| 0.8 * (1.5 + normal * (2.0 / 3.0)));
    }
}

/// Under a clear pane no light sample reaches the sky, yet the path that leaves the floor goes on
/// through both interfaces to find it: three bounces read the albedo, two read nothing. The pane
/// is so wide that one sample in a million passes beneath it.
#[test]
fn light_is_found_through_a_pane() {
    let device = device();
    let view = View::new(dvec3(0.0, 0.8, 0.0), dvec3(0.5, 0.0, 0.3), 60.0);
    let stage = Stage::new(view)
        .sky(1.0)
        .material("Kd 0.25 0.5 1")
        .square(DVec3::ZERO, DVec3::Y, 1000.0)
        .material("illum 6; Ni 1.5")
        .square(dvec3(0.0, 1.5, 0.0), DVec3::Y, 1000.0)
        .square(dvec3(0.0, 1.0, 0.0), -DVec3::Y, 1000.0);
    let albedo = dvec3(0.25, 0.5, 1.0);
    assert_every_sample(&device, "pane", &stage, settings(32, 1, 3), albedo);
    assert_every_sample(&device, "pane at two bounces", &stage, settings(32, 1, 2), DVec3::ZERO);
}

/// All integrators have one expectation for every number of bounces: in a box, and where light
/// reaches the floor through glass alone, so that paths go on after the last light sample.
#[test]
fn integrators_agree_bounce_by_bounce() {
    let device = device();
    for (first, name) in [(0, "cornell-box"), (5, "cornell-caustic")] {
        let scene = own_scene(name);
        for bounces in (0..=4).filter(|bounces| tries(&device, first + *bounces as usize, 3)) {
            let [implicit, explicit, mis] =
                [(Implicit, 768), (Explicit, 256), (Mis, 255)].map(|(integrator, samples)| {
                    let settings =
                        Settings { integrator, seed: samples, ..settings(32, samples_on(&device, samples), bounces) };
                    render_on(&device, &scene, &settings).film
                });
            assert_same_mean(&format!("{name}, {bounces} bounces"), &implicit, &explicit);
            assert_same_mean(&format!("{name}, {bounces} bounces, weighted"), &implicit, &mis);
        }
    }
}
