//! The replay of frozen rays: one traversal kernel by itself, launched repeatedly, checked against the CPU and timed.
//!
//! An invocation traces one ray, so the rounds after which a driver may leave an invocation's loops (see
//! [`RenderError::CutLoops`]) are spent on one ray and never add up over a launch, whatever its size. A ray that
//! needs more of them gets a wrong answer, as it would in a render, and the check against the CPU is there to find it.

use std::ops::Range;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use rayon::prelude::*;

use super::dump::ray_buffers;
use super::error::RenderError;
use super::plan::{Plan, SampleRange};
use super::prepare::{PreparedScene, TriangleName};
use super::schedule::{connect_kernel, extend_kernel};
use super::session::{SessionOptions, limits, open_executor};
use super::warm_up::{WarmUp, Warmth};
use crate::bvh::{Hit, Primitive, Ray, trace_any, trace_closest};
use crate::constants::{NO_TRIANGLE, STAGE_CONNECT, STAGE_EXTEND, WORLD_INSTANCE};
use crate::gpu::{Device, DeviceKind, Executor, GpuError};
use crate::layout::{Control, WorkCount};
use crate::rays::{RayClass, RayRecord};
use crate::recording::Recording;
use crate::settings::{Offsets, PathState, Settings};
use crate::shaders::{Kernel, buffers};

/// Bytes of half a ray, and of an answer without its instance.
const RECORD_BYTES: usize = 16;
/// Most rays of a dump that are traced on the CPU too.
const CHECKED_RAYS: usize = 1 << 16;

/// Seconds of launches that go to the device at once, about: short enough for any driver's watchdog, and long enough that
/// the host has the next ones ready.
const SUBMISSION_SECONDS: f64 = 0.1;
/// Launches of a submission, at most.
const MOST_LAUNCHES: f64 = 256.0;
/// Seconds of launches that [`Replay::round`] takes the mean of, on devices that are done in less.
const ROUND_SECONDS: f64 = 0.005;
/// Rays that a core packs at a time.
const PACKED: usize = 1 << 12;

/// Rays of a class in a scene, and what the CPU finds of them: the same in whatever way a device traces them.
pub struct FrozenRays<'a> {
    scene: &'a PreparedScene,
    class: RayClass,
    rays: &'a [RayRecord],
    /// The place in leaf order, which the kernels know, of every triangle.
    places: Vec<u32>,
    /// Numbers of the rays that are checked, ascending, and what the CPU finds of them, once anyone has asked.
    expected: OnceLock<Vec<(u64, Answer)>>,
}

impl<'a> FrozenRays<'a> {
    /// Of one ray at least.
    pub fn new(scene: &'a PreparedScene, class: RayClass, rays: &'a [RayRecord]) -> Self {
        Self { scene, class, rays, places: scene.places(), expected: OnceLock::new() }
    }

    fn expected(&self) -> &[(u64, Answer)] {
        self.expected.get_or_init(|| {
            let checked = self.rays.len().min(CHECKED_RAYS);
            let numbers = (0..checked).into_par_iter().map(|i| i * self.rays.len() / checked);
            let find =
                |number| on_cpu(self.scene, self.class, &in_leaf_order(self.scene, &self.places, &self.rays[number]));
            numbers.map(|number| (number as u64, find(number))).collect()
        })
    }
}

/// Rays on a device, ready to be traced.
pub struct Replay<'a> {
    executor: Executor,
    plan: Plan,
    frozen: Arc<FrozenRays<'a>>,
    kernel: &'static Kernel,
    repeat: u32,
    /// The part of a round that lies in the slots.
    loaded: Option<Range<u64>>,
    /// Seconds of a launch, about.
    launch_seconds: f64,
    /// Whether the device is as fast after a rest as before.
    software: bool,
    warm: bool,
}

/// What a replay found and how long it took.
#[derive(Debug, Clone)]
pub struct ReplayOutcome {
    /// The kernel that traced.
    pub kernel: &'static str,
    /// Rays of a round: the dump's, as many times over as was asked for.
    pub rays: u64,
    /// Rays of a round that hit a triangle or, of shadow rays, are blocked.
    pub hits: u64,
    /// Rays of the dump that were traced on the CPU too.
    pub checked: u64,
    /// Seconds of each round.
    pub seconds: Vec<f64>,
    /// Whether they are by the device's clock; else by the host's, around each launch.
    pub device_clock: bool,
    /// How the device was warmed up before.
    pub warmth: Warmth,
    /// Seconds that the device was idle between the timed launches, summed; `None` where it has no clock.
    pub idle_seconds: Option<f64>,
    /// Launches of a round.
    pub launches: u64,
    /// Invocations of a workgroup.
    pub workgroup_size: u32,
    /// Whether scene buffers were read by texels.
    pub texel_fetch: bool,
}

/// Launches that followed each other.
struct Launches {
    /// Of each.
    seconds: Vec<f64>,
    /// Whether they are by the device's clock.
    device_clock: bool,
    /// Between them, in all.
    idle_seconds: Option<f64>,
}

impl<'a> Replay<'a> {
    /// Builds the class's kernel and uploads the scene. Of `settings`, workgroup size and paths in flight count: the
    /// latter is the most rays of a launch. The rays, at least 1, are traced `repeat` times over in every round.
    ///
    /// # Errors
    /// When the scene is over the device's limits, or the device fails.
    ///
    /// # Panics
    /// When a ray names a triangle that the scene has not, sooner or later.
    pub fn new(
        device: &Device,
        scene: &'a PreparedScene,
        settings: &Settings,
        class: RayClass,
        rays: &'a [RayRecord],
        repeat: u32,
    ) -> Result<Self, RenderError> {
        Self::of(device, Arc::new(FrozenRays::new(scene, class, rays)), settings, repeat)
    }

    /// As [`Replay::new`], of rays that other replays may trace in other ways.
    ///
    /// # Errors
    /// As [`Replay::new`].
    ///
    /// # Panics
    /// As [`Replay::new`].
    pub fn of(
        device: &Device,
        frozen: Arc<FrozenRays<'a>>,
        settings: &Settings,
        repeat: u32,
    ) -> Result<Self, RenderError> {
        Self::with_options(device, frozen, settings, repeat, SessionOptions::default())
    }

    /// Counts what tracing each ray once is, with kernels that count. Of `settings` and the rays as [`Replay::new`].
    ///
    /// # Errors
    /// As [`Replay::new`].
    pub fn count_work(
        device: &Device,
        scene: &'a PreparedScene,
        settings: &Settings,
        class: RayClass,
        rays: &'a [RayRecord],
    ) -> Result<WorkCount, RenderError> {
        let options = SessionOptions { counting: true, ..SessionOptions::default() };
        let frozen = Arc::new(FrozenRays::new(scene, class, rays));
        let mut replay = Self::with_options(device, frozen, settings, 1, options)?;
        for part in replay.parts() {
            replay.load(&part)?;
            replay.launch(rays_of(&part), 1)?;
        }
        let found = replay.executor.run(Recording::default().download(buffers::WORK_COUNTS))?;
        let counts: Vec<WorkCount> = bytemuck::pod_collect_to_vec(&found[0]);
        Ok(counts[if class == RayClass::Shadow { STAGE_CONNECT } else { STAGE_EXTEND } as usize])
    }

    fn with_options(
        device: &Device,
        frozen: Arc<FrozenRays<'a>>,
        settings: &Settings,
        repeat: u32,
        options: SessionOptions,
    ) -> Result<Self, RenderError> {
        let FrozenRays { scene, class, rays, .. } = *frozen;
        // Dumped rays are exact, whatever made them, and the CPU knows of nothing else.
        let settings = &Settings { path_state: PathState::F32, offsets: Offsets::Robust, ..*settings };
        let total = rays.len() as u64 * u64::from(repeat);
        let plan = Plan::of_replay(settings, &limits(device), total, scene.needs(settings).stack_bytes(1));
        let mut executor = open_executor(device, scene, settings, &plan, &[kernel_of(settings, class)], options)?;
        // A ray lies in the slot of its number.
        let slots = 0..plan.path_capacity;
        if class == RayClass::Shadow {
            let one = 1.0_f32.to_bits();
            let radiances: Vec<_> = slots.map(|slot| [one, one, one, slot]).collect();
            executor.run(Recording::default().upload(buffers::SHADOW_RADIANCES, bytemuck::cast_slice(&radiances)))?;
        } else {
            let slots: Vec<_> = slots.collect();
            executor.run(Recording::default().upload(buffers::RAY_QUEUE, bytemuck::cast_slice(&slots)))?;
        }
        Ok(Self {
            executor,
            plan,
            frozen,
            kernel: kernel_of(settings, class),
            repeat,
            loaded: None,
            launch_seconds: f64::INFINITY,
            software: device.description().kind == DeviceKind::Cpu,
            warm: false,
        })
    }

    /// Traces all rays, checks the answers against the CPU's, then warms the device up, and traces and times them `rounds`
    /// times, one launch after the other without the host in between.
    ///
    /// Up to 2^16 rays are checked: all, or evenly spread ones. Answers must be the CPU's to the last bit, on any device,
    /// since kernels compute in raywave's own arithmetic.
    ///
    /// # Errors
    /// When an answer is wrong or changes between rounds, or the device fails.
    pub fn run(&mut self, rounds: usize) -> Result<ReplayOutcome, RenderError> {
        self.run_watched(rounds, || ())
    }

    /// As [`Replay::run`]; `watch` is called right before and right after timed launches.
    ///
    /// # Errors
    /// As [`Replay::run`].
    pub fn run_watched(&mut self, rounds: usize, mut watch: impl FnMut()) -> Result<ReplayOutcome, RenderError> {
        let frozen = Arc::clone(&self.frozen);
        let expected = frozen.expected();
        let rays = frozen.rays.len() as u64;
        let mut outcome = ReplayOutcome {
            kernel: self.kernel.name,
            rays: rays * u64::from(self.repeat),
            hits: 0,
            checked: expected.len() as u64,
            seconds: vec![0.0; rounds],
            device_clock: true,
            warmth: Warmth::default(),
            idle_seconds: Some(0.0),
            launches: 0,
            workgroup_size: self.plan.workgroup_size,
            texel_fetch: self.executor.access().texel_fetch,
        };
        let mut found = Vec::new();
        for part in self.parts() {
            self.load(&part)?;
            self.executor.run(Recording::default().clear(self.answer_buffer()))?;
            // The first launch may compile, so it is not timed.
            self.launch(rays_of(&part), 1)?;
            self.read_answers(rays_of(&part), &mut found)?;
            let (class, kernel) = (self.frozen.class, self.kernel.name);
            let instances = self.read_instances(rays_of(&part))?;
            let answer = |at: usize| Answer::of(class, &found[at]).of_instance(instances.get(at));
            let judged = judge(found.len(), answer, expected, part.start, rays);
            judged.map_err(|(ray, found, expected)| RenderError::WrongAnswer {
                ray,
                kernel,
                found: self.describe(&found),
                expected: self.describe(&expected),
            })?;
            outcome.hits += found.par_iter().filter(|words| Answer::of(class, words).is_hit()).count() as u64;
            outcome.launches += 1;
            if rounds == 0 {
                continue;
            }
            self.executor.run(Recording::default().clear(self.answer_buffer()))?;
            outcome.warmth.add(&self.warm_up(rays_of(&part))?);
            watch();
            let Launches { seconds, device_clock, idle_seconds } = self.timed(rays_of(&part), rounds)?;
            watch();
            outcome.seconds.iter_mut().zip(seconds).for_each(|(sum, seconds)| *sum += seconds);
            outcome.device_clock &= device_clock;
            outcome.idle_seconds = outcome.idle_seconds.zip(idle_seconds).map(|(sum, seconds)| sum + seconds);
            if let Some((at, again)) = self.first_change(&found)? {
                return Err(RenderError::Unstable {
                    ray: (part.start + at as u64) % rays,
                    kernel,
                    first: self.describe(&answer(at)),
                    again: self.describe(&again),
                });
            }
        }
        Ok(outcome)
    }

    /// Traces all rays and returns the seconds that it took: the mean over as many times as fill some milliseconds. The
    /// answers are not looked at: [`Replay::run`] checks them.
    ///
    /// # Errors
    /// When the device fails.
    pub fn round(&mut self) -> Result<f64, RenderError> {
        let mut seconds = 0.0;
        for part in self.parts() {
            self.load(&part)?;
            let times =
                if self.software { 1.0 } else { (ROUND_SECONDS / self.launch_seconds).clamp(1.0, MOST_LAUNCHES) };
            let launches = self.timed(rays_of(&part), times as usize)?.seconds;
            seconds += launches.iter().sum::<f64>() / launches.len() as f64;
        }
        Ok(seconds)
    }

    /// Traces rays until the device is steady, as it must be before [`Replay::round`].
    ///
    /// # Errors
    /// When the device fails.
    pub fn warm(&mut self) -> Result<Warmth, RenderError> {
        let part = self.parts().next().expect("there is a ray");
        self.load(&part)?;
        self.warm = false;
        Ok(self.warm_up(rays_of(&part))?)
    }

    /// Bytes of device memory.
    pub fn memory_bytes(&self) -> u64 {
        self.executor.memory_bytes()
    }

    /// A round's rays by launches.
    fn parts(&self) -> impl Iterator<Item = Range<u64>> + use<> {
        let total = self.frozen.rays.len() as u64 * u64::from(self.repeat);
        let capacity = u64::from(self.plan.path_capacity);
        (0..total).step_by(capacity as usize).map(move |first| first..total.min(first + capacity))
    }

    /// Puts a part of a round's rays into the slots, unless it is there already.
    fn load(&mut self, part: &Range<u64>) -> Result<(), GpuError> {
        if self.loaded.as_ref() != Some(part) {
            self.loaded = None;
            let FrozenRays { scene, class, rays, places, .. } = &*self.frozen;
            for (half, buffer) in ray_buffers(*class).into_iter().enumerate() {
                self.executor.fill(buffer, u64::from(rays_of(part)) * RECORD_BYTES as u64, |offset, bytes| {
                    let first = (part.start + offset / RECORD_BYTES as u64) as usize;
                    let slots: &mut [[u32; 4]] = bytemuck::cast_slice_mut(bytes);
                    slots.par_chunks_mut(PACKED).enumerate().for_each(|(i, slots)| {
                        let mut at = (first + i * PACKED) % rays.len();
                        for slot in slots {
                            *slot = halves(&in_leaf_order(scene, places, &rays[at]))[half];
                            at = if at + 1 == rays.len() { 0 } else { at + 1 };
                        }
                    });
                })?;
            }
            if scene.bvh.has_two_levels() {
                let at = |number: u64| &rays[(number % rays.len() as u64) as usize];
                let records = part.clone().map(|number| in_leaf_order(scene, places, at(number)));
                let words: Vec<[u32; 2]> = records.map(|ray| [ray.leaves_instance, ray.target_instance]).collect();
                let leaves: Vec<u32> = words.iter().map(|[leaves, _]| *leaves).collect();
                let (buffer, bytes): (_, &[u8]) = match class {
                    RayClass::Shadow => (buffers::SHADOW_INSTANCES, bytemuck::cast_slice(&words)),
                    RayClass::Camera | RayClass::Bounce => (buffers::RAY_INSTANCES, bytemuck::cast_slice(&leaves)),
                };
                self.executor.run(Recording::default().upload(buffer, bytes))?;
            }
            let count = rays_of(part);
            let none: Control = bytemuck::Zeroable::zeroed();
            let control = Control { current_rays: count, current_shadow_rays: count, ..none };
            self.executor.run(Recording::default().upload(buffers::CONTROL, bytemuck::bytes_of(&control)))?;
            self.loaded = Some(part.clone());
        }
        Ok(())
    }

    /// Works the device warm, unless it is: a software device stays so while others are put into its slots.
    fn warm_up(&mut self, count: u32) -> Result<Warmth, GpuError> {
        if self.warm && self.software {
            return Ok(Warmth::default());
        }
        let warmth = WarmUp::of(self.software).run(|seconds| {
            let times = (seconds / self.launch_seconds).clamp(1.0, MOST_LAUNCHES) as usize;
            let launched = self.launch(count, times)?.seconds;
            Ok::<_, GpuError>((launched.iter().sum(), launched.len() as f64))
        })?;
        self.warm = true;
        Ok(warmth)
    }

    /// Times launches that follow each other. On devices that rest when they have nothing to do, one that is not timed goes
    /// ahead of them.
    fn timed(&mut self, count: u32, times: usize) -> Result<Launches, GpuError> {
        let ahead = usize::from(!self.software);
        let mut launches = self.launch(count, ahead + times)?;
        launches.seconds.drain(..ahead);
        Ok(launches)
    }

    /// Traces the rays in the slots `times` times.
    fn launch(&mut self, count: u32, times: usize) -> Result<Launches, GpuError> {
        // The kernels read the half of the queue that bounce 0 reads.
        let batch = SampleRange { first_pixel: 0, pixel_count: count, first_sample: 0, sample_count: 1, film_pixel: 0 };
        let at_once = (SUBMISSION_SECONDS / self.launch_seconds).clamp(1.0, MOST_LAUNCHES) as usize;
        self.executor.forget_times();
        self.executor.keep_launches();
        let mut host_seconds = Vec::new();
        for first in (0..times).step_by(at_once) {
            let mut recording = Recording::default();
            for _ in first..times.min(first + at_once) {
                recording.dispatch(self.kernel, self.plan.groups(count), &batch.at_bounce(0));
            }
            let start = Instant::now();
            self.executor.submit(&recording)?;
            if !self.executor.has_clock() {
                self.executor.wait()?;
                let launches = recording.commands.len();
                host_seconds.extend(vec![start.elapsed().as_secs_f64() / launches as f64; launches]);
            }
        }
        self.executor.wait()?;
        let device_clock = self.executor.has_clock();
        let device_seconds = self.executor.take_launches();
        let seconds = if device_clock { device_seconds } else { host_seconds };
        // Without a device's clock, launches are waited for one by one, so that each has a time of its own.
        let shortest = seconds.iter().copied().fold(f64::INFINITY, f64::min);
        self.launch_seconds = if device_clock && shortest > 0.0 { shortest } else { f64::INFINITY };
        Ok(Launches { seconds, device_clock, idle_seconds: self.executor.idle().between })
    }

    /// The buffer that the kernel writes.
    fn answer_buffer(&self) -> &'static str {
        if self.frozen.class == RayClass::Shadow { buffers::RADIANCES } else { buffers::HITS }
    }

    /// Reads what the kernel wrote of the rays in the slots since the buffer was cleared.
    fn read_answers(&mut self, count: u32, words: &mut Vec<[u32; 4]>) -> Result<(), GpuError> {
        words.clear();
        let bytes = u64::from(count) * RECORD_BYTES as u64;
        let mut recording = Recording::default();
        recording.download_first(self.answer_buffer(), bytes);
        self.executor.run_seen(&recording, |_, _, part| words.extend_from_slice(bytemuck::cast_slice(part)))
    }

    /// Reads the instances of the hits in the slots; there are none where a scene has none, or of shadow rays.
    fn read_instances(&mut self, count: u32) -> Result<Vec<u32>, GpuError> {
        let mut instances = Vec::new();
        if self.frozen.scene.bvh.has_two_levels() && self.frozen.class != RayClass::Shadow {
            let mut recording = Recording::default();
            recording.download_first(buffers::HIT_INSTANCES, u64::from(count) * 4);
            self.executor.run_seen(&recording, |_, _, part| instances.extend_from_slice(bytemuck::cast_slice(part)))?;
        }
        Ok(instances)
    }

    /// The first of the answers in the slots that is another than it was, and what it is now.
    fn first_change(&mut self, before: &[[u32; 4]]) -> Result<Option<(usize, Answer)>, GpuError> {
        let (class, bytes) = (self.frozen.class, size_of_val(before) as u64);
        let mut change = None;
        let mut recording = Recording::default();
        recording.download_first(self.answer_buffer(), bytes);
        self.executor.run_seen(&recording, |_, offset, part| {
            let now: &[[u32; 4]] = bytemuck::cast_slice(part);
            let first = offset as usize / RECORD_BYTES;
            let before = &before[first..][..now.len()];
            // Nearly always the words are the same. A sum of radiance may differ though its ray is as free.
            if change.is_none() && before != now {
                let differs = |(a, b): (&[u32; 4], &[u32; 4])| !Answer::of(class, a).is_same(&Answer::of(class, b));
                let at = before.iter().zip(now).position(differs);
                change = at.map(|at| (first + at, Answer::of(class, &now[at])));
            }
        })?;
        Ok(change)
    }

    /// An answer for people, with the triangle in the scene's order.
    fn describe(&self, answer: &Answer) -> String {
        match answer {
            Answer::Nearest(None) => "no hit".to_owned(),
            Answer::Nearest(Some(Hit { triangle, instance, barycentrics: [u, v], distance })) => {
                let scene = self.frozen.scene;
                let is_there = (*triangle as usize) < scene.triangles.len()
                    && (*instance as usize) < scene.bvh.instances.len().max(1);
                let name = match is_there {
                    true => scene.name_of(Primitive { triangle: *triangle, instance: *instance }),
                    false => TriangleName { triangle: *triangle, instance: *instance },
                };
                let of = if name.instance == WORLD_INSTANCE {
                    String::new()
                } else {
                    format!(" of instance {}", name.instance)
                };
                format!("triangle {}{of} at distance {distance:?}, barycentrics {u:?} {v:?}", name.triangle)
            }
            Answer::Blocked(true) => "it blocked".to_owned(),
            Answer::Blocked(false) => "it free".to_owned(),
        }
    }
}

/// What the CPU finds of rays: how far away the nearest hit is, in lengths of the direction, infinite where there is
/// none; of shadow rays 0 where they are blocked and infinite where they are not. The same for every kind of BVH.
///
/// # Panics
/// When a ray names a triangle that the scene has not.
pub fn distances(scene: &PreparedScene, class: RayClass, rays: &[RayRecord]) -> Vec<f32> {
    let distance = |ray: &RayRecord| match on_cpu(scene, class, ray) {
        Answer::Nearest(Some(hit)) => hit.distance,
        Answer::Blocked(true) => 0.0,
        Answer::Nearest(None) | Answer::Blocked(false) => f32::INFINITY,
    };
    let places = scene.places();
    rays.par_iter().map(|ray| distance(&in_leaf_order(scene, &places, ray))).collect()
}

/// How many rays a part has, which is no more than a device has slots.
fn rays_of(part: &Range<u64>) -> u32 {
    (part.end - part.start) as u32
}

/// A ray with triangles by their places in leaf order, and instances as kernels have them.
fn in_leaf_order(scene: &PreparedScene, places: &[u32], ray: &RayRecord) -> RayRecord {
    let place = |triangle: u32, instance: u32| match triangle {
        NO_TRIANGLE => (NO_TRIANGLE, NO_TRIANGLE),
        triangle => {
            let (number, instance) = scene.number_of(TriangleName { instance, triangle });
            (places[number as usize], instance)
        }
    };
    let (leaves, leaves_instance) = place(ray.leaves, ray.leaves_instance);
    let (target, target_instance) = place(ray.target, ray.target_instance);
    RayRecord { leaves, target, leaves_instance, target_instance, ..*ray }
}

/// The two halves of a ray in the buffers of rays.
fn halves(ray: &RayRecord) -> [[u32; 4]; 2] {
    let half = |[x, y, z]: [f32; 3], triangle: u32| [x.to_bits(), y.to_bits(), z.to_bits(), triangle];
    [half(ray.origin, ray.leaves), half(ray.direction, ray.target)]
}

/// What the CPU finds of a ray with triangles in leaf order.
fn on_cpu(scene: &PreparedScene, class: RayClass, record: &RayRecord) -> Answer {
    let (bvh, triangles) = (&scene.bvh, &scene.triangles);
    let RayRecord { origin, leaves, direction, target, leaves_instance, target_instance } = *record;
    let leaves = Primitive { triangle: leaves, instance: leaves_instance };
    let ray = Ray { origin: origin.into(), direction: direction.into(), leaves };
    match class {
        RayClass::Camera | RayClass::Bounce => Answer::Nearest(trace_closest(bvh, triangles, &ray)),
        RayClass::Shadow => {
            // As `shadow_limit` of `path.glsl`: up to the lamp, or for ever.
            let limit = if target == NO_TRIANGLE { f32::MAX } else { 1.0 };
            let target = Primitive { triangle: target, instance: target_instance };
            Answer::Blocked(trace_any(bvh, triangles, &ray, target, limit))
        }
    }
}

/// The kernel that traces rays of a class.
fn kernel_of(settings: &Settings, class: RayClass) -> &'static Kernel {
    let packets = settings.packets.unwrap_or_default();
    match class {
        RayClass::Camera | RayClass::Bounce => extend_kernel(packets, class),
        RayClass::Shadow => connect_kernel(packets),
    }
}

/// What a traversal finds of a ray.
#[derive(Debug, Clone, Copy)]
enum Answer {
    /// The nearest hit, by place in leaf order.
    Nearest(Option<Hit>),
    /// Whether something lies between a surface and a light.
    Blocked(bool),
}

impl Answer {
    /// What a kernel wrote of a ray.
    fn of(class: RayClass, [x, y, z, w]: &[u32; 4]) -> Self {
        match class {
            // A ray brings a radiance of 1 in every launch, unless it is blocked.
            RayClass::Shadow => Self::Blocked(f32::from_bits(*x) == 0.0),
            RayClass::Camera | RayClass::Bounce if *x == NO_TRIANGLE => Self::Nearest(None),
            RayClass::Camera | RayClass::Bounce => {
                let [u, v, distance] = [*y, *z, *w].map(f32::from_bits);
                Self::Nearest(Some(Hit { triangle: *x, instance: WORLD_INSTANCE, barycentrics: [u, v], distance }))
            }
        }
    }

    /// The same where a kernel wrote an instance too.
    fn of_instance(self, instance: Option<&u32>) -> Self {
        match (self, instance) {
            (Self::Nearest(Some(hit)), Some(&instance)) => Self::Nearest(Some(Hit { instance, ..hit })),
            _ => self,
        }
    }

    /// Whether the ray met something.
    fn is_hit(&self) -> bool {
        matches!(self, Self::Nearest(Some(_)) | Self::Blocked(true))
    }

    /// Whether they agree to the last bit.
    fn is_same(&self, other: &Self) -> bool {
        let bits = |hit: &Hit| {
            let numbers = [hit.triangle, hit.instance, hit.distance.to_bits()];
            numbers.into_iter().chain(hit.barycentrics.map(f32::to_bits))
        };
        match (self, other) {
            (Self::Nearest(Some(a)), Self::Nearest(Some(b))) => bits(a).eq(bits(b)),
            (Self::Nearest(a), Self::Nearest(b)) => a.is_none() && b.is_none(),
            (Self::Blocked(a), Self::Blocked(b)) => a == b,
            _ => false,
        }
    }
}

/// Holds `count` answers, the first of which is that of number `first` of a round, against the expected ones of the `rays` rays
/// that a round repeats. Else the first ray that is wrong, what was found, and what is right.
fn judge(
    count: usize,
    answer: impl Fn(usize) -> Answer,
    expected: &[(u64, Answer)],
    first: u64,
    rays: u64,
) -> Result<(), (u64, Answer, Answer)> {
    let end = first + count as u64;
    for copy in first / rays..end.div_ceil(rays) {
        for (ray, right) in expected {
            let number = copy * rays + ray;
            if !(first..end).contains(&number) {
                continue;
            }
            let found = answer((number - first) as usize);
            if !found.is_same(right) {
                return Err((*ray, found, *right));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(triangle: u32, distance: f32) -> Answer {
        Answer::Nearest(Some(Hit { triangle, instance: 0, barycentrics: [0.25, 0.5], distance }))
    }

    /// The verdict on answers from number 3 on of a round that repeats five rays.
    fn verdict(answers: &[Answer]) -> Result<(), u64> {
        let expected = [(0, hit(7, 1.0)), (2, Answer::Nearest(None)), (4, hit(8, 2.0))];
        judge(answers.len(), |at| answers[at], &expected, 3, 5).map_err(|(ray, ..)| ray)
    }

    #[test]
    fn every_copy_of_a_checked_ray_is_judged() {
        let none = Answer::Nearest(None);
        // Numbers 3 to 10 of the round; rays 1 and 3 are not checked.
        let right = [none, hit(8, 2.0), hit(7, 1.0), hit(9, 9.0), none, none, hit(8, 2.0), hit(7, 1.0)];
        assert_eq!(verdict(&right), Ok(()));
        for (at, ray) in [(1, 4), (2, 0), (4, 2), (6, 4), (7, 0)] {
            for wrong in [hit(6, 0.5), Answer::Blocked(true)] {
                let mut answers = right;
                answers[at] = wrong;
                assert_eq!(verdict(&answers), Err(ray));
            }
        }
    }

    #[test]
    fn shadow_rays_are_blocked_or_not() {
        let (free, blocked) = (Answer::Blocked(false), Answer::Blocked(true));
        let verdict = |answers: [Answer; 2]| {
            judge(2, |at| answers[at], &[(0, free), (1, blocked)], 0, 2).map_err(|(ray, ..)| ray)
        };
        assert_eq!(verdict([free, blocked]), Ok(()));
        assert_eq!(verdict([free, free]), Err(1));
        // The last bit counts.
        let next = Answer::Nearest(Some(Hit {
            triangle: 8,
            instance: 0,
            barycentrics: [0.25, 0.5],
            distance: 2.0_f32.next_up(),
        }));
        assert!(judge(1, |_| next, &[(0, hit(8, 2.0))], 0, 1).is_err());
    }
}
