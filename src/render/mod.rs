//! Rendering: from a scene and settings to a film.
//!
//! [`PreparedScene`] is the scene as the kernels read it; [`Plan`] computes sizes and batches;
//! `wavefront` and `megakernel` make recordings; [`Session`] uploads, runs and reads back. Only the session
//! touches [`crate::gpu`].

mod megakernel;
mod plan;
mod prepare;
mod session;
mod settings;
mod wavefront;

pub use plan::{Plan, PlanError, SampleRange};
pub use prepare::{Features, PrepareError, PreparedScene};
pub use session::{Outcome, Progress, RenderError, Session, SessionOptions, Statistics, scene_buffers};
pub use settings::{MAX_MATERIAL_BRANCHES, MAX_SAMPLES, Scheduler, Settings, SettingsError, Sort};
