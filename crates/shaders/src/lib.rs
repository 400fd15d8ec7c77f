//! What raywave does with the SPIR-V of its kernels, when it is built and when it renders.
//!
//! When raywave is built, its `build.rs` compiles GLSL and hands each [`Module`] to the passes of this crate:
//! [`passes`] make of it what drivers run fast, [`checks`] find what no kernel may do, [`Reflection`] reads what the
//! host must know, and [`Table`] writes all of it as Rust statics of [`Kernel`]s. When raywave renders,
//! [`Variant::specialize`] takes a kernel from there, leaves what its constants let run, and puts an [`Arithmetic`] into
//! it by linking functions of a [`Library`].
//!
//! The crate knows nothing of Vulkan objects, of GLSL compilers and of path tracing.
//!
//! [`Module`]: rspirv::dr::Module

mod arithmetic;
pub mod checks;
mod ids;
mod kernel;
mod link;
pub mod passes;
mod prune;
mod reflection;
#[cfg(test)]
mod small;
mod specialize;
mod table;
mod texels;
mod variant;

pub use arithmetic::{Arithmetic, Form, Forms, lower};
pub use kernel::{Binding, BindingKind, Kernel, Member, StructLayout, Variant};
pub use link::Library;
pub use reflection::{Layout, Reflection};
pub use specialize::{Build, Promises, Reconvergence, Specialized};
pub use table::{BuiltModule, Table, deflate};
pub use texels::fetch_texels;
pub use variant::{Access, Edition, variants};
