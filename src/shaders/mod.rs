//! The kernel table that `build.rs` writes: SPIR-V and what was read from it.
//!
//! Data, and what specialization constants leave of it: it knows nothing of Vulkan objects.

mod arithmetic;
mod link;
mod specialize;
mod variant;

use std::io::Read as _;
use std::sync::LazyLock;

use flate2::read::ZlibDecoder;

pub use arithmetic::{Arithmetic, Form, Forms};
pub use link::Library;
pub use specialize::{Build, Specialized};
pub use variant::{Access, Edition};

/// A compute kernel in every variant that it is built in.
#[derive(Debug)]
pub struct Kernel {
    /// Name of the shader file without extension, or of a form of it; the one name it has everywhere.
    pub name: &'static str,
    /// One of each [`Access`] in each [`Edition`]; probes have only the plain edition.
    pub variants: &'static [Variant],
}

/// When lanes of a subgroup that took different branches reconverge. Without a promise a driver may keep them
/// apart for as long as it likes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reconvergence {
    /// As soon as the source says (VK_KHR_shader_maximal_reconvergence).
    Maximal,
    /// Where a branch ends that the whole subgroup came to together (VK_KHR_shader_subgroup_uniform_control_flow).
    UniformControlFlow,
}

/// What a driver promises a kernel that asks for it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Promises {
    /// Of lanes that diverged.
    pub reconvergence: Option<Reconvergence>,
    /// Infinities, NaN and the signs of zeros are preserved: the driver does not assume that there are none.
    pub special_values: bool,
    /// Floats are rounded to nearest, ties to even.
    pub nearest_rounding: bool,
    /// Subnormal floats are zeros.
    pub flushes_subnormals: bool,
}

impl Kernel {
    /// The build for that use.
    ///
    /// # Panics
    /// When the kernel does not have that edition.
    pub fn variant(&self, edition: Edition, access: Access) -> &'static Variant {
        let place = variant::variants(&Edition::ALL).position(|variant| variant == (edition, access));
        &self.variants[place.expect("every access of every edition is listed")]
    }
}

/// One build of a kernel.
#[derive(Debug)]
pub struct Variant {
    /// SPIR-V words, the lowest bytes of all first, then the second ones, and so on; deflated (zlib), since all kernels
    /// together have 11 MB.
    pub deflated: &'static [u8],
    /// What the kernel binds, sorted by set and binding.
    pub bindings: &'static [Binding],
    /// Bytes of push constants that the kernel declares; 0 for none.
    pub push_constant_size: u32,
}

impl Variant {
    /// Its SPIR-V words.
    ///
    /// # Panics
    /// When they are not what `build.rs` made.
    pub fn words(&self) -> Vec<u32> {
        let mut planes = Vec::new();
        ZlibDecoder::new(self.deflated).read_to_end(&mut planes).expect("build.rs deflated it");
        let count = planes.len() / 4;
        let word = |i| u32::from_le_bytes(std::array::from_fn(|place| planes[place * count + i]));
        (0..count).map(word).collect()
    }
}

/// A descriptor that a kernel uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// GLSL name of the variable: the role of the buffer.
    pub name: &'static str,
    /// Descriptor set.
    pub set: u32,
    /// Binding number within the set.
    pub binding: u32,
    /// Descriptor type.
    pub kind: BindingKind,
    /// Whether the kernel may read it.
    pub reads: bool,
    /// Whether the kernel may write it.
    pub writes: bool,
}

/// Descriptor types that kernels use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BindingKind {
    /// `uniform` block.
    UniformBuffer,
    /// `buffer` block.
    StorageBuffer,
    /// `usamplerBuffer` or `samplerBuffer`.
    UniformTexelBuffer,
}

/// Memory layout of a GLSL struct or block.
#[derive(Debug)]
pub struct StructLayout {
    /// GLSL name of the type.
    pub name: &'static str,
    /// Members in order.
    pub members: &'static [Member],
}

/// Member of a [`StructLayout`].
#[derive(Debug)]
pub struct Member {
    /// GLSL name.
    pub name: &'static str,
    /// Bytes from the start of the struct.
    pub offset: u32,
    /// Bytes; 0 for a runtime array.
    pub size: u32,
    /// Bytes between array elements; 0 where the member is no array.
    pub array_stride: u32,
}

/// Functions in raywave's arithmetic that stand for operations of kernels.
static PORTABLE_LIBRARY: LazyLock<Library> = LazyLock::new(|| Library::of_words(PORTABLE));

include!(concat!(env!("OUT_DIR"), "/kernels.rs"));

/// The self-test's kernels, of `shaders/selftest`.
pub mod selftest {
    use super::{Binding, BindingKind, Kernel, Variant};

    include!(concat!(env!("OUT_DIR"), "/selftest.rs"));
}
