//! The replay of frozen rays: one traversal kernel alone, over and over, checked against the CPU and timed.
//!
//! An invocation traces one ray, so the rounds after which a driver may leave an invocation's loops (see
//! [`RenderError::CutLoops`]) are spent on that ray alone and never add up over a launch, whatever its size. A ray that
//! needs more of them gets a wrong answer, as it would in a render, and the check against the CPU is there to find it.

use std::ops::Range;
use std::time::Instant;

use rayon::prelude::*;

use super::plan::{Plan, SampleRange};
use super::prepare::PreparedScene;
use super::session::{RenderError, SessionOptions, limits, open_executor};
use super::settings::{Offsets, PathState, Settings};
use crate::bvh::{Hit, Ray, trace_any, trace_closest};
use crate::constants::{NO_TRIANGLE, STAGE_CONNECT, STAGE_EXTEND};
use crate::gpu::{Device, DeviceKind, Executor, GpuError};
use crate::layout::{Control, WorkCount};
use crate::rays::{RayClass, RayRecord};
use crate::recording::Recording;

/// Most rays of a dump that are traced on the CPU too.
const CHECKED_RAYS: usize = 1 << 16;

/// Rays on a device, ready to be traced.
pub struct Replay<'a> {
    executor: Executor,
    plan: Plan,
    scene: &'a PreparedScene,
    class: RayClass,
    kernel: &'static str,
    /// With triangles by their place in leaf order, as the kernels have them.
    rays: Vec<RayRecord>,
    repeat: u32,
    /// Whether the device rounds as the CPU does.
    exact: bool,
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
    /// Answers that differ from the CPU's by rounding; none on a software device.
    pub rounded: u64,
    /// Seconds of each round.
    pub seconds: Vec<f64>,
    /// Whether the device's clock told them; else the host's did, around each launch.
    pub device_clock: bool,
    /// Launches of a round.
    pub launches: u64,
    /// Invocations of a workgroup.
    pub workgroup_size: u32,
    /// Whether scene buffers were read by texels.
    pub texel_fetch: bool,
}

impl<'a> Replay<'a> {
    /// Builds the class's kernel and uploads the scene. Of `settings`, workgroup size and paths in flight count: the
    /// latter is the most rays of a launch. The rays, at least 1, are traced `repeat` times over in every round.
    ///
    /// # Errors
    /// When the scene is over the device's limits, or the device fails.
    ///
    /// # Panics
    /// When a ray names a triangle that the scene has not.
    pub fn new(
        device: &Device,
        scene: &'a PreparedScene,
        settings: &Settings,
        class: RayClass,
        rays: &[RayRecord],
        repeat: u32,
    ) -> Result<Self, RenderError> {
        Self::with_options(device, scene, settings, class, rays, repeat, SessionOptions::default())
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
        rays: &[RayRecord],
    ) -> Result<WorkCount, RenderError> {
        let options = SessionOptions { counting: true, ..SessionOptions::default() };
        let mut replay = Self::with_options(device, scene, settings, class, rays, 1, options)?;
        for part in replay.parts() {
            replay.load(&part)?;
            replay.launch((part.end - part.start) as u32)?;
        }
        let counts: Vec<WorkCount> = bytemuck::pod_collect_to_vec(&replay.executor.read("work_counts")?);
        Ok(counts[if class == RayClass::Shadow { STAGE_CONNECT } else { STAGE_EXTEND } as usize])
    }

    fn with_options(
        device: &Device,
        scene: &'a PreparedScene,
        settings: &Settings,
        class: RayClass,
        rays: &[RayRecord],
        repeat: u32,
        options: SessionOptions,
    ) -> Result<Self, RenderError> {
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
            executor.write("shadow_radiances", bytemuck::cast_slice(&radiances))?;
        } else {
            executor.write("ray_queue", bytemuck::cast_slice(&slots.collect::<Vec<_>>()))?;
        }
        let rays = in_leaf_order(scene, rays);
        let exact = device.description().kind == DeviceKind::Cpu;
        Ok(Self { executor, plan, scene, class, kernel: kernel_of(settings, class), rays, repeat, exact })
    }

    /// Traces all rays, checks the answers against the CPU's, then traces and times them `rounds` times.
    ///
    /// Up to 2^16 rays are checked: all, or evenly spread ones. On a software device answers must be the CPU's to the
    /// last bit. Vulkan lets others round a quotient in their own way, so there a hit may be as near but for rounding.
    ///
    /// # Errors
    /// When an answer is wrong or changes between rounds, or the device fails.
    pub fn run(&mut self, rounds: usize) -> Result<ReplayOutcome, RenderError> {
        let expected = self.expected();
        let total = self.rays.len() as u64 * u64::from(self.repeat);
        let mut outcome = ReplayOutcome {
            kernel: self.kernel,
            rays: total,
            hits: 0,
            checked: expected.len() as u64,
            rounded: 0,
            seconds: vec![0.0; rounds],
            device_clock: true,
            launches: 0,
            workgroup_size: self.plan.workgroup_size,
            texel_fetch: self.executor.access().texel_fetch,
        };
        for part in self.parts() {
            let first = part.start;
            let count = (part.end - first) as u32;
            self.load(&part)?;
            // The first launch may compile, so it is not timed.
            self.launch(count)?;
            let answers = self.answers(count)?;
            let judged = judge(&answers, &expected, first, self.rays.len() as u64, self.exact);
            outcome.rounded += judged.map_err(|(ray, found, expected)| RenderError::WrongAnswer {
                ray,
                kernel: outcome.kernel,
                found: self.describe(&found),
                expected: self.describe(&expected),
            })?;
            outcome.hits += answers.iter().filter(|answer| answer.is_hit()).count() as u64;
            outcome.launches += 1;

            self.executor.clear(self.answer_buffer())?;
            for seconds in &mut outcome.seconds {
                let (time, device_clock) = self.launch(count)?;
                *seconds += time;
                outcome.device_clock &= device_clock;
            }
            if rounds > 0 {
                let again = self.answers(count)?;
                if let Some(at) = answers.iter().zip(&again).position(|(a, b)| !a.is_same(b)) {
                    return Err(RenderError::Unstable {
                        ray: (first + at as u64) % self.rays.len() as u64,
                        kernel: outcome.kernel,
                        first: self.describe(&answers[at]),
                        again: self.describe(&again[at]),
                    });
                }
            }
        }
        Ok(outcome)
    }

    /// Traces all rays once and tells how many seconds that took. The answers are not looked at: [`Replay::run`] checks
    /// them.
    ///
    /// # Errors
    /// When the device fails.
    pub fn round(&mut self) -> Result<f64, RenderError> {
        let mut seconds = 0.0;
        for part in self.parts() {
            self.load(&part)?;
            seconds += self.launch((part.end - part.start) as u32)?.0;
        }
        Ok(seconds)
    }

    /// Bytes of device memory.
    pub fn memory_bytes(&self) -> u64 {
        self.executor.memory_bytes()
    }

    /// A round's rays by launches.
    fn parts(&self) -> impl Iterator<Item = Range<u64>> + use<> {
        let total = self.rays.len() as u64 * u64::from(self.repeat);
        let capacity = u64::from(self.plan.path_capacity);
        (0..total).step_by(capacity as usize).map(move |first| first..total.min(first + capacity))
    }

    /// Numbers of the rays that are checked, ascending, and what the CPU finds of them.
    fn expected(&self) -> Vec<(u64, Answer)> {
        let checked = self.rays.len().min(CHECKED_RAYS);
        let numbers = (0..checked).into_par_iter().map(|i| i * self.rays.len() / checked);
        numbers.map(|number| (number as u64, on_cpu(self.scene, self.class, &self.rays[number]))).collect()
    }

    /// Puts a part of a round's rays into the slots.
    fn load(&mut self, part: &Range<u64>) -> Result<(), GpuError> {
        let mut words = [Vec::new(), Vec::new()];
        for number in part.clone() {
            let ray = &self.rays[(number % self.rays.len() as u64) as usize];
            let [origin, direction]: [[u32; 4]; 2] = bytemuck::cast(*ray);
            words[0].push(origin);
            words[1].push(direction);
        }
        let shadow = self.class == RayClass::Shadow;
        let names = if shadow { ["shadow_origins", "shadow_directions"] } else { ["ray_origins", "ray_directions"] };
        for (name, words) in names.into_iter().zip(&words) {
            self.executor.write(name, bytemuck::cast_slice(words))?;
        }
        let count = (part.end - part.start) as u32;
        let none: Control = bytemuck::Zeroable::zeroed();
        let control = Control { current_rays: count, current_shadow_rays: count, ..none };
        self.executor.write("control", bytemuck::bytes_of(&control))?;
        self.executor.clear(self.answer_buffer())
    }

    /// Traces the rays in the slots. Seconds, and whether the device's clock told them.
    fn launch(&mut self, count: u32) -> Result<(f64, bool), GpuError> {
        let kernel = self.kernel;
        // The kernels read the half of the queue that bounce 0 reads.
        let batch = SampleRange { first_pixel: 0, pixel_count: count, first_sample: 0, sample_count: 1, film_pixel: 0 };
        let batch = batch.at_bounce(0);
        let mut recording = Recording::default();
        recording.dispatch(kernel, self.plan.groups(count), batch);
        self.executor.forget_times();
        let start = Instant::now();
        self.executor.submit(&recording)?;
        self.executor.wait()?;
        let host_seconds = start.elapsed().as_secs_f64();
        let device_seconds = self.executor.kernel_times().get(&(kernel, 0)).map_or(0.0, |time| time.seconds);
        // A device without timestamps leaves it at 0.
        let told = device_seconds > 0.0;
        Ok((if told { device_seconds } else { host_seconds }, told))
    }

    /// The buffer that the kernel writes.
    fn answer_buffer(&self) -> &'static str {
        if self.class == RayClass::Shadow { "radiances" } else { "hits" }
    }

    /// What the kernel found of the rays in the slots, since the buffer was cleared.
    fn answers(&mut self, count: u32) -> Result<Vec<Answer>, GpuError> {
        let words: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&self.executor.read(self.answer_buffer())?);
        let answer = |[x, y, z, w]: &[u32; 4]| match self.class {
            // A ray brings a radiance of 1 in every launch, unless it is blocked.
            RayClass::Shadow => Answer::Blocked(f32::from_bits(*x) == 0.0),
            RayClass::Camera | RayClass::Bounce if *x == NO_TRIANGLE => Answer::Nearest(None),
            RayClass::Camera | RayClass::Bounce => {
                let [u, v, distance] = [*y, *z, *w].map(f32::from_bits);
                Answer::Nearest(Some(Hit { triangle: *x, barycentrics: [u, v], distance }))
            }
        };
        Ok(words[..count as usize].iter().map(answer).collect())
    }

    /// An answer for people, with the triangle in the scene's order.
    fn describe(&self, answer: &Answer) -> String {
        match answer {
            Answer::Nearest(None) => "no hit".to_owned(),
            Answer::Nearest(Some(Hit { triangle, barycentrics: [u, v], distance })) => {
                let original = self.scene.triangles.get(*triangle as usize).map_or(*triangle, |t| t.original);
                format!("triangle {original} at distance {distance:?}, barycentrics {u:?} {v:?}")
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
    in_leaf_order(scene, rays).par_iter().map(distance).collect()
}

/// Rays with triangles by their place in leaf order, as the kernels have them.
fn in_leaf_order(scene: &PreparedScene, rays: &[RayRecord]) -> Vec<RayRecord> {
    let mut places = vec![0; scene.triangles.len()];
    for (triangle, place) in scene.triangles.iter().zip(0..) {
        places[triangle.original as usize] = place;
    }
    let place = |original: u32| if original == NO_TRIANGLE { NO_TRIANGLE } else { places[original as usize] };
    rays.iter().map(|r| RayRecord { leaves: place(r.leaves), target: place(r.target), ..*r }).collect()
}

/// What the CPU finds of a ray with triangles in leaf order.
fn on_cpu(scene: &PreparedScene, class: RayClass, record: &RayRecord) -> Answer {
    let (bvh, triangles) = (&scene.bvh, &scene.triangles);
    let RayRecord { origin, leaves, direction, target } = *record;
    let ray = Ray { origin: origin.into(), direction: direction.into(), leaves };
    match class {
        RayClass::Camera | RayClass::Bounce => Answer::Nearest(trace_closest(bvh, triangles, &ray)),
        RayClass::Shadow => {
            // As `shadow_limit` of `path.glsl`: up to the lamp, or for ever.
            let limit = if target == NO_TRIANGLE { f32::MAX } else { 1.0 };
            Answer::Blocked(trace_any(bvh, triangles, &ray, target, limit))
        }
    }
}

/// The kernel that traces rays of a class.
fn kernel_of(settings: &Settings, class: RayClass) -> &'static str {
    let packets = settings.packets.unwrap_or_default();
    match class {
        RayClass::Camera => packets.kernel_at(0, "extend", "extend_packets"),
        RayClass::Bounce => packets.kernel_at(1, "extend", "extend_packets"),
        RayClass::Shadow => packets.connect(),
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
    /// Whether the ray met something.
    fn is_hit(&self) -> bool {
        matches!(self, Self::Nearest(Some(_)) | Self::Blocked(true))
    }

    /// Whether they agree to the last bit.
    fn is_same(&self, other: &Self) -> bool {
        let bits =
            |hit: &Hit| [hit.triangle, hit.distance.to_bits()].into_iter().chain(hit.barycentrics.map(f32::to_bits));
        match (self, other) {
            (Self::Nearest(Some(a)), Self::Nearest(Some(b))) => bits(a).eq(bits(b)),
            (Self::Nearest(a), Self::Nearest(b)) => a.is_none() && b.is_none(),
            (Self::Blocked(a), Self::Blocked(b)) => a == b,
            _ => false,
        }
    }

    /// Whether rounding can make one of the other. Where neighbours meet it may pick either, so distances decide.
    fn is_near(&self, other: &Self) -> bool {
        const TOLERANCE: f32 = 1e-4;
        match (self, other) {
            (Self::Nearest(Some(a)), Self::Nearest(Some(b))) => {
                (a.distance - b.distance).abs() <= TOLERANCE * a.distance.max(b.distance)
            }
            _ => self.is_same(other),
        }
    }
}

/// Holds answers, the first of which is that of number `first` of a round, against the expected ones of the `rays` rays
/// that a round repeats. How many differ by rounding, or the first ray that is wrong, what was found, and what is right.
fn judge(
    answers: &[Answer],
    expected: &[(u64, Answer)],
    first: u64,
    rays: u64,
    exact: bool,
) -> Result<u64, (u64, Answer, Answer)> {
    let end = first + answers.len() as u64;
    let mut rounded = 0;
    for copy in first / rays..end.div_ceil(rays) {
        for (ray, right) in expected {
            let number = copy * rays + ray;
            if !(first..end).contains(&number) {
                continue;
            }
            let found = &answers[(number - first) as usize];
            if !found.is_same(right) {
                if exact || !found.is_near(right) {
                    return Err((*ray, *found, *right));
                }
                rounded += 1;
            }
        }
    }
    Ok(rounded)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(triangle: u32, distance: f32) -> Answer {
        Answer::Nearest(Some(Hit { triangle, barycentrics: [0.25, 0.5], distance }))
    }

    /// The verdict on answers from number 3 on of a round that repeats five rays.
    fn verdict(answers: &[Answer], exact: bool) -> Result<u64, u64> {
        let expected = [(0, hit(7, 1.0)), (2, Answer::Nearest(None)), (4, hit(8, 2.0))];
        judge(answers, &expected, 3, 5, exact).map_err(|(ray, ..)| ray)
    }

    #[test]
    fn every_copy_of_a_checked_ray_is_judged() {
        let none = Answer::Nearest(None);
        // Numbers 3 to 10 of the round; rays 1 and 3 are not checked.
        let right = [none, hit(8, 2.0), hit(7, 1.0), hit(9, 9.0), none, none, hit(8, 2.0), hit(7, 1.0)];
        assert_eq!(verdict(&right, true), Ok(0));
        for (at, ray) in [(1, 4), (2, 0), (4, 2), (6, 4), (7, 0)] {
            for wrong in [hit(6, 0.5), Answer::Blocked(true)] {
                let mut answers = right;
                answers[at] = wrong;
                assert_eq!(verdict(&answers, true), Err(ray));
                assert_eq!(verdict(&answers, false), Err(ray));
            }
        }
    }

    #[test]
    fn rounding_is_pardoned_where_a_device_may_round() {
        let next = f32::from_bits(2.0_f32.to_bits() + 1);
        for answer in [hit(8, next), hit(9, 2.0)] {
            let answers = [Answer::Nearest(None), answer];
            assert_eq!(verdict(&answers, true), Err(4));
            assert_eq!(verdict(&answers, false), Ok(1));
        }
    }

    #[test]
    fn shadow_rays_are_blocked_or_not() {
        let (free, blocked) = (Answer::Blocked(false), Answer::Blocked(true));
        assert!(judge(&[free, blocked], &[(0, free), (1, blocked)], 0, 2, true).is_ok());
        for exact in [true, false] {
            assert!(judge(&[free, free], &[(0, free), (1, blocked)], 0, 2, exact).is_err());
        }
    }
}
