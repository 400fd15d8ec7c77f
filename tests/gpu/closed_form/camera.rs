//! The camera: which way the image lies, and the blur of a lens.

use std::f64::consts::PI;

use glam::{DVec3, dvec3};

use super::check::*;
use super::stage::*;
use crate::common::device;

/// A triangle with no symmetry: +x is on the right, +y at the top.
#[test]
fn the_image_is_not_mirrored() {
    let corners = [dvec3(-0.2, -0.5, -2.0), dvec3(1.3, 0.1, -2.0), dvec3(0.9, 0.8, -2.0)];
    let stage = Stage::new(View::new(DVec3::ZERO, -DVec3::Z, 80.0)).material("Ke 1").polygon(&corners);
    let edges = [(0, 1), (1, 2), (2, 0)];
    assert_image(&device(), "triangle", &stage, settings(64, 32, 0), 0.0, |d| {
        let inside = edges.iter().all(|&(a, b)| corners[a].cross(corners[b]).dot(d) < 0.0);
        DVec3::splat(f64::from(u8::from(inside)))
    });
}

/// Share of a unit disk on the side of a chord at distance `t` that the centre is on.
fn share_of_disk(t: f64) -> f64 {
    let t = t.clamp(-1.0, 1.0);
    0.5 + (t * (1.0 - t * t).sqrt() + t.asin()) / PI
}

/// The edge of a lamp that covers a half-plane. A lens of radius a, focused at distance f, blurs
/// a point at distance z to a disk of radius a |f - z| / z in the plane in focus, so the edge
/// becomes a chord's share of that disk; in focus it stays sharp.
#[test]
fn a_lens_blurs_by_distance() {
    const FOCUS: f64 = 4.0;
    const APERTURE: f64 = 0.3;
    let view = View { aperture: APERTURE, focus: FOCUS, ..View::new(DVec3::ZERO, -DVec3::Z, 40.0) };
    let across = dvec3(0.8, 0.6, 0.0);
    let along = dvec3(-0.6, 0.8, 0.0);
    let device = device();
    for z in [1.5, 3.0, 4.0, 10.0] {
        // The lamp's edge goes through the axis; the lamp is towards `across`.
        let (middle, far) = (-z * DVec3::Z, 40.0 * across);
        let lamp =
            [middle - 40.0 * along, middle - 40.0 * along + far, middle + 40.0 * along + far, middle + 40.0 * along];
        let stage = Stage::new(view).material("Ke 1").polygon(&lamp);
        assert_image(&device, &format!("lamp at {z}"), &stage, settings(64, 32, 0), 0.0, |d| {
            let from_edge = across.dot(d) / -d.z * FOCUS;
            let blur = APERTURE * (FOCUS - z).abs() / z;
            let sharp = if from_edge > 0.0 { f64::INFINITY } else { f64::NEG_INFINITY };
            DVec3::splat(share_of_disk(if blur > 0.0 { from_edge / blur } else { sharp }))
        });
    }
}
