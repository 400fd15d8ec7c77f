//! Surfaces over the unit square: what the gallery's statues, columns and lamps are made of.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};

use super::noise::fractal_noise;

/// How the edges of a shape's parameter square meet.
#[derive(Clone, Copy, PartialEq)]
pub enum Seam {
    /// A sheet with four free edges.
    Open,
    /// Closed in u, open at both ends of v.
    Tube,
    /// Closed in u, a single point at either end of v.
    Poles,
    /// Closed in u and in v.
    Torus,
}

/// A surface over the unit square; its front is the side of du x dv.
pub struct Shape {
    pub material: &'static str,
    pub seam: Seam,
    /// Has normals; without, its facets show.
    pub is_smooth: bool,
    /// Share of the triangles.
    pub weight: f64,
    /// Quads along u for each along v, so that they come out about square.
    pub aspect: f64,
    pub point: Box<dyn Fn(f64, f64) -> DVec3>,
}

impl Shape {
    pub fn new(
        material: &'static str,
        seam: Seam,
        weight: f64,
        aspect: f64,
        point: impl Fn(f64, f64) -> DVec3 + 'static,
    ) -> Self {
        Self { material, seam, is_smooth: true, weight, aspect, point: Box::new(point) }
    }

    /// A ball.
    pub fn ball(material: &'static str, weight: f64, centre: DVec3, radius: f64) -> Self {
        let point = move |u, v| centre + radius * on_sphere(u, v);
        Self::new(material, Seam::Poles, weight, 2.0, point)
    }

    /// A ball with dents and bulges; `frequency` is how many across its radius.
    pub fn blob(
        material: &'static str,
        weight: f64,
        (centre, radius): (DVec3, f64),
        (roughness, frequency): (f64, f64),
    ) -> Self {
        let point = move |u, v| {
            let direction = on_sphere(u, v);
            let bulge = 1.0 + roughness * fractal_noise(frequency * direction + centre);
            centre + radius * bulge * direction
        };
        Self::new(material, Seam::Poles, weight, 2.0, point)
    }

    /// A torus about the y axis.
    pub fn ring(material: &'static str, weight: f64, centre: DVec3, radius: f64, tube: f64) -> Self {
        let aspect = tube / radius;
        let point = move |u, v| centre + ring(radius, tube, v, u);
        Self::new(material, Seam::Torus, weight, aspect, point)
    }

    /// The same without normals.
    pub fn faceted(self) -> Self {
        Self { is_smooth: false, ..self }
    }
}

/// The unit sphere, u about the y axis, v from the lower pole to the upper.
pub fn on_sphere(u: f64, v: f64) -> DVec3 {
    let (sin_azimuth, cos_azimuth) = (TAU * u).sin_cos();
    let (sin_polar, cos_polar) = (PI * v).sin_cos();
    dvec3(sin_polar * sin_azimuth, -cos_polar, sin_polar * cos_azimuth)
}

/// A point of a body of revolution about the y axis.
pub fn revolved(foot: DVec3, radius: f64, height: f64, u: f64) -> DVec3 {
    let (sine, cosine) = (TAU * u).sin_cos();
    foot + dvec3(radius * sine, height, radius * cosine)
}

/// A fluted column with swelling ends, 4.56 high.
pub fn column(foot: DVec3, u: f64, v: f64) -> DVec3 {
    let t = 0.5 - 0.5 * (PI * v).cos(); // Rows crowd at the ends, where the profile bends.
    let bell = |at: f64, width: f64| (-((t - at) / width).powi(2)).exp();
    let shaft = ((t - 0.05) * 30.0).clamp(0.0, 1.0) * ((0.94 - t) * 30.0).clamp(0.0, 1.0);
    let flute = 0.026 * shaft * (0.5 - 0.5 * (TAU * 16.0 * u).cos());
    let ends = 0.14 * bell(0.0, 0.03) + 0.18 * bell(1.0, 0.05);
    revolved(foot, 0.29 - 0.045 * t - flute + ends, 4.56 * t, u)
}

/// A vase with a slight fluting, `height` high.
pub fn vase(foot: DVec3, height: f64, u: f64, v: f64) -> DVec3 {
    let belly = 0.20 * (PI * v.powf(0.8)).sin().max(0.0).powf(1.3);
    let lip = 0.09 * (-((1.0 - v) / 0.07).powi(2)).exp();
    let foot_flare = 0.06 * (-(v / 0.05).powi(2)).exp();
    let flute = 1.0 + 0.03 * (TAU * 12.0 * (u + 0.35 * v)).cos() * (PI * v).sin();
    revolved(foot, height * flute * (0.09 + belly + lip + foot_flare), height * v, u)
}

/// A rounded square bar that twists as it rises, closed at both ends.
pub fn twist(foot: DVec3, u: f64, v: f64) -> DVec3 {
    let (sine, cosine) = (TAU * u).sin_cos();
    let rounded = |x: f64| x.signum() * x.abs().powf(0.45);
    // The profile rises within the first and last tenth of v, so that the ends are caps.
    let cap = |v: f64| (1.0 - (1.0 - (10.0 * v).min(1.0)).powi(2)).max(0.0).sqrt();
    let radius = 0.23 * cap(v) * cap(1.0 - v) * (1.0 - 0.25 * (PI * v).sin());
    let turn = DVec2::from_angle(1.2 * PI * v);
    let section = turn.rotate(dvec2(rounded(sine), rounded(cosine))) * radius;
    foot + dvec3(section.x, 1.15 * v, section.y)
}

/// A torus about the y axis at the origin; `u` runs along it, `v` around its tube, downwards first.
fn ring(radius: f64, tube: f64, u: f64, v: f64) -> DVec3 {
    let (sine, cosine) = (-TAU * v).sin_cos();
    revolved(DVec3::ZERO, radius + tube * cosine, tube * sine, u)
}

/// A bent ring that stands on its edge.
pub fn hoop(centre: DVec3, u: f64, v: f64) -> DVec3 {
    let radius = 0.42 * (1.0 + 0.10 * (3.0 * TAU * u).cos());
    let bend = dvec3(0.0, 0.12 * (2.0 * TAU * u).sin(), 0.0);
    centre + DQuat::from_rotation_x(1.05) * (ring(radius, 0.055, u, v) + bend)
}

/// A (2, 3) torus knot; `u` runs along it, `v` around its tube.
pub fn knot(centre: DVec3, size: f64, u: f64, v: f64) -> DVec3 {
    let curve = |u: f64| {
        let (sin_two, cos_two) = (2.0 * TAU * u).sin_cos();
        let (sin_three, cos_three) = (3.0 * TAU * u).sin_cos();
        let radius = 1.0 + 0.45 * cos_three;
        dvec3(radius * cos_two, radius * sin_two, 0.55 * sin_three)
    };
    const STEP: f64 = 1e-4;
    let (before, after) = (curve(u - STEP), curve(u + STEP));
    let tangent = (after - before).normalize();
    let side = tangent.cross(before + after).normalize();
    let (sine, cosine) = (TAU * v).sin_cos();
    let tube = 0.24 * (cosine * side.cross(tangent) + sine * side);
    centre + size * (curve(u) + tube)
}
