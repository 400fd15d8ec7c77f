//! How long a process takes from its start to its first sample.
//!
//! Drivers look at their caches when a process first touches them, so cold and warm ones are measured in processes of
//! their own: a program that is started with the command `first-sample`, with the settings on its stdin.

use std::io::{BufRead, BufReader, Read, Write as _};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::Context;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::kernels::stage;
use super::record::record;
use crate::stats::Estimate;
use raywave::gpu::Device;
use raywave::render::{Defaults, PreparedScene, Session, SessionOptions, Tuned};
use raywave::scene::{LoadOptions, Scene};
use raywave::settings::Settings;

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

/// What such a process renders a sample of.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FirstSample {
    /// As they were asked for.
    pub settings: Settings,
    /// What a tuning chose for what they leave open.
    pub tuned: Option<Tuned>,
    /// How the scene is loaded.
    pub load: LoadOptions,
}

/// How start-up is measured: by processes that render one sample of a scene.
#[derive(Debug, Clone)]
pub struct StartUp {
    /// The program, which answers to the command `first-sample`.
    pub program: PathBuf,
    /// Its device, by number or part of its name; `None` leaves it to the program.
    pub device: Option<String>,
    /// Processes with cold caches, and as many with warm ones.
    pub rounds: usize,
}

impl StartUp {
    /// By this very program.
    ///
    /// # Errors
    /// A program that cannot find itself.
    pub fn new(device: Option<&str>, rounds: usize) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("this program cannot find itself")?;
        Ok(Self { program, device: device.map(str::to_owned), rounds })
    }

    /// Starts the processes in turn, and one before them that fills the caches. All caches lie in a folder of their
    /// own, which is removed.
    ///
    /// # Errors
    /// A process that cannot be started, or fails.
    pub fn measure(&self, scene: Option<&Path>, first: &FirstSample) -> anyhow::Result<StartUps> {
        let folder = tempfile::tempdir().context("no folder can be made for caches")?;
        let first = serde_json::to_vec(first).context("settings become JSON")?;
        let start = |cold: bool| {
            let mut command = Command::new(&self.program);
            command.arg("first-sample").args(self.device.as_ref().map(|name| format!("--device={name}")));
            command.arg("--").args(scene);
            command.envs(CACHE_FOLDERS.map(|name| (name, folder.path())));
            for (name, value) in COLD {
                if cold {
                    command.env(name, value)
                } else {
                    command.env_remove(name)
                };
            }
            run(command, &first)
        };
        start(false)?;
        let mut measured = StartUps { cold: Vec::new(), cached: Vec::new() };
        for _ in 0..self.rounds {
            measured.cold.push(start(true)?);
            measured.cached.push(start(false)?);
        }
        Ok(measured)
    }
}

/// Runs a process to the line that it writes when it has its first sample.
fn run(mut command: Command, first: &[u8]) -> anyhow::Result<Run> {
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let start = Instant::now();
    let mut child = command.spawn().context("this program cannot be started anew")?;
    // A child that has died says why on stderr.
    let _ = child.stdin.take().expect("stdin is a pipe").write_all(first);
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
    let told =
        serde_json::from_str(&line).context("a process that was started printed something else than its times")?;
    Ok(Run { seconds, told })
}

/// What a process tells that [`StartUp::measure`] has started: it renders one sample of every pixel. A line of text.
///
/// # Errors
/// A device that fails.
pub fn first_sample_of(scene: &Scene, first: &FirstSample, device: &Device) -> anyhow::Result<String> {
    let defaults = Defaults::of(device)?.with(first.tuned);
    let prepared = PreparedScene::for_device(scene, &first.settings, &defaults)?;
    let settings = Settings { samples: 1, ..first.settings };
    let options = SessionOptions { tuned: first.tuned, ..SessionOptions::default() };
    let mut session = Session::with_options(device, &prepared, &settings, options)?;
    let outcome = session.render(|_| ControlFlow::Continue(()))?;
    let told = Told {
        settings: record(scene, &settings, device.description(), &outcome.statistics),
        all_pipelines: session.pipelines_time().as_secs_f64(),
        pipelines: session.pipeline_times().map(|(name, time)| (name.to_owned(), time.as_secs_f64())).collect(),
    };
    Ok(serde_json::to_string(&told)? + "\n")
}

impl StartUps {
    /// Settings and provenance, as in the metadata of an image.
    pub fn settings(&self) -> &Map<String, Value> {
        &self.cold[0].told.settings
    }

    /// Seconds of every process, with cold caches and with warm ones.
    pub fn runs(&self) -> [Vec<f64>; 2] {
        [&self.cold, &self.cached].map(|runs| runs.iter().map(|run| run.seconds).collect())
    }

    fn contrast(&self, pick: impl Fn(&Run) -> f64) -> Contrast {
        let median = |runs: &[Run]| Estimate::of_median(&runs.iter().map(&pick).collect::<Vec<_>>());
        Contrast { cold: median(&self.cold), cached: median(&self.cached) }
    }

    /// Seconds from the start of a process to the end of its first sample.
    pub fn seconds(&self) -> Contrast {
        self.contrast(|run| run.seconds)
    }

    /// Seconds until all pipelines were built.
    pub fn all_pipelines(&self) -> Contrast {
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
