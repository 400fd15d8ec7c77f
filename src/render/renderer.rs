//! From a scene to an image in one call, with what suits the device.

use std::ops::ControlFlow;

use super::defaults::Defaults;
use super::error::RenderError;
use super::prepare::PreparedScene;
use super::session::Session;
use super::statistics::Outcome;
use crate::gpu::Device;
use crate::scene::Scene;
use crate::settings::Settings;

/// A device and its defaults, ready for scenes.
pub struct Renderer {
    device: Device,
    defaults: Defaults,
}

impl Renderer {
    /// Looks up what suits the device, which is measured if it never was.
    ///
    /// # Errors
    /// When the device fails.
    pub fn new(device: &Device) -> Result<Self, RenderError> {
        Ok(Self { device: device.clone(), defaults: Defaults::of(device)? })
    }

    /// Renders a scene: its film, and what it cost.
    ///
    /// # Errors
    /// When the settings make no sense, the scene is over the device's limits, or the device fails.
    pub fn render(&self, scene: &Scene, settings: &Settings) -> Result<Outcome, RenderError> {
        self.session(scene, settings)?.render(|_| ControlFlow::Continue(()))
    }

    /// Makes a scene ready on the device, for renders of which the caller sees the progress, the tiles or a trace.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn session(&self, scene: &Scene, settings: &Settings) -> Result<Session, RenderError> {
        Session::new(&self.device, &self.prepare(scene, settings)?, settings)
    }

    /// Builds what kernels read of a scene, with the BVH that suits the device.
    ///
    /// # Errors
    /// When the settings make no sense or the scene cannot be told in the kernels' numbers.
    pub fn prepare(&self, scene: &Scene, settings: &Settings) -> Result<PreparedScene, RenderError> {
        settings.validate()?;
        Ok(PreparedScene::for_device(scene, settings, &self.defaults)?)
    }
}
