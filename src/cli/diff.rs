//! `raywave diff`: how far an image is from a reference, in numbers and in false colour.

use std::fmt;
use std::path::PathBuf;

use anyhow::Context;
use glam::{DVec3, Vec3};
use serde::Serialize;

use super::print;
use crate::film::{Image, WriteOptions, check_output, read_image, srgb, write_image};
use crate::stats::{Differences, ImageComparison, compare_images, relative_squared_error};

/// Decades that the logarithmic heatmap spans below its brightest.
const DECADES: f64 = 6.0;
/// What the heatmap paints where either image is not finite: in no place of the colour map.
const NON_FINITE: Vec3 = Vec3::new(0.0, 1.0, 0.0);

/// Compare an image with a reference of the same size
///
/// Errors are taken of linear radiance, over the pixels that are finite in both images. PNG files
/// hold clamped 8-bit values; prefer EXR. Exits with 0 whenever both could be compared, however
/// much they differ.
#[derive(Debug, Clone, clap::Args)]
pub struct DiffArguments {
    /// Image to judge (.exr, .hdr or .png)
    #[arg(value_name = "A")]
    pub a: PathBuf,
    /// Reference to judge it by
    #[arg(value_name = "B")]
    pub b: PathBuf,
    /// Write the error of every pixel as a false-colour image
    #[arg(long, value_name = "FILE.png")]
    pub heatmap: Option<PathBuf>,
    /// What the heatmap shows
    #[arg(long, value_enum, value_name = "SCALE", default_value_t, requires = "heatmap")]
    pub scale: HeatmapScale,
    /// Print red, green and blue beside the whole
    #[arg(long)]
    pub channels: bool,
    /// Print JSON, always with channels; what is not finite is null
    #[arg(long)]
    pub json: bool,
}

/// What the colours of a heatmap stand for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HeatmapScale {
    /// log10 of (a - b)² / (b² + 0.01), six decades down from the largest
    #[default]
    Relative,
    /// |a - b|, from 0 to the largest
    Absolute,
}

/// Compares, writes the heatmap if one is asked for, and prints the report to stdout.
///
/// # Errors
///
/// An image that cannot be read, images of different sizes, a heatmap that cannot be written.
pub fn run(arguments: &DiffArguments) -> anyhow::Result<()> {
    let report = diff(arguments)?;
    let text = if arguments.json {
        serde_json::to_string_pretty(&report).context("cannot put the report into JSON")? + "\n"
    } else {
        report.to_string()
    };
    print(&text)
}

/// Everything [`run`] does but the printing.
///
/// # Errors
///
/// As [`run`].
pub fn diff(arguments: &DiffArguments) -> anyhow::Result<Report> {
    if let Some(path) = &arguments.heatmap {
        check_output(path)?;
    }
    let (a, b) = (read_image(&arguments.a)?, read_image(&arguments.b)?);
    let comparison = compare_images(&a, &b).with_context(|| {
        let (a, b) = (arguments.a.display(), arguments.b.display());
        format!("cannot compare {a} with {b}")
    })?;
    let heatmap = match &arguments.heatmap {
        None => None,
        Some(path) => {
            let (image, low, high) = heatmap(&a, &b, arguments.scale);
            write_image(path, &image, &WriteOptions::default())?;
            Some(Heatmap { path: path.clone(), scale: arguments.scale, low, high })
        }
    };
    Ok(Report { a: arguments.a.clone(), b: arguments.b.clone(), comparison, heatmap, channels: arguments.channels })
}

/// A comparison with the names of what was compared. It displays as aligned lines and serializes
/// with all channels.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The image.
    pub a: PathBuf,
    /// The reference.
    pub b: PathBuf,
    /// How they differ.
    #[serde(flatten)]
    pub comparison: ImageComparison,
    /// The heatmap, if one was written.
    pub heatmap: Option<Heatmap>,
    /// Whether the lines show red, green and blue too.
    #[serde(skip)]
    pub channels: bool,
}

/// A heatmap that was written, and how to read it.
#[derive(Debug, Clone, Serialize)]
pub struct Heatmap {
    /// Where it was written.
    pub path: PathBuf,
    /// What its colours stand for.
    pub scale: HeatmapScale,
    /// Value of the darkest colour; what is smaller has it too.
    pub low: f64,
    /// Value of the brightest colour.
    pub high: f64,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let comparison = &self.comparison;
        let pixels = u64::from(comparison.width) * u64::from(comparison.height);
        let mut columns = vec![("all", &comparison.whole)];
        if self.channels {
            columns.extend(["red", "green", "blue"].into_iter().zip(&comparison.channels));
        }
        writeln!(f, "{:<20}{}", "a", self.a.display())?;
        writeln!(f, "{:<20}{}", "b", self.b.display())?;
        let (width, height) = (comparison.width, comparison.height);
        writeln!(f, "{:<20}{width} x {height}", "size")?;
        writeln!(f, "{:<20}{} of {pixels}", "compared_pixels", comparison.compared_pixels)?;
        let differing = 100.0 * comparison.share_of_differing_pixels;
        writeln!(f, "{:<20}{differing:.4} %", "differing_pixels")?;
        for (name, count) in [("a", comparison.non_finite_a), ("b", comparison.non_finite_b)] {
            let name = format!("non_finite_{name}");
            let (nan, inf) = (count.nan_count, count.inf_count);
            writeln!(f, "{name:<20}{nan} nan, {inf} inf")?;
        }

        if self.channels {
            write!(f, "{:<20}", "")?;
            for (name, _) in &columns {
                write!(f, "{name:>14}")?;
            }
            writeln!(f)?;
        }
        let mut row = |name: &str, value: fn(&Differences) -> f64| {
            let cells = columns.iter().map(|(_, d)| format!("{:>14.6e}", value(d)));
            writeln!(f, "{name:<20}{}", cells.collect::<String>())
        };
        row("mse", |d| d.mse)?;
        row("rel_mse", |d| d.rel_mse)?;
        row("mean_a", |d| d.mean_a)?;
        row("mean_b", |d| d.mean_b)?;
        row("mean_difference", |d| d.mean_difference)?;
        row("  standard_error", |d| d.standard_error)?;
        row("  z", |d| d.z)?;
        row("  p", |d| d.p)?;
        row("max_abs_difference", |d| d.max_abs_difference)?;

        if let Some(heatmap) = &self.heatmap {
            let (scale, low, high) = (heatmap.scale, heatmap.low, heatmap.high);
            let path = heatmap.path.display();
            writeln!(f, "{:<20}{path}: {scale}, {low} black to {high} yellow", "heatmap")?;
        }
        Ok(())
    }
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
fn heatmap(a: &Image, b: &Image, scale: HeatmapScale) -> (Image, f64, f64) {
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
