//! Studies: which setting is faster, by how much, and how sure that is.
//!
//! This room owns the design of an experiment ([`Design`]), its conduct ([`Study::run`]) and its analysis ([`Report`]).
//! It measures any implementation of the [`Renderer`] trait and knows nothing of the GPU, so that all of it is tested
//! without one. It never prints and writes no files: a caller follows it through [`Event`]s.

mod analysis;
mod crossover;
mod envelope;
mod error;
mod factorial;
mod measurement;
mod noise;
mod runner;
pub mod tradeoff;
mod validity;

pub use analysis::{Clock, CombinationReport, Drift, Ratio, RatioVerdict, Report, Run, SceneReport, Warning};
pub use crossover::{Crossing, CrossingDirection, Crossover, CrossoverPoint, find_crossings};
pub use envelope::{Envelope, Limit, Trial};
pub use error::StudyError;
pub use factorial::{Configuration, Design, Factor};
pub use measurement::{
    BounceRow, CompiledKernelRow, Cpu, ExecutableRow, FigureRow, KernelRow, Measurement, PipelineBuild, Provenance,
    Purpose, Rays, Renderer, SceneFacts, StageWork, WarmUpRow, WorkCounters,
};
pub use noise::{modified_z_scores, outliers, rank_correlation, shuffle, trend};
pub use runner::{Event, Listener, Rounds, Study};
pub use validity::{Contract, Verdict, judge};
