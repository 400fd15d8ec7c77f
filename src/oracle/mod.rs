//! What images should be, computed on the CPU in `f64`: a path tracer and the optics of a surface.
//!
//! Tests and the study of stability hold the kernels against this room. It is written from the textbook and
//! must not know how the kernels work: of `render` it reads the settings alone, and `bvh`, `layout` and `gpu`
//! are closed to it.

pub mod optics;
mod path;
pub mod sobol;

pub use path::{Path, Reference, pcg4d};
