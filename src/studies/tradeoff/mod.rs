//! What speed costs in error: a sweep over the settings that buy the one with the other.
//!
//! Every point, a configuration and a number of samples, is rendered again and again by other random
//! numbers; each render is timed and held against a reference. Its squared error is then told apart
//! into bias, which no number of samples mends, and variance ([`departures`]). A knob at one level is
//! judged against the base by what an equal error costs ([`Worth`]).

pub mod departures;
mod knobs;
mod report;
mod sweep;

pub use departures::{Decomposition, Reference, ReferenceNoise};
pub use knobs::{Base, knobs};
pub use report::{KnobReport, PointReport, PointRun, Stage, TargetAnswer, TradeoffReport, Worth};
pub use sweep::{ReferenceKeeper, Sweep, SweepEvent, SweepPlan};
