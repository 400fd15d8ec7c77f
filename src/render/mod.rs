//! Rendering: from a scene and settings to a film.
//!
//! [`PreparedScene`] is the scene as the kernels read it; [`Plan`] computes sizes and batches;
//! `wavefront`, `bounce` and `megakernel` make recordings, between what `batch` begins and ends; [`Session`] uploads,
//! runs and reads back, and can freeze a queue of rays, which a [`Replay`] runs through one kernel; [`Footprint`] tells
//! what kernels and buffers amount to. Only session and replay touch [`crate::gpu`].

mod batch;
mod bounce;
mod dump;
mod faults;
mod footprint;
mod megakernel;
mod plan;
mod prepare;
mod replay;
mod session;
mod settings;
mod wavefront;

pub use dump::QueuedRays;
pub use faults::{Fault, find_faults};
pub use footprint::{FeatureCost, Footprint, feature_costs};
pub use plan::{Plan, SampleRange, SceneLevels, Tile};
pub use prepare::{Features, Needs, Normalisation, PrepareError, PreparedScene, SceneBuffer};
pub use replay::{Replay, ReplayOutcome, distances};
pub use session::{Outcome, Progress, RenderError, Session, SessionOptions, Statistics, forms_for, scene_buffers};
pub use settings::{
    Fetch, MAX_MATERIAL_BRANCHES, MAX_SAMPLES, Numerics, Offsets, Packets, PathState, RouletteMode, Scheduler,
    Settings, SettingsError, ShadowRays, Sort, Traversal,
};
