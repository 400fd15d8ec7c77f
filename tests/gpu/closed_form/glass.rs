//! Interfaces: Snell's law, total internal reflection, Fresnel's formulas, the scaling of radiance.

use glam::{DVec3, dvec3};

use super::check::*;
use super::stage::*;
use crate::common::{device, tries};

/// Cosine beyond an interface, or `None` where all light is reflected. `eta` is the index beyond
/// over the index before.
fn snell(cos: f64, eta: f64) -> Option<f64> {
    let cos2 = 1.0 - (1.0 - cos * cos) / (eta * eta);
    (cos2 > 0.0).then(|| cos2.sqrt())
}

/// Reflectance of unpolarised light, from the angles alone. (Fresnel 1823)
fn fresnel(cos: f64, eta: f64) -> f64 {
    let Some(beyond) = snell(cos, eta) else {
        return 1.0;
    };
    let (i, t) = (cos.acos(), beyond.acos());
    if i < 1e-6 {
        return ((eta - 1.0) / (eta + 1.0)).powi(2);
    }
    0.5 * (((i - t).sin() / (i + t).sin()).powi(2) + ((i - t).tan() / (i + t).tan()).powi(2))
}

/// Stripes behind a slab: each ray leaves as it came, moved sideways. Two interfaces are two
/// bounces.
#[test]
fn a_slab_moves_what_is_behind_it() {
    const NI: f64 = 1.5;
    let view = View::new(dvec3(0.0, 0.0, 2.0), dvec3(2.0, 0.0, 0.0), 50.0);
    let slab = Stage::new(view)
        .material("illum 6; Ni 1.5")
        .square(DVec3::ZERO, DVec3::Z, 100.0)
        .square(dvec3(0.0, 0.0, -1.0), -DVec3::Z, 100.0)
        .material("Ke 1 2 3");
    let stripes = (-20..20).map(|i| dvec3(f64::from(i) + 0.25, 0.0, -2.0));
    let stage = stripes.fold(slab, |stage, c| {
        let (x, y) = (dvec3(0.25, 0.0, 0.0), dvec3(0.0, 50.0, 0.0));
        stage.polygon(&[c - x - y, c + x - y, c + x + y, c - x + y])
    });
    let device = device();
    assert_image(&device, "slab", &stage, settings(64, 32, 2), 0.0, |d| {
        let cos_inside = snell(-d.z, NI).expect("denser glass transmits");
        // Three units of air and one of glass; sideways the direction in glass is 1 / Ni as long.
        let x = 3.0 * d.x / -d.z + d.x / NI / cos_inside;
        if x.rem_euclid(1.0) < 0.5 { dvec3(1.0, 2.0, 3.0) } else { DVec3::ZERO }
    });
    assert_every_sample(&device, "slab at one bounce", &stage, settings(32, 1, 1), DVec3::ZERO);
}

/// From inside a clear block one interface away from the sky: Ni² up to the critical angle, and
/// nothing beyond, where the bounce is spent on a reflection.
#[test]
fn reflection_is_total_from_the_critical_angle() {
    const NI: f64 = 1.5;
    let view = View::new(dvec3(0.0, 0.0, 9.0), dvec3(0.0, 0.0, 10.0), 120.0);
    let stage = Stage::new(view).sky(1.0).material("illum 6; Ni 1.5").cube(10.0);
    let critical_cos = (1.0 - 1.0 / (NI * NI)).sqrt();
    assert_image(&device(), "critical angle", &stage, settings(64, 32, 1), 0.0, |d| {
        if d.z > critical_cos { DVec3::splat(NI * NI) } else { DVec3::ZERO }
    });
}

/// Radiance in a medium is Ni² times what it is outside: so reads a camera in a glass ball, with
/// the tint of one passage. Outside, Ni² cancels and the tint counts twice. With Fresnel
/// reflection inside, paths go to and fro but all of them leave in the end.
#[test]
fn radiance_scales_with_the_square_of_the_index() {
    let device = device();
    let ball = sphere(1.0, 24);
    let tint = dvec3(0.5, 0.8, 1.0);
    let stage = |view, keys| Stage::new(view).sky(0.5).material(keys).polygons(&ball);
    let inside = View::new(dvec3(0.1, 0.2, 0.3), DVec3::X, 100.0);
    let through = View::new(dvec3(0.0, 0.0, 3.0), DVec3::ZERO, 20.0);
    let tinted = "illum 6; Ni 1.5; Tf 0.5 0.8 1";
    assert_every_sample(&device, "inside", &stage(inside, tinted), settings(32, 1, 1), 0.5 * 2.25 * tint);
    assert_every_sample(&device, "through", &stage(through, tinted), settings(32, 1, 2), 0.5 * tint * tint);
    let fresnel = stage(inside, "illum 7; Ni 1.5");
    assert_every_sample(&device, "inside, Fresnel", &fresnel, settings(32, 1, 64), DVec3::splat(0.5 * 2.25));
}

/// One interface between a red plane, on the camera's side, and a green one; both are blue. Red
/// reads the reflectance, green the transmittance scaled to the camera's medium, over angles
/// from 0 to 85 degrees, Brewster's among them.
#[test]
fn an_interface_splits_light_after_fresnel() {
    let device = device();
    for (case, ni) in [1.5, 2.4].into_iter().enumerate() {
        // Into glass and out of it.
        for side in [1.0, -1.0] {
            if !tries(&device, 2 * case + usize::from(side < 0.0), 3) {
                continue;
            }
            let view = View::new(dvec3(0.0, 0.0, side), dvec3(1.0, 0.0, 0.0), 80.0);
            let stage = Stage::new(view)
                .material(&format!("illum 7; Ni {ni}"))
                .square(DVec3::ZERO, DVec3::Z, 200.0)
                .material("Ke 1 0 1")
                .square(dvec3(0.0, 0.0, 5.0 * side), dvec3(0.0, 0.0, -side), 200.0)
                .material("Ke 0 1 1")
                .square(dvec3(0.0, 0.0, -5.0 * side), dvec3(0.0, 0.0, side), 200.0);
            let eta = if side > 0.0 { ni } else { 1.0 / ni };
            assert_image(&device, &format!("Ni {ni}, side {side}"), &stage, settings(64, 32, 1), 0.0, |d| {
                let reflected = fresnel(d.z.abs(), eta);
                let transmitted = (1.0 - reflected) / (eta * eta);
                dvec3(reflected, transmitted, reflected + transmitted)
            });
        }
    }
}
