//! What a process did when: stages of the host, and a file of them, and of whatever else has a time, in Chrome's trace
//! format.
//!
//! This room knows nothing of devices and renders: it is given names and times.

mod chrome;
mod stages;

pub use chrome::{Trace, Track};
pub use stages::{Stage, StageGuard, Stages};
