//! Which way to trace rays is fastest for a scene on a device.
//!
//! Freezes camera, bounce and shadow rays of a small render, and replays them by every shape of BVH, every way to read it
//! and several workgroups, in rounds of random order.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;

use super::tuning::{TunedClass, Tuning, describe};
use crate::stats::{Estimate, SplitMix64, median};
use crate::studies::shuffle;
use raywave::bvh::BvhKind;
use raywave::gpu::{Device, DeviceKind, GpuError};
use raywave::rays::{RayClass, RayOrder, RayRecord};
use raywave::render::{
    Choices, Defaults, FrozenRays, PrepareError, PreparedScene, RenderError, Replay, SceneLevels, Session, Traversal,
    WarmUp, Warmth,
};
use raywave::scene::Scene;
use raywave::settings::{Fetch, Instances, Packets, Scheduler, Settings};

/// Pixels of the picture whose rays are frozen, at most: a bounce of them keeps software devices busy.
const PIXELS: f64 = 65_536.0;
/// Rays of a round on devices that need more to be busy; the frozen ones are traced several times over.
const HARDWARE_RAYS: u32 = 1 << 20;
/// Workgroups that are tried where the device has them.
const WORKGROUPS: [u32; 3] = [64, 256, 1024];
/// Bounces whose rays stand for those of all bounces.
const BOUNCES: u32 = 2;

/// Rays of a class, frozen.
#[derive(Debug, Clone)]
pub struct Frozen {
    /// Which rays.
    pub class: RayClass,
    /// All of them.
    pub rays: Vec<RayRecord>,
    /// Share that the class has of the render's rays, in (0, 1].
    pub share: f64,
}

/// A way to trace a class of rays, measured.
#[derive(Debug, Clone)]
pub struct Measured {
    /// Place of the class in [`TuningStudy::frozen`].
    pub class: usize,
    /// The way.
    pub traversal: Traversal,
    /// Seconds of a ray, by round.
    pub seconds: Vec<f64>,
}

/// A way to trace all classes in one render.
#[derive(Debug, Clone)]
pub struct Plan {
    /// For each class, the place in [`TuningStudy::measured`] of the fastest way that one render can have with the others.
    pub ways: Vec<usize>,
    /// Seconds of a ray, by round: the mean over the classes by their shares.
    pub seconds: Vec<f64>,
}

/// What was measured, and what is chosen for it.
#[derive(Debug, Clone)]
pub struct TuningStudy {
    /// Of the small render whose rays were frozen.
    pub settings: Settings,
    /// The classes of rays that there are.
    pub frozen: Vec<Frozen>,
    /// Every way of every class.
    pub measured: Vec<Measured>,
    /// For each way that the kernels of a render share, the fastest of each class.
    pub plans: Vec<Plan>,
    /// Place of the default among the plans.
    pub own: usize,
    /// Place of the fastest plan; of the default, where nothing is surely faster.
    pub chosen: usize,
    /// How the device was warmed up.
    pub warmth: Warmth,
}

/// Measures every way to trace a scene's rays on a device, and chooses one.
///
/// # Errors
/// A device that fails or gives wrong answers, or cannot trace by its own default.
pub fn tune(
    device: &Device,
    scene: &Scene,
    settings: &Settings,
    rounds: usize,
    warn: &mut dyn FnMut(&str),
) -> anyhow::Result<TuningStudy> {
    let default = default_traversal(device, settings, scene)?;
    let (_, instances) = Defaults::of(device)?.tree(settings, scene);
    let mut scenes = HashMap::from([(default.bvh, PreparedScene::with_tree(scene, default.bvh, instances)?)]);
    // There are two levels of one kind alone.
    let others = BvhKind::all_of(scene.triangle_count() as usize).filter(|_| instances == Instances::Flatten);
    for kind in others {
        if let Entry::Vacant(entry) = scenes.entry(kind) {
            match PreparedScene::with_bvh(scene, kind) {
                Err(PrepareError::TooManyNodes { .. }) => {}
                prepared => drop(entry.insert(prepared?)),
            }
        }
    }
    let settings = small(*settings);
    let frozen = freeze(device, &scenes[&default.bvh], &settings)?;
    let replays = Replays {
        device,
        scenes: &scenes,
        settings: &settings,
        frozen: &frozen,
        rays: HashMap::new(),
        open: HashMap::new(),
    };
    let (measured, warmth) = measure(replays, default, rounds, warn)?;
    let plans = plans(&measured, &frozen);
    let own = plans.iter().position(|plan| measured[plan.ways[0]].traversal.shared() == default.shared());
    let own = own.context("the default cannot be measured on this device")?;
    let chosen = choose(&plans, own);
    Ok(TuningStudy { settings, frozen, measured, plans, own, chosen, warmth })
}

impl TuningStudy {
    /// The choice, to be kept.
    pub fn tuning(&self) -> Tuning {
        let tuned = |way: &usize| {
            let Measured { class, traversal, ref seconds } = self.measured[*way];
            let Frozen { class, share, .. } = self.frozen[class];
            TunedClass { class, traversal, rays_per_second: 1.0 / median(seconds), share }
        };
        Tuning { classes: self.plans[self.chosen].ways.iter().map(tuned).collect() }
    }

    /// The measured ways of a plan, by class.
    pub fn ways<'a>(&'a self, plan: &'a Plan) -> impl Iterator<Item = &'a Measured> {
        plan.ways.iter().map(|way| &self.measured[*way])
    }

    /// What the kernels of a plan share.
    pub fn shared(&self, plan: &Plan) -> Traversal {
        self.measured[plan.ways[0]].traversal.shared()
    }

    /// How many times as fast as the default a plan is, round by round.
    pub fn speed_up(&self, plan: &Plan) -> Estimate {
        speed_up(plan, &self.plans[self.own])
    }

    /// Rounds that were timed.
    pub fn rounds(&self) -> usize {
        self.plans[self.own].seconds.len()
    }
}

/// Place of the fastest plan, or of the default where that may be as fast.
fn choose(plans: &[Plan], own: usize) -> usize {
    let time = |plan: usize| median(&plans[plan].seconds);
    let fastest = (0..plans.len()).min_by(|a, b| time(*a).total_cmp(&time(*b))).unwrap_or(own);
    if speed_up(&plans[fastest], &plans[own]).surely_above(1.0) { fastest } else { own }
}

fn speed_up(plan: &Plan, other: &Plan) -> Estimate {
    let ratios = other.seconds.iter().zip(&plan.seconds).map(|(other, own)| other / own);
    Estimate::of_median(&ratios.collect::<Vec<_>>())
}

/// How rays are traced where nothing is tuned.
fn default_traversal(device: &Device, settings: &Settings, scene: &Scene) -> Result<Traversal, GpuError> {
    let defaults = Defaults::of(device)?;
    let (bvh, _) = defaults.tree(settings, scene);
    let Choices { fetch, workgroup_size, .. } = defaults.choose(settings, bvh, SceneLevels::default());
    let workgroup_size = workgroup_size.min(device.description().max_workgroup_size);
    Ok(Traversal { bvh, fetch, workgroup_size, packets: false })
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
/// the device has no room for are left out, with a warning.
fn measure(
    mut replays: Replays<'_>,
    default: Traversal,
    rounds: usize,
    warn: &mut dyn FnMut(&str),
) -> Result<(Vec<Measured>, Warmth), RenderError> {
    let Replays { device, scenes, frozen, .. } = replays;
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
                            warn(&format!("{} is left out: {error}", describe(&traversal, Packets::default())));
                        }
                        Err(error) => return Err(error),
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
    for _ in 0..rounds {
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

fn plans(measured: &[Measured], frozen: &[Frozen]) -> Vec<Plan> {
    let mut shared: Vec<Traversal> = Vec::new();
    for way in measured {
        if !shared.contains(&way.traversal.shared()) {
            shared.push(way.traversal.shared());
        }
    }
    let time = |way: usize| median(&measured[way].seconds);
    let plan = |shared: Traversal| {
        let of_class = |class| {
            let is = move |way: &usize| measured[*way].class == class && measured[*way].traversal.shared() == shared;
            (0..measured.len()).filter(is)
        };
        let fastest = |class| of_class(class).min_by(|a, b| time(*a).total_cmp(&time(*b)));
        let ways: Vec<usize> = (0..frozen.len()).filter_map(fastest).collect();
        let round =
            |i: usize| ways.iter().map(|way| frozen[measured[*way].class].share * measured[*way].seconds[i]).sum();
        let seconds = (0..measured[ways[0]].seconds.len()).map(round).collect();
        Plan { ways, seconds }
    };
    shared.into_iter().map(plan).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two classes, a third and two thirds of the rays, by two shapes of tree and each with and without packets.
    fn measured(camera: [f64; 4], bounce: [f64; 4]) -> (Vec<Measured>, Vec<Frozen>) {
        let ways = [(BvhKind::Bvh2, false), (BvhKind::Cwbvh, false), (BvhKind::Cwbvh, true), (BvhKind::Bvh4, false)];
        let way = |class: usize, (i, (bvh, packets)): (usize, (BvhKind, bool))| Measured {
            class,
            traversal: Traversal { bvh, fetch: Fetch::Storage, workgroup_size: 64, packets },
            // Rounds drift together.
            seconds: (0..8).map(|round| [camera, bounce][class][i] * (1.0 + 0.01 * f64::from(round))).collect(),
        };
        let measured = [0, 1].into_iter().flat_map(|class| ways.into_iter().enumerate().map(move |w| way(class, w)));
        let frozen = [(RayClass::Camera, 1.0 / 3.0), (RayClass::Bounce, 2.0 / 3.0)];
        let frozen = frozen.map(|(class, share)| Frozen { class, rays: Vec::new(), share });
        (measured.collect(), frozen.to_vec())
    }

    fn tuned(camera: [f64; 4], bounce: [f64; 4]) -> TuningStudy {
        let (measured, frozen) = measured(camera, bounce);
        let plans = plans(&measured, &frozen);
        let chosen = choose(&plans, 0);
        let settings = Settings::default();
        TuningStudy { settings, frozen, measured, plans, own: 0, chosen, warmth: Warmth::default() }
    }

    #[test]
    fn a_plan_has_the_fastest_way_of_each_class_that_one_render_can_have() {
        let tuned = tuned([2.0, 3.0, 1.0, 9.0], [2.0, 1.0, 1.5, 9.0]);
        assert_eq!(tuned.plans.len(), 3, "packets are no tree of their own");
        let wide = &tuned.plans[1];
        assert_eq!(tuned.shared(wide).bvh, BvhKind::Cwbvh);
        assert_eq!(tuned.ways(wide).map(|way| way.traversal.packets).collect::<Vec<_>>(), [true, false]);
        // By the shares of the classes.
        assert!((wide.seconds[0] - (1.0 / 3.0 + 2.0 / 3.0)).abs() < 1e-12);
        assert!((tuned.speed_up(wide).value - 2.0).abs() < 1e-12);
        assert_eq!(tuned.chosen, 1);
        let kept = tuned.tuning();
        assert_eq!(kept.packets(), Packets { camera: true, ..Packets::default() });
        assert!((kept.classes[0].rays_per_second - 1.0 / 1.035).abs() < 1e-12);
    }

    #[test]
    fn the_default_stays_where_nothing_is_surely_faster() {
        assert_eq!(tuned([1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]).chosen, 0);
        let mut noisy = tuned([1.0, 0.99, 0.99, 9.0], [1.0, 0.99, 0.99, 9.0]);
        for (round, seconds) in noisy.plans[1].seconds.iter_mut().enumerate() {
            *seconds *= if round % 3 == 0 { 1.2 } else { 0.95 };
        }
        assert_eq!(choose(&noisy.plans, 0), 0);
    }
}
