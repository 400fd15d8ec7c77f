//! Rendering: from a scene and settings to a film.
//!
//! [`PreparedScene`] is the scene as the kernels read it; [`Plan`] computes sizes and batches;
//! `wavefront` makes recordings; [`Session`] uploads, runs and reads back. Only the session
//! touches [`crate::gpu`].

mod plan;
mod prepare;
mod session;
mod settings;
mod wavefront;

pub use plan::{Plan, PlanError, SampleRange};
pub use prepare::{Features, PrepareError, PreparedScene};
pub use session::{Outcome, Progress, RenderError, Session, Statistics, scene_buffers};
pub use settings::{MAX_SAMPLES, Settings, SettingsError};
