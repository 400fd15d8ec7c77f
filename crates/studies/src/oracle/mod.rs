//! What images should be, computed on the CPU in `f64`: a path tracer and the optics of a surface.
//!
//! Tests and the study of stability compare the kernels with this room. It is written from the textbook and must not
//! know how the kernels work: it reads scenes and `settings`, and may not use `bvh`, `layout` or `gpu`.

pub mod bsdf;
mod microfacets;
pub mod optics;
mod path;
mod principled;
pub mod sobol;
mod texture;

pub use path::{Path, Reference, Unsupported, pcg4d};
