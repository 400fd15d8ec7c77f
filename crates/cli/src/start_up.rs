//! `raywave start-up`: how long a process takes from its start to its first sample.
//!
//! The processes that it starts are this program as the hidden command `first-sample`.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Context;
use serde_json::{Value, json};

use super::picture::PictureArguments;
use super::{at_least_one, load_scene, open_device, print, warn_unless};
use raywave_studies::export::numbers::{Unit, interval};
use raywave_studies::export::plain;
use raywave_studies::lab::{Contrast, FirstSample, StartUp, Tuning, first_sample_of};
use raywave_studies::stats::{CONFIDENCE, Estimate};

/// Measure how long a process takes to its first sample, with cold and with warm shader caches
///
/// Starts processes that load the scene and render one sample of every pixel, in turn without any
/// cache of compiled kernels and with the caches that another process has filled.
#[derive(Debug, clap::Args)]
pub struct StartUpArguments {
    /// Scene (.toml, .gltf, .glb, Mitsuba's .xml) or mesh (.obj, .ply); the built-in Cornell box without
    scene: Option<PathBuf>,
    #[command(flatten)]
    picture: PictureArguments,
    /// Processes with cold caches, and as many with warm ones
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = at_least_one)]
    rounds: usize,
    /// JSON instead of a table
    #[arg(long)]
    json: bool,
}

/// One sample of every pixel, for [`StartUp`].
#[derive(Debug, clap::Args)]
pub struct FirstSampleArguments {
    scene: Option<PathBuf>,
    #[arg(long)]
    device: Option<String>,
}

pub fn run_command(arguments: &StartUpArguments) -> anyhow::Result<()> {
    // What is wrong with the arguments is said once, before anything is started.
    let scene = load_scene(arguments.scene.as_deref(), &arguments.picture.load.options(), false)?;
    let settings = arguments.picture.settings(&scene)?;
    let mut first = FirstSample { settings, tuned: None, load: arguments.picture.load.options() };
    if arguments.picture.tuned() {
        let device = arguments.picture.open_device()?;
        first.tuned = Tuning::of_scene(device.description(), &scene, &mut warn_unless(false)).chosen();
    }
    let start_up = StartUp::new(arguments.picture.device(), arguments.rounds)?;
    let measured = start_up.measure(arguments.scene.as_deref(), &first)?;
    let settings = measured.settings();
    if arguments.json {
        let seconds = |Contrast { cold, cached }| json!({ "cold_seconds": cold, "cached_seconds": cached });
        let pipelines: Vec<Value> = measured
            .pipelines()
            .into_iter()
            .map(|(kernel, Contrast { cold, cached })| {
                json!({ "kernel": kernel, "cold_seconds": cold, "cached_seconds": cached })
            })
            .collect();
        let [cold_runs, cached_runs] = measured.runs();
        let report = json!({
            "settings": settings,
            "rounds": arguments.rounds,
            "start_up": seconds(measured.seconds()),
            "all_pipelines": seconds(measured.all_pipelines()),
            "pipelines": pipelines,
            "runs": { "cold_seconds": cold_runs, "cached_seconds": cached_runs },
        });
        return print(&(serde_json::to_string_pretty(&report)? + "\n"));
    }

    let mut rows =
        vec![("start-up".to_owned(), measured.seconds()), ("pipelines".to_owned(), measured.all_pipelines())];
    rows.extend(measured.pipelines().into_iter().map(|(kernel, seconds)| (format!("  {kernel}"), seconds)));
    let tell = |key: &str| plain(&settings[key]);
    let mut text = format!(
        "{}, {}x{}, {}, on {}\nmedian of {} processes with its {:.0} % interval\n\n{:<20} {:<26} cached\n",
        tell("scene"),
        tell("width_pixels"),
        tell("height_pixels"),
        tell("scheduler"),
        tell("device"),
        arguments.rounds,
        100.0 * CONFIDENCE,
        "",
        "cold",
    );
    let cell = |estimate: &Estimate| {
        let unit = Unit::of_time(estimate.value);
        format!("{} {}", interval(estimate, unit), unit.symbol)
    };
    for (name, Contrast { cold, cached }) in rows {
        writeln!(text, "{name:<20} {:<26} {}", cell(&cold), cell(&cached))?;
    }
    print(&text)
}

/// The process that [`StartUp::measure`] starts.
pub fn first_sample(arguments: &FirstSampleArguments) -> anyhow::Result<()> {
    let first: FirstSample = serde_json::from_reader(std::io::stdin().lock()).context("no settings on stdin")?;
    first.settings.validate()?;
    let scene = load_scene(arguments.scene.as_deref(), &first.load, true)?;
    print(&first_sample_of(&scene, &first, &open_device(arguments.device.as_deref())?)?)
}
