//! `raywave stability`: the operating envelope of the renderer on a device.

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use anyhow::ensure;

use super::compare::provenance;
use super::{open_device, output_path, print, stop_on_interrupt};
use raywave_studies::export::{Document, Exports, Format, envelope::lines};
use raywave_studies::lab::sign;
use raywave_studies::stability::{Level, plans};
use raywave_studies::studies::Envelope;

/// Drive the tracer to its numerical limits and tell where it fails
///
/// Each row drives one thing, such as the size of a scene, from the tame to the extreme. Every image is held against
/// paths in f64 or a closed form. Exits with 1 where something is not as promised.
#[derive(Debug, clap::Args)]
pub struct StabilityArguments {
    /// Rows to run, by name; all without
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    only: Vec<String>,
    /// Every setting in full: 10^8 rays, films of 16384 x 16384
    #[arg(long, conflicts_with = "quick")]
    thorough: bool,
    /// The extremes of what is promised alone, by few samples
    #[arg(long)]
    quick: bool,
    /// Print the names of the rows and what they drive, and run none
    #[arg(long)]
    list: bool,
    /// Device, by number or part of its name; see `raywave devices`
    #[arg(long, env = "RAYWAVE_DEVICE")]
    device: Option<String>,
    /// Write everything, as JSON; - is stdout, in place of the tables, here as below
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    json: Option<PathBuf>,
    /// Write a row for each setting, as CSV
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    csv: Option<PathBuf>,
    /// Write the table, as Markdown
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    markdown: Option<PathBuf>,
    /// Write a page
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    html: Option<PathBuf>,
    /// No progress
    #[arg(long, short)]
    quiet: bool,
}

/// A promise that was not kept.
#[derive(Debug, thiserror::Error)]
#[error("not as promised: {0}; the table tells by how much")]
pub struct BrokenPromise(String);

pub fn run(arguments: &StabilityArguments) -> anyhow::Result<()> {
    let names: Vec<&str> = plans().map(|plan| plan.name).collect();
    if arguments.list {
        return print(&plans().map(|plan| format!("{:<24} {}\n", plan.name, plan.driven)).collect::<String>());
    }
    for name in &arguments.only {
        ensure!(names.contains(&name.as_str()), "--only {name} is no row; the rows are {}", names.join(", "));
    }
    let files = [
        (Format::Json, &arguments.json),
        (Format::Csv, &arguments.csv),
        (Format::Markdown, &arguments.markdown),
        (Format::Html, &arguments.html),
    ];
    let files = files.into_iter().filter_map(|(format, file)| Some((format, file.clone()?)));
    let mut exports = Exports::open(files.collect(), 0.0)?;
    let level = match (arguments.quick, arguments.thorough) {
        (true, _) => Level::Quick,
        (_, true) => Level::Thorough,
        _ => Level::Standard,
    };
    let device = open_device(arguments.device.as_deref())?;
    let provenance = sign(device.description(), provenance());
    let interrupted = stop_on_interrupt("finishing the row that is begun; Ctrl-C again gives it up")?;
    let level_name = format!("{level:?}").to_lowercase();
    let mut envelope = Envelope { level: level_name, limits: Vec::new(), complete: false };
    let chosen: Vec<_> =
        plans().filter(|plan| arguments.only.is_empty() || arguments.only.iter().any(|o| o == plan.name)).collect();
    for (number, plan) in chosen.iter().enumerate() {
        if interrupted.load(Ordering::Relaxed) {
            break;
        }
        if !arguments.quiet {
            tell!("{} of {}: {}", number + 1, chosen.len(), plan.name);
        }
        envelope.limits.push(plan.run(&device, level));
        envelope.complete = envelope.limits.len() == chosen.len();
        exports.keep(&Document { provenance: &provenance, report: &envelope })?;
    }
    exports.write(&Document { provenance: &provenance, report: &envelope })?;
    if !exports.take_stdout() {
        print(&lines(&envelope))?;
    }
    let failing: Vec<&str> = envelope.limits.iter().filter(|row| !row.holds()).map(|row| row.name).collect();
    if failing.is_empty() { Ok(()) } else { Err(BrokenPromise(failing.join(", ")).into()) }
}
