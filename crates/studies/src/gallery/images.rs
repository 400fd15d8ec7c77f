//! The gallery's images: the tiles of its floor and the sky outside.

use std::f64::consts::{PI, TAU};

use glam::dvec3;

use super::noise::fractal_noise;
use raywave::image::{Image, srgb};

/// A square of two pale and two dark floor tiles with joints between them.
pub fn tiles() -> Image {
    const SIZE: u32 = 256;
    const TILE: u32 = SIZE / 2;
    const JOINT: u32 = 3;
    let pixel = |(x, y): (u32, u32)| {
        let in_joint = x % TILE < JOINT || y % TILE < JOINT;
        let is_pale = (x / TILE + y / TILE).is_multiple_of(2);
        let at = dvec3(f64::from(x), f64::from(y), 0.0);
        let vein = fractal_noise(at * dvec3(0.02, 0.05, 1.0));
        let codes = match (in_joint, is_pale) {
            (true, _) => dvec3(70.0, 66.0, 60.0),
            (_, true) => dvec3(206.0, 196.0, 178.0),
            (_, false) => dvec3(92.0, 72.0, 62.0),
        };
        let shade = |code: f64| (code * (1.0 + 0.22 * vein)).clamp(0.0, 255.0).floor();
        codes.map(|code| srgb::decode(shade(code) / 255.0)).as_vec3()
    };
    Image::new(SIZE, SIZE, texels(SIZE, SIZE).map(pixel).collect())
}

/// An evening sky as a lat-long image: blue above, a broad glow low on the left, dark ground below.
pub fn evening_sky() -> Image {
    const WIDTH: u32 = 128;
    const HEIGHT: u32 = 64;
    let pixel = |(x, y): (u32, u32)| {
        let azimuth = (f64::from(x) + 0.5) / f64::from(WIDTH) * TAU - PI;
        let (sine, cosine) = (PI * (f64::from(y) + 0.5) / f64::from(HEIGHT)).sin_cos();
        let direction = dvec3(sine * azimuth.sin(), cosine, -sine * azimuth.cos());
        let glow = direction.dot(dvec3(-0.92, 0.16, -0.36).normalize()).max(0.0);
        let zenith = dvec3(0.16, 0.26, 0.55);
        let horizon = dvec3(0.95, 0.62, 0.42);
        let sky = horizon.lerp(zenith, direction.y.max(0.0).powf(0.45));
        let sky = 1.3 * sky + dvec3(9.0, 4.6, 1.7) * glow.powi(24);
        let ground = dvec3(0.10, 0.08, 0.07);
        // The horizon is soft, so that bilinear lookup and a step do not meet.
        ground.lerp(sky, (direction.y * 12.0 + 0.5).clamp(0.0, 1.0)).as_vec3()
    };
    Image::new(WIDTH, HEIGHT, texels(WIDTH, HEIGHT).map(pixel).collect())
}

/// Columns and rows of all texels, row by row.
fn texels(width: u32, height: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)))
}
