//! Value noise in three dimensions.

use glam::{DVec3, dvec3};

/// Four octaves of value noise, about -1 to 1.
pub fn fractal_noise(at: DVec3) -> f64 {
    let octave = |k: i32| 0.5f64.powi(k) * value_noise(at * 2.0f64.powi(k) + f64::from(k) * 17.3);
    0.55 * (0..4).map(octave).sum::<f64>()
}

/// Smoothly interpolated lattice noise, -1 to 1.
fn value_noise(at: DVec3) -> f64 {
    let cell = at.floor();
    let t = at - cell;
    let t = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let corner = |dx: f64, dy: f64, dz: f64| lattice(cell + dvec3(dx, dy, dz));
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let plane = |dz: f64| {
        mix(
            mix(corner(0.0, 0.0, dz), corner(1.0, 0.0, dz), t.x),
            mix(corner(0.0, 1.0, dz), corner(1.0, 1.0, dz), t.x),
            t.y,
        )
    };
    mix(plane(0.0), plane(1.0), t.z)
}

/// A hash of an integer point to -1..1.
fn lattice(cell: DVec3) -> f64 {
    let [x, y, z] = cell.as_i64vec3().to_array().map(|i| i as u64);
    let mut h = x
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(y.wrapping_mul(0xc2b2_ae3d_27d4_eb4f))
        .wrapping_add(z.wrapping_mul(0x1656_67b1_9e37_79f9));
    h = (h ^ (h >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^= h >> 29;
    (h >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}
