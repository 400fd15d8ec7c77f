//! Buffers by their roles: what an executor is asked to make.

/// How kernels see a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BufferUse {
    /// Constants of the render.
    Uniform,
    /// Scene data of that many bytes a texel (8 or 16): a texel or storage buffer.
    Scene {
        /// 8 or 16.
        texel_bytes: u64,
    },
    /// State that kernels read and write.
    State,
}

/// A buffer by its GLSL name.
#[derive(Debug, Clone)]
pub struct BufferRole<'a> {
    /// Name of the GLSL variable.
    pub name: &'static str,
    /// How kernels see it.
    pub usage: BufferUse,
    /// Bytes, above 0.
    pub size: u64,
    /// First contents; zeros without.
    pub contents: Option<&'a [u8]>,
}
