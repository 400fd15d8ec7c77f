//! Kernels as the host has them: SPIR-V and what was read from it.

use std::io::Read as _;

use flate2::read::ZlibDecoder;
use rspirv::dr::Module;

use crate::texels::fetch_texels;
use crate::variant::{self, Access, Edition};

/// A compute kernel in every variant that it is built in.
#[derive(Debug)]
pub struct Kernel {
    /// Name of the shader file without extension, or of a form of it; the one name it has everywhere.
    pub name: &'static str,
    /// One of each [`Access`] in each [`Edition`]; some kernels have only the plain edition.
    pub variants: &'static [Variant],
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
    /// Its SPIR-V words by [`deflate`](crate::deflate).
    pub deflated: &'static [u8],
    /// Whether the scene is read by texels, to which its words are still to be brought.
    pub fetches_texels: bool,
    /// What the kernel binds, sorted by set and binding.
    pub bindings: &'static [Binding],
    /// Bytes of push constants that the kernel declares; 0 for none.
    pub push_constant_size: u32,
}

impl Variant {
    /// The descriptor set of the scene, whose buffers may be read by texels.
    pub const SCENE_SET: u32 = 0;

    /// Its module, with code for every specialization.
    ///
    /// # Panics
    /// As [`Variant::words`].
    pub fn module(&self) -> Module {
        let mut module = self.storage_module();
        self.bring_to_texels(&mut module);
        module
    }

    /// Its module, which reads the scene from storage buffers.
    pub(crate) fn storage_module(&self) -> Module {
        rspirv::dr::load_words(self.words()).expect("the build has read this SPIR-V")
    }

    /// Has a module of its own read the scene as the variant does.
    pub(crate) fn bring_to_texels(&self, module: &mut Module) {
        if self.fetches_texels {
            fetch_texels(module, Self::SCENE_SET).expect("the build has done it");
        }
    }

    /// The SPIR-V words that it is made of, which read the scene from storage buffers.
    ///
    /// # Panics
    /// When they are not what [`deflate`](crate::deflate) made.
    pub fn words(&self) -> Vec<u32> {
        let mut planes = Vec::new();
        ZlibDecoder::new(self.deflated).read_to_end(&mut planes).expect("the build deflated it");
        let count = planes.len() / 4;
        let word = |i| u32::from_le_bytes(std::array::from_fn(|place| planes[place * count + i]));
        (0..count).map(word).collect()
    }
}

/// A descriptor that a kernel uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding<Text = &'static str> {
    /// GLSL name of the variable: the role of the buffer.
    pub name: Text,
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
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StructLayout<Text = &'static str, Members = &'static [Member]> {
    /// GLSL name of the type.
    pub name: Text,
    /// Members in order.
    pub members: Members,
}

/// Member of a [`StructLayout`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member<Text = &'static str> {
    /// GLSL name.
    pub name: Text,
    /// Bytes from the start of the struct.
    pub offset: u32,
    /// Bytes; 0 for a runtime array.
    pub size: u32,
    /// Bytes between array elements; 0 where the member is no array.
    pub array_stride: u32,
}
