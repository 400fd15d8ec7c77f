//! Host-side images: from the sums that a renderer hands over to files on disk and back.
//!
//! This room owns [`Image`], the film's [`FilmMoments`] and the file formats EXR, PNG and Radiance
//! HDR. It knows nothing of scenes or of the GPU, and it never prints.

mod error;
mod exr;
mod files;
mod moments;
mod rgbe;
pub mod srgb;

use glam::Vec3;

pub use error::FilmError;
pub use files::{MAX_PIXELS, WriteOptions, check_output, image_bytes, read_image, read_metadata, write_image};
pub use moments::{FilmMoments, ImageMean, MeanSum};

/// An image of linear radiance, Rec. 709 primaries.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Radiance, `width * height` entries in rows, row 0 at the top. Any `f32` may stand here, NaN
    /// and infinity too: hiding them is not the film's business.
    pub pixels: Vec<Vec3>,
}

impl Image {
    /// An image of these pixels, row 0 at the top.
    ///
    /// # Panics
    ///
    /// When there are not `width * height` pixels.
    pub fn new(width: u32, height: u32, pixels: Vec<Vec3>) -> Self {
        assert_eq!(
            pixels.len() as u64,
            u64::from(width) * u64::from(height),
            "a {width} x {height} image needs one entry for each pixel",
        );
        Self { width, height, pixels }
    }
}
