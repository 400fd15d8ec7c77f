//! What a render leaves behind: its film and what it cost.

use std::collections::BTreeMap;
use std::time::Duration;

use super::defaults::Choices;
use super::plan::Band;
use super::session::sums;
use crate::constants::TRACED_SAMPLES;
use crate::film::FilmMoments;
use crate::gpu::{Idle, KernelTime};
use crate::image::Image;
use crate::layout::{RayCount, WorkCount};

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
    /// How the render was done where its settings left a choice open.
    pub choices: Choices,
    /// Path slots.
    pub paths_in_flight: u32,
    /// Paths that an invocation of the megakernel followed.
    pub paths_per_invocation: u32,
    /// Work by bounce and then by `STAGE_*`, of a session that counts; else empty.
    pub work_counts: Vec<WorkCount>,
}

impl Outcome {
    /// The image: the mean of every pixel's samples.
    pub fn image(&self) -> Image {
        self.film.mean()
    }
}

impl Statistics {
    /// The samples and rows that its bands tell of.
    pub(super) fn told(self) -> Self {
        Self {
            samples: self.bands.iter().map(|band| band.samples).min().unwrap_or(0),
            rows: self.bands.iter().map(|band| band.rows).sum(),
            ..self
        }
    }

    /// This cost and that of another device that rendered beside it.
    pub(super) fn beside(mut self, other: &Self) -> Self {
        let mut nonfinite_traced = [self.nonfinite_traced, other.nonfinite_traced.clone()].concat();
        nonfinite_traced.sort_unstable();
        nonfinite_traced.truncate(TRACED_SAMPLES as usize);
        for (pass, time) in &other.passes {
            let total = self.passes.entry(*pass).or_default();
            total.seconds += time.seconds;
            total.launches += time.launches;
        }
        Self {
            sample_count: self.sample_count + other.sample_count,
            camera_rays: self.camera_rays + other.camera_rays,
            bounce_rays: self.bounce_rays + other.bounce_rays,
            shadow_rays: self.shadow_rays + other.shadow_rays,
            nonfinite_samples: self.nonfinite_samples + other.nonfinite_samples,
            nonfinite_traced,
            wall_time: self.wall_time.max(other.wall_time),
            gpu_seconds: self.gpu_seconds + other.gpu_seconds,
            ray_counts: sums(self.ray_counts, &other.ray_counts, RayCount::plus),
            work_counts: sums(self.work_counts, &other.work_counts, WorkCount::plus),
            memory_bytes: self.memory_bytes + other.memory_bytes,
            ..self
        }
    }

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

/// Rays after the camera's, and shadow rays, over all bounces.
pub(super) fn scattered_rays(counts: &[RayCount]) -> (u64, u64) {
    (counts.iter().skip(1).map(RayCount::rays).sum(), counts.iter().map(RayCount::shadow_rays).sum())
}
