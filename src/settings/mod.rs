//! What to render and how: every setting, its text, its default and what it does to the image.
//!
//! [`Settings`] is what was asked. [`SETTINGS`] lists its fields once, for flags, files, records and studies alike. Knows
//! no scene and no device; what they decide where a setting leaves it open is up to `render`.

mod catalogue;
mod names;
mod packets;
mod quality;
mod table;

use std::ops::Range;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use catalogue::{Knob, Role, SETTINGS, Setting, Value, Values, flags, parse_count, record};
pub use names::{
    Fetch, Filter, Instances, Integrator, Name, Named, Numerics, Offsets, PathState, RouletteMode, Sampler, Scheduler,
    ShadowRays, Sort,
};
pub use packets::Packets;
pub use quality::Quality;
pub use table::markdown_rows;

use crate::bvh::BvhKind;
use crate::constants::{MATERIAL_BINS, SECOND_HALF_BIT};
use crate::image::MAX_PIXELS;

/// Most samples of a pixel: the film's sums are tested up to here.
pub const MAX_SAMPLES: u32 = 1 << 24;

/// Number of the first sample of a second half.
pub const SECOND_HALF: u32 = 1 << SECOND_HALF_BIT;

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
    #[error("a block of {0} samples cannot be halved; use a power of two up to {MAX_SAMPLES}")]
    BlockSamples(u32),
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
    /// Samples of a block, a power of two; `None` leaves it to the size of the image.
    pub block_samples: Option<u32>,
    /// Whether samples are taken in two halves that are scrambled independently, so that their difference tells the error.
    pub halves: bool,
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
    /// How the light about a pixel makes its value.
    pub filter: Filter,
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
    /// [1, [`MAX_MATERIAL_BRANCHES`]], to stand for a scene of that many BSDFs. They do not change the
    /// image.
    pub material_branches: u32,
    /// The shape of the BVH; `None` leaves it to the device.
    pub bvh: Option<BvhKind>,
    /// How meshes lie in memory that are placed more than once; `None` leaves it to the scene.
    pub instances: Option<Instances>,
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
    /// Whether kernels and buffers are for this scene alone. Without, they are for any, and the image
    /// is the same.
    pub specialize: bool,
}

impl Default for Settings {
    /// What a scene file that says nothing is rendered with.
    fn default() -> Self {
        Self {
            width: 512,
            height: 512,
            samples: 64,
            block_samples: None,
            halves: false,
            integrator: Integrator::Explicit,
            max_bounces: Some(8),
            roulette: 0.0,
            roulette_mode: RouletteMode::Constant,
            roulette_from: 3,
            sampler: Sampler::Sobol,
            filter: Filter::Box,
            clamp: None,
            seed: 0,
            scheduler: None,
            in_flight: None,
            workgroup_size: None,
            shading_cost: 0,
            material_branches: 1,
            bvh: None,
            instances: None,
            sort: Sort::None,
            shadow_rays: ShadowRays::Deferred,
            packets: None,
            paths_per_invocation: None,
            path_state: PathState::F32,
            offsets: Offsets::Robust,
            numerics: Numerics::Portable,
            fast_math: false,
            fetch: None,
            specialize: true,
        }
    }
}

impl Settings {
    /// The settings that bias the image, by the names of their flags; none where it is right in expectation.
    pub fn biased_by(&self) -> Vec<&'static str> {
        SETTINGS.iter().filter(|setting| (setting.bias)(self).is_some()).map(|setting| setting.flag).collect()
    }

    /// Vertices of the longest path: one after the last bounce, where it may still find emission.
    pub fn vertices(&self) -> u32 {
        self.max_bounces.map_or(u32::MAX, |bounces| bounces.saturating_add(1))
    }

    /// Samples of a block, whose sums are added up by itself: a block of the image, or of 64x64 pixels where it is smaller,
    /// is 2^20 samples at least.
    pub fn block_samples(&self) -> u32 {
        const BLOCK: u64 = 1 << 20;
        const LEAST: u64 = 256;
        const MOST: u64 = 1 << 14;
        let pixels = u64::from(self.width) * u64::from(self.height);
        let suits = BLOCK.div_ceil(pixels.max(1)).next_power_of_two().clamp(LEAST, MOST) as u32;
        self.block_samples.unwrap_or(suits)
    }

    /// The numbers of the first `samples` samples of each pixel: from 0 on, or half of them from 0 on and half from
    /// [`SECOND_HALF`] on.
    pub fn sample_numbers(&self, samples: u32) -> Vec<Range<u32>> {
        let first = if self.halves { samples.div_ceil(2) } else { samples };
        let second = SECOND_HALF..SECOND_HALF + samples - first;
        [0..first, second].into_iter().filter(|numbers| !numbers.is_empty()).collect()
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
        if let Some(block) = self.block_samples.filter(|block| !block.is_power_of_two() || *block > MAX_SAMPLES) {
            return Err(SettingsError::BlockSamples(block));
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
