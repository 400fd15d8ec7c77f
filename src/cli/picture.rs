//! What picture to make and on which device: the arguments that commands which render share.

use clap::ValueEnum;

use super::open_device;
use crate::bvh::BvhKind;
use crate::gpu::Device;
use crate::render::{
    Fetch, MAX_MATERIAL_BRANCHES, Numerics, Offsets, Packets, PathState, RouletteMode, Scheduler, Settings, ShadowRays,
    Sort,
};
use crate::scene::{Integrator, Sampler, Scene};

/// Arguments that say what a pixel is, in place of what the scene says.
#[derive(Debug, Clone, clap::Args)]
pub struct PictureArguments {
    /// Image width in pixels
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    width: Option<u32>,
    /// Image height in pixels
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    height: Option<u32>,
    /// Samples per pixel
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    samples: Option<u32>,
    /// Settings from a measured front of error against time, where the command line does not say
    #[arg(long, value_name = "NAME")]
    quality: Option<QualityName>,
    /// Scattering events between camera and light; -1 is unbounded and needs a roulette
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(i64).range(-1..=1_000_000))]
    max_bounces: Option<i64>,
    /// How light is gathered
    #[arg(long)]
    integrator: Option<IntegratorName>,
    /// Probability of stopping at each vertex, in [0, 1)
    #[arg(long, value_name = "Q", allow_negative_numbers = true)]
    roulette: Option<f64>,
    /// How a roulette decides; the image stays the same up to noise
    #[arg(long, value_name = "NAME")]
    roulette_mode: Option<RouletteModeName>,
    /// First vertex at which a roulette by throughput may stop a path; 0 is what the camera sees
    #[arg(long, value_name = "VERTEX", default_value_t = Settings::ROULETTE_FROM)]
    roulette_from: u32,
    /// Where random numbers come from
    #[arg(long, value_name = "NAME")]
    sampler: Option<SamplerName>,
    /// Most radiance that indirect light may bring to a sample by one vertex; BIASED: the image loses light
    #[arg(long, value_name = "RADIANCE", allow_negative_numbers = true)]
    clamp: Option<f64>,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// Device, by number or part of its name; see `raywave devices`
    #[arg(long, env = "RAYWAVE_DEVICE")]
    device: Option<String>,
    /// How the work is cut into kernels; the image is the same to the last bit; without, by device
    #[arg(long)]
    scheduler: Option<SchedulerName>,
    /// Invocations of a workgroup
    #[arg(long, value_name = "SIZE", value_parser = clap::value_parser!(u32).range(1..=1024))]
    workgroup: Option<u32>,
    /// Paths in flight
    #[arg(long, value_name = "PATHS", value_parser = clap::value_parser!(u32).range(1..))]
    in_flight: Option<u32>,
    /// Steps of arithmetic added to the shading of each hit; they change speed, not the image
    #[arg(long, value_name = "STEPS", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=32_768))]
    shading_cost: u32,
    /// Branches that the scattering of hits is spread over by triangle, as if the scene had so many BSDFs
    #[arg(long, value_name = "BRANCHES", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_MATERIAL_BRANCHES)))]
    materials: u32,
    /// Shape of the BVH; without, by device and size of the scene
    #[arg(long)]
    bvh: Option<BvhName>,
    /// How kernels read the scene's buffers; without, by device
    #[arg(long)]
    fetch: Option<FetchName>,
    /// Whether what `raywave tune` has found fastest stands in for --bvh, --fetch, --packets and --workgroup where they are not given
    #[arg(long, default_value = "on")]
    tuned: Switch,
    /// Order in which the wavefront shades
    #[arg(long, default_value = "none")]
    sort: SortName,
    /// When the bounce scheduler traces the rays to lights
    #[arg(long, value_name = "NAME", default_value = "deferred")]
    shadow_rays: ShadowRaysName,
    /// Rays of queues that subgroups trace together, in wide BVHs: none, or camera, bounce and shadow with + between them
    #[arg(long, value_name = "CLASSES")]
    packets: Option<Packets>,
    /// Paths that an invocation of the megakernel follows one after the other; above 1 no path waits for its subgroup's longest
    #[arg(long, value_name = "PATHS", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    paths_per_invocation: Option<u32>,
    /// How exactly the state of a path is kept between its vertices
    #[arg(long, value_name = "NAME", default_value = "f32")]
    path_state: PathStateName,
    /// How rays are kept from hitting the surface that they leave
    #[arg(long, value_name = "NAME", default_value = "robust")]
    offsets: OffsetsName,
    /// Who lays down quotients, roots and products of vectors where Vulkan leaves them to the driver
    #[arg(long, value_name = "NAME", default_value = "portable")]
    numerics: NumericsName,
    /// Let the driver fuse and reorder arithmetic: images are no longer equal to the last bit
    #[arg(long)]
    fast_math: bool,
    /// Whether kernels and buffers are made for what the scene needs, or for any scene; the image is the same
    #[arg(long, default_value = "on")]
    specialize: Switch,
}

/// Whether a thing is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    /// It is not
    Off,
    /// It is
    On,
}

/// Points of the fronts that `raywave tradeoff` measured; see docs/studies.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum QualityName {
    /// A few samples and bounces, for looking around; BIASED: light of later bounces is missing
    Draft,
    /// For looking at: no bias
    Balanced,
    /// For measuring against: no bias
    Reference,
}

impl QualityName {
    /// The scene's settings at this quality.
    fn of(self, given: Settings) -> Settings {
        let (integrator, sampler) = (Integrator::Mis, Sampler::Sobol);
        let samples = match self {
            Self::Draft => 4,
            Self::Balanced => 64,
            Self::Reference => 4096,
        };
        let max_bounces = match self {
            Self::Draft => Some(given.max_bounces.map_or(DRAFT_BOUNCES, |bounces| bounces.min(DRAFT_BOUNCES))),
            Self::Balanced | Self::Reference => given.max_bounces,
        };
        Settings { samples, integrator, sampler, max_bounces, roulette_mode: RouletteMode::Throughput, ..given }
    }
}

/// Bounces of a draft at most.
const DRAFT_BOUNCES: u32 = 4;

#[derive(Debug, Clone, Copy, ValueEnum)]
enum IntegratorName {
    /// BRDF importance sampling alone
    Implicit,
    /// A light sample at every vertex
    Explicit,
    /// Both, weighted by their densities: the power heuristic
    Mis,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RouletteModeName {
    /// Every vertex stops the path with probability q
    Constant,
    /// Paths survive by their throughput, and by 1 - q at most
    Throughput,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SamplerName {
    /// Numbers that know nothing of each other
    Independent,
    /// An Owen-scrambled Sobol sequence in each pixel
    Sobol,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SchedulerName {
    /// A kernel a stage, queues between them
    Wavefront,
    /// A kernel that takes paths to their next surface and shades it, a queue between bounces
    Bounce,
    /// One kernel that follows a path from the camera to its end
    Megakernel,
}

/// Shapes of BVH, as the command line has them.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum BvhName {
    /// No tree: up to 63 triangles, compiled into the kernels
    List,
    /// Two children a node
    Bvh2,
    /// Four children a node, boxes in 8 bits
    Bvh4,
    /// Eight children a node, boxes in 8 bits
    Cwbvh,
}

/// Ways to read the scene's buffers, as the command line has them.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum FetchName {
    /// As texel buffers
    Texel,
    /// As storage buffers
    Storage,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SortName {
    /// As the rays were queued
    None,
    /// By kind of surface, or by branch with --materials
    Material,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ShadowRaysName {
    /// By a kernel of their own, from a queue
    Deferred,
    /// Where they arise
    AtOnce,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PathStateName {
    /// In floats
    F32,
    /// Throughput in halves, rounded at random, and directions in 48 bits: less memory, the same image in expectation
    F16,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum NumericsName {
    /// raywave: the same image on every device, to the last bit
    Portable,
    /// The driver: the same image on this device and driver alone
    Native,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OffsetsName {
    /// By a bound of the rounding error, and the triangle is remembered
    Robust,
    /// By 1e-4 of the scene; BIASED where surfaces are closer than that
    Fixed,
}

impl PictureArguments {
    /// The scene's settings, with what the command line says instead.
    ///
    /// # Errors
    /// Settings that make no sense together.
    pub fn settings(&self, scene: &Scene) -> anyhow::Result<Settings> {
        let given = self.quality.map_or(Settings::of(scene), |quality| quality.of(Settings::of(scene)));
        let settings = Settings {
            width: self.width.unwrap_or(given.width),
            height: self.height.unwrap_or(given.height),
            samples: self.samples.unwrap_or(given.samples),
            integrator: match self.integrator {
                Some(IntegratorName::Implicit) => Integrator::Implicit,
                Some(IntegratorName::Explicit) => Integrator::Explicit,
                Some(IntegratorName::Mis) => Integrator::Mis,
                None => given.integrator,
            },
            max_bounces: self.max_bounces.map_or(given.max_bounces, |bounces| u32::try_from(bounces).ok()),
            roulette: self.roulette.unwrap_or(given.roulette),
            roulette_mode: match self.roulette_mode {
                Some(RouletteModeName::Constant) => RouletteMode::Constant,
                Some(RouletteModeName::Throughput) => RouletteMode::Throughput,
                None => given.roulette_mode,
            },
            roulette_from: self.roulette_from,
            sampler: match self.sampler {
                Some(SamplerName::Independent) => Sampler::Independent,
                Some(SamplerName::Sobol) => Sampler::Sobol,
                None => given.sampler,
            },
            clamp: self.clamp,
            seed: self.seed,
            scheduler: self.scheduler.map(|name| match name {
                SchedulerName::Wavefront => Scheduler::Wavefront,
                SchedulerName::Bounce => Scheduler::Bounce,
                SchedulerName::Megakernel => Scheduler::Megakernel,
            }),
            in_flight: self.in_flight,
            workgroup_size: self.workgroup,
            shading_cost: self.shading_cost,
            material_branches: self.materials,
            bvh: self.bvh.map(Into::into),
            sort: match self.sort {
                SortName::None => Sort::None,
                SortName::Material => Sort::Material,
            },
            shadow_rays: match self.shadow_rays {
                ShadowRaysName::Deferred => ShadowRays::Deferred,
                ShadowRaysName::AtOnce => ShadowRays::AtOnce,
            },
            packets: self.packets,
            paths_per_invocation: self.paths_per_invocation,
            path_state: match self.path_state {
                PathStateName::F32 => PathState::F32,
                PathStateName::F16 => PathState::F16,
            },
            offsets: match self.offsets {
                OffsetsName::Robust => Offsets::Robust,
                OffsetsName::Fixed => Offsets::Fixed,
            },
            numerics: match self.numerics {
                NumericsName::Portable => Numerics::Portable,
                NumericsName::Native => Numerics::Native,
            },
            fast_math: self.fast_math,
            fetch: self.fetch.map(Into::into),
            tuned: false,
            specialize: self.specialize == Switch::On,
        };
        settings.validate()?;
        Ok(settings)
    }

    /// Whether the command line says how many samples there are.
    pub fn has_samples(&self) -> bool {
        self.samples.is_some() || self.quality.is_some()
    }

    /// Opens the device that is wanted, or the best one.
    ///
    /// # Errors
    /// No Vulkan, no such device.
    pub fn open_device(&self) -> anyhow::Result<Device> {
        open_device(self.device())
    }

    /// Whether tunings are wanted.
    pub fn tuned(&self) -> bool {
        self.tuned == Switch::On
    }

    /// The device that is wanted, by number or part of its name.
    pub fn device(&self) -> Option<&str> {
        self.device.as_deref()
    }
}

/// Name of an integrator, as the command line and the scene file have it.
pub fn integrator_name(integrator: Integrator) -> &'static str {
    match integrator {
        Integrator::Implicit => "implicit",
        Integrator::Explicit => "explicit",
        Integrator::Mis => "mis",
    }
}

/// Name of a way that a roulette decides, as the command line has it.
pub fn roulette_mode_name(mode: RouletteMode) -> &'static str {
    match mode {
        RouletteMode::Constant => "constant",
        RouletteMode::Throughput => "throughput",
    }
}

/// Name of a sampler, as the command line and the scene file have it.
pub fn sampler_name(sampler: Sampler) -> &'static str {
    match sampler {
        Sampler::Independent => "independent",
        Sampler::Sobol => "sobol",
    }
}

impl From<BvhName> for BvhKind {
    fn from(name: BvhName) -> Self {
        match name {
            BvhName::List => Self::List,
            BvhName::Bvh2 => Self::Bvh2,
            BvhName::Bvh4 => Self::Bvh4,
            BvhName::Cwbvh => Self::Cwbvh,
        }
    }
}

/// Name of a shape of BVH, as the command line has it.
pub fn bvh_name(kind: BvhKind) -> &'static str {
    match kind {
        BvhKind::List => "list",
        BvhKind::Bvh2 => "bvh2",
        BvhKind::Bvh4 => "bvh4",
        BvhKind::Cwbvh => "cwbvh",
    }
}

impl From<FetchName> for Fetch {
    fn from(name: FetchName) -> Self {
        match name {
            FetchName::Texel => Self::Texel,
            FetchName::Storage => Self::Storage,
        }
    }
}

/// Name of a way to read the scene's buffers, as the command line has it.
pub fn fetch_name(fetch: Fetch) -> &'static str {
    match fetch {
        Fetch::Texel => "texel",
        Fetch::Storage => "storage",
    }
}

/// Name of how exactly path state is kept, as the command line has it.
pub fn path_state_name(path_state: PathState) -> &'static str {
    match path_state {
        PathState::F32 => "f32",
        PathState::F16 => "f16",
    }
}

/// Name of a way to leave surfaces, as the command line has it.
pub fn numerics_name(numerics: Numerics) -> &'static str {
    match numerics {
        Numerics::Portable => "portable",
        Numerics::Native => "native",
    }
}

pub fn offsets_name(offsets: Offsets) -> &'static str {
    match offsets {
        Offsets::Robust => "robust",
        Offsets::Fixed => "fixed",
    }
}

/// Name of an order of shading, as the command line has it.
pub fn sort_name(sort: Sort) -> &'static str {
    match sort {
        Sort::None => "none",
        Sort::Material => "material",
    }
}

/// Name of a time to trace shadow rays, as the command line has it.
pub fn shadow_rays_name(shadow_rays: ShadowRays) -> &'static str {
    match shadow_rays {
        ShadowRays::Deferred => "deferred",
        ShadowRays::AtOnce => "at-once",
    }
}

/// Name of a scheduler, as the command line has it.
pub fn scheduler_name(scheduler: Scheduler) -> &'static str {
    match scheduler {
        Scheduler::Wavefront => "wavefront",
        Scheduler::Bounce => "bounce",
        Scheduler::Megakernel => "megakernel",
    }
}
