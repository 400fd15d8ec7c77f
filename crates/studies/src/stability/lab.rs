//! What the rows share: renders, and ways to hold them against what they should be.

use glam::DVec3;

use crate::oracle::Reference;
use crate::stats::{mean, standard_error};
use crate::studies::Trial;
use raywave::bvh::BvhKind;
use raywave::film::FilmMoments;
use raywave::gpu::Device;
use raywave::parallel;
use raywave::rays::{RayClass, RayRecord};
use raywave::render::{PreparedScene, RenderError, Renderer, Replay};
use raywave::scene::Scene;
use raywave::settings::{Integrator, Settings};

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// The extremes of what is promised, by few samples: seconds on a software device.
    Quick,
    /// Every setting, by as many samples as take minutes on a software device.
    Standard,
    /// Every setting in full.
    Thorough,
}

/// A device, and how much is done on it.
pub struct Lab<'a> {
    /// What renders.
    pub device: &'a Device,
    /// How much.
    pub level: Level,
}

/// What came of a trial.
#[derive(Debug, Clone, Copy)]
pub struct Measured {
    /// Error or rate of defects.
    pub value: f64,
    /// Standard error of it.
    pub standard_error: f64,
    /// Samples or rays that were looked at.
    pub checked: u64,
    /// Samples that were not finite.
    pub nonfinite: u64,
}

/// How far a sample may be from what it should be and count as right, relative.
pub const CLOSE: f64 = 1e-3;

impl Lab<'_> {
    /// One of three.
    pub fn by_level<T>(&self, quick: T, standard: T, thorough: T) -> T {
        match self.level {
            Level::Quick => quick,
            Level::Standard => standard,
            Level::Thorough => thorough,
        }
    }

    /// Settings that are promised, and those beyond; of the quick level the most extreme of what is promised.
    pub fn ladder<T: Copy>(&self, promised: &[T], beyond: &[T]) -> Vec<(T, bool)> {
        if self.level == Level::Quick {
            return promised.last().map(|last| (*last, true)).into_iter().collect();
        }
        let promised = promised.iter().map(|setting| (*setting, true));
        promised.chain(beyond.iter().map(|setting| (*setting, false))).collect()
    }

    /// Side of a picture in pixels.
    pub fn side(&self) -> u32 {
        self.by_level(32, 96, 512)
    }

    /// A square picture of one sample a pixel.
    pub fn picture(&self, integrator: Integrator, max_bounces: u32) -> Settings {
        let (side, max_bounces) = (self.side(), Some(max_bounces));
        let settings = Scene::cornell_box().settings;
        Settings { width: side, height: side, samples: 1, integrator, max_bounces, roulette: 0.0, ..settings }
    }

    /// Renders.
    pub fn film(&self, scene: &Scene, settings: &Settings) -> Result<(FilmMoments, u64), RenderError> {
        let outcome = Renderer::new(self.device)?.render(scene, settings)?;
        Ok((outcome.film, outcome.statistics.nonfinite_samples.into()))
    }

    /// The share of samples, one a pixel, that are off by more than `tolerance` relative to what they should be.
    pub fn every_sample(
        &self,
        scene: &Scene,
        settings: &Settings,
        tolerance: f64,
        expected: impl Fn(usize) -> f64,
    ) -> Result<Measured, RenderError> {
        let (film, nonfinite) = self.film(scene, settings)?;
        let wrong = |(pixel, sum): (usize, &DVec3)| {
            let expected = expected(pixel);
            let error = (*sum - expected).abs().max_element();
            // NaN is wrong.
            error.is_nan() || error > tolerance * expected
        };
        let wrong = film.sum.iter().enumerate().filter(|sample| wrong(*sample)).count();
        Ok(share(wrong as u64, film.sum.len() as u64, nonfinite))
    }

    /// The share of samples, one a pixel, whose radiance is not that of the oracle's path, divided by `scale`. It may be
    /// off by `CLOSE` of its own and, unless `own` is set, of the image's mean.
    pub fn against_paths(
        &self,
        scene: &Scene,
        settings: &Settings,
        oracle: (&Scene, f64),
        own: bool,
    ) -> Result<Measured, RenderError> {
        let (film, nonfinite) = self.film(scene, settings)?;
        let reference = reference(oracle.0, settings);
        let radiance = |pixel| reference.path(pixel as u32, 0).radiance;
        let right = parallel::map(film.sum.len(), &radiance);
        let floor = if own { DVec3::ZERO } else { right.iter().sum::<DVec3>() / right.len() as f64 };
        let wrong = |(found, right): (&DVec3, &DVec3)| {
            let off = (*found / oracle.1 - *right).abs();
            !off.cmple(CLOSE * (*right + floor)).all()
        };
        let wrong = film.sum.iter().zip(&right).filter(|pair| wrong(*pair)).count();
        Ok(share(wrong as u64, film.sum.len() as u64, nonfinite))
    }

    /// The relative difference of the means of the same paths, one a pixel, here and by the oracle.
    pub fn mean_of_paths(&self, scene: &Scene, settings: &Settings) -> Result<Measured, RenderError> {
        let (film, nonfinite) = self.film(scene, settings)?;
        let reference = reference(scene, settings);
        let right = parallel::map(film.sum.len(), &|pixel| reference.path(pixel as u32, 0).radiance.x);
        let off: Vec<f64> = film.sum.iter().zip(&right).map(|(found, right)| found.x - right).collect();
        let exact = mean(&right);
        Ok(Measured {
            value: (mean(&off) / exact).abs(),
            standard_error: standard_error(&off) / exact,
            checked: off.len() as u64,
            nonfinite,
        })
    }

    /// The relative error of the mean over the image and its colours.
    pub fn mean(&self, scene: &Scene, settings: &Settings, exact: f64) -> Result<Measured, RenderError> {
        let (film, nonfinite) = self.film(scene, settings)?;
        let known = film.mean_and_standard_error();
        Ok(Measured {
            value: ((known.mean - exact) / exact).abs().max_element(),
            standard_error: (known.standard_error / exact).max_element(),
            checked: film.sum.len() as u64 * film.samples,
            nonfinite,
        })
    }

    /// The share of rays in a closed scene, in its normalised space, that find no surface. The first 65,536 of each four
    /// million are held against the CPU's walk too.
    pub fn leaks(
        &self,
        scene: &PreparedScene,
        rays: u64,
        ray: impl Fn(u64) -> RayRecord + Sync,
    ) -> Result<Measured, RenderError> {
        const AT_ONCE: u64 = 1 << 22;
        let settings = Scene::cornell_box().settings;
        let mut lost = 0;
        for first in (0..rays).step_by(AT_ONCE as usize) {
            let part = parallel::map(AT_ONCE.min(rays - first) as usize, &|number| ray(first + number as u64));
            let mut replay = Replay::new(self.device, scene, &settings, RayClass::Camera, &part, 1)?;
            let outcome = replay.run(0)?;
            lost += outcome.rays - outcome.hits;
        }
        Ok(share(lost, rays, 0))
    }

    /// The scene with the BVH of that kind.
    pub fn prepared(&self, scene: &Scene, kind: BvhKind) -> Result<PreparedScene, RenderError> {
        Ok(PreparedScene::with_bvh(scene, kind)?)
    }
}

/// The oracle of a scene of this room, which has nothing that it does not know.
fn reference<'a>(scene: &'a Scene, settings: &Settings) -> Reference<'a> {
    Reference::new(scene, settings).expect("the oracle knows all that these scenes have")
}

fn share(wrong: u64, checked: u64, nonfinite: u64) -> Measured {
    Measured { value: wrong as f64 / checked as f64, standard_error: 0.0, checked, nonfinite }
}

/// A trial by its setting and what came of it.
pub fn trial(setting: impl ToString, required: bool, outcome: Result<Measured, RenderError>) -> Trial {
    let none = Measured { value: f64::NAN, standard_error: 0.0, checked: 0, nonfinite: 0 };
    let failure = outcome.as_ref().err().map_or_else(String::new, ToString::to_string);
    let Measured { value, standard_error, checked, nonfinite } = outcome.unwrap_or(none);
    Trial {
        setting: setting.to_string(),
        required,
        measured: value,
        standard_error,
        checked,
        nonfinite_samples: nonfinite,
        failure,
    }
}

/// A number of a setting: plain where it is short, else a power of ten.
pub fn tell(value: f64) -> String {
    if (0.01..10_000.0).contains(&value.abs()) || value == 0.0 { format!("{value}") } else { format!("{value:e}") }
}
