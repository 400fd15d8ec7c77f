//! Shading normals that an image turns.

use std::fs;

use glam::DVec3;
use raywave::scene::Scene;
use raywave_studies::oracle::optics;

use super::check::*;
use super::stage::*;
use crate::common::device;

/// A rectangle under a sky of 1, seen under an angle to +z and with its normal turned by another, both towards +x. The
/// integrator's bounces are those of the settings.
fn turned(bsdf: &str, view: f64, tilt: f64) -> Scene {
    let [x, z] = [tilt.to_radians().sin(), tilt.to_radians().cos()].map(|coordinate| 0.5 + 0.5 * coordinate);
    let (sin, cos) = view.to_radians().sin_cos();
    let text = format!(
        "<scene version='3.0.0'>
        <sensor type='perspective'><float name='fov' value='0.001'/><transform name='to_world'>
        <lookat origin='{} 0 {}' target='0 0 0' up='0 1 0'/></transform></sensor>
        <emitter type='constant'><rgb name='radiance' value='1'/></emitter>
        <shape type='rectangle'><bsdf type='normalmap'>
        <texture type='rawconstant' name='normalmap'><vector name='value' value='{x} 0.5 {z}'/></texture>
        {bsdf}</bsdf></shape></scene>",
        2.0 * sin,
        2.0 * cos
    );
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("scene.xml");
    fs::write(&file, text).expect("a temporary file");
    Scene::load(&file).expect("the test's scene loads")
}

/// Light that slopes of a tilt leave to a direction. (Conty Estevez, Lecocq and Stein 2019)
fn left_by_slopes(tilt: f64, direction: f64) -> f64 {
    let [tilt, direction] = [tilt, direction].map(|degrees| degrees.to_radians().tan().powi(2));
    2.0 / (1.0 + (1.0 + (0.125 * tilt).min(1.0) * direction).sqrt())
}

/// A turned normal stays: it leans the other way where it would face away, and what it sends into the surface is lost, of
/// smooth surfaces and of rough ones, and so is what passes on the wrong side.
#[test]
fn what_a_turned_normal_sends_into_the_surface_is_lost() {
    let device = device();
    let mirror = "<bsdf type='conductor'/>";
    // Facets of that width lose little and scatter some degrees.
    let satin = "<bsdf type='roughconductor'><float name='alpha' value='0.02'/></bsdf>";
    let glass = "<bsdf type='dielectric'><float name='int_ior' value='1.5'/><float name='ext_ior' value='1'/></bsdf>";
    let through = |tilt: f64| {
        let inside = tilt - (tilt.to_radians().sin() / 1.5).asin().to_degrees();
        (1.0 - optics::reflectance(tilt.to_radians().cos(), 1.5)) / 2.25 * left_by_slopes(tilt, inside)
    };
    let cases = [
        ("a mirror", mirror, 0.0, 30.0, left_by_slopes(30.0, 60.0)),
        ("a mirror that leans the other way", mirror, -80.0, 30.0, left_by_slopes(30.0, 20.0)),
        ("a mirror that reflects into itself", mirror, 0.0, 50.0, 0.0),
        ("satin", satin, 0.0, 30.0, left_by_slopes(30.0, 60.0)),
        ("satin that reflects into itself", satin, 0.0, 60.0, 0.0),
        ("glass that reflects into itself", glass, 0.0, 50.0, through(50.0)),
    ];
    for (case, bsdf, view, tilt, expected) in cases {
        // Turned normals are halves; satin loses a thousandth.
        let scene = turned(bsdf, view, tilt);
        let stage = View::new(DVec3::Z, DVec3::ZERO, 1e-3);
        assert_image_of(&device, case, (&scene, &stage), settings(16, 64, 1), 5e-3, |_| DVec3::splat(expected));
    }
}
