//! Rendering: from a scene and settings to a film.
//!
//! [`PreparedScene`] is the scene as the kernels read it; [`Plan`] computes sizes and batches;
//! `wavefront`,
//! `bounce` and `megakernel` make recordings; [`Session`] uploads, runs and reads back, and can freeze a queue of
//! rays, which a [`Replay`] runs through one kernel. Only these two touch [`crate::gpu`].

mod batch;
mod bounce;
mod dump;
mod megakernel;
mod plan;
mod prepare;
mod replay;
mod session;
mod settings;
mod wavefront;

pub use dump::QueuedRays;
pub use plan::{Plan, PlanError, SampleRange};
pub use prepare::{Features, Normalisation, PrepareError, PreparedScene};
pub use replay::{Replay, ReplayOutcome};
pub use session::{Outcome, Progress, RenderError, Session, SessionOptions, Statistics, scene_buffers};
pub use settings::{MAX_MATERIAL_BRANCHES, MAX_SAMPLES, Scheduler, Settings, SettingsError, ShadowRays, Sort};
