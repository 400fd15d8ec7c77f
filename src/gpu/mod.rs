//! Vulkan: devices, memory, pipelines and the executor of recordings.
//!
//! An [`Executor`] makes `resources` and `pipeline`s where `memory` says that they fit. It cuts a recording into `steps`,
//! `submit` records these with the barriers that `hazards` asks for, and `times` keeps what their timestamps say. Where no
//! device is found, `discovery` looks for the cause.
//!
//! The only room with `ash` and with `unsafe`. It knows kernels by the table and buffers by their
//! roles; it knows nothing of scenes or of light.
#![allow(unsafe_code)]

mod buffer;
mod clock;
mod device;
mod discovery;
mod error;
mod executables;
mod executor;
mod hazards;
mod instance;
mod labels;
mod memory;
mod pipeline;
mod pipeline_cache;
mod resources;
mod roles;
mod steps;
mod submit;
mod times;

pub use clock::Alignment;
pub use device::Device;
pub use discovery::{Discovery, Finding, Verdict};
pub use error::GpuError;
pub use executables::{CompiledKernel, Executable, Figure, FigureValue, Multiprocessors};
pub use executor::{Executor, ExecutorDescription};
pub use instance::{DeviceDescription, DeviceKind, Instance, Tools};
pub use roles::{BufferRole, BufferUse};
pub use times::{Idle, KernelTime, TracedPass, TracedSubmission};
