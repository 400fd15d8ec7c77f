//! Kernels as the host has them: SPIR-V and what was read from it.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::sync::{Arc, Mutex};

use flate2::read::ZlibDecoder;
use rspirv::dr::Module;

/// A compute kernel: one module, from which [`Kernel::specialize`] makes what a render needs.
#[derive(Debug)]
pub struct Kernel {
    /// Name of the shader file without extension, or of a form of it; the one name it has everywhere.
    pub name: &'static str,
    /// Its SPIR-V words by [`deflate`](crate::deflate).
    pub deflated: &'static [u8],
    /// Whether it is the form in which the rays of a subgroup traverse a tree together.
    pub in_packets: bool,
    /// What the kernel binds, sorted by set and binding, where it reads the scene from storage buffers.
    pub bindings: &'static [Binding],
    /// The same where it reads the scene by texels.
    pub texel_bindings: &'static [Binding],
    /// Bytes of push constants that the kernel declares; 0 for none.
    pub push_constant_size: u32,
}

impl Kernel {
    /// The descriptor set of the scene, whose buffers may be read by texels.
    pub const SCENE_SET: u32 = 0;

    /// What the kernel binds, sorted by set and binding.
    pub fn bindings(&self, texel_fetch: bool) -> &'static [Binding] {
        if texel_fetch { self.texel_bindings } else { self.bindings }
    }

    /// Its module, with code for every specialization, which reads the scene from storage buffers. It is read once, however
    /// often a program builds the kernel.
    ///
    /// # Panics
    /// As [`Kernel::words`].
    pub fn module(&self) -> Arc<Module> {
        /// By where their words are.
        static MODULES: Mutex<BTreeMap<usize, Arc<Module>>> = Mutex::new(BTreeMap::new());
        let modules = || MODULES.lock().expect("nobody panics with it");
        let key = self.deflated.as_ptr().addr();
        if let Some(known) = modules().get(&key) {
            return Arc::clone(known);
        }
        let module = Arc::new(rspirv::dr::load_words(self.words()).expect("the build has read this SPIR-V"));
        modules().insert(key, Arc::clone(&module));
        module
    }

    /// The SPIR-V words that it is made of.
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
