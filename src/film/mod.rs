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

    /// A BLAKE3 hash of the pixels' bits, as 64 hexadecimal digits: the same of images that are the same to the last
    /// bit, wherever they were made. What is hashed is width, height and the three floats of each pixel in rows from
    /// the top, all of them 32 bits in little-endian order.
    pub fn digest(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.width.to_le_bytes()).update(&self.height.to_le_bytes());
        for row in self.pixels.chunks(self.width.max(1) as usize) {
            let bytes: Vec<u8> = row.iter().flat_map(|p| p.to_array().map(f32::to_le_bytes)).flatten().collect();
            hasher.update(&bytes);
        }
        hasher.finalize().to_hex().to_string()
    }

    /// Whether it is of the same size and has the same bits: zeros of unlike sign differ, NaNs of like bits do not.
    pub fn is_identical(&self, other: &Self) -> bool {
        let [own, others] = [self, other].map(|image| bytemuck::cast_slice::<_, u8>(&image.pixels));
        (self.width, self.height) == (other.width, other.height) && own == others
    }
}
