//! The sRGB transfer function.
//!
//! Source: IEC 61966-2-1:1999, with the constants of its amendment 1. Computed in `f64`, so that
//! rounding to 8 bits is decided by the formula and not by the arithmetic, and by `libm`, so that
//! an image is the same on every host.

use std::sync::LazyLock;

/// Linear light to the sRGB signal. Meant for [0, 1], which it maps onto [0, 1].
pub fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 }
}

/// The sRGB signal to linear light, the inverse of [`encode`]. Meant for [0, 1].
pub fn decode(signal: f64) -> f64 {
    if signal <= 0.040_45 { signal / 12.92 } else { libm::pow((signal + 0.055) / 1.055, 2.4) }
}

/// Linear light to an 8-bit sRGB code, rounded to the nearest. Light outside [0, 1] is clamped;
/// NaN becomes 0.
pub fn encode_byte(linear: f64) -> u8 {
    // `as` saturates and takes NaN to 0.
    (encode(linear.clamp(0.0, 1.0)) * 255.0).round() as u8
}

/// The linear light of every 16-bit sRGB code.
pub(super) fn decoded_codes() -> &'static [f32] {
    static LINEAR: LazyLock<Vec<f32>> = LazyLock::new(|| {
        let linear = |code: u16| decode(f64::from(code) / f64::from(u16::MAX)) as f32;
        (0..=u16::MAX).map(linear).collect()
    });
    &LINEAR
}
