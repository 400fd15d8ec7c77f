//! Formats of integer codes: PNG, JPEG, TGA and BMP.

use std::io::{self, BufWriter, Cursor, Write};

use ::image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::{Encoding, Image, ImageProblem, Texels, limits::check_size, srgb};

/// Reads codes of 8 or 16 bits, whatever the file's colour profile says. `name` is what messages call the format.
pub fn decode(
    name: &'static str,
    format: ImageFormat,
    bytes: &[u8],
    encoding: Encoding,
) -> Result<Texels, ImageProblem> {
    let damaged = |error: ::image::ImageError| ImageProblem::decode(name, error);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    // What is too large is refused below, by the number of its pixels.
    reader.no_limits();
    let decoder = reader.into_decoder().map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    // 8-bit codes become 16-bit codes by * 257, so code / largest code stays the same number.
    let codes = DynamicImage::from_decoder(decoder).map_err(damaged)?.into_rgba16();
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
