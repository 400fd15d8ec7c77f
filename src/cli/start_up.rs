//! `raywave start-up`: how long a process takes from its start to its first sample.
//!
//! Drivers look at their caches when a process first touches them, so cold and warm ones are
//! measured in processes of their own: this program, started anew as the hidden command
//! `first-sample`, with the settings on its stdin.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Read, Write as _};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::Context;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::compare::at_least_one;
use super::measure::stage;
use super::picture::PictureArguments;
use super::render::record;
use super::tuning::Tuning;
use super::{load_scene, open_device, print};
use crate::export::numbers::{Unit, interval};
use crate::export::plain;
use crate::render::{Defaults, PreparedScene, Session, Settings};
use crate::stats::{CONFIDENCE, Estimate};

/// Measure how long a process takes to its first sample, with cold and with warm shader caches
///
/// Starts processes that load the scene and render one sample of every pixel, in turn without any
/// cache of compiled kernels and with the caches that another process has filled.
#[derive(Debug, clap::Args)]
pub struct StartUpArguments {
    /// Scene file (.toml) or mesh (.obj); the built-in Cornell box without
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

/// One sample of every pixel, for [`measure`].
#[derive(Debug, clap::Args)]
pub struct FirstSampleArguments {
    scene: Option<PathBuf>,
    #[arg(long)]
    device: Option<String>,
}

/// A process that did not get to its first sample.
#[derive(Debug, thiserror::Error)]
#[error("a process that was to render one sample failed: {said}")]
pub struct ChildFailed {
    said: String,
    /// Its exit code.
    pub code: u8,
}

/// Variables that take a process its caches, as far as drivers and this program listen to any.
const COLD: [(&str, &str); 3] =
    [("MESA_SHADER_CACHE_DISABLE", "true"), ("__GL_SHADER_DISK_CACHE", "0"), ("RAYWAVE_CACHE", "off")];
/// Variables that name the folder in which a process has its caches.
const CACHE_FOLDERS: [&str; 3] = ["XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR", "__GL_SHADER_DISK_CACHE_PATH"];

/// What a process took.
#[derive(Debug, Clone)]
struct Run {
    /// From before its start to the end of its first sample.
    seconds: f64,
    told: Told,
}

/// What a process tells of itself, as a line of JSON, when it has its first sample.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Told {
    /// As in the metadata of an image.
    settings: Map<String, Value>,
    /// Seconds until all pipelines were built.
    all_pipelines: f64,
    /// Seconds of each kernel's pipeline, by name.
    pipelines: Vec<(String, f64)>,
}

/// Start-ups with cold caches and with warm ones.
#[derive(Debug, Clone)]
pub struct StartUps {
    cold: Vec<Run>,
    cached: Vec<Run>,
}

/// A quantity with cold caches and with warm ones: the median over processes, with its interval.
#[derive(Debug, Clone, Copy)]
pub struct Contrast {
    /// Without any cache.
    pub cold: Estimate,
    /// With all caches filled.
    pub cached: Estimate,
}

/// Starts `2 * rounds` processes that render one sample of that scene, and one before them that
/// fills the caches. All caches lie in a folder of their own, which is removed.
///
/// # Errors
/// A process that cannot be started, or fails.
pub fn measure(
    scene: Option<&Path>,
    device: Option<&str>,
    settings: &Settings,
    rounds: usize,
) -> anyhow::Result<StartUps> {
    let folder = tempfile::tempdir().context("no folder can be made for caches")?;
    let settings = serde_json::to_vec(settings).context("settings become JSON")?;
    let run = |cold: bool| {
        let mut command = Command::new(std::env::current_exe().context("this program cannot find itself")?);
        command.arg("first-sample").args(device.map(|name| format!("--device={name}"))).arg("--").args(scene);
        command.envs(CACHE_FOLDERS.map(|name| (name, folder.path())));
        for (name, value) in COLD {
            if cold {
                command.env(name, value)
            } else {
                command.env_remove(name)
            };
        }
        run(command, &settings)
    };
    run(false)?;
    let mut measured = StartUps { cold: Vec::new(), cached: Vec::new() };
    for _ in 0..rounds {
        measured.cold.push(run(true)?);
        measured.cached.push(run(false)?);
    }
    Ok(measured)
}

/// Runs a process to the line that it writes when it has its first sample.
fn run(mut command: Command, settings: &[u8]) -> anyhow::Result<Run> {
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let start = Instant::now();
    let mut child = command.spawn().context("this program cannot be started anew")?;
    // A child that has died says why on stderr.
    let _ = child.stdin.take().expect("stdin is a pipe").write_all(settings);
    let mut line = String::new();
    let read = BufReader::new(child.stdout.take().expect("stdout is a pipe")).read_line(&mut line);
    let seconds = start.elapsed().as_secs_f64();
    let mut said = String::new();
    let _ = child.stderr.take().expect("stderr is a pipe").read_to_string(&mut said);
    let status = child.wait().context("a process that was started is lost")?;
    if !status.success() || read.is_err() {
        let said = said.trim().trim_start_matches("error: ").to_owned();
        let said = if said.is_empty() { status.to_string() } else { said };
        return Err(ChildFailed { said, code: status.code().map_or(1, |code| code as u8) }.into());
    }
    let told = serde_json::from_str(&line).context("a process that was started speaks another language")?;
    Ok(Run { seconds, told })
}

/// The process that [`measure`] starts.
pub fn first_sample(arguments: &FirstSampleArguments) -> anyhow::Result<()> {
    let settings: Settings = serde_json::from_reader(std::io::stdin().lock()).context("no settings on stdin")?;
    settings.validate()?;
    let scene = load_scene(arguments.scene.as_deref(), true)?;
    let device = open_device(arguments.device.as_deref())?;
    let prepared = PreparedScene::for_device(&scene, &settings, &Defaults::of(&device)?)?;
    let settings = Settings { samples: 1, ..settings };
    let mut session = Session::new(&device, &prepared, &settings)?;
    let outcome = session.render(|_| ControlFlow::Continue(()))?;
    let told = Told {
        settings: record(&scene, &settings, device.description(), &outcome.statistics),
        all_pipelines: session.pipelines_time().as_secs_f64(),
        pipelines: session.pipeline_times().map(|(name, time)| (name.to_owned(), time.as_secs_f64())).collect(),
    };
    print(&(serde_json::to_string(&told)? + "\n"))
}

impl StartUps {
    fn contrast(&self, pick: impl Fn(&Run) -> f64) -> Contrast {
        let median = |runs: &[Run]| Estimate::of_median(&runs.iter().map(&pick).collect::<Vec<_>>());
        Contrast { cold: median(&self.cold), cached: median(&self.cached) }
    }

    /// Seconds from the start of a process to the end of its first sample.
    pub fn seconds(&self) -> Contrast {
        self.contrast(|run| run.seconds)
    }

    /// Seconds until all pipelines were built.
    fn all_pipelines(&self) -> Contrast {
        self.contrast(|run| run.told.all_pipelines)
    }

    /// Seconds of each kernel's pipeline, in the order in which a bounce runs them.
    pub fn pipelines(&self) -> Vec<(String, Contrast)> {
        let mut names: Vec<&String> =
            self.cold.iter().take(1).flat_map(|run| &run.told.pipelines).map(|(n, _)| n).collect();
        names.sort_by_key(|name| stage(name));
        let of =
            |run: &Run, name: &String| run.told.pipelines.iter().find(|(n, _)| n == name).map_or(f64::NAN, |(_, s)| *s);
        names.into_iter().map(|name| (name.clone(), self.contrast(|run| of(run, name)))).collect()
    }
}

pub fn run_command(arguments: &StartUpArguments) -> anyhow::Result<()> {
    // What is wrong with the arguments is said once, before anything is started.
    let scene = load_scene(arguments.scene.as_deref(), false)?;
    let mut settings = arguments.picture.settings(&scene)?;
    if arguments.picture.tuned() {
        let device = arguments.picture.open_device()?;
        Tuning::of_scene(device.description(), &scene, false).apply(&mut settings, &Defaults::of(&device)?);
    }
    let measured = measure(arguments.scene.as_deref(), arguments.picture.device(), &settings, arguments.rounds)?;
    let settings = &measured.cold[0].told.settings;
    if arguments.json {
        let seconds = |Contrast { cold, cached }| json!({ "cold_seconds": cold, "cached_seconds": cached });
        let pipelines: Vec<Value> = measured
            .pipelines()
            .into_iter()
            .map(|(kernel, Contrast { cold, cached })| {
                json!({ "kernel": kernel, "cold_seconds": cold, "cached_seconds": cached })
            })
            .collect();
        let runs = |runs: &[Run]| runs.iter().map(|run| run.seconds).collect::<Vec<_>>();
        let report = json!({
            "settings": settings,
            "rounds": arguments.rounds,
            "start_up": seconds(measured.seconds()),
            "all_pipelines": seconds(measured.all_pipelines()),
            "pipelines": pipelines,
            "runs": { "cold_seconds": runs(&measured.cold), "cached_seconds": runs(&measured.cached) },
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
