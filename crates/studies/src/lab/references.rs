//! References of sweeps: read from a file, or kept in the folder of caches from one sweep to the next.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;

use super::host::cache_folder;
use crate::studies::tradeoff::{Base, Reference, ReferenceKeeper, ReferenceNoise};
use crate::studies::{SceneFacts, StudyError};
use raywave::image::{Image, WriteOptions, read_image, read_metadata, write_image};

/// Where references are looked for and kept.
#[derive(Debug)]
pub struct References {
    /// The one that the user named.
    named: Option<Reference>,
    /// relMSE by its own noise that is good enough.
    good_enough: f64,
    /// Seconds that a new one may cost a share of.
    budget_seconds: f64,
    warning: Option<String>,
}

/// What a cached image says of itself: its noise, and what it was allowed to cost.
const NOISE: &str = "raywave.reference_noise";
const BUDGET: &str = "raywave.reference_budget_seconds";

impl References {
    /// Reads the image that was named, if one was.
    ///
    /// # Errors
    /// An image that cannot be read.
    pub fn new(named: Option<&Path>, good_enough: f64, budget_seconds: f64) -> anyhow::Result<Self> {
        let named = named.map(read).transpose()?.map(|(reference, _)| reference);
        Ok(Self { named, good_enough, budget_seconds, warning: None })
    }

    /// Why a reference was not kept, if it was not.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }
}

/// An image and what it says of its noise and cost.
fn read(path: &Path) -> anyhow::Result<(Reference, Option<f64>)> {
    let image = read_image(path)?;
    // A format without metadata says nothing.
    let metadata = read_metadata(path).unwrap_or_default();
    let told = |key: &str| metadata.iter().find(|(name, _)| name == key).map(|(_, text)| text.as_str());
    let noise: Option<ReferenceNoise> = told(NOISE).and_then(|text| serde_json::from_str(text).ok());
    let budget = told(BUDGET).and_then(|text| text.parse().ok());
    Ok((Reference { image: Arc::new(image), noise, origin: path.display().to_string() }, budget))
}

/// The file of a picture's reference: by its scene and what of the settings is the picture.
fn file(facts: &SceneFacts, base: &Base) -> Option<PathBuf> {
    let bounces = base.settings.max_bounces.map_or(-1, i64::from);
    let picture =
        format!("{} {} {} {} {bounces}", raywave::VERSION, facts.scene_hash, facts.width_pixels, facts.height_pixels);
    let hash = blake3::hash(picture.as_bytes()).to_hex();
    Some(cache_folder()?.join(format!("{}.reference.exr", &hash[..24])))
}

fn fits(image: &Image, facts: &SceneFacts) -> bool {
    (image.width, image.height) == (facts.width_pixels, facts.height_pixels)
}

impl ReferenceKeeper for References {
    fn load(&mut self, facts: &SceneFacts, base: &Base) -> Result<Option<Reference>, StudyError> {
        if let Some(reference) = &self.named {
            if !fits(&reference.image, facts) {
                let Image { width, height, .. } = *reference.image;
                let cause = format!(
                    "{}: it has {width} x {height} pixels and the render {} x {}; render both at one size",
                    reference.origin, facts.width_pixels, facts.height_pixels
                );
                return Err(StudyError::Scene { scene: facts.scene.clone(), cause: cause.into() });
            }
            return Ok(Some(reference.clone()));
        }
        let cached = file(facts, base).filter(|path| path.exists()).and_then(|path| read(&path).ok());
        let good = |(reference, budget): &(Reference, Option<f64>)| {
            // One that was allowed to cost as much would not become better.
            let spent = budget.is_some_and(|budget| budget >= self.budget_seconds);
            let known = reference.noise.is_some_and(|noise| spent || noise.relative_variance <= self.good_enough);
            known && fits(&reference.image, facts)
        };
        Ok(cached.filter(good).map(|(reference, _)| reference))
    }

    fn store(&mut self, facts: &SceneFacts, base: &Base, reference: &Reference) {
        let Some(path) = file(facts, base) else { return };
        let write = || -> anyhow::Result<()> {
            let noise = serde_json::to_string(&reference.noise).context("its noise becomes JSON")?;
            let metadata = [(NOISE.to_owned(), noise), (BUDGET.to_owned(), self.budget_seconds.to_string())];
            if let Some(folder) = path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            Ok(write_image(&path, &reference.image, &WriteOptions { metadata: &metadata, ..WriteOptions::default() })?)
        };
        if let Err(error) = write() {
            self.warning = Some(format!("the reference is not kept: {error:#}"));
        }
    }
}
