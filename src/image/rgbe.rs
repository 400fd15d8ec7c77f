//! Radiance HDR: three 8-bit mantissas that share one exponent.
//!
//! Source: Ward, "Real Pixels", Graphics Gems II (1991), with one change. Ward truncates the
//! mantissas, which darkens an image by half a step on average; a measuring instrument rounds.

use std::io::{self, Write};

use ::image::{DynamicImage, ImageDecoder, codecs::hdr::HdrDecoder};
use glam::Vec3;

use super::{Image, ImageProblem, limits::check_size};

/// Largest exponent byte. The stored value is mantissa * 2^(exponent - 136).
const MAX_EXPONENT: i32 = 255;

/// Writes the image as a Radiance file, scanlines stored flat.
///
/// Flat scanlines are legal and need no escape: a reader takes a scanline for run-length coded
/// when it opens with (2, 2, < 128) or (1, 1, 1), and the largest mantissa written here is 0 or at
/// least 128.
pub fn encode(file: &mut impl Write, image: &Image) -> io::Result<()> {
    write!(file, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n", image.height, image.width)?;
    image.pixels.iter().try_for_each(|&pixel| file.write_all(&rgbe(pixel)))
}

/// One pixel. Negative light and NaN become 0, too much becomes the largest value there is.
fn rgbe(radiance: Vec3) -> [u8; 4] {
    // `max` prefers the number to NaN.
    let light = radiance.to_array().map(|channel| f64::from(channel.max(0.0)));
    let largest = light[0].max(light[1]).max(light[2]);
    if largest < f64::from(f32::MIN_POSITIVE) {
        return [0; 4];
    }
    // `largest` is now normal in f64, so its exponent field is floor(log2) without rounding.
    let floor_log2 = ((largest.to_bits() >> 52) & 0x7ff) as i32 - 1023;
    let mut exponent = floor_log2 + 129;
    if mantissa(largest, exponent) > 255.0 {
        exponent += 1;
    }
    let exponent = exponent.min(MAX_EXPONENT);
    let [r, g, b] = light.map(|channel| mantissa(channel, exponent) as u8);
    [r, g, b, exponent as u8]
}

fn mantissa(light: f64, exponent: i32) -> f64 {
    (light * f64::exp2(f64::from(136 - exponent))).round()
}

/// Reads a Radiance file, flat or run-length coded, and divides its `EXPOSURE` out.
pub fn decode(bytes: &[u8]) -> Result<Image, ImageProblem> {
    let damaged = |cause: String| ImageProblem::decode("Radiance HDR", cause);
    if !bytes.starts_with(b"#?") {
        return Err(damaged("it does not begin with #?RADIANCE".into()));
    }
    // Not strict, because the signature may be `#?RGBE` too.
    let decoder = HdrDecoder::new_nonstrict(bytes).map_err(|error| damaged(error.to_string()))?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    let exposure = decoder.metadata().exposure.unwrap_or(1.0);
    let pixels = DynamicImage::from_decoder(decoder)
        .map_err(|error| damaged(error.to_string()))?
        .into_rgb32f()
        .pixels()
        .map(|pixel| Vec3::from(pixel.0) / exposure)
        .collect();
    Ok(Image::new(width, height, pixels))
}
