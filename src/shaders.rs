//! The kernel tables that `build.rs` writes: SPIR-V and what was read from it. The crate `raywave-shaders` has what
//! can be done with them.

use std::sync::LazyLock;

pub use raywave_shaders::{
    Access, Arithmetic, Binding, BindingKind, Build, Edition, Form, Forms, Kernel, Library, Member, Promises,
    Reconvergence, SWITCHES, Specialized, StructLayout,
};

/// Functions in raywave's arithmetic that stand for operations of kernels.
pub fn portable_library() -> &'static Library {
    static LIBRARY: LazyLock<Library> = LazyLock::new(|| Library::of_words(PORTABLE));
    &LIBRARY
}

include!(concat!(env!("OUT_DIR"), "/kernels.rs"));

/// The self-test's kernels, of `shaders/selftest`.
pub mod selftest {
    use super::{Binding, BindingKind, Kernel};

    include!(concat!(env!("OUT_DIR"), "/selftest.rs"));
}
