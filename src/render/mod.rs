//! Rendering: from a scene and settings to a film.
//!
//! `schedule` has the frame function: the passes of a batch under each scheduler. [`Session`] uploads the scene, runs
//! frame after frame and reads the film; it can also freeze a queue of rays, which [`Replay`] traces with one kernel.
//! `rounds` ends a render by its error, and `together` shares one among devices.
//!
//! Around these: [`PreparedScene`] is the scene as the kernels read it; [`Plan`] computes sizes and batches, `buffers`
//! the sizes of buffers, and `pace` how many paths a batch may have; [`Footprint`] reports what kernels and buffers
//! amount to; [`Defaults`] are a device's choices where the user makes none; [`WarmUp`] runs a device until its clock is
//! steady. Only `session` and `replay` run anything on a device.

mod buffers;
mod defaults;
mod dump;
mod error;
mod faults;
mod footprint;
mod kept;
mod pace;
mod plan;
mod prepare;
mod renderer;
mod replay;
mod rounds;
mod schedule;
mod session;
mod statistics;
mod together;
mod traced;
mod warm_up;

pub use buffers::scene_buffers;
pub use defaults::{Choices, Defaults, Traversal, Tuned};
pub use dump::QueuedRays;
pub use error::RenderError;
pub use faults::{Fault, find_faults};
pub use footprint::{FeatureCost, Footprint, feature_costs};
pub use kept::Kept;
pub use plan::{Band, Plan, SampleRange, SceneLevels, Tile};
pub use prepare::{
    FeatureFlag, Features, Needs, Normalisation, PrepareError, PreparedScene, SceneBuffer, TriangleName,
};
pub use renderer::Renderer;
pub use replay::{FrozenRays, Replay, ReplayOutcome, distances};
pub use session::{Ending, Progress, Session, SessionOptions};
pub use statistics::{Outcome, Statistics};
pub use together::render_together;
pub use traced::{DeviceTrace, Purpose, QueueLengths, TracedBatch};
pub use warm_up::{WarmUp, Warmth};
