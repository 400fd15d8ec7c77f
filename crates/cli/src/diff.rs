//! `raywave diff`: how far an image is from a reference, in numbers and in false colour.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;

use super::film;
use super::picture::one_of;
use super::print;
use raywave::image::{Image, WriteOptions, check_output, read_image, write_image};
pub use raywave_studies::export::heatmap::HeatmapScale;
use raywave_studies::export::heatmap::heatmap;
use raywave_studies::stats::{Differences, ImageComparison, PixelTest, compare_images, test_pixels};

/// Compare an image with a reference of the same size
///
/// Errors are taken of linear radiance, over the pixels that are finite in both images. PNG files
/// hold clamped 8-bit values; prefer EXR. Exits with 0 whenever both could be compared, however
/// much they differ.
#[derive(Debug, Clone, clap::Args)]
pub struct DiffArguments {
    /// Image to judge (.exr, .hdr or .png), or a film (.film)
    #[arg(value_name = "A")]
    pub a: PathBuf,
    /// Reference to judge it by
    #[arg(value_name = "B")]
    pub b: PathBuf,
    /// Write the error of every pixel as a false-colour image
    #[arg(long, value_name = "FILE.png")]
    pub heatmap: Option<PathBuf>,
    /// What the heatmap shows
    #[arg(long, value_parser = one_of::<HeatmapScale>(), value_name = "SCALE", default_value = "relative", requires = "heatmap")]
    pub scale: HeatmapScale,
    /// Variance of one sample of each pixel of B (.exr): tests of each pixel whether noise explains the difference, as the
    /// tests of Mitsuba 3's renders do
    #[arg(long, value_name = "FILE", requires = "samples")]
    pub variance: Option<PathBuf>,
    /// Samples a pixel in A
    #[arg(long, value_name = "N", requires = "variance", value_parser = clap::value_parser!(u32).range(1..))]
    pub samples: Option<u32>,
    /// Print red, green and blue beside the whole
    #[arg(long)]
    pub channels: bool,
    /// Print JSON, always with channels; what is not finite is null
    #[arg(long)]
    pub json: bool,
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
        check_output(path, None)?;
    }
    let (a, b) = (read_picture(&arguments.a)?, read_picture(&arguments.b)?);
    let comparison = compare_images(&a, &b).with_context(|| {
        let (a, b) = (arguments.a.display(), arguments.b.display());
        format!("cannot compare {a} with {b}")
    })?;
    let pixel_test = match (&arguments.variance, arguments.samples) {
        (Some(path), Some(samples)) => {
            let test = test_pixels(&a, &b, &read_image(path)?, samples);
            Some(test.with_context(|| format!("cannot test by {}", path.display()))?)
        }
        _ => None,
    };
    let heatmap = match &arguments.heatmap {
        None => None,
        Some(path) => {
            let (image, low, high) = heatmap(&a, &b, arguments.scale);
            write_image(path, &image, &WriteOptions::default())?;
            Some(Heatmap { path: path.clone(), scale: arguments.scale, low, high })
        }
    };
    let (a, b) = (arguments.a.clone(), arguments.b.clone());
    Ok(Report { a, b, comparison, pixel_test, heatmap, channels: arguments.channels })
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
    /// The test of each pixel, if a variance was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_test: Option<PixelTest>,
    /// The heatmap, if one was written.
    pub heatmap: Option<Heatmap>,
    /// Whether the lines show red, green and blue too.
    #[serde(skip)]
    pub channels: bool,
}

/// Reads an image, or that of a film.
fn read_picture(path: &Path) -> anyhow::Result<Image> {
    Ok(if film::is_film(path) { film::read(path)?.0.image() } else { read_image(path)? })
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
        writeln!(f, "{:<20}{} of {pixels}, to the last bit", "identical_pixels", comparison.identical_pixels)?;
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

        if let Some(PixelTest { values, explained, share, largest_z, .. }) = &self.pixel_test {
            let share = 100.0 * share;
            writeln!(
                f,
                "{:<20}{explained} of {values} values, {share:.3} %; largest z {largest_z:.3}",
                "noise_explains"
            )?;
        }
        if let Some(heatmap) = &self.heatmap {
            let (scale, low, high) = (heatmap.scale, heatmap.low, heatmap.high);
            let path = heatmap.path.display();
            writeln!(f, "{:<20}{path}: {scale}, {low} black to {high} yellow", "heatmap")?;
        }
        Ok(())
    }
}
