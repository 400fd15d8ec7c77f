//! What a study asks of a renderer, and what it gets.

use std::error::Error;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::Configuration;
use crate::stats::mean;
use raywave::clocks::ClockState;
use raywave::image::Image;
use raywave::settings::Settings;

/// What a render is for. The settings of the image are the same in all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// The first render of this scene and configuration: builds what it needs, reports [`Measurement::settings`],
    /// [`Measurement::pipelines`], [`Measurement::compiled_kernels`] and the time of start-up, and hands over the
    /// image. Its times are reported separately and enter no statistic.
    First,
    /// A timed render. Everything that the first one built is kept.
    Timed,
    /// A timed render with that seed, which hands over its image. It needs no first render, and no time includes what
    /// it builds.
    Seeded(u32),
    /// A render with kernels that count their work. Its times are thrown away. A renderer that
    /// cannot count may return an empty measurement.
    Counting,
}

/// What renders for a study: the GPU, or a fake one in tests.
pub trait Renderer {
    /// Opens a scene, a path or a name as the user gave it, for [`Renderer::run`] to render, and closes the one before.
    ///
    /// # Errors
    /// A scene that cannot be read or does not fit. This ends the study.
    fn open(&mut self, scene: &str) -> Result<SceneFacts, Box<dyn Error + Send + Sync>>;

    /// Renders the open scene once, every sample of it.
    ///
    /// # Errors
    /// A configuration that this device cannot run. The study goes on without that configuration, unless the others are
    /// compared with it.
    fn run(
        &mut self,
        configuration: &Configuration,
        purpose: Purpose,
    ) -> Result<Measurement, Box<dyn Error + Send + Sync>>;
}

/// A scene, for the record.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Name for tables and plots.
    pub scene: String,
    /// BLAKE3 of the scene's files, lower-case hex.
    pub scene_hash: String,
    /// Image width.
    pub width_pixels: u32,
    /// Image height.
    pub height_pixels: u32,
    /// Samples of each pixel in one render.
    pub samples_per_pixel: u32,
    /// The settings as they were asked for, before a configuration changes them.
    #[serde(skip)]
    pub settings: Settings,
    /// Triangles of the scene.
    pub triangles: u64,
    /// Nodes of its bounding volume hierarchy.
    pub bvh_nodes: u64,
}

/// Where and how a study was made, for the record.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of raywave.
    pub raywave_version: String,
    /// The command that made the study.
    pub command_line: String,
    /// When it began, ISO 8601 with the time zone.
    pub date: String,
    /// Name that the driver gives the device.
    pub device: String,
    /// discrete, integrated, virtual, cpu or other.
    pub device_kind: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Highest Vulkan version of the device.
    pub vulkan_version: String,
    /// Lanes of a subgroup.
    pub subgroup_size_lanes: u32,
    /// Version of the compiler that built raywave.
    pub rustc_version: String,
    /// The processor, if it is the device and the system reports it.
    pub cpu: Option<Cpu>,
    /// Clocks and power limits, if the user gave them.
    pub clocks: Option<String>,
    /// Settings that all configurations share, snake_case keys with the unit in the name.
    pub settings: Map<String, Value>,
}

/// A processor.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Cpu {
    /// Its name.
    pub model: String,
    /// Logical processors that this process may use.
    pub logical_processors: usize,
    /// The fastest one's clock when the study began, if the system reports it.
    pub megahertz: Option<f64>,
}

impl fmt::Display for Cpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {} logical processors", self.model, self.logical_processors)?;
        self.megahertz.map_or(Ok(()), |megahertz| write!(f, ", {megahertz:.0} MHz"))
    }
}

/// What one render cost. Numbers that a renderer does not know stay at their default.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// From the first submission to the last result, on the host's clock.
    pub wall_seconds: f64,
    /// Inside command buffers, on the device's clock; 0 if the device has none.
    pub gpu_seconds: f64,
    /// Idle time of the device between command buffers of this render, on its own clock; `None` if it has none.
    pub idle_seconds: Option<f64>,
    /// As [`Measurement::idle_seconds`], from the end of its previous work to the start of this render.
    pub idle_before_seconds: Option<f64>,
    /// How the device was warmed up for this render; `None` if it had just been busy.
    pub warm_up: Option<WarmUpRow>,
    /// Clocks, power and temperature of the device before; `None` if nothing reports them.
    pub clocks_before: Option<ClockState>,
    /// And after.
    pub clocks_after: Option<ClockState>,
    /// Samples over all pixels.
    pub samples: u64,
    /// Samples that were NaN or infinite and were left out of the film.
    pub nonfinite_samples: u64,
    /// Rays traced.
    pub rays: Rays,
    /// Each kernel, in the order in which a bounce runs them.
    pub kernels: Vec<KernelRow>,
    /// Each kernel of each bounce.
    pub bounces: Vec<BounceRow>,
    /// Every setting, including those that the renderer chose: snake_case keys with the unit in the name; only of the
    /// first render.
    pub settings: Map<String, Value>,
    /// Compile time of each pipeline; only of the first render.
    pub pipelines: Vec<PipelineBuild>,
    /// What the compiler made of each kernel, in the order of [`Measurement::kernels`]; only of the first render.
    pub compiled_kernels: Vec<CompiledKernelRow>,
    /// From the start of a process to the end of its first sample of every pixel, with this configuration and without
    /// any cache of compiled kernels: the median of several processes. Only of the first render; `None` if that was not
    /// tried.
    pub cold_start_up_seconds: Option<f64>,
    /// As [`Measurement::cold_start_up_seconds`], with every cache filled by an earlier process.
    pub cached_start_up_seconds: Option<f64>,
    /// Device memory.
    pub memory_bytes: u64,
    /// Path state read and written by all kernels, by the sizes of the records and the items of the queues. What caches
    /// save is not known.
    pub path_state_bytes: u64,
    /// Work of traversal; only of the counting render.
    pub counters: Option<WorkCounters>,
    /// The image. The first render must have it; if another render has one, it is checked too.
    #[serde(skip)]
    pub image: Option<Image>,
}

impl Measurement {
    /// Time that it took, including the warm-up of the device.
    pub fn seconds_spent(&self) -> f64 {
        self.wall_seconds + self.warm_up.map_or(0.0, |warm_up| warm_up.seconds)
    }

    /// Clock of the device's processors, the mean of before and after, in MHz; `None` if neither is known.
    pub fn megahertz(&self) -> Option<f64> {
        let known: Vec<f64> = [&self.clocks_before, &self.clocks_after]
            .into_iter()
            .filter_map(|clocks| clocks.as_ref()?.sm_megahertz.map(f64::from))
            .collect();
        (!known.is_empty()).then(|| mean(&known))
    }

    /// Compile time of all pipelines, one after the other, with cold or with filled caches; `None` if that was not
    /// tried.
    pub fn pipeline_seconds(&self, cached: bool) -> Option<f64> {
        let seconds = |build: &PipelineBuild| if cached { build.cached_seconds } else { build.cold_seconds };
        let known: Vec<f64> = self.pipelines.iter().filter_map(seconds).collect();
        (!known.is_empty()).then(|| known.iter().sum())
    }
}

/// Work that was thrown away before a render, until the device was steady.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct WarmUpRow {
    /// Seconds of it.
    pub seconds: f64,
    /// Whether two successive windows of it agreed within 1 % before the time was up; `None` if there was time for only
    /// one.
    pub steady: Option<bool>,
}

/// Rays traced, by class.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rays {
    /// Rays from the camera.
    pub camera: u64,
    /// Rays from a scattering.
    pub bounce: u64,
    /// Rays to a light.
    pub shadow: u64,
}

impl Rays {
    /// Rays of all classes.
    pub fn total(&self) -> u64 {
        self.camera + self.bounce + self.shadow
    }
}

/// What a kernel cost over a render.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct KernelRow {
    /// Its name, as in `shaders/`.
    pub kernel: String,
    /// Time between its timestamps.
    pub gpu_seconds: f64,
    /// Dispatches.
    pub launches: u64,
}

/// What a kernel cost at one bounce, over all batches of a render.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct BounceRow {
    /// 0 for the camera's rays.
    pub bounce: u32,
    /// The kernel's name.
    pub kernel: String,
    /// Time between its timestamps.
    pub gpu_seconds: f64,
    /// Items in the queue that it processed.
    pub items: u64,
}

/// How long a pipeline took to build: its creation, and one launch without any work, which is when some drivers compile
/// it. Medians of several processes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PipelineBuild {
    /// The kernel's name.
    pub kernel: String,
    /// Without any cache; `None` if that was not tried.
    pub cold_seconds: Option<f64>,
    /// With every cache filled; `None` if that was not tried.
    pub cached_seconds: Option<f64>,
}

/// What the compiler made of a kernel, in a separate pipeline that never runs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CompiledKernelRow {
    /// The kernel's name.
    pub kernel: String,
    /// Instructions of its specialised SPIR-V that can run.
    pub spirv_instructions: u64,
    /// What the driver made of it; `None` if it does not say.
    pub executables: Option<Vec<ExecutableRow>>,
    /// Occupancy that its registers allow: share of a multiprocessor's warps, in [0, 1]; `None` if the device's limits
    /// or the kernel's registers are not known.
    pub occupancy_by_registers: Option<f64>,
}

/// Machine code that a driver made of a kernel. Names and descriptions are the driver's.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ExecutableRow {
    /// Its name.
    pub name: String,
    /// Lanes of a subgroup.
    pub subgroup_size_lanes: u32,
    /// The driver's statistics, in its order: registers, memory, size of the code.
    pub figures: Vec<FigureRow>,
}

/// A statistic that a driver reports for an executable.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FigureRow {
    /// Its name.
    pub name: String,
    /// Its description.
    pub description: String,
    /// A number, or whether something is so.
    pub value: Value,
}

/// Work of a render, counted by kernels of the counting edition.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct WorkCounters {
    /// By bounce, then by stage; stages without items are left out.
    pub stages: Vec<StageWork>,
}

/// Work of a stage at one bounce, whichever kernel does it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct StageWork {
    /// 0 for the camera's rays.
    pub bounce: u32,
    /// extend, shade or connect.
    pub stage: String,
    /// Rays traced, or vertices shaded.
    pub items: u64,
    /// Nodes that the rays visited.
    pub nodes_visited: u64,
    /// Triangles that they were tested against.
    pub triangles_tested: u64,
    /// Lanes that subgroups had for their node visits, triangle tests and shadings, active or not; 0 if the device
    /// cannot count them.
    pub lane_steps: u64,
}

impl StageWork {
    fn is_tracing(&self) -> bool {
        self.stage != "shade"
    }

    /// Node visits and triangle tests, or shadings.
    fn active_lane_steps(&self) -> u64 {
        if self.is_tracing() { self.nodes_visited + self.triangles_tested } else { self.items }
    }

    /// Share of active lanes (SIMD utilisation), in [0, 1], if the device can count them.
    pub fn active_lane_share(&self) -> Option<f64> {
        share(self.active_lane_steps(), self.lane_steps)
    }
}

fn share(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

impl WorkCounters {
    fn per_ray(&self, work: impl Fn(&StageWork) -> u64) -> f64 {
        let tracing = || self.stages.iter().filter(|stage| stage.is_tracing());
        tracing().map(work).sum::<u64>() as f64 / tracing().map(|stage| stage.items).sum::<u64>() as f64
    }

    /// Nodes visited per ray; NaN without rays.
    pub fn nodes_per_ray(&self) -> f64 {
        self.per_ray(|stage| stage.nodes_visited)
    }

    /// Triangles tested per ray; NaN without rays.
    pub fn triangles_per_ray(&self) -> f64 {
        self.per_ray(|stage| stage.triangles_tested)
    }

    /// Share of active lanes over all stages, in [0, 1], if the device can count them.
    pub fn active_lane_share(&self) -> Option<f64> {
        let sum = |of: fn(&StageWork) -> u64| self.stages.iter().map(of).sum::<u64>();
        share(sum(StageWork::active_lane_steps), sum(|stage| stage.lane_steps))
    }

    /// Work of a stage, summed over the bounces; its own bounce is 0.
    pub fn over_bounces(&self, stage: &str) -> StageWork {
        let bounces = || self.stages.iter().filter(|work| work.stage == stage);
        StageWork {
            bounce: 0,
            stage: stage.to_owned(),
            items: bounces().map(|work| work.items).sum(),
            nodes_visited: bounces().map(|work| work.nodes_visited).sum(),
            triangles_tested: bounces().map(|work| work.triangles_tested).sum(),
            lane_steps: bounces().map(|work| work.lane_steps).sum(),
        }
    }
}
