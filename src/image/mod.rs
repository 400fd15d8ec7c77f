//! Images: linear radiance in memory, and the files that hold it.
//!
//! This room owns [`Image`] and the file formats: EXR, Radiance HDR and PNG are read and written,
//! PFM, JPEG, WebP, TIFF, TGA and BMP are read. Skies and textures of scenes, renders and references all come
//! through it, so that a file means the same wherever it is read. It knows nothing of scenes or of
//! the GPU, and it never prints.
//!
//! ```
//! use glam::Vec3;
//! use raywave::image::{Image, WriteOptions, read_image, write_image};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("grey.exr");
//! let image = Image::new(2, 1, vec![Vec3::ZERO, Vec3::splat(0.25)]);
//! write_image(&path, &image, &WriteOptions::default())?;
//! assert_eq!(read_image(&path)?, image);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod codes;
mod error;
mod exr;
mod files;
mod format;
mod limits;
mod pfm;
mod rgbe;
pub mod srgb;
mod texels;

use glam::Vec3;

pub use error::{ImageError, ImageProblem};
pub use files::{
    WriteOptions, check_output, decode_image, decode_texels, image_bytes, read_image, read_metadata, write_image,
};
pub use format::OutputFormat;
pub use limits::MAX_PIXELS;
pub use texels::{Encoding, Texels};

/// Keeps relMSE finite if the reference is dark, in radiance squared. The 0.01 of Rousselle, Knaus and Zwicker,
/// "Adaptive sampling and reconstruction using greedy error minimization", ACM TOG 30 (2011).
pub const DARK: f64 = 0.01;

/// An image of linear radiance, Rec. 709 primaries.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Radiance, `width * height` entries in rows, row 0 at the top. Any `f32` may stand here, NaN
    /// and infinity too: to hide them is not an image's business.
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

    /// The largest value in each channel; 0 where all are below 0 or NaN.
    pub fn brightest(&self) -> Vec3 {
        self.pixels.iter().copied().fold(Vec3::ZERO, Vec3::max)
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
