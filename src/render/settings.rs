//! What to render and how, resolved from scene file and command line.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::bvh::BvhKind;
use crate::constants::MATERIAL_BINS;
use crate::image::MAX_PIXELS;
use crate::rays::RayClass;
use crate::scene::{Integrator, Sampler, Scene};

/// Most samples of a pixel: the film's sums are tested up to here.
pub const MAX_SAMPLES: u32 = 1 << 24;

/// Most branches of [`Settings::material_branches`]: each is a bin of the sort, and misses have one.
pub const MAX_MATERIAL_BRANCHES: u32 = MATERIAL_BINS - 1;

/// Settings that make no sense.
#[derive(Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum SettingsError {
    #[error(
        "an image of {width}x{height} has {} pixels and {MAX_PIXELS} is the most; use a smaller --width or --height",
        u64::from(*width) * u64::from(*height)
    )]
    TooManyPixels { width: u32, height: u32 },
    #[error(
        "{0} samples per pixel are asked for and {MAX_SAMPLES} is the most; use several renders of other --seed and average them"
    )]
    TooManySamples(u32),
    #[error("roulette {0} is not a probability of stopping; use a number from 0 up to, not including, 1")]
    Roulette(f64),
    #[error("a clamp of {0} lets no light through or all of it; use a radiance above 0, or leave it out")]
    Clamp(f64),
    #[error("{0} material branches are asked for; use 1 to {MAX_MATERIAL_BRANCHES}")]
    MaterialBranches(u32),
    #[error("unbounded paths never end without a roulette; set --roulette above 0, or --max-bounces")]
    Endless,
}

/// Settings of a render. All of them are in its metadata.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Image width in pixels, at least 1.
    pub width: u32,
    /// Image height in pixels, at least 1; with the width at most [`MAX_PIXELS`] pixels.
    pub height: u32,
    /// Samples per pixel, at least 1.
    pub samples: u32,
    /// How light is gathered.
    pub integrator: Integrator,
    /// Scattering events between camera and light; `None` is unbounded.
    pub max_bounces: Option<u32>,
    /// Probability q of stopping at each vertex, in [0, 1); above 0 where bounces are unbounded.
    pub roulette: f64,
    /// How a roulette decides, where there is one.
    pub roulette_mode: RouletteMode,
    /// The first vertex at which a roulette by throughput may stop a path; 0 is what the camera sees.
    pub roulette_from: u32,
    /// Where random numbers come from.
    pub sampler: Sampler,
    /// Most radiance, in any channel, that indirect light may bring by one vertex: light of two bounces
    /// and more. It takes fireflies away, and energy with them: the image is biased. `None` is unbiased.
    pub clamp: Option<f64>,
    /// Seed of the random numbers.
    pub seed: u32,
    /// How the work is cut into kernels; `None` leaves it to the device.
    pub scheduler: Option<Scheduler>,
    /// Paths in flight; `None` leaves it to the device.
    pub in_flight: Option<u32>,
    /// Invocations of a workgroup, a power of two; `None` leaves it to the device.
    pub workgroup_size: Option<u32>,
    /// Dependent steps of arithmetic added to the shading of each hit, to stand for a costlier
    /// material. They do not change the image.
    pub shading_cost: u32,
    /// Branches that the scattering of hits is spread over by their triangle, in
    /// [1, [`MAX_MATERIAL_BRANCHES`]], to stand for a scene of so many BSDFs. They do not change the
    /// image.
    pub material_branches: u32,
    /// The shape of the BVH; `None` leaves it to the device.
    pub bvh: Option<BvhKind>,
    /// The order in which the wavefront shades.
    pub sort: Sort,
    /// When the bounce scheduler traces the rays to lights.
    pub shadow_rays: ShadowRays,
    /// Which rays of queues are traced by packets; `None` leaves it to a tuning.
    pub packets: Option<Packets>,
    /// Paths that an invocation of the megakernel follows one after the other, at least 1. Above 1
    /// it takes a new path as soon as one has ended, and none waits for its subgroup's longest.
    /// `None` leaves it to the device.
    pub paths_per_invocation: Option<u32>,
    /// How exactly the state of a path is kept between its vertices.
    pub path_state: PathState,
    /// How rays are kept from hitting the surface that they leave.
    pub offsets: Offsets,
    /// Who lays down what arithmetic gives where Vulkan does not.
    pub numerics: Numerics,
    /// Whether the driver may fuse and reorder arithmetic, whatever `numerics` says. The image is then no longer the same to
    /// the last bit between schedulers.
    pub fast_math: bool,
    /// How kernels read the scene's buffers; `None` leaves it to the device.
    pub fetch: Option<Fetch>,
    /// Whether a tuning chose some of what the user left open. For the record: what it chose stands
    /// in the settings themselves.
    pub tuned: bool,
    /// Whether kernels and buffers are for this scene alone. Without, they are for any, and the image
    /// is the same.
    pub specialize: bool,
}

/// How exactly the state of a path is kept between its vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PathState {
    /// As it was computed, in floats.
    F32,
    /// Throughput in halves, rounded at random so that the image is the same in expectation, and
    /// directions in 48 bits. A throughput above 65,504 is cut to it.
    F16,
}

/// How rays are kept from hitting the surface that they leave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Offsets {
    /// They begin as far off it as rounding can err there, and remember its triangle.
    Robust,
    /// They begin 10⁻⁴ normalised lengths off it. What is nearer than that is not seen.
    Fixed,
}

/// Who lays down what arithmetic gives where Vulkan leaves it to the driver: quotients, roots, dot and cross products,
/// and functions made of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Numerics {
    /// raywave: the image is the same on every device, to the last bit.
    Portable,
    /// The driver: the image is the same on one device and driver alone, whatever the scheduler.
    Native,
}

/// How a roulette decides. Either way the image stays the same in expectation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum RouletteMode {
    /// Every vertex stops the path with probability q.
    Constant,
    /// From a vertex on the path survives with the probability of its throughput, the largest channel,
    /// and of 1 - q at most.
    Throughput,
}

/// How kernels read the scene's buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Fetch {
    /// As texel buffers, where the scene is not too large for the device's.
    Texel,
    /// As storage buffers.
    Storage,
}

/// Rays that wide trees are walked for by packets: the rays of a subgroup visit every node that one of them
/// meets, so that none waits for another. Good for rays that are alike.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Packets {
    /// Rays from the camera.
    pub camera: bool,
    /// Rays from a scattering.
    pub bounce: bool,
    /// Rays to a light that are traced from a queue.
    pub shadow: bool,
}

impl Packets {
    /// Whether rays of a class are in packets.
    pub fn has(self, class: RayClass) -> bool {
        match class {
            RayClass::Camera => self.camera,
            RayClass::Bounce => self.bounce,
            RayClass::Shadow => self.shadow,
        }
    }

    /// The same with a class in packets or not.
    pub fn with(mut self, class: RayClass, is: bool) -> Self {
        match class {
            RayClass::Camera => self.camera = is,
            RayClass::Bounce => self.bounce = is,
            RayClass::Shadow => self.shadow = is,
        }
        self
    }

    /// The kernel that takes rays after so many bounces to their next surface.
    pub(super) fn kernel_at(self, bounce: u32, single: &'static str, packets: &'static str) -> &'static str {
        let class = if bounce == 0 { RayClass::Camera } else { RayClass::Bounce };
        if self.has(class) { packets } else { single }
    }

    /// Those kernels.
    pub(super) fn kernels(self, single: &'static str, packets: &'static str) -> Vec<&'static str> {
        let mut kernels = vec![self.kernel_at(0, single, packets), self.kernel_at(1, single, packets)];
        kernels.dedup();
        kernels
    }

    /// The kernel that traces the rays to lights.
    pub(super) fn connect(self) -> &'static str {
        if self.shadow { "connect_packets" } else { "connect" }
    }
}

const CLASSES: [(RayClass, &str); 3] =
    [(RayClass::Camera, "camera"), (RayClass::Bounce, "bounce"), (RayClass::Shadow, "shadow")];

/// Classes of rays with a plus between them, or `none`.
impl fmt::Display for Packets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let classes: Vec<_> = CLASSES.iter().filter(|(class, _)| self.has(*class)).map(|(_, name)| *name).collect();
        f.write_str(if classes.is_empty() { "none".to_owned() } else { classes.join("+") }.as_str())
    }
}

impl FromStr for Packets {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "none" {
            return Ok(Self::default());
        }
        text.split('+').try_fold(Self::default(), |packets, name| {
            let class = CLASSES.iter().find(|(_, class)| *class == name);
            let (class, _) = class.ok_or("use none, or camera, bounce and shadow with + between them")?;
            Ok(packets.with(*class, true))
        })
    }
}

/// How rays are traced: what a tuning chooses. Whatever it is, the image stays the same to the last bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Traversal {
    /// Shape of the BVH.
    pub bvh: BvhKind,
    /// How kernels read the scene's buffers.
    pub fetch: Fetch,
    /// Invocations of a workgroup.
    pub workgroup_size: u32,
    /// Whether they are in packets, which each class of rays decides for itself.
    pub packets: bool,
}

impl Traversal {
    /// What all kernels of a render share, whatever rays they trace.
    pub fn shared(&self) -> Self {
        Self { packets: false, ..*self }
    }
}

/// The order in which the wavefront shades.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Sort {
    /// As the rays were queued.
    None,
    /// By what was hit: the kind of surface, or the material branch where there are several.
    Material,
}

/// When the bounce scheduler traces the rays to lights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ShadowRays {
    /// By a kernel of their own, from a queue, so that every lane has one.
    Deferred,
    /// Where they arise: nothing of them is written down, and lanes without one wait.
    AtOnce,
}

/// How the work is cut into kernels. The image is the same to the last bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Scheduler {
    /// A kernel a stage, queues between them.
    Wavefront,
    /// A kernel that takes paths to their next surface and shades it, a queue between bounces.
    Bounce,
    /// One kernel that follows a path from the camera to its end.
    Megakernel,
}

impl Settings {
    /// Vertices that a roulette by throughput leaves alone where the user does not say: most of the light
    /// comes by these.
    pub const ROULETTE_FROM: u32 = 3;

    /// What the scene asks for.
    pub fn of(scene: &Scene) -> Self {
        Self {
            width: scene.width,
            height: scene.height,
            samples: scene.defaults.samples,
            integrator: scene.defaults.integrator,
            max_bounces: scene.defaults.max_bounces,
            roulette: scene.defaults.roulette,
            roulette_mode: RouletteMode::Constant,
            roulette_from: Self::ROULETTE_FROM,
            sampler: scene.defaults.sampler,
            clamp: None,
            seed: 0,
            scheduler: None,
            in_flight: None,
            workgroup_size: None,
            shading_cost: 0,
            material_branches: 1,
            bvh: None,
            sort: Sort::None,
            shadow_rays: ShadowRays::Deferred,
            packets: None,
            paths_per_invocation: None,
            path_state: PathState::F32,
            offsets: Offsets::Robust,
            numerics: Numerics::Portable,
            fast_math: false,
            fetch: None,
            tuned: false,
            specialize: true,
        }
    }

    /// The settings that make the image another one in expectation, by name; none where it is right.
    pub fn biased_by(&self) -> Vec<&'static str> {
        let clamp = self.clamp.map(|_| "clamp");
        let offsets = (self.offsets == Offsets::Fixed).then_some("offsets");
        clamp.into_iter().chain(offsets).collect()
    }

    /// Whether they make sense together.
    ///
    /// # Errors
    /// Says which does not.
    pub fn validate(&self) -> Result<(), SettingsError> {
        let (width, height) = (self.width, self.height);
        if u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(SettingsError::TooManyPixels { width, height });
        }
        if self.samples > MAX_SAMPLES {
            return Err(SettingsError::TooManySamples(self.samples));
        }
        if !(0.0..1.0).contains(&self.roulette) {
            return Err(SettingsError::Roulette(self.roulette));
        }
        if let Some(clamp) = self.clamp.filter(|clamp| !(*clamp as f32 > 0.0 && clamp.is_finite())) {
            return Err(SettingsError::Clamp(clamp));
        }
        if !(1..=MAX_MATERIAL_BRANCHES).contains(&self.material_branches) {
            return Err(SettingsError::MaterialBranches(self.material_branches));
        }
        if self.max_bounces.is_none() && self.roulette == 0.0 {
            return Err(SettingsError::Endless);
        }
        Ok(())
    }
}
