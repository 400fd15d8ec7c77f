//! The camera's vectors, and where its rays start.

use glam::{DVec3, Vec3};

use super::instances::Soup;
use super::space::Normalisation;
use crate::layout::Frame;
use crate::scene;

/// The eye, moved along its view if it lies in a surface to within rounding: there some rays would hit that surface and
/// some would not.
fn clear_of_surfaces(eye: DVec3, forward: DVec3, soup: &Soup) -> DVec3 {
    // A few roundings, relative to the coordinates.
    const TOUCH: f64 = 4.8e-7;
    let touch = |corners: [Vec3; 3]| {
        let [a, b, c] = corners.map(|corner| corner.as_dvec3());
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let touch = TOUCH * low.abs().max(high.abs()).max(eye.abs()).max_element();
        let near = eye.cmpge(low - touch).all() && eye.cmple(high + touch).all();
        let off = || (b - a).cross(c - a).normalize_or_zero().dot(eye - a).abs();
        (near && off() <= touch).then_some(touch)
    };
    soup.near(eye).find_map(touch).map_or(eye, |touch| eye + 8.0 * touch * forward)
}

/// Radius of the ball about the origin that holds any normalised scene.
const SCENE_RADIUS: f64 = 1.75;
/// Distance of an eye from the middle of the scene beyond which rays start nearer to the scene, normalised units. Up to
/// there an eye has about as many digits behind the point as the scene.
const NEAR_EYE: f64 = 16.0;

/// Distance along the view axis from the eye to the plane where the camera's rays start. No surface is nearer.
fn ray_start(eye: DVec3, forward: DVec3) -> f64 {
    if eye.length() <= NEAR_EYE {
        return 0.0;
    }
    (-eye.dot(forward) - SCENE_RADIUS).max(0.0)
}

/// Camera vectors for a square image: the session scales `camera_right` by the aspect.
pub(super) fn camera_frame(camera: &scene::Camera, normalisation: &Normalisation, soup: &Soup) -> Frame {
    let forward = (camera.target - camera.eye).normalize();
    let mut right = forward.cross(camera.up).normalize_or_zero();
    if right == DVec3::ZERO {
        // The view is along `up`: any other axis will do for it.
        right = forward.cross(forward.any_orthonormal_vector()).normalize();
    }
    let up = right.cross(forward);
    // At distance 1, or wherever it looks.
    let half_height = match camera.orthographic {
        Some(height) => 0.5 * height * normalisation.scale,
        None => libm::tan(0.5 * camera.vfov.to_radians()),
    };
    let mut frame: Frame = bytemuck::Zeroable::zeroed();
    let eye = clear_of_surfaces(normalisation.point(camera.eye), forward, soup);
    let distance = ray_start(eye, forward);
    frame.camera_eye = (eye + distance * forward).as_vec3().to_array();
    // Parallel rays do not spread up to where they start.
    frame.camera_distance = if camera.orthographic.is_some() { 0.0 } else { distance as f32 };
    frame.is_orthographic = u32::from(camera.orthographic.is_some());
    frame.height_scale = normalisation.scale as f32;
    frame.camera_forward = forward.as_vec3().to_array();
    frame.camera_right = (right * half_height).as_vec3().to_array();
    frame.camera_up = (up * half_height).as_vec3().to_array();
    frame.lens_radius = if camera.orthographic.is_some() { 0.0 } else { normalisation.length(camera.aperture) };
    frame.focus_distance = normalisation.length(camera.focus);
    frame
}
