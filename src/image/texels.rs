//! What image files hold before it is taken for radiance: colour with alpha, of codes that may stand for anything.

use glam::Vec3;

use super::Image;

/// What integer codes of an image file stand for, as a share of the largest code. Alpha is always such a share, and formats
/// of floats hold linear values under either.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// The sRGB signal of a colour, whose linear light the texels are.
    Srgb,
    /// The value itself, as of a normal, a roughness or an opacity.
    Raw,
}

/// The texels of an image file.
#[derive(Debug, Clone, PartialEq)]
pub struct Texels {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Red, green, blue and alpha, `width * height` entries in rows, row 0 at the top. Alpha is 1 where the file has none.
    /// Colours are as they stand in the file: in EXR files they are usually premultiplied by alpha, in others not.
    pub rgba: Vec<[f32; 4]>,
}

impl From<Texels> for Image {
    /// The colours, whatever their alpha.
    fn from(texels: Texels) -> Self {
        let Texels { width, height, rgba } = texels;
        Self::new(width, height, rgba.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::{io::Cursor, path::Path};

    use ::image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgba};

    use super::*;
    use crate::image::{decode_image, decode_texels, srgb};

    fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.into().write_to(&mut bytes, ImageFormat::Png).expect("a PNG is written to memory");
        bytes.into_inner()
    }

    fn texel(bytes: &[u8], encoding: Encoding) -> [f32; 4] {
        decode_texels(Path::new("a"), bytes, encoding).expect("it is an image").rgba[0]
    }

    #[test]
    fn codes_are_light_or_shares_and_alpha_is_always_a_share() {
        let bytes = png(ImageBuffer::from_pixel(1, 1, Rgba([0u8, 51, 255, 102])));
        assert_eq!(texel(&bytes, Encoding::Raw), [0.0, 0.2, 1.0, 0.4]);
        assert_eq!(texel(&bytes, Encoding::Srgb), [0.0, srgb::decode(0.2) as f32, 1.0, 0.4]);
        let wide = png(ImageBuffer::from_pixel(1, 1, Luma([13_107u16])));
        assert_eq!(texel(&wide, Encoding::Raw), [0.2, 0.2, 0.2, 1.0]);
        let image = decode_image(Path::new("a"), &bytes).expect("it is an image");
        assert_eq!(image.pixels, [Vec3::new(0.0, srgb::decode(0.2) as f32, 1.0)]);
    }
}
