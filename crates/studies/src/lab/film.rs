//! What a film file tells of its render, and when two are parts of one.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use raywave::constants::TRACED_SAMPLES;
use raywave::film::Film;
use raywave::gpu::DeviceDescription;
use raywave::render::Statistics;
use raywave::scene::Scene;
use raywave::settings::{Numerics, Role, SETTINGS, Settings};

use super::record::{object, record, samples_of_rows};

/// Key of the samples that each pixel is to have.
const SAMPLES: &str = "samples_per_pixel";
/// Keys of what follows from the sums, or from how a part came about.
const OF_SUMS: [&str; 3] = [SAMPLES, "finished_rows_pixels", "samples_by_rows"];

/// What the samples of a film have cost.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Rays from the camera.
    pub camera_rays: u64,
    /// Rays from a scattering.
    pub bounce_rays: u64,
    /// Rays to a light.
    pub shadow_rays: u64,
    /// Samples that were NaN or infinite and were left out.
    pub nonfinite_samples: u64,
    /// Pixel and number of some of those, by pixel.
    pub nonfinite_traced: Vec<[u32; 2]>,
    /// Time of rendering, added up over all parts.
    pub wall_seconds: f64,
}

impl Counters {
    /// Of a render.
    pub fn of(statistics: &Statistics) -> Self {
        Self {
            camera_rays: statistics.camera_rays,
            bounce_rays: statistics.bounce_rays,
            shadow_rays: statistics.shadow_rays,
            nonfinite_samples: statistics.nonfinite_samples.into(),
            nonfinite_traced: statistics.nonfinite_traced.clone(),
            wall_seconds: statistics.wall_time.as_secs_f64(),
        }
    }

    /// Of both.
    pub fn plus(&self, other: &Self) -> Self {
        let mut nonfinite_traced = [&self.nonfinite_traced[..], &other.nonfinite_traced].concat();
        nonfinite_traced.sort_unstable();
        nonfinite_traced.truncate(TRACED_SAMPLES as usize);
        Self {
            camera_rays: self.camera_rays + other.camera_rays,
            bounce_rays: self.bounce_rays + other.bounce_rays,
            shadow_rays: self.shadow_rays + other.shadow_rays,
            nonfinite_samples: self.nonfinite_samples + other.nonfinite_samples,
            nonfinite_traced,
            wall_seconds: self.wall_seconds + other.wall_seconds,
        }
    }
}

/// What a film tells of its render.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AboutFilm {
    /// Samples that each pixel of the whole image is to have.
    pub samples: u32,
    /// By what arithmetic: `portable`, which is the same on every device, or that of a device.
    pub arithmetic: String,
    /// The record that belongs to an image.
    pub record: Map<String, Value>,
    /// What it has cost.
    pub counters: Counters,
}

/// Two films of different renders, by the first thing that differs.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key} is {ours} here and {theirs} there")]
pub struct OtherRender {
    /// What it is called in records.
    pub key: String,
    /// Its value in the one, as text.
    pub ours: String,
    /// And in the other.
    pub theirs: String,
}

/// Whether the image has the same bits on every device.
pub fn is_portable(settings: &Settings) -> bool {
    settings.numerics == Numerics::Portable && !settings.fast_math
}

impl AboutFilm {
    /// Of a render under way or at its end.
    pub fn new(scene: &Scene, settings: &Settings, device: &DeviceDescription, statistics: &Statistics) -> Self {
        let arithmetic =
            if is_portable(settings) { "portable".to_owned() } else { format!("{}, {}", device.name, device.driver) };
        Self {
            samples: settings.samples,
            arithmetic,
            record: record(scene, settings, device, statistics),
            counters: Counters::of(statistics),
        }
    }

    /// Numbers of the samples that each pixel is to have.
    pub fn sample_numbers(&self) -> Vec<Range<u32>> {
        let halves = self.record.get("halves") == Some(&Value::Bool(true));
        Settings { halves, ..Settings::default() }.sample_numbers(self.samples)
    }

    /// As JSON, for a film file.
    pub fn to_map(&self) -> Map<String, Value> {
        object(serde_json::to_value(self).expect("numbers and names become JSON"))
    }

    /// From a film file.
    ///
    /// # Errors
    /// When it is not what [`AboutFilm::to_map`] makes.
    pub fn of_map(map: &Map<String, Value>) -> Result<Self, serde_json::Error> {
        Self::deserialize(Value::Object(map.clone()))
    }

    /// Whether both tell of parts of one render: the same program, scene and arithmetic, and the same value of every
    /// setting that may change a bit of the image, but for the number of samples.
    ///
    /// # Errors
    /// Says what differs.
    pub fn check_same_render(&self, other: &Self) -> Result<(), OtherRender> {
        let differ = |key: &str, ours: &dyn fmt::Display, theirs: &dyn fmt::Display| {
            Err(OtherRender { key: key.to_owned(), ours: ours.to_string(), theirs: theirs.to_string() })
        };
        let of_settings = SETTINGS.iter().filter(|setting| setting.role != Role::Schedule).map(|setting| setting.key);
        for key in ["raywave_version", "scene_hash"].into_iter().chain(of_settings).filter(|key| *key != SAMPLES) {
            let [ours, theirs] = [self, other].map(|about| about.record.get(key).unwrap_or(&Value::Null));
            if ours != theirs {
                return differ(key, ours, theirs);
            }
        }
        if self.arithmetic != other.arithmetic {
            return differ("arithmetic", &self.arithmetic, &other.arithmetic);
        }
        Ok(())
    }

    /// The record of the image of a film: of one that has all samples, what a render of all would tell.
    pub fn image_record(&self, film: &Film) -> Map<String, Value> {
        let strips = film.strips().iter().map(|strip| (strip.rows, strip.samples()));
        let lit: Vec<(u32, u64)> = strips.filter(|(_, samples)| *samples > 0).collect();
        let told = json!({
            SAMPLES: lit.iter().map(|(_, samples)| *samples).min().unwrap_or(0),
            "finished_rows_pixels": lit.iter().map(|(rows, _)| rows).sum::<u32>(),
            "samples_by_rows": samples_of_rows(lit),
        });
        let mut record = self.record.clone();
        OF_SUMS.iter().for_each(|key| drop(record.insert((*key).to_owned(), told[*key].clone())));
        record
    }
}
