//! What a process did when: stages of the host, and a writer of Chrome's trace format for them and for anything else
//! that has a time.
//!
//! This room knows nothing of devices and renders, only names and times.

mod chrome;
mod stages;

pub use chrome::{Trace, Track};
pub use stages::{Stage, StageGuard, Stages};
