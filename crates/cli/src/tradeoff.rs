//! `raywave tradeoff`: what speed costs in error for a scene, and what reaches an error soonest.
//!
//! From arguments to a [`Sweep`], its reference, its progress and its files. What renders is handed in.

use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use indicatif::ProgressBar;
use jiff::SignedDuration;

use super::at_least_one;
use super::picture::PictureArguments;
use super::{output_path, print, readable_bytes, stop_on_interrupt};
use raywave_studies::export::numbers::seconds;
use raywave_studies::export::{Document, Exports, Format};
use raywave_studies::lab::References;
use raywave_studies::stats::Bootstrap;
use raywave_studies::studies::tradeoff::{Sweep, SweepEvent, SweepPlan};
use raywave_studies::studies::{Provenance, Renderer};

/// Measure what speed costs in error: which settings buy most, which are free, which are never worth it
///
/// Renders a reference, turns one knob at a time, then what was worth it together along the number of samples, in
/// rounds of random order and by other random numbers each; tells bias from variance, and the Pareto front.
#[derive(Debug, Clone, clap::Args)]
pub struct TradeoffArguments {
    /// Scene (.toml, .gltf, .glb, Mitsuba's .xml) or mesh (.obj, .ply); the built-in Cornell box without
    #[arg(value_name = "SCENE")]
    pub scene: Option<String>,
    /// Rendering time that it may take, such as 90s, 10m or 1h; building kernels and writing files come on top
    #[arg(long, value_name = "TIME", default_value = "10m", value_parser = duration)]
    pub budget: f64,
    /// Renders of each point, at most
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = at_least_one)]
    pub rounds: usize,
    /// Image to hold renders against, instead of one that is rendered
    #[arg(long, value_name = "FILE")]
    pub reference: Option<PathBuf>,
    /// relMSE by its own noise at which a rendered reference is good enough
    #[arg(long, value_name = "E", default_value_t = 1e-5, value_parser = above_zero, conflicts_with = "reference")]
    pub reference_error: f64,
    /// Ask what reaches this relMSE soonest
    #[arg(long, value_name = "E", value_parser = above_zero)]
    pub target_error: Option<f64>,
    /// Seed of the order of the renders
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    pub order_seed: u64,
    /// Clocks and power limits of the device, for the record
    #[arg(long, value_name = "TEXT")]
    pub clocks: Option<String>,
    /// The base: what to render, and on which device. Without --samples as many as the budget has room for.
    #[command(flatten)]
    pub picture: PictureArguments,
    /// Exposure of the images in the page, in stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f32,
    /// Write everything, as JSON; - is stdout, in place of the tables, here as below
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    pub json: Option<PathBuf>,
    /// Write a row for each point, as CSV
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    pub csv: Option<PathBuf>,
    /// Write tables, as Markdown
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    pub markdown: Option<PathBuf>,
    /// Write a page with the front, tables and images
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    pub html: Option<PathBuf>,
    /// No plan, progress or warnings
    #[arg(long, short)]
    pub quiet: bool,
}

/// The sweep that the arguments ask for.
pub fn sweep(arguments: &TradeoffArguments) -> Sweep {
    Sweep {
        scene: arguments.scene.clone().unwrap_or_default(),
        load_flags: arguments.picture.load.flags(),
        budget_seconds: arguments.budget,
        rounds: arguments.rounds,
        fixed_samples: arguments.picture.has_samples(),
        reference_error: arguments.reference_error,
        target: arguments.target_error,
        bootstrap: Bootstrap { resamples: 2000, ..Bootstrap::default() },
        seed: arguments.order_seed,
    }
}

/// Carries the sweep out with a renderer that `open` makes, keeps the files up to date, and prints tables to stdout. A
/// scene that is the empty text is the built-in one.
///
/// # Errors
/// Files that cannot be written, a scene or a base that does not render, a reference that does not fit.
pub fn run(
    arguments: &TradeoffArguments,
    open: impl FnOnce(&TradeoffArguments) -> anyhow::Result<(Box<dyn Renderer>, Provenance)>,
) -> anyhow::Result<()> {
    let mut exports = Exports::open(files(arguments), arguments.exposure)?;
    let mut references = References::new(arguments.reference.as_deref(), arguments.reference_error, arguments.budget)?;
    let (mut renderer, provenance) = open(arguments)?;
    let interrupted =
        stop_on_interrupt("ending after this render; the files keep what there is; Ctrl-C again gives it up")?;
    let hidden = arguments.quiet || !std::io::stderr().is_terminal();
    let bar = if hidden { ProgressBar::hidden() } else { ProgressBar::new_spinner() };

    let sweep = sweep(arguments);
    let mut unwritten = None;
    let outcome = sweep.run(renderer.as_mut(), &mut references, &mut |event| {
        match event {
            SweepEvent::Planned(plan) if !arguments.quiet => bar.suspend(|| tell!("{}", plan_text(plan))),
            SweepEvent::Planned(_) => {}
            SweepEvent::Rendering { label, round } => {
                let step = round.map_or_else(String::new, |round| format!("round {}: ", round + 1));
                bar.set_message(format!("{step}{label}"));
                bar.tick();
            }
            SweepEvent::Updated(report) => {
                if let Err(error) = exports.update(&Document { provenance: &provenance, report }) {
                    unwritten = Some(error);
                    return ControlFlow::Break(());
                }
            }
        }
        if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    let report = outcome?;
    if let (Some(warning), false) = (references.warning(), arguments.quiet) {
        tell!("warning: {warning}");
    }
    let document = Document { provenance: &provenance, report: &report };
    let written = unwritten.map_or_else(|| exports.write(&document), Err);
    if !exports.take_stdout() {
        print(&document.markdown())?;
    }
    Ok(written?)
}

fn plan_text(plan: &SweepPlan) -> String {
    let SweepPlan { stage, points, rounds, seconds: time, image_bytes } = plan;
    let memory = if *image_bytes > 0 { format!(", {} of images", readable_bytes(*image_bytes)) } else { String::new() };
    let listed = if points.len() > 1 { format!("\n    {}", points.join("\n    ")) } else { String::new() };
    format!("{stage}: {} points, up to {rounds} rounds, about {}{memory}{listed}", points.len(), seconds(*time))
}

fn files(arguments: &TradeoffArguments) -> Vec<(Format, PathBuf)> {
    let named = [
        (Format::Json, &arguments.json),
        (Format::Csv, &arguments.csv),
        (Format::Markdown, &arguments.markdown),
        (Format::Html, &arguments.html),
    ];
    named.into_iter().filter_map(|(format, path)| Some((format, path.clone()?))).collect()
}

fn above_zero(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
    number.ok_or_else(|| "it is not a number above 0".to_owned())
}

/// Seconds of a time such as 90s, 10m or 1h30m; a number alone is of seconds.
pub(super) fn duration(text: &str) -> Result<f64, String> {
    let units = || text.parse::<SignedDuration>().ok().map(|time| time.as_secs_f64()).filter(|seconds| *seconds > 0.0);
    above_zero(text).ok().or_else(units).ok_or_else(|| "it is not a time such as 90s, 10m or 1h".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[test]
    fn commands_load_the_scene_as_it_was_loaded() {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            tradeoff: TradeoffArguments,
        }
        let flags = |words: &[&str]| {
            let line = Line::try_parse_from(["tradeoff"].iter().chain(words)).expect("it is a command line");
            sweep(&line.tradeoff).load_flags
        };
        assert_eq!(flags(&["s.glb"]), "");
        let words = ["s.glb", "--camera", "from above", "--up", "-1,0,0.5", "--lenient", "--allow-outside"];
        let written = flags(&words);
        assert_eq!(written, "--camera='from above' --up=-1,0,0.5 --allow-outside --lenient");
        let again: Vec<String> = shlex::split(&written).expect("a shell takes it");
        assert_eq!(flags(&again.iter().map(String::as_str).collect::<Vec<_>>()), written);
    }

    #[test]
    fn times_have_units() {
        for (text, seconds) in [("90", Some(90.0)), ("1.5s", Some(1.5)), ("10m", Some(600.0)), ("1h30m", Some(5400.0))]
        {
            assert_eq!(duration(text).ok(), seconds, "{text}");
        }
        for text in ["", "m", "-1s", "0", "ten", "1d", "inf", "é"] {
            assert!(duration(text).is_err(), "{text}");
        }
    }
}
