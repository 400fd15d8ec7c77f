//! A render on a device: uploads the scene, runs batch after batch, reads the film.

use std::collections::{BTreeMap, VecDeque};
use std::ops::{ControlFlow, Range};
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use thiserror::Error;

use super::defaults::Defaults;
use super::pace::Pace;
use super::plan::{Band, DeviceLimits, Plan, SampleRange, SceneDemands, Taken, Tile};
use super::prepare::{Needs, PrepareError, PreparedScene, SceneBuffer};
use super::settings::{Numerics, Packets, Scheduler, Settings, ShadowRays, Sort};
use super::traced::{DeviceTrace, Gathering};
use super::{batch, bounce, megakernel, wavefront};
use crate::bvh::BvhKind;
use crate::constants::{COUNTED_BOUNCES, STAGES};
use crate::film::FilmMoments;
use crate::gpu::{
    BufferRole, BufferUse, CompiledKernel, Device, Executor, ExecutorDescription, GpuError, Idle, KernelTime,
};
use crate::image::Image;
use crate::layout::{Bins, Control, FilmPixel, Frame, RayCount, WorkCount};
use crate::recording::Recording;
use crate::shaders::{self, Access, Arithmetic, Edition, Forms, Library};

/// A render that failed.
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum RenderError {
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error(
        "the driver leaves a kernel's loops before their end, so the image would be wrong; use another --scheduler than megakernel, or a smaller --shading-cost"
    )]
    CutLoops,
    #[error(
        "the driver does not promise that lanes which part in a loop meet again, as the rays of a packet must; leave out --packets"
    )]
    NoPackets,
    #[error("the megakernel keeps no queues, so there are no rays to dump; use --scheduler wavefront")]
    NoQueues,
    #[error(
        "shadow rays that are traced at once are in no queue, so there are none to dump; use --shadow-rays deferred"
    )]
    NoShadowQueue,
    #[error("there are no {rays} rays at bounce {bounce}{}", of_last(*last))]
    NoRays { rays: &'static str, bounce: u32, last: Option<u32> },
    #[error(
        "ray {ray} of the dump: {kernel} finds {found} where the CPU finds {expected}, so its speed means nothing; report this with device and driver"
    )]
    WrongAnswer { ray: u64, kernel: &'static str, found: String, expected: String },
    #[error("ray {ray} of the dump: {kernel} finds {first} and, when run again, {again}; the device cannot be trusted")]
    Unstable { ray: u64, kernel: &'static str, first: String, again: String },
}

/// Where there are rays, for a message. The camera's are always there.
fn of_last(last: Option<u32>) -> String {
    match last {
        Some(0) => "; there are some at bounce 0".to_owned(),
        Some(last) => format!("; there are some up to bounce {last}"),
        None => ", nor before it; they need --integrator explicit and a light".to_owned(),
    }
}

/// How far a render is.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    /// Samples done, over all pixels.
    pub samples_done: u64,
    /// Samples to do, over all pixels.
    pub samples_total: u64,
    /// Rays traced, of all classes, by the latest look at the device's counts.
    pub rays: u64,
    /// Since the first batch.
    pub elapsed: Duration,
}

/// How a render is to end before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// When all pixels of the tile under way have equal samples.
    Even,
    /// When all pixels of each row have.
    Now,
}

/// What a render leaves.
#[derive(Debug)]
pub struct Outcome {
    /// Sums over the samples of each pixel, of as many rows as the statistics say.
    pub film: FilmMoments,
    /// What it cost.
    pub statistics: Statistics,
}

/// What a render cost.
#[derive(Debug, Clone)]
pub struct Statistics {
    /// Samples of each pixel in the image; where rows have different ones, the fewest of any that has some.
    pub samples: u32,
    /// Rows of the image, from the top, that have samples: all of them, unless the render was broken off.
    pub rows: u32,
    /// Those rows by their samples: one entry, unless the render was broken off.
    pub bands: Vec<Band>,
    /// Rows of a tile.
    pub tile_rows: u32,
    /// Samples that were taken, over all pixels.
    pub sample_count: u64,
    /// Rays from the camera.
    pub camera_rays: u64,
    /// Rays from a scattering.
    pub bounce_rays: u64,
    /// Rays to a light.
    pub shadow_rays: u64,
    /// Samples that were NaN or infinite and were left out of the film.
    pub nonfinite_samples: u32,
    /// Pixel and number of those, by pixel: all, or some where they are many; see [`super::find_faults`].
    pub nonfinite_traced: Vec<[u32; 2]>,
    /// From the first batch to the last.
    pub wall_time: Duration,
    /// Inside the command buffers of the batches, from end to end, on the device's clock; 0 where it
    /// has none.
    pub gpu_seconds: f64,
    /// How long the device was idle before and between those.
    pub idle: Idle,
    /// Time and launches by kernel and bounce.
    pub passes: BTreeMap<(&'static str, u32), KernelTime>,
    /// Rays by bounce; the last entry takes all that follow. The megakernel leaves the
    /// camera's out, and counts all of its rays
    /// after the camera's as bounce 1, and all shadow rays as bounce 0.
    pub ray_counts: Vec<RayCount>,
    /// Bytes of device memory.
    pub memory_bytes: u64,
    /// How the work was cut into kernels.
    pub scheduler: Scheduler,
    /// Path slots.
    pub paths_in_flight: u32,
    /// Invocations of a workgroup.
    pub workgroup_size: u32,
    /// Paths that an invocation of the megakernel followed.
    pub paths_per_invocation: u32,
    /// Shape of the BVH.
    pub bvh: BvhKind,
    /// Whether scene buffers were read by texels.
    pub texel_fetch: bool,
    /// Work by bounce and then by `STAGE_*`, of a session that counts; else empty.
    pub work_counts: Vec<WorkCount>,
}

/// What a session can be asked for besides the settings of its render.
#[derive(Debug, Clone, Copy, Default)]
pub struct SessionOptions {
    /// How kernels reach memory; `None` leaves it to the device.
    pub access: Option<Access>,
    /// Whether kernels count their work, which takes time.
    pub counting: bool,
    /// What portable quotients and roots are made of; `None` is what suits the device.
    pub forms: Option<Forms>,
    /// Functions that stand for the driver's own operations, for tests of what other drivers do.
    pub driver: Option<&'static Library>,
    /// Most bytes of film that the device holds at once; `None` is what fits a buffer. The image is
    /// the same.
    pub film_bytes: Option<u64>,
}

impl Statistics {
    /// Rays of all classes.
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.bounce_rays + self.shadow_rays
    }

    /// Time and launches by kernel.
    pub fn kernels(&self) -> BTreeMap<&'static str, KernelTime> {
        let mut kernels: BTreeMap<_, KernelTime> = BTreeMap::new();
        for ((kernel, _), time) in &self.passes {
            let total = kernels.entry(*kernel).or_default();
            total.seconds += time.seconds;
            total.launches += time.launches;
        }
        kernels
    }
}

/// Bounces that go to the device before the host looks whether paths are left. Bounded paths of
/// up to this length never make the host wait.
const BOUNCES_AT_ONCE: u32 = 32;

/// Seconds that a pass over all pixels may take where it could be longer: the fewer passes, the less time goes into
/// what is between them; the shorter they are, the sooner pixels have equal samples.
const PASS_SECONDS: f64 = 1.0;

/// Paths of a render below which the pace is not sampled beforehand: they take no second.
const SAMPLED_RENDER: u64 = 1 << 17;
/// Small batches, at most, by which the pace is sampled, and paths of the first one.
const SAMPLINGS: u32 = 32;
const SAMPLED_PATHS: u32 = 256;
/// Multiples of it are spread evenly over [0, 1), however many of them there are.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// Seconds that such a batch takes, at least, if it is to tell of paths rather than of launches.
const SAMPLING_SECONDS: f64 = 2e-3;
/// How much more than what was sampled a path may cost.
const SURPRISE: f64 = 8.0;
/// The share of a render that sampling may take.
const SAMPLING_SHARE: f64 = 1.0 / 200.0;

/// Time between two looks at the device's ray counts: each waits for the device.
const COUNT_INTERVAL: Duration = Duration::from_millis(250);

/// A scene on a device, ready to render.
pub struct Session {
    pub(super) executor: Executor,
    pub(super) plan: Plan,
    pub(super) settings: Settings,
    pub(super) scheduler: Scheduler,
    /// Whether shadow rays wait in a queue for `connect`.
    connects: bool,
    bvh: BvhKind,
    counting: bool,
    /// What the kernels' radiance is of the scene's.
    radiance_scale: f64,
    pace: Pace,
    /// Submissions whose time is not known yet: with the batch that each of them ends, if it ends one.
    timed: VecDeque<Option<SampleRange>>,
    /// The longest submission so far of the batch under way, in seconds.
    longest: f64,
    /// Batches that the megakernel has followed and whose samples are not in the film yet, as one.
    gathered: Option<SampleRange>,
    /// What is kept for a trace, if anything is.
    tracing: Option<Gathering>,
}

impl Session {
    /// Plans the render, builds its kernels and uploads the scene.
    ///
    /// # Errors
    /// When scene or film are over the device's limits, or the device fails.
    pub fn new(device: &Device, scene: &PreparedScene, settings: &Settings) -> Result<Self, RenderError> {
        Self::with_options(device, scene, settings, SessionOptions::default())
    }

    /// As [`Session::new`], with options.
    ///
    /// # Errors
    /// As [`Session::new`].
    pub fn with_options(
        device: &Device,
        scene: &PreparedScene,
        settings: &Settings,
        options: SessionOptions,
    ) -> Result<Self, RenderError> {
        let limits = limits(device);
        let max_film_bytes = options.film_bytes.unwrap_or(limits.max_film_bytes);
        let defaults = Defaults::of(device)?;
        let (levels, needs) = (scene.levels(), scene.needs(settings));
        let scheduler = defaults.scheduler(settings, levels);
        let limits = DeviceLimits { max_film_bytes, ..limits };
        let state_bytes = path_records(settings.sort, &needs).iter().map(|(_, bytes)| bytes).sum();
        let demands = SceneDemands { levels, stack_bytes: needs.stack_bytes(1), state_bytes };
        let plan = Plan::new(settings, scheduler, &demands, &limits, &defaults);
        let executor = open_executor(device, scene, settings, &plan, &kernels(scheduler, settings, &needs), options)?;
        Ok(Self {
            executor,
            plan,
            settings: *settings,
            scheduler,
            connects: connects(scheduler, settings, &needs),
            bvh: scene.bvh.kind,
            counting: options.counting,
            radiance_scale: scene.radiance_scale,
            pace: Pace::new(plan.pixels()),
            timed: VecDeque::new(),
            longest: 0.0,
            gathered: None,
            tracing: None,
        })
    }

    /// Lets the renders that follow take other random numbers and another number of samples. `scene` is
    /// the session's own.
    ///
    /// # Errors
    /// When the device fails.
    pub fn reseed(&mut self, scene: &PreparedScene, seed: u32, samples: u32) -> Result<(), RenderError> {
        self.settings = Settings { seed, samples, ..self.settings };
        let frame = scene.frame(&self.settings, self.plan.path_capacity);
        Ok(self.executor.write("frame", bytemuck::bytes_of(&frame))?)
    }

    /// Bytes of device memory that the session holds.
    pub fn memory_bytes(&self) -> u64 {
        self.executor.memory_bytes()
    }

    /// What the driver made of the kernels, as [`Executor::compiled_kernels`] has it.
    ///
    /// # Errors
    /// When a kernel cannot be built.
    pub fn compiled_kernels(&self) -> Result<Option<Vec<CompiledKernel>>, RenderError> {
        Ok(self.executor.compiled_kernels()?)
    }

    /// Instructions of each kernel's SPIR-V that can run, by name.
    pub fn instructions(&self) -> impl Iterator<Item = (&'static str, usize)> {
        self.executor.instructions()
    }

    /// Invocations of a workgroup.
    pub fn workgroup_size(&self) -> u32 {
        self.plan.workgroup_size
    }

    /// Time until all kernels were built.
    pub fn pipelines_time(&self) -> Duration {
        self.executor.pipelines_time()
    }

    /// Time that the driver took to build each kernel, by name. Kernels are built side by side, so that these may add
    /// up to more than the time of all.
    pub fn pipeline_times(&self) -> impl Iterator<Item = (&'static str, Duration)> {
        self.executor.pipeline_times()
    }

    /// Lets be kept what the device does in the render that follows, for a trace: up to so many passes.
    ///
    /// # Errors
    /// When the device fails.
    pub fn keep_trace(&mut self, most_passes: usize) -> Result<(), RenderError> {
        self.executor.keep_trace("ray_counts", most_passes)?;
        self.tracing = Some(Gathering::new(self.scheduler != Scheduler::Megakernel));
        Ok(())
    }

    /// What has been kept since [`Session::keep_trace`], and no more is; `None` where it was not called.
    pub fn take_trace(&mut self) -> Option<DeviceTrace> {
        self.gather_trace();
        let batches = self.tracing.take()?.batches();
        Some(DeviceTrace { alignment: self.executor.alignment()?, batches })
    }

    fn gather_trace(&mut self) {
        if let Some(tracing) = &mut self.tracing {
            tracing.add(self.executor.take_traced());
        }
    }

    /// As [`Session::render_tiles`], with the tiles put together. Of a render that is broken off, the film has the rows
    /// from the top that have equal samples.
    ///
    /// # Errors
    /// When the device fails.
    pub fn render(&mut self, progress: impl FnMut(&Progress) -> ControlFlow<Ending>) -> Result<Outcome, RenderError> {
        let mut film: Option<FilmMoments> = None;
        let statistics = self.render_tiles(progress, |rows| match &mut film {
            None => film = Some(rows),
            Some(film) if film.samples == rows.samples => film.append(rows),
            Some(_) => {}
        })?;
        Ok(Outcome { film: film.expect("a render has a row"), statistics })
    }

    /// As [`Session::render`], for the image alone: the mean of every pixel, and no more of it is made.
    ///
    /// # Errors
    /// When the device fails.
    pub fn render_image(&mut self) -> Result<(Image, Statistics), RenderError> {
        let mut pixels = Vec::with_capacity(self.plan.pixels() as usize);
        let whole = |_: &Progress| ControlFlow::Continue(());
        let mut kept = Kept::every(Duration::MAX);
        let statistics = self.run(&mut kept, whole, |session, tile, _| session.mean(tile, &mut pixels))?;
        Ok((Image::new(self.plan.width, statistics.rows, pixels), statistics))
    }

    /// As [`Session::render`], for what it costs: the film stays where it is.
    ///
    /// # Errors
    /// When the device fails.
    pub fn time(&mut self) -> Result<Statistics, RenderError> {
        self.run(&mut Kept::every(Duration::MAX), |_| ControlFlow::Continue(()), |_, _, _| Ok(()))
    }

    /// As [`Session::go_on`], from the start.
    ///
    /// # Errors
    /// When the device fails.
    pub fn render_tiles(
        &mut self,
        progress: impl FnMut(&Progress) -> ControlFlow<Ending>,
        finished: impl FnMut(FilmMoments),
    ) -> Result<Statistics, RenderError> {
        self.go_on(&mut Kept::default(), progress, finished)
    }

    /// Renders all samples of one tile after the other, from the top, and hands each to `finished`. Begins where `kept`
    /// ends, which another session of the same scene and settings may have left, and keeps it up to date.
    ///
    /// `progress` is called after each batch, and after each sampling before the first one, some fractions of a second
    /// apart. When it breaks, the render ends as it says, with the samples that it has: the rows of the tile under way
    /// are handed over by their samples, and of the rows that have none nothing is. There is a batch at least.
    ///
    /// # Errors
    /// When the device fails.
    pub fn go_on(
        &mut self,
        kept: &mut Kept,
        progress: impl FnMut(&Progress) -> ControlFlow<Ending>,
        mut finished: impl FnMut(FilmMoments),
    ) -> Result<Statistics, RenderError> {
        self.run(kept, progress, |session, tile, bands| {
            let film = session.film(tile)?;
            moments(&film, bands, session.plan.width, session.radiance_scale).for_each(&mut finished);
            Ok(())
        })
    }

    /// Renders as [`Session::go_on`] says; `finished` may look at the film of each tile, by its rows of equal samples.
    fn run(
        &mut self,
        kept: &mut Kept,
        mut progress: impl FnMut(&Progress) -> ControlFlow<Ending>,
        mut finished: impl FnMut(&mut Self, Tile, &[Band]) -> Result<(), GpuError>,
    ) -> Result<Statistics, RenderError> {
        let start = Instant::now();
        let before = kept.statistics.clone().unwrap_or_else(|| self.nothing());
        let mut samples_done = before.sample_count;
        let samples_total = self.plan.pixels() * u64::from(self.settings.samples);
        self.sample_pace(|| {
            let elapsed = before.wall_time + start.elapsed();
            progress(&Progress { samples_done, samples_total, rays: 0, elapsed }).is_continue()
        })?;
        let mut taken = self.take_up(kept)?;
        let mut bands = before.bands.clone();
        let mut statistics = before.clone();
        let mut ending = None;
        let (mut counted, mut rays_per_sample) = (start, 1.0);
        for (place, tile) in self.plan.tiles(kept.first_row).enumerate() {
            if place > 0 {
                self.executor.clear("film")?;
            }
            while let Some(batch) = self.next_batch(tile, taken)? {
                self.render_batch(batch)?;
                taken.add(batch, tile.rows * self.plan.width);
                samples_done += u64::from(batch.paths());
                if counted.elapsed() > COUNT_INTERVAL {
                    let (bounce_rays, shadow_rays) = scattered_rays(&self.ray_counts()?);
                    let known = samples_done - self.gathered.map_or(0, |batch| batch.paths().into());
                    rays_per_sample = 1.0 + (bounce_rays + shadow_rays) as f64 / known.max(1) as f64;
                    counted = Instant::now();
                }
                let rays = (samples_done as f64 * rays_per_sample) as u64;
                let elapsed = before.wall_time + start.elapsed();
                ending = progress(&Progress { samples_done, samples_total, rays, elapsed }).break_value();
                let of_rows = taken.is_of_rows(self.plan.width);
                if ending == Some(Ending::Even) && taken.pixels == 0 || ending == Some(Ending::Now) && of_rows {
                    break;
                }
                if of_rows && kept.is_due() {
                    let begun = Instant::now();
                    let film = self.film(tile)?;
                    let control = self.control()?;
                    statistics = self.statistics(&control, &before, &bands, samples_done, start.elapsed())?;
                    kept.keep(tile.first_row, taken, film, control, statistics.clone());
                    kept.cost = begun.elapsed();
                }
            }
            self.resolve()?;
            self.executor.wait()?;
            let wall_time = start.elapsed();
            let rows = taken.bands(tile, self.plan.width);
            finished(self, tile, &rows)?;
            bands.extend(rows);
            let control = self.control()?;
            statistics = self.statistics(&control, &before, &bands, samples_done, wall_time)?;
            taken = Taken::default();
            kept.keep(tile.first_row + tile.rows, taken, Vec::new(), control, statistics.clone());
            if ending.is_some() {
                break;
            }
        }
        Ok(statistics)
    }

    /// Gives the device what was kept of a render, and tells which samples the tile under way has.
    fn take_up(&mut self, kept: &mut Kept) -> Result<Taken, GpuError> {
        self.clear()?;
        (kept.width, kept.radiance_scale, kept.at) = (self.plan.width, self.radiance_scale, Instant::now());
        if let Some(statistics) = &kept.statistics {
            self.executor.write("ray_counts", bytemuck::cast_slice(&statistics.ray_counts))?;
            if self.counting {
                self.executor.write("work_counts", bytemuck::cast_slice(&statistics.work_counts))?;
            }
            self.executor.write("control", bytemuck::bytes_of(&kept.control))?;
        }
        self.gather_trace();
        if let Some(tracing) = &mut self.tracing {
            tracing.begin_render(kept.statistics.as_ref().map_or(&[], |statistics| &statistics.ray_counts));
        }
        if !kept.film.is_empty() {
            self.executor.write("film", bytemuck::cast_slice(&kept.film))?;
        }
        Ok(kept.taken)
    }

    /// Starts the sums and counts anew.
    pub(super) fn clear(&mut self) -> Result<(), GpuError> {
        self.executor.wait()?;
        let _stage = self.executor.stages().begin("clear");
        self.executor.clear("film")?;
        self.executor.clear("ray_counts")?;
        if self.counting {
            self.executor.clear("work_counts")?;
        }
        self.executor.forget_times();
        self.timed.clear();
        self.gathered = None;
        self.clear_control()
    }

    /// Nothing is queued or counted. Launches that the device sizes have one workgroup in height and depth, which no
    /// kernel writes.
    fn clear_control(&mut self) -> Result<(), GpuError> {
        let mut control: Control = bytemuck::Zeroable::zeroed();
        (control.ray_groups, control.shadow_groups) = ([0, 1, 1], [0, 1, 1]);
        self.executor.write("control", bytemuck::bytes_of(&control))
    }

    /// Looks all over the image what paths cost, by small batches that are in no film, before the first render of a
    /// session. Stops when it is sure that no batch can take long, that more of it costs more than it is worth, or when
    /// `goes_on` says that the render is to end.
    fn sample_pace(&mut self, mut goes_on: impl FnMut() -> bool) -> Result<(), GpuError> {
        let pixels = self.plan.pixels();
        let paths = pixels * u64::from(self.settings.samples);
        if self.pace.mean() > 0.0 || paths < SAMPLED_RENDER {
            return Ok(());
        }
        self.clear_control()?;
        let sample_count = self.plan.samples_side_by_side().min(self.settings.samples);
        let (mut size, mut spent) = (SAMPLED_PATHS.min(self.plan.path_capacity), 0.0);
        for sampling in 0..SAMPLINGS {
            // The first ones are spread as evenly as all of them.
            let place = u64::from(sampling.reverse_bits() >> (32 - SAMPLINGS.ilog2()));
            let place = pixels * place / u64::from(SAMPLINGS)..pixels * (place + 1) / u64::from(SAMPLINGS);
            let pixel_count = (size / sample_count).min((place.end - place.start) as u32);
            // Each in another column, for the columns of an image may differ as its rows do.
            let aside = (f64::from(sampling) * GOLDEN).fract();
            let spare = place.end - place.start - u64::from(pixel_count);
            let first_pixel = (place.start + (aside * spare as f64) as u64) as u32;
            let batch = SampleRange { first_pixel, pixel_count, first_sample: 0, sample_count, film_pixel: 0 };
            let mut recording = Recording::default();
            match self.scheduler {
                Scheduler::Megakernel => megakernel::follow(&mut recording, &self.plan, batch, 0),
                Scheduler::Wavefront | Scheduler::Bounce => self.advance_from_the_camera(&mut recording, batch)?,
            }
            self.submit(&recording, Some(batch))?;
            self.executor.wait()?;
            let seconds = self.executor.take_submission_seconds().into_iter().fold(0.0, f64::max);
            self.timed.clear();
            self.pace.note_sampling(batch, place, seconds);
            spent += seconds;
            let longest = self.pace.dearest() * f64::from(self.plan.path_capacity) * SURPRISE;
            let is_sure = longest < Pace::BATCH_SECONDS;
            if is_sure || spent > self.pace.mean() * paths as f64 * SAMPLING_SHARE || !goes_on() {
                break;
            }
            if seconds < SAMPLING_SECONDS {
                size = (8 * size).min(self.plan.path_capacity);
            }
        }
        Ok(())
    }

    /// The batch that follows in a tile, of as many paths as the pace allows.
    fn next_batch(&mut self, tile: Tile, taken: Taken) -> Result<Option<SampleRange>, GpuError> {
        let samples = if taken.pixels > 0 { taken.more } else { self.plan.samples_side_by_side() };
        let width = self.plan.width;
        let mut paths = self.pace.paths(tile, width, taken.pixels, samples);
        if paths < self.plan.path_capacity && self.pace.is_growing(paths) {
            // What is under way tells whether it may be more.
            self.executor.wait()?;
            self.learn();
            paths = self.pace.paths(tile, width, taken.pixels, samples);
        }
        let pass_paths = self.pace.paths_within(tile, width, taken.pixels, samples, PASS_SECONDS) as u32;
        Ok(self.plan.next_batch(tile, taken, self.settings.samples, paths, pass_paths))
    }

    /// Tells the pace of the batches that have ended.
    fn learn(&mut self) {
        for seconds in self.executor.take_submission_seconds() {
            self.longest = self.longest.max(seconds);
            if let Some(batch) = self.timed.pop_front().flatten() {
                self.pace.note(batch, std::mem::take(&mut self.longest));
            }
        }
    }

    /// Starts a recording, which ends that batch.
    fn submit(&mut self, recording: &Recording, ends: Option<SampleRange>) -> Result<(), GpuError> {
        self.executor.submit(recording)?;
        self.timed.push_back(ends);
        if let Some(tracing) = &mut self.tracing {
            tracing.expect(ends.is_some() || self.scheduler == Scheduler::Megakernel);
        }
        self.gather_trace();
        Ok(())
    }

    /// Takes a batch from the camera to the film, or to where `resolve` takes it from.
    fn render_batch(&mut self, batch: SampleRange) -> Result<(), GpuError> {
        let mut recording = Recording::default();
        if self.scheduler == Scheduler::Megakernel {
            let fits = |all: &SampleRange| all.paths() <= self.plan.path_capacity;
            let mut gathered = self.gathered.and_then(|before| before.with(batch)).filter(fits);
            if gathered.is_none() {
                self.resolve()?;
                gathered = Some(batch);
            }
            let first_slot = gathered.map_or(0, |all| all.paths() - batch.paths());
            megakernel::follow(&mut recording, &self.plan, batch, first_slot);
            self.gathered = gathered;
        } else {
            self.advance_from_the_camera(&mut recording, batch)?;
            batch::end(&mut recording, &self.plan, batch);
        }
        self.submit(&recording, Some(batch))?;
        self.learn();
        Ok(())
    }

    /// Adds what the megakernel has gathered to the film.
    fn resolve(&mut self) -> Result<(), GpuError> {
        let Some(batch) = self.gathered.take() else { return Ok(()) };
        let mut recording = Recording::default();
        megakernel::count(&mut recording, batch);
        batch::end(&mut recording, &self.plan, batch);
        self.submit(&recording, None)
    }

    /// Takes the paths of a batch from the camera to their ends. Leaves the last of that to be submitted.
    fn advance_from_the_camera(&mut self, recording: &mut Recording, batch: SampleRange) -> Result<(), GpuError> {
        batch::begin(recording, &self.plan, batch);
        self.advance_to_the_end(recording, batch)
    }

    /// Takes every path through its bounces. Leaves the last of them to be submitted.
    fn advance_to_the_end(&mut self, recording: &mut Recording, range: SampleRange) -> Result<(), GpuError> {
        // The vertex after the last bounce still finds emission.
        let vertices = self.settings.max_bounces.map_or(u32::MAX, |bounces| bounces.saturating_add(1));
        let mut bounce = 0;
        loop {
            let bounces = bounce..vertices.min(bounce + BOUNCES_AT_ONCE);
            bounce = bounces.end;
            self.advance(recording, range, bounces);
            if bounce == vertices {
                return Ok(());
            }
            self.submit(&std::mem::take(recording), None)?;
            if self.control()?.current_rays == 0 {
                return Ok(());
            }
        }
    }

    /// Takes the queued paths through the bounces.
    pub(super) fn advance(&self, recording: &mut Recording, range: SampleRange, bounces: Range<u32>) {
        let packets = self.settings.packets.unwrap_or_default();
        match self.scheduler {
            Scheduler::Wavefront => {
                wavefront::advance(recording, self.settings.sort, packets, self.connects, range, bounces);
            }
            Scheduler::Bounce => bounce::advance(recording, packets, self.connects, range, bounces),
            Scheduler::Megakernel => unreachable!("the megakernel queues no paths"),
        }
    }

    pub(super) fn control(&mut self) -> Result<Control, GpuError> {
        self.executor.wait()?;
        let _stage = self.executor.stages().begin("read counts");
        Ok(bytemuck::pod_read_unaligned(&self.executor.read("control")?))
    }

    fn ray_counts(&mut self) -> Result<Vec<RayCount>, GpuError> {
        self.executor.wait()?;
        let _stage = self.executor.stages().begin("read counts");
        Ok(bytemuck::pod_collect_to_vec(&self.executor.read("ray_counts")?))
    }

    /// Reads the film of the tile under way.
    fn film(&mut self, tile: Tile) -> Result<Vec<FilmPixel>, GpuError> {
        let mut film = Vec::new();
        self.visit_film(tile, |pixels| film.extend_from_slice(pixels))?;
        Ok(film)
    }

    /// Reads the mean of every pixel of a tile that has all samples, as [`FilmMoments::mean`] has it.
    fn mean(&mut self, tile: Tile, means: &mut Vec<Vec3>) -> Result<(), GpuError> {
        let (scale, samples) = (self.radiance_scale, f64::from(self.settings.samples));
        let mean = |p: &FilmPixel| (total(p.sum, p.sum_compensation, scale) / samples).as_vec3();
        self.visit_film(tile, |pixels| means.par_extend(pixels.par_iter().map(mean)))
    }

    /// Shows the pixels of the tile under way where they were read to, some rows after the other.
    fn visit_film(&mut self, tile: Tile, mut show: impl FnMut(&[FilmPixel])) -> Result<(), GpuError> {
        self.resolve()?;
        self.executor.wait()?;
        let _stage = self.executor.stages().begin("read film");
        // The last tile may have fewer rows than the buffer.
        let bytes = u64::from(tile.rows * self.plan.width) * size_of::<FilmPixel>() as u64;
        self.executor.visit("film", bytes, |_, part| show(bytemuck::cast_slice(part)))
    }

    /// What a render has cost before it begins.
    fn nothing(&self) -> Statistics {
        Statistics {
            samples: 0,
            rows: 0,
            bands: Vec::new(),
            tile_rows: self.plan.tile_rows,
            sample_count: 0,
            camera_rays: 0,
            bounce_rays: 0,
            shadow_rays: 0,
            nonfinite_samples: 0,
            nonfinite_traced: Vec::new(),
            wall_time: Duration::ZERO,
            gpu_seconds: 0.0,
            idle: Idle::default(),
            passes: BTreeMap::new(),
            ray_counts: Vec::new(),
            memory_bytes: self.executor.memory_bytes(),
            scheduler: self.scheduler,
            paths_in_flight: self.plan.path_capacity,
            workgroup_size: self.plan.workgroup_size,
            paths_per_invocation: self.plan.paths_per_invocation,
            bvh: self.bvh,
            texel_fetch: self.executor.access().texel_fetch,
            work_counts: Vec::new(),
        }
    }

    /// What a render has cost so far, with what it had cost `before` in another session. Nothing is under way.
    fn statistics(
        &mut self,
        control: &Control,
        before: &Statistics,
        bands: &[Band],
        sample_count: u64,
        wall_time: Duration,
    ) -> Result<Statistics, RenderError> {
        if control.cut_loops != 0 {
            return Err(RenderError::CutLoops);
        }
        let mut nonfinite_traced = control.traced_samples.to_vec();
        nonfinite_traced.truncate(control.nonfinite_samples as usize);
        nonfinite_traced.sort_unstable();
        let ray_counts = self.ray_counts()?;
        let (bounce_rays, shadow_rays) = scattered_rays(&ray_counts);
        let work_counts = match self.counting {
            true => bytemuck::pod_collect_to_vec(&self.executor.read("work_counts")?),
            false => Vec::new(),
        };
        let mut passes = before.passes.clone();
        for (pass, time) in self.executor.kernel_times() {
            let total = passes.entry(*pass).or_default();
            total.seconds += time.seconds;
            total.launches += time.launches;
        }
        let told = bands.iter().map(|band| band.samples).min().unwrap_or(0);
        Ok(Statistics {
            samples: told,
            rows: bands.iter().map(|band| band.rows).sum(),
            bands: bands.to_vec(),
            sample_count,
            camera_rays: sample_count,
            bounce_rays,
            shadow_rays,
            nonfinite_samples: control.nonfinite_samples,
            nonfinite_traced,
            wall_time: before.wall_time + wall_time,
            gpu_seconds: before.gpu_seconds + self.executor.device_seconds(),
            idle: self.executor.idle(),
            passes,
            ray_counts,
            work_counts,
            ..self.nothing()
        })
    }
}

/// Sums of rows of a tile's film, from its top, in the scene's radiance.
fn moments<'a>(
    film: &'a [FilmPixel],
    bands: &'a [Band],
    width: u32,
    radiance_scale: f64,
) -> impl Iterator<Item = FilmMoments> + 'a {
    let (scale, mut rest) = (radiance_scale, film);
    bands.iter().map(move |band| {
        let (pixels, below) = rest.split_at((band.rows * width) as usize);
        rest = below;
        FilmMoments {
            width,
            height: band.rows,
            samples: band.samples.into(),
            sum: pixels.par_iter().map(|p| total(p.sum, p.sum_compensation, scale)).collect(),
            sum_of_squares: pixels
                .par_iter()
                .map(|p| total(p.squares, p.squares_compensation, scale * scale))
                .collect(),
        }
    })
}

/// What the host keeps of a render, so that it can go on from there in another session, or end with it, should its
/// device be lost.
#[derive(Debug)]
pub struct Kept {
    /// Time between two looks at the device's film, at least; each takes up to a hundredth of that.
    every: Duration,
    at: Instant,
    /// Time that the last look took.
    cost: Duration,
    /// First row of the tile under way, and the samples that it has.
    first_row: u32,
    taken: Taken,
    /// Its film; empty where it has no samples.
    film: Vec<FilmPixel>,
    control: Control,
    /// Of all tiles, with the bands of those that were handed over; `None` before the first look.
    statistics: Option<Statistics>,
    width: u32,
    radiance_scale: f64,
}

impl Default for Kept {
    fn default() -> Self {
        Self::every(Self::EVERY)
    }
}

impl Kept {
    /// Time between two looks at the film where the user does not say.
    pub const EVERY: Duration = Duration::from_secs(5);

    /// Nothing so far. The film is looked at so often, if a look takes less than a hundredth of that.
    pub fn every(every: Duration) -> Self {
        Self {
            every,
            at: Instant::now(),
            cost: Duration::ZERO,
            first_row: 0,
            taken: Taken::default(),
            film: Vec::new(),
            control: bytemuck::Zeroable::zeroed(),
            statistics: None,
            width: 0,
            radiance_scale: 1.0,
        }
    }

    /// Samples that were kept, over all pixels.
    pub fn sample_count(&self) -> u64 {
        self.statistics.as_ref().map_or(0, |statistics| statistics.sample_count)
    }

    fn is_due(&self) -> bool {
        self.at.elapsed() >= self.every.max(100 * self.cost)
    }

    fn keep(&mut self, first_row: u32, taken: Taken, film: Vec<FilmPixel>, control: Control, statistics: Statistics) {
        (self.first_row, self.taken, self.film, self.control) = (first_row, taken, film, control);
        (self.statistics, self.at) = (Some(statistics), Instant::now());
    }

    /// Ends a render with what was kept: hands the rows of the tile under way to `finished`. `None` where nothing was.
    pub fn end(self, finished: impl FnMut(FilmMoments)) -> Option<Statistics> {
        let mut statistics = self.statistics?;
        if !self.film.is_empty() {
            // The tile has as many rows as its film.
            let rows = (self.film.len() / self.width as usize) as u32;
            let bands = self.taken.bands(Tile { first_row: self.first_row, rows }, self.width);
            moments(&self.film, &bands, self.width, self.radiance_scale).for_each(finished);
            statistics.bands.extend(bands);
            statistics.rows = statistics.bands.iter().map(|band| band.rows).sum();
            statistics.samples = statistics.bands.iter().map(|band| band.samples).min().unwrap_or(0);
        }
        (statistics.rows > 0).then_some(statistics)
    }
}

/// A compensated sum, in the scene's units.
fn total(value: [f32; 4], compensation: [f32; 4], scale: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|i| (f64::from(value[i]) + f64::from(compensation[i])) / scale))
}

/// Kernels of a render.
pub(super) fn kernels(scheduler: Scheduler, settings: &Settings, needs: &Needs) -> Vec<&'static str> {
    let connects = connects(scheduler, settings, needs);
    let packets = settings.packets.unwrap_or_default();
    match scheduler {
        Scheduler::Wavefront => wavefront::kernels(settings.sort, packets, connects),
        Scheduler::Bounce => bounce::kernels(packets, connects),
        Scheduler::Megakernel => megakernel::KERNELS.to_vec(),
    }
}

/// Whether shadow rays wait in a queue for `connect`: there are some, and they are not traced where they arise.
fn connects(scheduler: Scheduler, settings: &Settings, needs: &Needs) -> bool {
    needs.shadows
        && match scheduler {
            Scheduler::Wavefront => true,
            Scheduler::Bounce => settings.shadow_rays == ShadowRays::Deferred,
            Scheduler::Megakernel => false,
        }
}

/// What a plan must know of a device.
pub(super) fn limits(device: &Device) -> DeviceLimits {
    let description = device.description();
    DeviceLimits {
        max_workgroup_size: description.max_workgroup_size,
        max_workgroups: description.max_workgroups,
        max_storage_buffer_bytes: description.max_storage_buffer_bytes,
        max_film_bytes: description.max_storage_buffer_bytes,
    }
}

/// Builds the kernels of those names, with the buffers that they bind.
pub(super) fn open_executor(
    device: &Device,
    scene: &PreparedScene,
    settings: &Settings,
    plan: &Plan,
    names: &[&str],
    options: SessionOptions,
) -> Result<Executor, RenderError> {
    if settings.packets.unwrap_or_default() != Packets::default() && !device.description().packets() {
        return Err(RenderError::NoPackets);
    }
    let edition = if options.counting { Edition::Counting } else { Edition::Plain };
    let defaults = Defaults::of(device)?;
    let arithmetic = match settings.numerics {
        // Kernels that count have no use for speed.
        _ if settings.fast_math && !options.counting => Arithmetic::Contracted,
        Numerics::Native => Arithmetic::Native,
        Numerics::Portable => Arithmetic::Portable(options.forms.unwrap_or(defaults.forms)),
    };
    let frame = scene.frame(settings, plan.path_capacity);
    let kernels: Vec<_> = names.iter().map(|name| shaders::kernel(name)).collect();
    let executor = Executor::new(
        device,
        ExecutorDescription {
            kernels: &kernels,
            specialization: &scene.specialization(settings, plan),
            buffers: scene_buffers(scene, settings, &frame)
                .chain(path_buffers(plan, settings.sort, &scene.needs(settings)))
                .collect(),
            access: options.access.unwrap_or_else(|| defaults.access(settings)),
            edition,
            arithmetic,
            driver: options.driver,
        },
    )?;
    Ok(executor)
}

/// Rays after the camera's, and shadow rays, over all bounces.
fn scattered_rays(counts: &[RayCount]) -> (u64, u64) {
    (counts.iter().skip(1).map(RayCount::rays).sum(), counts.iter().map(RayCount::shadow_rays).sum())
}

/// Buffers that the scene fills.
pub fn scene_buffers<'a>(
    scene: &'a PreparedScene,
    settings: &Settings,
    frame: &'a Frame,
) -> impl Iterator<Item = BufferRole<'a>> {
    let bytes = bytemuck::cast_slice::<Frame, u8>(std::slice::from_ref(frame));
    let uniform =
        BufferRole { name: "frame", usage: BufferUse::Uniform, size: bytes.len() as u64, contents: Some(bytes) };
    let data = |SceneBuffer { name, texel_bytes, contents, size }| BufferRole {
        name,
        usage: BufferUse::Scene { texel_bytes },
        size,
        contents: (!contents.is_empty()).then_some(contents),
    };
    std::iter::once(uniform).chain(scene.buffers(settings.specialize).into_iter().map(data))
}

/// Buffers with a record for each path in flight, or of stacks for each invocation: bytes of a record.
pub(super) fn path_records(sort: Sort, needs: &Needs) -> [(&'static str, u64); 11] {
    [
        // Two halves, but for paths that go on nowhere.
        ("ray_queue", if needs.scatters { 8 } else { 4 }),
        ("ray_origins", 16),
        ("ray_directions", 16),
        ("throughputs", 16),
        ("radiances", 16),
        ("hits", 16),
        ("shadow_origins", 16),
        ("shadow_directions", 16),
        ("shadow_radiances", 16),
        ("stack_blocks", needs.stack_bytes(1)),
        ("sorted_rays", if sort == Sort::None { 0 } else { 4 }),
    ]
}

/// Buffers of the paths in flight and of the film.
fn path_buffers<'a>(plan: &Plan, sort: Sort, needs: &Needs) -> impl Iterator<Item = BufferRole<'a>> {
    let state = |name, size| BufferRole { name, usage: BufferUse::State, size, contents: None };
    let records_of = |name| if name == "stack_blocks" { plan.stacks() } else { u64::from(plan.path_capacity) };
    // Kernels that do not sort bind one entry of the sorted queue, and never read it.
    let records = path_records(sort, needs).map(|(name, bytes)| state(name, (bytes * records_of(name)).max(16)));
    let shared = [
        state("control", size_of::<Control>() as u64),
        state("bins", size_of::<Bins>() as u64),
        state("work_counts", u64::from(STAGES * COUNTED_BOUNCES) * size_of::<WorkCount>() as u64),
        state("ray_counts", u64::from(COUNTED_BOUNCES) * size_of::<RayCount>() as u64),
        state("film", plan.film_bytes()),
    ];
    records.into_iter().chain(shared)
}
