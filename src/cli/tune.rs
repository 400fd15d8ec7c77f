//! `raywave tune`: which way to trace rays is fastest for a scene on a device.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, ensure};
use indicatif::HumanCount;
use serde_json::{Value, json};

use super::compare::at_least_one;
use super::picture::PictureArguments;
use super::tuning::{Key, TunedClass, Tuning, describe};
use super::{load_scene, print};
use crate::bvh::BvhKind;
use crate::export::numbers::{estimate, significant};
use crate::gpu::{Device, DeviceKind, GpuError};
use crate::rays::{RayClass, RayOrder, RayRecord};
use crate::render::{
    Defaults, FrozenRays, PrepareError, PreparedScene, RenderError, Replay, Session, Traversal, WarmUp, Warmth,
};
use crate::scene::Scene;
use crate::settings::{Fetch, Named, Packets, Scheduler, Settings};
use crate::stats::{CONFIDENCE, Estimate, FEWEST_ROUNDS, SplitMix64, TOO_FEW_ROUNDS, median};
use crate::studies::shuffle;

/// Find the fastest way to trace a scene's rays on a device, and keep it for later renders
///
/// Freezes camera, bounce and shadow rays of a small render, and replays them with every shape of
/// BVH, every way to read it and several workgroups, in rounds of random order. The classes count by
/// their share of the scene's rays. The default stays where nothing is surely faster.
#[derive(Debug, clap::Args)]
pub struct TuneArguments {
    /// Scene file (.toml) or mesh (.obj); the built-in Cornell box without
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

/// Pixels of the picture whose rays are frozen, at most: a bounce of them keeps software devices busy.
const PIXELS: f64 = 65_536.0;
/// Rays of a round on devices that need more to be busy; the frozen ones are traced several times over.
const HARDWARE_RAYS: u32 = 1 << 20;
/// Workgroups that are tried where the device has them.
const WORKGROUPS: [u32; 3] = [64, 256, 1024];
/// Bounces whose rays stand for those of all bounces.
const BOUNCES: u32 = 2;

/// Rays of a class, frozen.
struct Frozen {
    class: RayClass,
    rays: Vec<RayRecord>,
    /// Of the rays of the classes that there are.
    share: f64,
}

/// Ways to trace a class of rays, measured.
struct Measured {
    class: usize,
    traversal: Traversal,
    /// A ray's, by round.
    seconds: Vec<f64>,
}

/// A way to trace all classes in one render.
struct Plan<'a> {
    /// The fastest way for each class, of those that one render can have together.
    ways: Vec<&'a Measured>,
    /// A ray's seconds, by round: the mean over the classes by their shares.
    seconds: Vec<f64>,
}

pub fn run(arguments: &TuneArguments) -> anyhow::Result<()> {
    let scene = load_scene(arguments.scene.as_deref(), arguments.quiet)?;
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
    let key = Key::new(device.description(), scene.mesh.triangles.len());

    let default = default_traversal(&device, &settings, &scene)?;
    let mut scenes = HashMap::from([(default.bvh, PreparedScene::with_bvh(&scene, default.bvh)?)]);
    for kind in BvhKind::all_of(scene.mesh.triangles.len()) {
        if let Entry::Vacant(entry) = scenes.entry(kind) {
            match PreparedScene::with_bvh(&scene, kind) {
                Err(PrepareError::TooManyNodes { .. }) => {}
                prepared => drop(entry.insert(prepared?)),
            }
        }
    }
    let settings = small(settings);
    let frozen = freeze(&device, &scenes[&default.bvh], &settings)?;
    let (measured, warmth) = measure(&device, &scenes, &settings, &frozen, default, arguments)?;
    let plans = plans(&measured, &frozen);
    let own = plans.iter().find(|plan| plan.ways[0].traversal.shared() == default.shared());
    let own = own.context("the default cannot be measured on this device")?;
    let chosen = choose(&plans, own);

    let report = Report {
        scene: &scene,
        device: &device,
        settings: &settings,
        frozen: &frozen,
        measured: &measured,
        own,
        chosen,
        warmth,
    };
    let tuning = report.tuning();
    let file = key.file();
    if let Some(file) = &file {
        tuning.write(file, &key, &scene.name)?;
    }
    if arguments.json {
        return print(&(serde_json::to_string_pretty(&report.json(&plans, file.as_deref()))? + "\n"));
    }
    if file.is_none() && !arguments.quiet {
        eprintln!("warning: the choice is not kept: RAYWAVE_CACHE is off, or there is no folder for caches");
    }
    print(&report.lines(&plans, file.as_deref()))
}

/// How rays are traced where nothing is tuned.
fn default_traversal(device: &Device, settings: &Settings, scene: &Scene) -> Result<Traversal, GpuError> {
    let defaults = Defaults::of(device)?;
    Ok(Traversal {
        bvh: defaults.bvh(settings, scene.mesh.triangles.len()),
        fetch: defaults.fetch,
        workgroup_size: device.description().max_workgroup_size.min(Defaults::WORKGROUP),
        packets: false,
    })
}

/// The same picture of fewer pixels, all samples of which are in flight at once.
fn small(settings: Settings) -> Settings {
    let pixels = f64::from(settings.width) * f64::from(settings.height);
    let scale = (PIXELS / pixels).sqrt().min(1.0);
    let shrunk = |side: u32| ((f64::from(side) * scale) as u32).max(1);
    let (width, height) = (shrunk(settings.width), shrunk(settings.height));
    let scheduler = Some(Scheduler::Wavefront);
    Settings { width, height, samples: 1, in_flight: Some(width * height), scheduler, ..settings }
}

/// Renders a sample of every pixel and freezes rays of each class that there are.
fn freeze(device: &Device, scene: &PreparedScene, settings: &Settings) -> Result<Vec<Frozen>, RenderError> {
    let mut session = Session::new(device, scene, settings)?;
    let traced = session.time()?;
    let classes = [
        (RayClass::Camera, 0..1, traced.camera_rays),
        (RayClass::Bounce, 1..1 + BOUNCES, traced.bounce_rays),
        (RayClass::Shadow, 0..BOUNCES, traced.shadow_rays),
    ];
    let mut frozen = Vec::new();
    for (class, bounces, count) in classes {
        let mut rays = Vec::new();
        for bounce in bounces {
            match session.dump_rays(scene, class, bounce, RayOrder::Slot) {
                Ok(queued) => rays.extend(queued.rays),
                Err(RenderError::NoRays { .. }) => break,
                Err(error) => return Err(error),
            }
        }
        if !rays.is_empty() {
            frozen.push(Frozen { class, rays, share: count as f64 });
        }
    }
    let all: f64 = frozen.iter().map(|frozen| frozen.share).sum();
    frozen.iter_mut().for_each(|frozen| frozen.share /= all);
    Ok(frozen)
}

/// Replays of the ways that were measured last, as many as fit a share of the device's memory.
struct Replays<'a> {
    device: &'a Device,
    scenes: &'a HashMap<BvhKind, PreparedScene>,
    settings: &'a Settings,
    frozen: &'a [Frozen],
    /// By class and shape of the BVH: what the CPU finds of the rays is found once.
    rays: HashMap<(usize, BvhKind), Arc<FrozenRays<'a>>>,
    open: HashMap<(usize, Traversal), Replay<'a>>,
}

impl<'a> Replays<'a> {
    fn get(&mut self, class: usize, traversal: Traversal) -> Result<&mut Replay<'a>, RenderError> {
        if !self.open.contains_key(&(class, traversal)) {
            let held: u64 = self.open.values().map(Replay::memory_bytes).sum();
            if held > self.device.description().memory_bytes / 4 {
                self.open.clear();
            }
            let Traversal { bvh, fetch, workgroup_size, packets } = traversal;
            let class_packets = Packets::default().with(self.frozen[class].class, packets);
            let settings = Settings {
                packets: Some(class_packets),
                fetch: Some(fetch),
                workgroup_size: Some(workgroup_size),
                in_flight: None,
                ..*self.settings
            };
            let Frozen { class: kind, rays, .. } = &self.frozen[class];
            let scene = &self.scenes[&bvh];
            let frozen = self.rays.entry((class, bvh)).or_insert_with(|| Arc::new(FrozenRays::new(scene, *kind, rays)));
            let software = self.device.description().kind == DeviceKind::Cpu;
            let repeat = if software { 1 } else { (HARDWARE_RAYS / rays.len() as u32).max(1) };
            let replay = Replay::of(self.device, Arc::clone(frozen), &settings, repeat)?;
            self.open.insert((class, traversal), replay);
        }
        Ok(self.open.get_mut(&(class, traversal)).expect("it was just opened"))
    }
}

/// Checks every way's answers, then warms the device up and times all of them in rounds of random order. Ways that
/// the device has no room for are left out.
fn measure(
    device: &Device,
    scenes: &HashMap<BvhKind, PreparedScene>,
    settings: &Settings,
    frozen: &[Frozen],
    default: Traversal,
    arguments: &TuneArguments,
) -> anyhow::Result<(Vec<Measured>, Warmth)> {
    let mut replays = Replays { device, scenes, settings, frozen, rays: HashMap::new(), open: HashMap::new() };
    let max = device.description().max_workgroup_size;
    let mut workgroups: Vec<u32> = WORKGROUPS.into_iter().filter(|size| *size <= max).collect();
    if !workgroups.contains(&default.workgroup_size) {
        workgroups.push(default.workgroup_size);
    }
    let mut measured = Vec::new();
    let mut rays = Vec::new();
    let triangles = scenes[&default.bvh].triangles.len();
    for bvh in BvhKind::all_of(triangles).filter(|kind| scenes.contains_key(kind)) {
        for fetch in [Fetch::Texel, Fetch::Storage] {
            for &workgroup_size in &workgroups {
                // Packets are of wide trees.
                for packets in [false, true].into_iter().take(if bvh.width() > 2 { 2 } else { 1 }) {
                    let traversal = Traversal { bvh, fetch, workgroup_size, packets };
                    match check(&mut replays, traversal) {
                        Ok(Some(counts)) => {
                            rays = counts;
                            let way = |class| Measured { class, traversal, seconds: Vec::new() };
                            measured.extend((0..frozen.len()).map(way));
                        }
                        Ok(None) => {}
                        Err(RenderError::Gpu(
                            error @ (GpuError::BufferTooLarge { .. } | GpuError::OutOfMemory { .. }),
                        )) => {
                            if !arguments.quiet {
                                let packets = Packets::default();
                                eprintln!("warning: {} is left out: {error}", describe(&traversal, packets));
                            }
                        }
                        Err(error) => return Err(error.into()),
                    }
                }
            }
        }
    }
    let mut random = SplitMix64::new(0);
    let mut order: Vec<usize> = (0..measured.len()).collect();
    let software = device.description().kind == DeviceKind::Cpu;
    let mut warmth = Warmth::default();
    let mut last: Option<Instant> = None;
    for _ in 0..arguments.rounds {
        shuffle(&mut order, &mut random);
        for &at in &order {
            let Measured { class, traversal, seconds } = &mut measured[at];
            let replay = replays.get(*class, *traversal)?;
            if WarmUp::is_due(software, last.map(|last| last.elapsed())) {
                warmth.add(&replay.warm()?);
            }
            seconds.push(replay.round()? / rays[*class] as f64);
            last = Some(Instant::now());
        }
    }
    Ok((measured, warmth))
}

/// Rays of a round of each class, where a way gives the right answers; `None` where the device does
/// not take its fetch.
fn check(replays: &mut Replays<'_>, traversal: Traversal) -> Result<Option<Vec<u64>>, RenderError> {
    let mut rays = Vec::new();
    for class in 0..replays.frozen.len() {
        let outcome = replays.get(class, traversal)?.run(0)?;
        if outcome.texel_fetch != (traversal.fetch == Fetch::Texel) {
            return Ok(None);
        }
        rays.push(outcome.rays);
    }
    Ok(Some(rays))
}

/// For each way that kernels of a render share, the fastest of each class.
fn plans<'a>(measured: &'a [Measured], frozen: &[Frozen]) -> Vec<Plan<'a>> {
    let mut shared: Vec<Traversal> = Vec::new();
    for way in measured {
        if !shared.contains(&way.traversal.shared()) {
            shared.push(way.traversal.shared());
        }
    }
    let plan = |shared: Traversal| {
        let of_class = |class| measured.iter().filter(move |w| w.class == class && w.traversal.shared() == shared);
        let fastest = |class| of_class(class).min_by(|a, b| median(&a.seconds).total_cmp(&median(&b.seconds)));
        let ways: Vec<&Measured> = (0..frozen.len()).filter_map(fastest).collect();
        let round = |i: usize| ways.iter().map(|way| frozen[way.class].share * way.seconds[i]).sum();
        let seconds = (0..ways[0].seconds.len()).map(round).collect();
        Plan { ways, seconds }
    };
    shared.into_iter().map(plan).collect()
}

/// How many times as fast as another a plan is, round by round.
fn speed_up(plan: &Plan<'_>, other: &Plan<'_>) -> Estimate {
    let ratios = other.seconds.iter().zip(&plan.seconds).map(|(other, own)| other / own);
    Estimate::of_median(&ratios.collect::<Vec<_>>())
}

/// The fastest plan, or the default where that may be as fast.
fn choose<'a, 'b>(plans: &'b [Plan<'a>], own: &'b Plan<'a>) -> &'b Plan<'a> {
    let fastest = plans.iter().min_by(|a, b| median(&a.seconds).total_cmp(&median(&b.seconds))).unwrap_or(own);
    if speed_up(fastest, own).surely_above(1.0) { fastest } else { own }
}

/// All that is told.
struct Report<'a> {
    scene: &'a Scene,
    device: &'a Device,
    settings: &'a Settings,
    frozen: &'a [Frozen],
    measured: &'a [Measured],
    own: &'a Plan<'a>,
    chosen: &'a Plan<'a>,
    warmth: Warmth,
}

impl Report<'_> {
    fn tuning(&self) -> Tuning {
        let tuned = |way: &&Measured| TunedClass {
            class: self.frozen[way.class].class,
            traversal: way.traversal,
            rays_per_second: 1.0 / median(&way.seconds),
            share: self.frozen[way.class].share,
        };
        Tuning { classes: self.chosen.ways.iter().map(tuned).collect() }
    }

    fn rounds(&self) -> usize {
        self.own.seconds.len()
    }

    fn lines(&self, plans: &[Plan<'_>], file: Option<&std::path::Path>) -> String {
        let Settings { width, height, .. } = self.settings;
        let mut text = format!(
            "{}, {width}x{height}, on {}\nM rays/s: medians of {} rounds in random order, with {:.0} % intervals\n\n",
            self.scene.name,
            self.device.description().name,
            self.rounds(),
            100.0 * CONFIDENCE,
        );
        let head = |frozen: &Frozen| {
            let rays = HumanCount(frozen.rays.len() as u64);
            format!("{} {:.0} % ({rays})", class_name(frozen.class), 100.0 * frozen.share)
        };
        let heads = self.frozen.iter().map(head).chain(["against the default".to_owned()]);
        text += &row(["bvh", "fetch", "workgroup"], heads);
        for plan in plans {
            let Traversal { bvh, fetch, workgroup_size, .. } = plan.ways[0].traversal;
            let speeds = plan.ways.iter().map(|way| {
                let packets = if way.traversal.packets { " packets" } else { "" };
                estimate(&speed(&way.seconds), millions) + packets
            });
            let ratio = estimate(&speed_up(plan, self.own), |value| format!("{value:.2}"));
            let workgroup = workgroup_size.to_string();
            text += &row([bvh.name(), fetch.name(), &workgroup], speeds.chain([ratio]));
        }
        if self.warmth.steady == Some(false) {
            text += "\nThe device's speed did not settle within 1 % before all of it was timed.\n";
        }
        text += "\nchosen  ";
        text += &describe(&self.chosen.ways[0].traversal, self.tuning().packets());
        if self.rounds() < FEWEST_ROUNDS {
            text += &format!(": the default; {TOO_FEW_ROUNDS} to say what is faster, {FEWEST_ROUNDS} can");
        } else if std::ptr::eq(self.chosen, self.own) {
            text += ": the default, than which nothing is surely faster";
        }
        text += "\n";
        if let Some(file) = file {
            text += &format!("kept    {}\n", file.display());
        }
        text
    }

    fn json(&self, plans: &[Plan<'_>], file: Option<&std::path::Path>) -> Value {
        let way = |Traversal { bvh, fetch, workgroup_size, .. }: Traversal| {
            json!({
                "bvh": bvh.name(),
                "scene_fetch": fetch.name(),
                "workgroup_size_invocations": workgroup_size,
            })
        };
        let classes: Vec<Value> = self
            .frozen
            .iter()
            .map(|Frozen { class, rays, share }| {
                json!({ "class": class_name(*class), "rays": rays.len(), "share_of_rays": share })
            })
            .collect();
        let variants: Vec<Value> = self
            .measured
            .iter()
            .map(|measured| {
                let mut value = way(measured.traversal);
                value["packets"] = measured.traversal.packets.into();
                value["class"] = class_name(self.frozen[measured.class].class).into();
                value["rays_per_second"] = json!(speed(&measured.seconds));
                value["seconds_per_ray"] = json!(measured.seconds);
                value
            })
            .collect();
        let speed_ups: Vec<Value> = plans
            .iter()
            .map(|plan| {
                let mut value = way(plan.ways[0].traversal);
                value["speed_up"] = json!(speed_up(plan, self.own));
                value
            })
            .collect();
        json!({
            "raywave_version": env!("CARGO_PKG_VERSION"),
            "scene": self.scene.name,
            "scene_hash": self.scene.hash,
            "triangles": self.scene.mesh.triangles.len(),
            "device": self.device.description().name,
            "driver": self.device.description().driver,
            "width_pixels": self.settings.width,
            "height_pixels": self.settings.height,
            "rounds": self.rounds(),
            "warm_up": self.warmth,
            "classes": classes,
            "variants": variants,
            "against_default": speed_ups,
            "default": way(self.own.ways[0].traversal),
            "chosen": way(self.chosen.ways[0].traversal),
            "packets": self.tuning().packets().to_string(),
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

fn class_name(class: RayClass) -> &'static str {
    match class {
        RayClass::Camera => "camera",
        RayClass::Bounce => "bounce",
        RayClass::Shadow => "shadow",
    }
}
