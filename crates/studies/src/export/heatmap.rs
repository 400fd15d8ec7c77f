//! Differences of two images in false colour.

use std::fmt;

use glam::{DVec3, Vec3};
use serde::Serialize;
use strum::{EnumMessage, EnumString, IntoStaticStr, VariantArray};

use crate::stats::relative_squared_error;
use raywave::image::{Image, srgb};

/// Decades that the logarithmic heatmap spans below its brightest.
const DECADES: f64 = 6.0;
/// What the heatmap paints where either image is not finite: in no place of the colour map.
const NON_FINITE: Vec3 = Vec3::new(0.0, 1.0, 0.0);

/// What the colours of a heatmap stand for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, EnumString, IntoStaticStr, VariantArray, EnumMessage)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "kebab-case")]
pub enum HeatmapScale {
    /// log10 of (a - b)² / (b² + 0.01), six decades down from the largest.
    Relative,
    /// |a - b|, from 0 to the largest.
    Absolute,
}

impl fmt::Display for HeatmapScale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Relative => "log10 of (a - b)^2 / (b^2 + 0.01)",
            Self::Absolute => "|a - b|",
        })
    }
}

/// Every pixel's error in false colour, and the errors that the darkest and the brightest colour
/// stand for. The images have one size.
pub fn heatmap(a: &Image, b: &Image, scale: HeatmapScale) -> (Image, f64, f64) {
    let error = |(a, b): (&Vec3, &Vec3)| {
        (a.is_finite() && b.is_finite()).then(|| match scale {
            HeatmapScale::Relative => relative_squared_error(*a, *b).log10(),
            HeatmapScale::Absolute => (a.as_dvec3() - b.as_dvec3()).abs().element_sum() / 3.0,
        })
    };
    let errors: Vec<Option<f64>> = a.pixels.iter().zip(&b.pixels).map(error).collect();
    let largest = errors.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = match scale {
        // Whole decades, so that the colours of two heatmaps can be compared. Equal images have
        // no largest decade; 0 stands in.
        HeatmapScale::Relative if largest.is_finite() => (largest.ceil() - DECADES, largest.ceil()),
        HeatmapScale::Relative => (-DECADES, 0.0),
        HeatmapScale::Absolute => (0.0, largest.max(0.0)),
    };
    // An empty range has one colour, the darkest.
    let range = (high - low).max(f64::MIN_POSITIVE);
    let colour = |error: Option<f64>| match error {
        Some(error) => inferno((error - low) / range),
        None => NON_FINITE,
    };
    let pixels = errors.into_iter().map(colour).collect();
    (Image::new(a.width, a.height, pixels), low, high)
}

/// The colour map inferno in linear light, `t` clamped to [0, 1]: it grows steadily in lightness,
/// so it reads the same in grey.
///
/// Source: Smith and van der Walt, matplotlib (2015); polynomial fit by Matt Zucker (2019). Both
/// are in the public domain (CC0).
fn inferno(t: f64) -> Vec3 {
    const COEFFICIENTS: [DVec3; 7] = [
        DVec3::new(0.000_218_940_4, 0.001_651_005, -0.019_480_90),
        DVec3::new(0.106_513_4, 0.563_956_4, 3.932_712),
        DVec3::new(11.602_49, -3.972_854, -15.942_39),
        DVec3::new(-41.703_996, 17.436_399, 44.354_145),
        DVec3::new(77.162_936, -33.402_359, -81.807_309),
        DVec3::new(-71.319_428, 32.626_064, 73.209_520),
        DVec3::new(25.131_126, -12.242_669, -23.070_325),
    ];
    let t = t.clamp(0.0, 1.0);
    let signal = COEFFICIENTS.into_iter().rev().fold(DVec3::ZERO, |sum, coefficient| sum * t + coefficient);
    signal.clamp(DVec3::ZERO, DVec3::ONE).map(srgb::decode).as_vec3()
}
