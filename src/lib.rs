//! A Vulkan compute path tracer that is also a measuring instrument.
//!
//! The rooms and who may depend on whom are drawn in `ARCHITECTURE.md`. In short: [`scene`],
//! [`bvh`], [`image`], [`film`] and [`stats`] know nothing of the GPU; [`layout`] is the one home of structs
//! that the GPU sees; [`render`] turns a scene and its settings into a plain recording of passes,
//! and [`gpu`], the only room with Vulkan and `unsafe`, executes it.

pub mod alias;
pub mod bvh;
pub mod cli;
pub mod clocks;
pub mod constants;
pub mod export;
pub mod facts;
pub mod film;
pub mod gallery;
pub mod gpu;
pub mod image;
pub mod layout;
pub mod oracle;
pub mod rays;
pub mod recording;
pub mod render;
pub mod scene;
pub mod selftest;
pub mod shaders;
pub mod stability;
pub mod stats;
pub mod studies;
pub mod trace;
pub mod whole_file;
