//! Rendering: from a scene and settings to a film.
//!
//! [`PreparedScene`] is the scene as the kernels read it; [`Plan`] computes sizes and batches, `pace` how many paths a batch may have;
//! `wavefront`, `bounce` and `megakernel` make recordings, between what `batch` begins and ends; [`Session`] uploads,
//! runs and reads back, and can freeze a queue of rays, which a [`Replay`] runs through one kernel; [`Footprint`] tells
//! what kernels and buffers amount to; [`Defaults`] are what a device takes where the user does not say; [`WarmUp`]
//! works until a device is steady. Only session and replay run anything on a device.

mod batch;
mod bounce;
mod defaults;
mod dump;
mod faults;
mod footprint;
mod megakernel;
mod pace;
mod plan;
mod prepare;
mod replay;
mod session;
mod settings;
mod traced;
mod warm_up;
mod wavefront;

pub use defaults::Defaults;
pub use dump::QueuedRays;
pub use faults::{Fault, find_faults};
pub use footprint::{FeatureCost, Footprint, feature_costs};
pub use plan::{Band, Plan, SampleRange, SceneLevels, Tile};
pub use prepare::{FeatureFlag, Features, Needs, Normalisation, PrepareError, PreparedScene, SceneBuffer};
pub use replay::{FrozenRays, Replay, ReplayOutcome, distances};
pub use session::{Ending, Kept, Outcome, Progress, RenderError, Session, SessionOptions, Statistics, scene_buffers};
pub use settings::{
    Fetch, MAX_MATERIAL_BRANCHES, MAX_SAMPLES, Numerics, Offsets, Packets, PathState, RouletteMode, Scheduler,
    Settings, SettingsError, ShadowRays, Sort, Traversal,
};
pub use traced::{DeviceTrace, Purpose, QueueLengths, TracedBatch};
pub use warm_up::{WarmUp, Warmth};
