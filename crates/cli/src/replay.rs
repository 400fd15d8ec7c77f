//! `raywave replay`: how fast a traversal kernel traces the rays of a dump.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context, ensure};
use indicatif::HumanCount;
use serde_json::json;

use raywave::bvh::BvhKind;
use raywave::clocks::{self, ClockState};
use raywave::gpu::DeviceDescription;
use raywave::layout::WorkCount;
use raywave::rays::{Metadata, RayClass, RayDump};
use raywave::render::{Defaults, PreparedScene, Replay, ReplayOutcome, Warmth};
use raywave::settings::{Named, Settings};
use raywave::whole_file::{is_same, is_stdout};
use raywave_studies::stats::{CONFIDENCE, Estimate, Interval, TOO_FEW_ROUNDS};

use super::dump_rays::{class_name, ray_scene};
use super::picture::one_of;
use super::{LoadArguments, check_text_output, load_scene, open_device, output_path, print, write_text};

/// Run dumped rays through a traversal kernel alone and tell its speed
///
/// Camera and bounce rays go through `extend`, shadow rays through `connect`. The answers are first held against the
/// CPU's; where one is wrong, no speed is told.
#[derive(Debug, clap::Args)]
#[command(allow_missing_positional = true)]
pub struct ReplayArguments {
    /// Scene that the rays were dumped from; the built-in Cornell box without
    scene: Option<PathBuf>,
    #[command(flatten)]
    load: LoadArguments,
    /// File that `raywave dump-rays` wrote
    file: PathBuf,
    /// Timed rounds; each traces all rays
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    rounds: u32,
    /// Trace the dump N times over in a round, to keep a device busy with a small one
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    repeat: u32,
    /// Invocations of a workgroup
    #[arg(long, value_name = "SIZE", value_parser = clap::value_parser!(u32).range(1..=1024))]
    workgroup: Option<u32>,
    /// Rays of a launch, at most; without, as many as the device takes, up to 4,194,304
    #[arg(long, value_name = "RAYS", value_parser = clap::value_parser!(u32).range(1..))]
    in_flight: Option<u32>,
    /// Shape of the BVH; without, by device
    #[arg(long, value_parser = one_of::<BvhKind>())]
    bvh: Option<BvhKind>,
    /// Device, by number or part of its name; see `raywave devices`
    #[arg(long, env = "RAYWAVE_DEVICE")]
    device: Option<String>,
    /// Write the report with the time of every round, as JSON; - is stdout, in place of the table
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    json: Option<PathBuf>,
    /// No warnings
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(arguments: &ReplayArguments) -> anyhow::Result<()> {
    if let Some(path) = &arguments.json {
        check_text_output(path)?;
    }
    let scene = load_scene(arguments.scene.as_deref(), &arguments.load.options(), arguments.quiet)?;
    let settings = Settings {
        workgroup_size: arguments.workgroup,
        in_flight: arguments.in_flight,
        bvh: arguments.bvh,
        ..scene.settings
    };
    let device = open_device(arguments.device.as_deref())?;
    let prepared = PreparedScene::for_device(&scene, &settings, &Defaults::of(&device)?)?;
    let RayDump { metadata, rays } = RayDump::read(&arguments.file, &ray_scene(&scene, &prepared))?;
    if let Some(path) = &arguments.json {
        let same = is_same(path, &arguments.file)?;
        ensure!(!same, "{}: --json would overwrite the rays; name another file", path.display());
    }
    let mut replay = Replay::new(&device, &prepared, &settings, metadata.class, &rays, arguments.repeat)?;
    let clocks = clocks::of_device(device.description().uuid);
    let mut states = Vec::new();
    let watch = || states.extend(clocks.as_ref().map(|clocks| clocks.state()));
    let outcome = replay.run_watched(arguments.rounds as usize, watch)?;
    let work = Replay::count_work(&device, &prepared, &settings, metadata.class, &rays)?;
    let report = Report {
        metadata: &metadata,
        repeat: arguments.repeat,
        device: device.description(),
        outcome,
        clocks: [states.first().cloned(), states.last().cloned()],
        bvh: prepared.bvh.kind.name(),
        work,
    };
    let json = serde_json::to_string_pretty(&report.json()).context("the report becomes JSON")? + "\n";
    let written = arguments.json.as_ref().map_or(Ok(()), |path| write_text(path, &json));
    if !arguments.json.as_deref().is_some_and(is_stdout) {
        print(&report.lines())?;
    }
    written
}

/// All that belongs to a result.
struct Report<'a> {
    metadata: &'a Metadata,
    repeat: u32,
    device: &'a DeviceDescription,
    outcome: ReplayOutcome,
    /// Of the device, before and after the timed launches, where something tells of them.
    clocks: [Option<ClockState>; 2],
    /// Shape of the BVH.
    bvh: &'static str,
    /// Of the dump, traced once.
    work: WorkCount,
}

impl Report<'_> {
    fn hit_share(&self) -> f64 {
        self.outcome.hits as f64 / self.outcome.rays as f64
    }

    fn per_ray(&self, count: u64) -> f64 {
        count as f64 / self.work.items() as f64
    }

    /// Share of lanes at work, where the device can tell.
    fn active_lane_share(&self) -> Option<f64> {
        let lanes = self.work.steps() * u64::from(self.device.subgroup_size);
        (lanes > 0).then(|| (self.work.nodes() + self.work.triangles()) as f64 / lanes as f64)
    }

    /// Rays a second of each round.
    fn speeds(&self) -> Vec<f64> {
        self.outcome.seconds.iter().map(|seconds| self.outcome.rays as f64 / seconds).collect()
    }

    /// Slowest and fastest.
    fn range(&self) -> (f64, f64) {
        let speeds = self.speeds();
        (speeds.iter().copied().fold(f64::INFINITY, f64::min), speeds.iter().copied().fold(0.0, f64::max))
    }

    fn lines(&self) -> String {
        let outcome = &self.outcome;
        let count = |n: u64| HumanCount(n).to_string();
        let times = if self.repeat > 1 { format!(", {} times over", self.repeat) } else { String::new() };
        let launches = if outcome.launches > 1 { format!(", in {} launches", outcome.launches) } else { String::new() };
        let met = if self.metadata.class == RayClass::Shadow { "blocked" } else { "hit" };
        let speed = Estimate::of_median(&self.speeds());
        let millions = |speed: f64| format!("{:.3}", speed / 1e6);
        let interval = speed.interval.map_or_else(
            || TOO_FEW_ROUNDS.to_owned(),
            |Interval { low, high }| format!("95 % [{}, {}]", millions(low), millions(high)),
        );
        let (min, max) = self.range();
        let lanes =
            self.active_lane_share().map_or_else(String::new, |s| format!(", {:.1} % of lanes at work", 100.0 * s));
        let rows = [
            ("scene", self.metadata.scene.scene.clone()),
            ("rays", format!("{} {}{times}{launches}", count(self.metadata.rays), class_name(self.metadata))),
            ("device", self.device.name.clone()),
            ("kernel", format!("{}, {} invocations a workgroup, {}", outcome.kernel, outcome.workgroup_size, self.bvh)),
            (met, format!("{:.2} %", 100.0 * self.hit_share())),
            ("checked", format!("{} rays, equal to the CPU's to the last bit", count(outcome.checked))),
            (
                "work",
                format!(
                    "{:.2} nodes and {:.2} triangles a ray{lanes}",
                    self.per_ray(self.work.nodes()),
                    self.per_ray(self.work.triangles())
                ),
            ),
            ("warm-up", self.warm_up()),
            ("rounds", format!("{}, {} clock{}", outcome.seconds.len(), self.clock(), self.idle())),
            ("speed", format!("{} M rays/s, {interval}", millions(speed.value))),
            ("range", format!("{:.3} to {:.3} M rays/s", min / 1e6, max / 1e6)),
        ];
        rows.iter().fold(String::new(), |mut text, (name, value)| {
            writeln!(text, "{name:<10}{value}").expect("a string takes all");
            text
        })
    }

    fn json(&self) -> serde_json::Value {
        let outcome = &self.outcome;
        let speed = Estimate::of_median(&self.speeds());
        let (min, max) = self.range();
        json!({
            "raywave_version": raywave::VERSION,
            "dump": self.metadata,
            "repeat": self.repeat,
            "bvh": self.bvh,
            "nodes_visited_per_ray": self.per_ray(self.work.nodes()),
            "triangles_tested_per_ray": self.per_ray(self.work.triangles()),
            "active_lane_share": self.active_lane_share(),
            "rays": outcome.rays,
            "launches": outcome.launches,
            "device": self.device.name,
            "device_kind": self.device.kind.name(),
            "driver": self.device.driver,
            "vulkan_version": self.device.vulkan_version,
            "subgroup_size_lanes": self.device.subgroup_size,
            "kernel": outcome.kernel,
            "workgroup_size_invocations": outcome.workgroup_size,
            "scene_fetch": if outcome.texel_fetch { "texel" } else { "storage" },
            "hit_share": self.hit_share(),
            "checked_rays": outcome.checked,
            "warm_up": outcome.warmth,
            "clock": self.clock(),
            "idle_seconds": outcome.idle_seconds,
            "clocks_before": self.clocks[0],
            "clocks_after": self.clocks[1],
            "seconds": outcome.seconds,
            "rays_per_second": {
                "median": speed.value,
                "low": speed.interval.map(|interval| interval.low),
                "high": speed.interval.map(|interval| interval.high),
                "verdict": speed.interval.is_none().then_some(TOO_FEW_ROUNDS),
                "confidence": CONFIDENCE,
                "min": min,
                "max": max,
            },
        })
    }

    /// How the device was warmed up.
    fn warm_up(&self) -> String {
        let Warmth { seconds, steady, last_apart } = self.outcome.warmth;
        let apart = last_apart
            .map_or_else(String::new, |apart| format!("; the last two windows are {:.2} % apart", 100.0 * apart));
        let verdict = match steady {
            Some(true) => ", steady",
            Some(false) => ", not steady within 1 %",
            None => "",
        };
        format!("{seconds:.2} s{verdict}{apart}")
    }

    /// How long the device had nothing to do between the timed launches.
    fn idle(&self) -> String {
        let timed: f64 = self.outcome.seconds.iter().sum();
        let share = |idle: f64| format!(", idle for {:.2} % of them", 100.0 * idle / (timed + idle));
        self.outcome.idle_seconds.map_or_else(String::new, share)
    }

    fn clock(&self) -> &'static str {
        if self.outcome.device_clock { "gpu" } else { "wall" }
    }
}
