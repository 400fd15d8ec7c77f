//! `raywave tune`: which way to trace rays is fastest for a scene on a device.

use std::path::{Path, PathBuf};

use anyhow::ensure;
use indicatif::HumanCount;
use serde_json::{Value, json};

use super::picture::PictureArguments;
use super::{at_least_one, load_scene, print, warn_unless};
use raywave::gpu::Device;
use raywave::render::Traversal;
use raywave::scene::Scene;
use raywave::settings::{Named, Settings};
use raywave_studies::export::numbers::{estimate, significant};
use raywave_studies::lab::{Frozen, TuningKey, TuningStudy, describe, tune};
use raywave_studies::stats::{CONFIDENCE, Estimate, FEWEST_ROUNDS, TOO_FEW_ROUNDS};

/// Find the fastest way to trace a scene's rays on a device, and keep it for later renders
///
/// Freezes camera, bounce and shadow rays of a small render, and replays them with every shape of
/// BVH, every way to read it and several workgroups, in rounds of random order. The classes count by
/// their share of the scene's rays. The default stays where nothing is surely faster.
#[derive(Debug, clap::Args)]
pub struct TuneArguments {
    /// Scene (.toml, .gltf, .glb, Mitsuba's .xml) or mesh (.obj, .ply); the built-in Cornell box without
    scene: Option<PathBuf>,
    #[command(flatten)]
    picture: PictureArguments,
    /// Timed rounds; each traces all rays in every way
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = at_least_one)]
    rounds: usize,
    /// JSON instead of a table
    #[arg(long)]
    json: bool,
    /// No warnings
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(arguments: &TuneArguments) -> anyhow::Result<()> {
    let scene = load_scene(arguments.scene.as_deref(), &arguments.picture.load.options(), arguments.quiet)?;
    let settings = arguments.picture.settings(&scene)?;
    let given = [
        ("--bvh", settings.bvh.is_some()),
        ("--fetch", settings.fetch.is_some()),
        ("--packets", settings.packets.is_some()),
        ("--workgroup", settings.workgroup_size.is_some()),
    ];
    for (flag, given) in given {
        ensure!(!given, "{flag} is what tune chooses; leave it out");
    }
    let device = arguments.picture.open_device()?;
    let key = TuningKey::new(device.description(), scene.triangle_count());

    let tuned = tune(&device, &scene, &settings, arguments.rounds, &mut warn_unless(arguments.quiet))?;
    let report = Report { scene: &scene, device: &device, tuned: &tuned };
    let named = key.file();
    // What was measured is printed even if it cannot be kept.
    let written = named.as_ref().map_or(Ok(()), |file| tuned.tuning().write(file, &key, &scene.name));
    let file = named.filter(|_| written.is_ok());
    if arguments.json {
        print(&(serde_json::to_string_pretty(&report.json(file.as_deref()))? + "\n"))?;
        return written;
    }
    if file.is_none() && written.is_ok() && !arguments.quiet {
        tell!("warning: the choice is not kept: RAYWAVE_CACHE is off, or there is no folder for caches");
    }
    print(&report.lines(file.as_deref()))?;
    written
}

/// What is printed.
struct Report<'a> {
    scene: &'a Scene,
    device: &'a Device,
    tuned: &'a TuningStudy,
}

impl Report<'_> {
    fn lines(&self, file: Option<&Path>) -> String {
        let TuningStudy { frozen, plans, own, chosen, warmth, .. } = self.tuned;
        let Settings { width, height, .. } = self.tuned.settings;
        let mut text = format!(
            "{}, {width}x{height}, on {}\nM rays/s: medians of {} rounds in random order, with {:.0} % intervals\n\n",
            self.scene.name,
            self.device.description().name,
            self.tuned.rounds(),
            100.0 * CONFIDENCE,
        );
        let head = |frozen: &Frozen| {
            let rays = HumanCount(frozen.rays.len() as u64);
            format!("{} {:.0} % ({rays})", frozen.class.name(), 100.0 * frozen.share)
        };
        let heads = frozen.iter().map(head).chain(["against the default".to_owned()]);
        text += &row(["bvh", "fetch", "workgroup"], heads);
        for plan in plans {
            let Traversal { bvh, fetch, workgroup_size, .. } = self.tuned.shared(plan);
            let speeds = self.tuned.ways(plan).map(|way| {
                let packets = if way.traversal.packets { " packets" } else { "" };
                estimate(&speed(&way.seconds), millions) + packets
            });
            let ratio = estimate(&self.tuned.speed_up(plan), |value| format!("{value:.2}"));
            let workgroup = workgroup_size.to_string();
            text += &row([bvh.name(), fetch.name(), &workgroup], speeds.chain([ratio]));
        }
        if warmth.steady == Some(false) {
            text += "\nThe device's speed did not settle within 1 % before all of it was timed.\n";
        }
        text += "\nchosen  ";
        text += &describe(&self.tuned.shared(&plans[*chosen]), self.tuned.tuning().packets());
        if self.tuned.rounds() < FEWEST_ROUNDS {
            text += &format!(": the default; {TOO_FEW_ROUNDS} to say what is faster, {FEWEST_ROUNDS} can");
        } else if chosen == own {
            text += ": the default, than which nothing is surely faster";
        }
        text += "\n";
        if let Some(file) = file {
            text += &format!("kept    {}\n", file.display());
        }
        text
    }

    fn json(&self, file: Option<&Path>) -> Value {
        let TuningStudy { settings, frozen, measured, plans, own, chosen, warmth } = self.tuned;
        let way = |Traversal { bvh, fetch, workgroup_size, .. }: Traversal| {
            json!({
                "bvh": bvh.name(),
                "scene_fetch": fetch.name(),
                "workgroup_size_invocations": workgroup_size,
            })
        };
        let classes: Vec<Value> = frozen
            .iter()
            .map(|Frozen { class, rays, share }| {
                json!({ "class": class.name(), "rays": rays.len(), "share_of_rays": share })
            })
            .collect();
        let variants: Vec<Value> = measured
            .iter()
            .map(|measured| {
                let mut value = way(measured.traversal);
                value["packets"] = measured.traversal.packets.into();
                value["class"] = frozen[measured.class].class.name().into();
                value["rays_per_second"] = json!(speed(&measured.seconds));
                value["seconds_per_ray"] = json!(measured.seconds);
                value
            })
            .collect();
        let speed_ups: Vec<Value> = plans
            .iter()
            .map(|plan| {
                let mut value = way(self.tuned.shared(plan));
                value["speed_up"] = json!(self.tuned.speed_up(plan));
                value
            })
            .collect();
        json!({
            "raywave_version": raywave::VERSION,
            "scene": self.scene.name,
            "scene_hash": self.scene.hash,
            "triangles": self.scene.triangle_count(),
            "device": self.device.description().name,
            "driver": self.device.description().driver,
            "width_pixels": settings.width,
            "height_pixels": settings.height,
            "rounds": self.tuned.rounds(),
            "warm_up": warmth,
            "classes": classes,
            "variants": variants,
            "against_default": speed_ups,
            "default": way(self.tuned.shared(&plans[*own])),
            "chosen": way(self.tuned.shared(&plans[*chosen])),
            "packets": self.tuned.tuning().packets().to_string(),
            "file": file.map(|file| file.display().to_string()),
        })
    }
}

/// Rays a second, of seconds a ray.
fn speed(seconds: &[f64]) -> Estimate {
    Estimate::of_median(&seconds.iter().map(|seconds| 1.0 / seconds).collect::<Vec<_>>())
}

fn millions(value: f64) -> String {
    significant(value / 1e6, 3)
}

fn row(way: [&str; 3], cells: impl Iterator<Item = String>) -> String {
    let [bvh, fetch, workgroup] = way;
    let cells: String = cells.map(|cell| format!("  {cell:<24}")).collect();
    format!("{bvh:<6} {fetch:<8} {workgroup:<9}{cells}").trim_end().to_owned() + "\n"
}
