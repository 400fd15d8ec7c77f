//! Non-finite samples: those that came out NaN or infinite, traced again to the bounce that made them so.

use super::error::RenderError;
use super::plan::SampleRange;
use super::prepare::PreparedScene;
use super::schedule::Work;
use super::session::{Session, SessionOptions};
use super::statistics::Statistics;
use crate::gpu::Device;
use crate::layout::FilmPixel;
use crate::recording::Recording;
use crate::settings::{Scheduler, Settings, ShadowRays, Sort};
use crate::shaders::buffers;

/// A non-finite sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fault {
    /// Column of the pixel, from the left.
    pub x: u32,
    /// Row of the pixel, from the top.
    pub y: u32,
    /// Number of the sample.
    pub sample: u32,
    /// Scattering events before the vertex that made it so; `None` if it is finite this time, which only a faulty device
    /// does.
    pub bounce: Option<u32>,
}

/// Traces again the samples that a render left out of the film, as many as it noted (up to 16), and finds the bounce at
/// which each became non-finite. The wavefront does it whatever scheduler rendered: the paths are the same to the last
/// bit, and their radiance can be read after every bounce. So a render without such samples pays nothing for it.
///
/// # Errors
/// When the device fails.
pub fn find_faults(
    device: &Device,
    scene: &PreparedScene,
    settings: &Settings,
    statistics: &Statistics,
) -> Result<Vec<Fault>, RenderError> {
    if statistics.nonfinite_traced.is_empty() {
        return Ok(Vec::new());
    }
    let settings = Settings {
        scheduler: Some(Scheduler::Wavefront),
        sort: Sort::None,
        shadow_rays: ShadowRays::Deferred,
        in_flight: Some(1),
        ..*settings
    };
    // The film is not used: a row of it will do.
    let film_bytes = Some(u64::from(settings.width) * size_of::<FilmPixel>() as u64);
    let mut session =
        Session::with_options(device, scene, &settings, SessionOptions { film_bytes, ..SessionOptions::default() })?;
    let fault = |&[pixel, sample]: &[u32; 2]| {
        let bounce = session.spoiling_bounce(pixel, sample)?;
        Ok(Fault { x: pixel % settings.width, y: pixel / settings.width, sample, bounce })
    };
    statistics.nonfinite_traced.iter().map(fault).collect()
}

impl Session {
    /// Scattering events before the vertex after which the radiance of that sample is not finite.
    fn spoiling_bounce(&mut self, first_pixel: u32, first_sample: u32) -> Result<Option<u32>, RenderError> {
        self.clear()?;
        let batch = SampleRange { first_pixel, pixel_count: 1, first_sample, sample_count: 1, film_pixel: 0 };
        let schedule = self.schedule;
        let mut spoiling = None;
        let work = Work { batch, first_slot: 0, resolves: false };
        schedule.record(&mut Recording::default(), work, |frame, recorded| {
            let Some(bounce) = recorded.checked_sub(1) else { return Ok(true) };
            let (control, found) = self.run_part(frame.download(buffers::RADIANCES))?;
            let [r, g, b, _]: [f32; 4] = bytemuck::pod_read_unaligned(&found[0][..16]);
            let is_finite = [r, g, b].iter().all(|channel| channel.is_finite());
            spoiling = (!is_finite).then_some(bounce);
            Ok::<_, RenderError>(is_finite && control.current_rays > 0)
        })?;
        Ok(spoiling)
    }
}
