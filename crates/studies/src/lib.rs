//! What measures raywave, and what checks it.
//!
//! [`studies`] design, conduct and analyse comparisons of settings, over a renderer that may be a fake; [`lab`] has the
//! one that renders on a device, and tuning, start-up and references; [`stats`] are the statistics of both, [`export`]
//! writes reports. [`oracle`] is a reference path tracer in `f64` that shares no code with the kernels, [`stability`]
//! drives the tracer to its numerical limits, and [`selftest`] checks what it relies on from a device. [`gallery`]
//! generates a scene of any size.

pub mod export;
pub mod gallery;
pub mod lab;
pub mod oracle;
pub mod selftest;
pub mod stability;
pub mod stats;
pub mod studies;
