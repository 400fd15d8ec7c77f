//! A Vulkan compute path tracer that is also a measuring instrument.
//!
//! [`Renderer`] takes a scene to an image, and to a record of what the image cost:
//!
//! ```no_run
//! use raywave::{Renderer, gpu::Device, scene::Scene, settings::Settings};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::load("scenes/cornell-box.toml".as_ref())?;
//! let settings = Settings { samples: 64, ..Settings::of(&scene) };
//! let outcome = Renderer::new(&Device::find(None)?)?.render(&scene, &settings)?;
//!
//! let (image, statistics) = (outcome.image(), outcome.statistics);
//! println!("{}x{} pixels, {} rays", image.width, image.height, statistics.rays());
//! # Ok(())
//! # }
//! ```
//!
//! `examples/render.rs` writes the image to a file. A [`render::Session`] gives more: progress, tiles, traces, renders
//! that go on after a device was lost. The frame function, which all schedulers share, is in `src/render/schedule.rs`.
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
pub mod lab;
pub mod layout;
pub mod oracle;
pub mod rays;
pub mod recording;
pub mod render;
pub mod scene;
pub mod selftest;
pub mod settings;
pub mod shaders;
pub mod stability;
pub mod stats;
pub mod studies;
pub mod trace;
pub mod whole_file;

pub use render::Renderer;
