//! What speed costs in error: a sweep over the settings that trade one for the other.
//!
//! Every point, a configuration and a number of samples, is rendered several times with independent seeds; each render
//! is timed and compared with a reference. Its squared error is then split into bias, which no number of samples mends,
//! and variance ([`departures`]). A knob at one level is compared with the base by the time to an equal error
//! ([`Worth`]).

pub mod departures;
mod knobs;
mod report;
mod sweep;

pub use departures::{Decomposition, Reference, ReferenceNoise};
pub use knobs::{Base, knobs};
pub use report::{KnobReport, PointReport, PointRun, Stage, TargetAnswer, TradeoffReport, Worth};
pub use sweep::{ReferenceKeeper, Sweep, SweepEvent, SweepPlan};
