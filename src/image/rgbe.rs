//! Radiance HDR: three 8-bit mantissas that share one exponent.
//!
//! Source: Ward, "Real Pixels", Graphics Gems II (1991), with one change. Ward truncates the
//! mantissas, which darkens an image by half a step on average; a measuring instrument rounds.

use std::io::{self, Write};

use ::image::{DynamicImage, ImageDecoder, codecs::hdr::HdrDecoder};
use glam::Vec3;

use super::{Image, ImageProblem, Texels, limits::check_size};

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

/// Reads a Radiance file, flat or run-length coded, and divides its `EXPOSURE` and `COLORCORR` out. Where such a line comes
/// several times, all of them count.
pub fn decode(bytes: &[u8]) -> Result<Texels, ImageProblem> {
    let damaged = |cause: String| ImageProblem::decode("Radiance HDR", cause);
    if !bytes.starts_with(b"#?") {
        return Err(damaged("it does not begin with #?RADIANCE".into()));
    }
    // Not strict, because the signature may be `#?RGBE` too.
    let decoder = HdrDecoder::new_nonstrict(bytes).map_err(|error| damaged(error.to_string()))?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into(), bytes.len())?;
    let metadata = decoder.metadata();
    let correction = metadata.color_correction.map_or(Vec3::ONE, Vec3::from);
    let exposure = metadata.exposure.unwrap_or(1.0) * correction;
    if !exposure.is_finite() || exposure.min_element() <= 0.0 {
        return Err(damaged(format!("its EXPOSURE and COLORCORR multiply to {exposure}, which is not above 0")));
    }
    let rgba = DynamicImage::from_decoder(decoder)
        .map_err(|error| damaged(error.to_string()))?
        .into_rgb32f()
        .pixels()
        .map(|pixel| (Vec3::from(pixel.0) / exposure).extend(1.0).to_array())
        .collect();
    Ok(Texels { width, height, rgba })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(header: &str) -> Result<[f32; 4], ImageProblem> {
        let head = format!("{header}FORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n");
        decode(&[head.as_bytes(), b"\x80\x40\x20\x81"].concat()).map(|texels| texels.rgba[0])
    }

    #[test]
    fn what_an_image_was_multiplied_by_is_divided_out() {
        assert_eq!(decoded("#?RADIANCE\n").unwrap(), [1.0, 0.5, 0.25, 1.0]);
        let both = "#?RGBE\n# EXPOSURE=9\nEXPOSURE=2\nEXPOSURE= 4.0 \nCOLORCORR=1 0.5 0.25\n";
        assert_eq!(decoded(both).unwrap(), [0.125, 0.125, 0.125, 1.0]);
    }

    #[test]
    fn an_exposure_of_nothing_is_refused() {
        for line in ["EXPOSURE=0\n", "EXPOSURE=inf\n", "EXPOSURE=-1\n", "COLORCORR=1 0 1\n"] {
            let problem = decoded(&format!("#?RADIANCE\n{line}")).expect_err(line);
            assert!(problem.to_string().contains("EXPOSURE and COLORCORR"), "{problem}");
        }
    }
}
