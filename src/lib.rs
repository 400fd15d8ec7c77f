//! A Vulkan compute path tracer that is also a measuring instrument.
//!
//! [`Renderer`] takes a scene to an image, and to a record of what the image cost:
//!
//! ```no_run
//! use raywave::{Renderer, gpu::Device, scene::Scene, settings::Settings};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::load("scenes/cornell-box.toml".as_ref())?;
//! let settings = Settings { samples: 64, ..scene.settings };
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
//! [`bvh`], [`image`] and [`film`] know nothing of the GPU; [`layout`] is the one home of structs
//! that the GPU sees; [`render`] turns a scene and its settings into a plain recording of passes,
//! and [`gpu`], the only room with Vulkan and `unsafe`, executes it.

pub mod alias;
pub mod bvh;
pub mod clocks;
pub mod constants;
pub mod facts;
pub mod film;
pub mod gpu;
pub mod image;
pub mod layout;
pub mod parallel;
pub mod rays;
pub mod recording;
pub mod render;
pub mod scene;
pub mod settings;
pub mod shaders;
pub mod trace;
pub mod whole_file;

pub use render::Renderer;

/// The version of this library and of all that is built with it, for records.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The compiler that built it, as `rustc --version` tells.
pub const RUSTC_VERSION: &str = env!("RAYWAVE_RUSTC_VERSION");
