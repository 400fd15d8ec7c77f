//! What to render and how, resolved from scene file and command line.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::scene::{Integrator, Scene};

/// Most samples of a pixel: the film's sums are tested up to here.
pub const MAX_SAMPLES: u32 = 1 << 24;

/// Settings that make no sense.
#[derive(Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum SettingsError {
    #[error(
        "{0} samples per pixel are asked for and {MAX_SAMPLES} is the most; use several renders of other --seed and average them"
    )]
    TooManySamples(u32),
    #[error("roulette {0} is not a probability of stopping; use a number from 0 up to, not including, 1")]
    Roulette(f64),
    #[error("unbounded paths never end without a roulette; set --roulette above 0, or --max-bounces")]
    Endless,
}

/// Settings of a render. All of them are in its metadata.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Image width in pixels, at least 1.
    pub width: u32,
    /// Image height in pixels, at least 1.
    pub height: u32,
    /// Samples per pixel, at least 1.
    pub samples: u32,
    /// How light is gathered.
    pub integrator: Integrator,
    /// Scattering events between camera and light; `None` is unbounded.
    pub max_bounces: Option<u32>,
    /// Probability q of stopping at each vertex, in [0, 1); above 0 where bounces are unbounded.
    pub roulette: f64,
    /// Seed of the random numbers.
    pub seed: u32,
    /// How the work is cut into kernels.
    pub scheduler: Scheduler,
    /// Paths in flight; `None` leaves it to the device.
    pub in_flight: Option<u32>,
    /// Invocations of a workgroup, a power of two; `None` leaves it to the device.
    pub workgroup_size: Option<u32>,
    /// Dependent steps of arithmetic added to the shading of each hit, to stand for a costlier
    /// material. They do not change the image.
    pub shading_cost: u32,
}

/// How the work is cut into kernels. The image is the same to the last bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Scheduler {
    /// A kernel a stage, queues between them.
    Wavefront,
    /// One kernel that follows a path from the camera to its end.
    Megakernel,
}

impl Settings {
    /// What the scene asks for.
    pub fn of(scene: &Scene) -> Self {
        Self {
            width: scene.width,
            height: scene.height,
            samples: scene.defaults.samples,
            integrator: scene.defaults.integrator,
            max_bounces: scene.defaults.max_bounces,
            roulette: scene.defaults.roulette,
            seed: 0,
            scheduler: Scheduler::Wavefront,
            in_flight: None,
            workgroup_size: None,
            shading_cost: 0,
        }
    }

    /// Whether they make sense together.
    ///
    /// # Errors
    /// Says which does not.
    pub fn validate(&self) -> Result<(), SettingsError> {
        if self.samples > MAX_SAMPLES {
            return Err(SettingsError::TooManySamples(self.samples));
        }
        if !(0.0..1.0).contains(&self.roulette) {
            return Err(SettingsError::Roulette(self.roulette));
        }
        if self.max_bounces.is_none() && self.roulette == 0.0 {
            return Err(SettingsError::Endless);
        }
        Ok(())
    }
}
