//! Image files to linear RGB: textures and environments.

use std::{
    io::Cursor,
    path::{Path, PathBuf},
};

use glam::Vec3;
use half::f16;
use image::{DynamicImage, ImageFormat, ImageReader};

use super::Texture;

/// Pixels that an image may have, so that a broken header cannot ask for all memory.
const MOST_PIXELS: u64 = 1 << 27;

const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// A decoded image: linear RGB, every value finite and at least 0, row 0 at the top.
#[derive(Debug)]
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    /// `width * height` entries, at least one.
    pub pixels: Vec<Vec3>,
}

impl Picture {
    /// Decodes an image. Integer formats are taken for sRGB, floating-point ones for linear. The
    /// error says what is wrong and what to do.
    pub(super) fn decode(path: &Path, bytes: &[u8]) -> Result<Self, String> {
        let picture = match bytes.starts_with(&EXR_MAGIC) {
            true => decode_exr(bytes)?,
            false => decode_other(path, bytes)?,
        };
        if picture.pixels.is_empty() {
            return Err("has no pixels; export it anew".into());
        }
        let is_radiance = |pixel: &Vec3| pixel.is_finite() && pixel.min_element() >= 0.0;
        match picture.pixels.iter().position(|pixel| !is_radiance(pixel)) {
            None => Ok(picture),
            Some(index) => {
                let (x, y) = (index % picture.width as usize, index / picture.width as usize);
                let [r, g, b] = picture.pixels[index].to_array();
                Err(format!("texel ({x}, {y}) is ({r}, {g}, {b}), negative or not finite; repair the image"))
            }
        }
    }

    /// The largest value in each channel.
    pub(super) fn brightest(&self) -> Vec3 {
        self.pixels.iter().copied().fold(Vec3::ZERO, Vec3::max)
    }

    /// A texture of these pixels times `scale`.
    pub(super) fn texture(&self, path: PathBuf, scale: f32) -> Texture {
        let texel = |pixel: &Vec3| {
            let [r, g, b] = (*pixel * scale).to_array().map(f16::from_f32);
            [r, g, b, f16::ONE]
        };
        Texture { path, width: self.width, height: self.height, texels: self.pixels.iter().map(texel).collect() }
    }
}

fn check_size(width: u64, height: u64) -> Result<(u32, u32), String> {
    let too_large = || format!("is {width} x {height}; keep it under {MOST_PIXELS} pixels");
    if width.saturating_mul(height) > MOST_PIXELS {
        return Err(too_large());
    }
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width), Ok(height)) => Ok((width, height)),
        _ => Err(too_large()),
    }
}

/// Any EXR with channels R, G and B; other channels are left alone.
fn decode_exr(bytes: &[u8]) -> Result<Picture, String> {
    use exr::prelude::*;

    let broken = |error: Error| format!("cannot be decoded ({error}); export it as RGB");
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    for header in &meta.headers {
        check_size(header.layer_size.width() as u64, header.layer_size.height() as u64)?;
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| (size, vec![glam::Vec3::ZERO; size.area()]),
            |(size, pixels), at, (r, g, b): (f32, f32, f32)| {
                pixels[at.y() * size.width() + at.x()] = glam::Vec3::new(r, g, b);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(broken)?;
    let (size, pixels) = image.layer_data.channel_data.pixels;
    let (width, height) = check_size(size.width() as u64, size.height() as u64)?;
    Ok(Picture { width, height, pixels })
}

fn decode_other(path: &Path, bytes: &[u8]) -> Result<Picture, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes));
    // TGA has no magic bytes: there the file's extension decides.
    let format = image::guess_format(bytes).or_else(|_| ImageFormat::from_path(path));
    let format = format.map_err(|_| "is of no known image format; use PNG, JPEG, HDR or EXR")?;
    reader.set_format(format);
    let image = reader.decode().map_err(|error| format!("cannot be decoded ({error}); export it anew"))?;
    let (width, height) = check_size(image.width().into(), image.height().into())?;
    let pixels = match image {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            let pixels = image.into_rgb32f();
            pixels.pixels().map(|pixel| Vec3::from(pixel.0)).collect()
        }
        // Eight bits widen exactly to sixteen, so that one table serves both.
        integers => {
            let linear: Vec<f32> = (0..=u16::MAX).map(srgb_to_linear).collect();
            let look_up = |value: u16| linear[usize::from(value)];
            let pixels = integers.into_rgb16();
            pixels.pixels().map(|pixel| Vec3::from(pixel.0.map(look_up))).collect()
        }
    };
    Ok(Picture { width, height, pixels })
}

/// The sRGB transfer function (IEC 61966-2-1), from 0..=65535 to 0..=1.
fn srgb_to_linear(value: u16) -> f32 {
    let x = f64::from(value) / f64::from(u16::MAX);
    let linear = match x <= 0.04045 {
        true => x / 12.92,
        false => libm::pow((x + 0.055) / 1.055, 2.4),
    };
    linear as f32
}
