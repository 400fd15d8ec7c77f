//! Formats of integer codes: PNG, JPEG, WebP, TIFF, TGA and BMP.

use std::io::{self, BufWriter, Cursor, Write};

use ::image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::{
    Encoding, Image, ImageProblem, Texels,
    limits::{MAX_WORKING_BYTES, check_size},
    srgb,
};

/// Reads codes of 8 or 16 bits, whatever the file's colour profile says, or the floats that a TIFF may hold in their place.
/// `name` is what messages call the format.
pub fn decode(
    name: &'static str,
    format: ImageFormat,
    bytes: &[u8],
    encoding: Encoding,
) -> Result<Texels, ImageProblem> {
    let damaged = |error: ::image::ImageError| ImageProblem::decode(name, error);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    // The output is allocated below, once its size is known to be sound.
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_WORKING_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into(), bytes.len())?;
    let image = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    if matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_)) {
        let rgba = image.into_rgba32f().pixels().map(|pixel| pixel.0).collect();
        return Ok(Texels { width, height, rgba });
    }
    // 8-bit codes become 16-bit codes by * 257, so code / largest code stays the same number.
    let codes = image.into_rgba16();
    let share = |code: u16| f32::from(code) / f32::from(u16::MAX);
    let rgba = match encoding {
        Encoding::Srgb => {
            let linear = srgb::decoded_codes();
            let light = |code: u16| linear[usize::from(code)];
            codes.pixels().map(|pixel| pixel.0).map(|[r, g, b, a]| [light(r), light(g), light(b), share(a)]).collect()
        }
        Encoding::Raw => codes.pixels().map(|pixel| pixel.0.map(share)).collect(),
    };
    Ok(Texels { width, height, rgba })
}

/// Whether a JPEG has four inks without Adobe's marker. Adobe's programs store light, 255 less the ink, and mark it; the
/// decoder takes every file for theirs.
pub fn has_unmarked_inks(bytes: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xda;
    const ADOBE: u8 = 0xee;
    let mut rest = bytes.get(2..).unwrap_or_default();
    loop {
        let (marker, length) = match *rest {
            // Fill.
            [0xff, 0xff, ..] => {
                rest = &rest[1..];
                continue;
            }
            [0xff, marker, high, low, ..] => (marker, usize::from(u16::from_be_bytes([high, low]))),
            _ => return false,
        };
        let Some(segment) = rest.get(4..2 + length) else { return false };
        match marker {
            ADOBE if segment.starts_with(b"Adobe") => return false,
            START_OF_SCAN => return false,
            // A frame, of whatever coding. The other three are tables, an extension and arithmetic coding's.
            0xc0..=0xcf if ![0xc4, 0xc8, 0xcc].contains(&marker) => return segment.get(5) == Some(&4),
            _ => rest = &rest[2 + length..],
        }
    }
}

/// Writes an 8-bit sRGB PNG of radiance * 2^exposure, a row at a time.
pub fn encode_png(file: impl Write, image: &Image, exposure: f32) -> io::Result<()> {
    let gain = f64::from(exposure).exp2();
    let mut encoder = png::Encoder::new(BufWriter::new(file), image.width, image.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    encoder.set_filter(png::Filter::Adaptive);
    let mut header = encoder.write_header()?;
    let mut rows = header.stream_writer()?;
    for row in image.pixels.chunks(image.width as usize) {
        let radiances = row.iter().flat_map(|pixel| pixel.to_array());
        let codes: Vec<u8> = radiances.map(|radiance| srgb::encode_byte(f64::from(radiance) * gain)).collect();
        rows.write_all(&codes)?;
    }
    rows.finish()?;
    header.finish()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::image::decode_texels;

    /// A JPEG of 2 x 1 texels of the inks 200, 100, 50 and 25 of 255, by Adobe's marker.
    const INKS: &str = "ffd8ffee000e41646f626500640000000000ffdb004300020101010101020101010202020202040302020202050404030406\
        0506060605060606070908060709070606080b08090a0a0a0a0a06080b0c0b0a0c090a0a0affc00014080001000204431100\
        4d11005911004b1100ffc4001500010100000000000000000000000000000907ffc400141001000000000000000000000000\
        00000000ffda000e0443004d0059004b00003f0036d6c268661fffd9";

    fn inks() -> Vec<u8> {
        let byte = |at: usize| u8::from_str_radix(&INKS[at..at + 2], 16).expect("two digits");
        (0..INKS.len()).step_by(2).map(byte).collect()
    }

    /// Codes of 8 bits, of which the file has no finer ones.
    fn raw(bytes: &[u8]) -> Vec<[u8; 4]> {
        let texels = decode_texels(Path::new("a"), bytes, Encoding::Raw).expect("it is an image");
        texels.rgba.iter().map(|texel| texel.map(|share| (255.0 * share).round() as u8)).collect()
    }

    #[test]
    fn inks_become_light() {
        let near = |texels: &[[u8; 4]], expected: [u8; 3]| {
            assert_eq!(texels.len(), 2);
            for texel in texels {
                let is_near = expected.iter().zip(texel).all(|(a, b)| a.abs_diff(*b) <= 2);
                assert!(is_near && texel[3] == 255, "{texel:?}, not {expected:?}");
            }
        };
        let mut bytes = inks();
        near(&raw(&bytes), [50, 140, 185]);
        // The same planes as luminance and chroma of the inks; what libjpeg makes of them.
        let transform = bytes.windows(5).position(|word| word == b"Adobe").expect("it is marked") + 11;
        bytes[transform] = 2;
        near(&raw(&bytes), [83, 230, 137]);
    }

    #[test]
    fn inks_without_a_marker_are_refused() {
        let mut bytes = inks();
        assert!(!has_unmarked_inks(&bytes));
        bytes.drain(2..18);
        let problem =
            decode_texels(Path::new("a"), &bytes, Encoding::Srgb).expect_err("nothing says what its codes are");
        assert!(matches!(problem, ImageProblem::UnmarkedInks), "{problem}");
        for length in 0..bytes.len() {
            has_unmarked_inks(&bytes[..length]);
        }
    }

    /// A PNG of 2 x 1 codes, in which colour 0 may have an alpha of its own.
    fn png(colour: png::ColorType, depth: png::BitDepth, transparency: Option<&[u8]>, codes: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if colour == png::ColorType::Indexed {
            encoder.set_palette(vec![10, 20, 30, 40, 50, 60]);
        }
        if let Some(transparency) = transparency {
            encoder.set_trns(transparency.to_vec());
        }
        let mut writer = encoder.write_header().expect("memory takes all");
        writer.write_image_data(codes).expect("memory takes all");
        writer.finish().expect("memory takes all");
        bytes
    }

    #[test]
    fn every_kind_of_png_is_read() {
        use png::{BitDepth, ColorType};
        let [first, second] = [[10, 20, 30], [40, 50, 60]].map(|[r, g, b]| [r, g, b, 255]);
        let palette = |depth, transparency, codes: &[u8]| raw(&png(ColorType::Indexed, depth, transparency, codes));
        assert_eq!(palette(BitDepth::Eight, None, &[1, 0]), [second, first]);
        assert_eq!(palette(BitDepth::One, None, &[0b1000_0000]), [second, first]);
        assert_eq!(palette(BitDepth::Two, Some(&[77]), &[0b0100_0000]), [second, [10, 20, 30, 77]]);
        let grey = png(ColorType::Grayscale, BitDepth::Four, None, &[0x3f]);
        assert_eq!(raw(&grey), [[51, 51, 51, 255], [255; 4]]);
        let keyed = png(ColorType::Rgb, BitDepth::Eight, Some(&[0, 1, 0, 2, 0, 3]), &[1, 2, 3, 3, 2, 1]);
        assert_eq!(raw(&keyed), [[1, 2, 3, 0], [3, 2, 1, 255]]);
        let wide = png(ColorType::GrayscaleAlpha, BitDepth::Sixteen, None, &[0x12, 0x34, 0x80, 0, 0, 1, 0xff, 0xff]);
        let texels = decode_texels(Path::new("a"), &wide, Encoding::Raw).expect("it is an image").rgba;
        let [grey, alpha, dark] = [0x1234 as f32, 32768.0, 1.0].map(|code| code / 65535.0);
        assert_eq!(texels, [[grey, grey, grey, alpha], [dark, dark, dark, 1.0]]);
    }

    #[test]
    fn tiff_and_webp_are_read_by_their_contents() {
        let image = ::image::RgbaImage::from_raw(2, 1, vec![1, 2, 3, 4, 200, 100, 50, 255]).expect("it has two texels");
        for format in [ImageFormat::Tiff, ImageFormat::WebP, ImageFormat::Png, ImageFormat::Tga] {
            let mut bytes = Cursor::new(Vec::new());
            image.write_to(&mut bytes, format).expect("memory takes all");
            let bytes = bytes.into_inner();
            let name = if format == ImageFormat::Tga { "a.tga" } else { "a.jpg" };
            let texels = decode_texels(Path::new(name), &bytes, Encoding::Raw).expect("it is an image").rgba;
            assert_eq!(
                texels,
                image.pixels().map(|pixel| pixel.0.map(|code| f32::from(code) / 255.0)).collect::<Vec<_>>()
            );
        }
        let floats = ::image::Rgb32FImage::from_raw(1, 1, vec![0.25, -1.0, 1e9]).expect("it has a texel");
        let mut bytes = Cursor::new(Vec::new());
        floats.write_to(&mut bytes, ImageFormat::Tiff).expect("memory takes all");
        let texels = decode_texels(Path::new("a"), bytes.get_ref(), Encoding::Srgb).expect("it is an image");
        assert_eq!(texels.rgba, [[0.25, -1.0, 1e9, 1.0]]);
    }
}
