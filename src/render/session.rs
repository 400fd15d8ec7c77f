//! A render on a device: uploads the scene, runs batch after batch, reads the film.

use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};
use std::time::{Duration, Instant};

use glam::DVec3;
use thiserror::Error;

use super::plan::{DeviceLimits, Plan, SampleRange, Tile};
use super::prepare::{Needs, PrepareError, PreparedScene, SceneBuffer};
use super::settings::{Fetch, Numerics, Packets, Scheduler, Settings, ShadowRays, Sort};
use super::{batch, bounce, megakernel, wavefront};
use crate::bvh::BvhKind;
use crate::constants::{COUNTED_BOUNCES, STAGES};
use crate::film::FilmMoments;
use crate::gpu::{BufferRole, BufferUse, Device, Executor, ExecutorDescription, GpuError, KernelTime};
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
    /// Samples of each pixel in the image.
    pub samples: u32,
    /// Rows of the image, from the top, that have samples: all of them, unless a render of several
    /// tiles was broken off.
    pub rows: u32,
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
        let (levels, needs) = (scene.levels(), scene.needs(settings));
        let scheduler = settings.scheduler_for(limits.software, device.description().subgroup_size, levels);
        let limits = DeviceLimits { max_film_bytes, ..limits };
        let plan = Plan::new(settings, scheduler, levels, needs.stack_bytes(1), &limits);
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

    /// Time until all kernels were built.
    pub fn pipelines_time(&self) -> Duration {
        self.executor.pipelines_time()
    }

    /// Time that the driver took to build each kernel, by name. Kernels are built side by side, so that these may add
    /// up to more than the time of all.
    pub fn pipeline_times(&self) -> impl Iterator<Item = (&'static str, Duration)> {
        self.executor.pipeline_times()
    }

    /// As [`Session::render_tiles`], with the tiles put together.
    ///
    /// # Errors
    /// When the device fails.
    pub fn render(&mut self, progress: impl FnMut(&Progress) -> ControlFlow<()>) -> Result<Outcome, RenderError> {
        let mut film: Option<FilmMoments> = None;
        let statistics = self.render_tiles(progress, |tile| match &mut film {
            None => film = Some(tile),
            Some(film) => film.append(tile),
        })?;
        Ok(Outcome { film: film.expect("a render has a tile"), statistics })
    }

    /// Renders all samples of one tile after the other, from the top, and hands each to `finished`.
    /// `progress` is called after each batch. When it breaks, the render ends with the tiles that
    /// are finished, so that all pixels have equal samples; in the first one, the samples that are
    /// begun are finished for all of its pixels.
    ///
    /// # Errors
    /// When the device fails.
    pub fn render_tiles(
        &mut self,
        mut progress: impl FnMut(&Progress) -> ControlFlow<()>,
        mut finished: impl FnMut(FilmMoments),
    ) -> Result<Statistics, RenderError> {
        self.clear()?;
        let start = Instant::now();
        let samples_total = self.plan.pixels() * u64::from(self.settings.samples);
        let mut samples_done = 0;
        let mut samples = self.settings.samples;
        let (mut rows, mut wall_time) = (0, Duration::ZERO);
        let mut stopping = false;
        let mut counted = start;
        let mut rays_per_sample = 1.0;
        'tiles: for tile in self.plan.tiles() {
            if tile.first_row > 0 {
                self.executor.clear("film")?;
            }
            for range in self.plan.batches(tile, 0..self.settings.samples) {
                if stopping && rows > 0 {
                    break 'tiles;
                }
                // Equal samples end where a batch would begin the next ones.
                if stopping && range.film_pixel == 0 {
                    samples = range.first_sample;
                    break;
                }
                self.render_batch(range)?;
                samples_done += u64::from(range.pixel_count) * u64::from(range.sample_count);
                if counted.elapsed() > COUNT_INTERVAL {
                    let (bounce_rays, shadow_rays) = scattered_rays(&self.ray_counts()?);
                    let scattered = bounce_rays + shadow_rays;
                    rays_per_sample = 1.0 + scattered as f64 / samples_done as f64;
                    counted = Instant::now();
                }
                let rays = (samples_done as f64 * rays_per_sample) as u64;
                let state = Progress { samples_done, samples_total, rays, elapsed: start.elapsed() };
                stopping |= progress(&state).is_break();
            }
            rows += tile.rows;
            self.executor.wait()?;
            wall_time = start.elapsed();
            finished(self.moments(tile, samples)?);
            if stopping {
                break;
            }
        }
        self.statistics(samples, rows, samples_done, wall_time)
    }

    /// Starts the sums and counts anew.
    pub(super) fn clear(&mut self) -> Result<(), GpuError> {
        self.executor.clear("film")?;
        self.executor.clear("ray_counts")?;
        if self.counting {
            self.executor.clear("work_counts")?;
        }
        self.executor.forget_times();
        let mut control: Control = bytemuck::Zeroable::zeroed();
        (control.ray_groups, control.shadow_groups) = ([0, 1, 1], [0, 1, 1]);
        self.executor.write("control", bytemuck::bytes_of(&control))
    }

    /// Takes a batch from the camera to the film.
    fn render_batch(&mut self, range: SampleRange) -> Result<(), GpuError> {
        let mut recording = Recording::default();
        match self.scheduler {
            Scheduler::Wavefront | Scheduler::Bounce => {
                batch::begin(&mut recording, &self.plan, range);
                self.advance_to_the_end(&mut recording, range)?;
            }
            Scheduler::Megakernel => megakernel::follow(&mut recording, &self.plan, range),
        }
        batch::end(&mut recording, &self.plan, range);
        self.executor.submit(&recording)
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
            self.executor.submit(&std::mem::take(recording))?;
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
        Ok(bytemuck::pod_read_unaligned(&self.executor.read("control")?))
    }

    fn ray_counts(&mut self) -> Result<Vec<RayCount>, GpuError> {
        Ok(bytemuck::pod_collect_to_vec(&self.executor.read("ray_counts")?))
    }

    /// Reads the film of a tile.
    fn moments(&mut self, tile: Tile, samples: u32) -> Result<FilmMoments, GpuError> {
        let mut pixels: Vec<FilmPixel> = bytemuck::pod_collect_to_vec(&self.executor.read("film")?);
        // The last tile may have fewer rows than the buffer.
        pixels.truncate((tile.rows * self.plan.width) as usize);
        let total = |value: [f32; 4], compensation: [f32; 4], scale: f64| {
            DVec3::from_array(std::array::from_fn(|i| (f64::from(value[i]) + f64::from(compensation[i])) / scale))
        };
        let scale = self.radiance_scale;
        Ok(FilmMoments {
            width: self.plan.width,
            height: tile.rows,
            samples: u64::from(samples),
            sum: pixels.iter().map(|p| total(p.sum, p.sum_compensation, scale)).collect(),
            sum_of_squares: pixels.iter().map(|p| total(p.squares, p.squares_compensation, scale * scale)).collect(),
        })
    }

    fn statistics(
        &mut self,
        samples: u32,
        rows: u32,
        sample_count: u64,
        wall_time: Duration,
    ) -> Result<Statistics, RenderError> {
        let control = self.control()?;
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
        Ok(Statistics {
            samples,
            rows,
            tile_rows: self.plan.tile_rows,
            sample_count,
            camera_rays: sample_count,
            bounce_rays,
            shadow_rays,
            nonfinite_samples: control.nonfinite_samples,
            nonfinite_traced,
            wall_time,
            gpu_seconds: self.executor.device_seconds(),
            passes: self.executor.kernel_times().clone(),
            ray_counts,
            memory_bytes: self.executor.memory_bytes(),
            scheduler: self.scheduler,
            paths_in_flight: self.plan.path_capacity,
            workgroup_size: self.plan.workgroup_size,
            paths_per_invocation: self.plan.paths_per_invocation,
            bvh: self.bvh,
            texel_fetch: self.executor.access().texel_fetch,
            work_counts,
        })
    }
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
        software: description.is_software(),
    }
}

/// What portable quotients and roots are made of on a device: its own, where it is known to round them right.
pub fn forms_for(device: &Device) -> Forms {
    if device.description().is_software() { Forms::NATIVE } else { Forms::CAREFUL }
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
    let arithmetic = match settings.numerics {
        // Kernels that count have no use for speed.
        _ if settings.fast_math && !options.counting => Arithmetic::Contracted,
        Numerics::Native => Arithmetic::Native,
        Numerics::Portable => Arithmetic::Portable(options.forms.unwrap_or_else(|| forms_for(device))),
    };
    let access = settings.fetch.map(|fetch| Access { texel_fetch: fetch == Fetch::Texel, subgroup_ballot: true });
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
            access: options.access.or(access),
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
