//! What picture to make and on which device: the arguments that commands which render share.

use std::sync::Arc;

use clap::ValueEnum;

use crate::gpu::{Device, Instance};
use crate::render::{Scheduler, Settings};
use crate::scene::{Integrator, Scene};

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
    /// Scattering events between camera and light; -1 is unbounded and needs a roulette
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(i64).range(-1..=1_000_000))]
    max_bounces: Option<i64>,
    /// How light is gathered
    #[arg(long)]
    integrator: Option<IntegratorName>,
    /// Probability of stopping at each vertex, in [0, 1)
    #[arg(long, value_name = "Q", allow_negative_numbers = true)]
    roulette: Option<f64>,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// Device, by number or part of its name; see `raywave devices`
    #[arg(long, env = "RAYWAVE_DEVICE")]
    device: Option<String>,
    /// How the work is cut into kernels; the image is the same to the last bit
    #[arg(long, default_value = "wavefront")]
    scheduler: SchedulerName,
    /// Invocations of a workgroup
    #[arg(long, value_name = "SIZE", value_parser = clap::value_parser!(u32).range(1..=1024))]
    workgroup: Option<u32>,
    /// Paths in flight
    #[arg(long, value_name = "PATHS", value_parser = clap::value_parser!(u32).range(1..))]
    in_flight: Option<u32>,
    /// Steps of arithmetic added to the shading of each hit; they change speed, not the image
    #[arg(long, value_name = "STEPS", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=32_768))]
    shading_cost: u32,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum IntegratorName {
    /// BRDF importance sampling alone
    Implicit,
    /// A light sample at every vertex
    Explicit,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SchedulerName {
    /// A kernel a stage, queues between them
    Wavefront,
    /// One kernel that follows a path from the camera to its end
    Megakernel,
}

impl PictureArguments {
    /// The scene's settings, with what the command line says instead.
    ///
    /// # Errors
    /// Settings that make no sense together.
    pub fn settings(&self, scene: &Scene) -> anyhow::Result<Settings> {
        let given = Settings::of(scene);
        let settings = Settings {
            width: self.width.unwrap_or(given.width),
            height: self.height.unwrap_or(given.height),
            samples: self.samples.unwrap_or(given.samples),
            integrator: match self.integrator {
                Some(IntegratorName::Implicit) => Integrator::Implicit,
                Some(IntegratorName::Explicit) => Integrator::Explicit,
                None => given.integrator,
            },
            max_bounces: self.max_bounces.map_or(given.max_bounces, |bounces| u32::try_from(bounces).ok()),
            roulette: self.roulette.unwrap_or(given.roulette),
            seed: self.seed,
            scheduler: match self.scheduler {
                SchedulerName::Wavefront => Scheduler::Wavefront,
                SchedulerName::Megakernel => Scheduler::Megakernel,
            },
            in_flight: self.in_flight,
            workgroup_size: self.workgroup,
            shading_cost: self.shading_cost,
        };
        settings.validate()?;
        Ok(settings)
    }

    /// Opens the device that is wanted, or the best one.
    ///
    /// # Errors
    /// No Vulkan, no such device.
    pub fn open_device(&self) -> anyhow::Result<Device> {
        open_device(self.device.as_deref())
    }
}

/// Opens the device of that number or name, or the best one.
///
/// # Errors
/// No Vulkan, no such device.
pub fn open_device(wanted: Option<&str>) -> anyhow::Result<Device> {
    let instance = Arc::new(Instance::new(false)?);
    let description = instance.choose(wanted)?;
    Ok(Device::open(&instance, description)?)
}

/// Name of an integrator, as the command line and the scene file have it.
pub fn integrator_name(integrator: Integrator) -> &'static str {
    match integrator {
        Integrator::Implicit => "implicit",
        Integrator::Explicit => "explicit",
    }
}

/// Name of a scheduler, as the command line has it.
pub fn scheduler_name(scheduler: Scheduler) -> &'static str {
    match scheduler {
        Scheduler::Wavefront => "wavefront",
        Scheduler::Megakernel => "megakernel",
    }
}
