//! Images to files and back, by the extension of the file's name.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Cursor, Read, Seek, Write};
use std::path::Path;

use glam::Vec3;
use image::{DynamicImage, ImageDecoder, codecs::png::PngDecoder};

use super::{FilmError, Image, exr, rgbe, srgb};
use crate::whole_file;

/// Most pixels that [`read_image`] takes, 3 GiB of memory. A damaged header cannot ask for more.
pub const MAX_PIXELS: u64 = 1 << 28;

/// How an image becomes a file.
#[derive(Debug, Clone, Copy, Default)]
pub struct WriteOptions<'a> {
    /// Exposure of a PNG in stops: radiance is multiplied by 2^exposure. EXR and HDR hold radiance
    /// itself and pay no heed.
    pub exposure: f32,
    /// Ordered (key, text) pairs that an EXR carries as text attributes. Keys differ, contain a dot
    /// (`raywave.samples`), and have at most 255 bytes. PNG and HDR carry none.
    pub metadata: &'a [(String, String)],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Exr,
    Png,
    Hdr,
}

impl Format {
    /// The format that the name's extension stands for, in upper or lower case.
    fn of(path: &Path) -> Result<Self, FilmError> {
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or("");
        match extension.to_ascii_lowercase().as_str() {
            "exr" => Ok(Self::Exr),
            "png" => Ok(Self::Png),
            "hdr" => Ok(Self::Hdr),
            _ => Err(FilmError::UnknownFormat { path: path.to_path_buf() }),
        }
    }
}

/// Says whether [`write_image`] could write here, to be asked before the rendering begins. Leaves
/// no trace.
///
/// # Errors
///
/// An extension that is unknown, a folder that is missing or takes no new file, a path that is a
/// folder.
pub fn check_output(path: &Path) -> Result<(), FilmError> {
    Format::of(path)?;
    whole_file::check(path).map_err(unwritable(path))
}

/// Writes an image to the format that the extension of `path` names:
///
/// - `.exr`: linear `f32` RGB, ZIP compressed, with the metadata. Every bit survives.
/// - `.hdr`: linear RGBE, mantissas rounded. Negative light and NaN become 0, infinity the largest
///   value.
/// - `.png`: 8-bit sRGB of radiance * 2^exposure, rounded. There is no tone curve: light above 1
///   is clamped. NaN is black.
///
/// The file appears under its name complete or not at all, with the permissions of any new file;
/// a file that stood there is replaced. The same image and options give the same bytes.
///
/// # Errors
///
/// What [`check_output`] finds, an image without pixels, a metadata key that EXR cannot take, a
/// full disk.
pub fn write_image(path: &Path, image: &Image, options: &WriteOptions) -> Result<(), FilmError> {
    let format = check_image(path, image, options)?;
    whole_file::write_freely(path, |file| encode(file, format, image, options)).map_err(unwritable(path))
}

/// The bytes that [`write_image`] puts into the file.
///
/// # Errors
///
/// As [`write_image`], as far as they do not concern the disk.
pub fn image_bytes(path: &Path, image: &Image, options: &WriteOptions) -> Result<Vec<u8>, FilmError> {
    let format = check_image(path, image, options)?;
    let mut bytes = Cursor::new(Vec::new());
    encode(&mut bytes, format, image, options).map_err(unwritable(path))?;
    Ok(bytes.into_inner())
}

/// Whether a file of that name can hold the image, and in which format.
fn check_image(path: &Path, image: &Image, options: &WriteOptions) -> Result<Format, FilmError> {
    let format = Format::of(path)?;
    let pixels = image.pixels.len();
    if pixels == 0 || pixels as u64 != u64::from(image.width) * u64::from(image.height) {
        return Err(FilmError::Shape { path: path.to_path_buf(), width: image.width, height: image.height, pixels });
    }
    check_metadata(path, options.metadata)?;
    Ok(format)
}

/// Writes a file a few rows at a time: beside the image it takes no memory to speak of.
fn encode(
    file: &mut (impl Read + Write + Seek),
    format: Format,
    image: &Image,
    options: &WriteOptions,
) -> io::Result<()> {
    match format {
        Format::Exr => exr::encode(file, image, options.metadata),
        Format::Png => encode_png(file, image, options.exposure),
        Format::Hdr => {
            let mut file = BufWriter::new(file);
            rgbe::encode(&mut file, image)?;
            file.flush()
        }
    }
}

/// Reads an image as linear radiance, in the format that the extension of `path` names.
///
/// - `.exr`: `f16` or `f32`, channels `R`, `G`, `B`, or `Y`, or the only group `name.R`, `name.G`,
///   `name.B`; the data window becomes the image.
/// - `.hdr`: its `EXPOSURE` is divided out.
/// - `.png`: 8 or 16 bits, taken as sRGB whatever its colour chunks say.
///
/// Alpha is left aside in all of them.
///
/// # Errors
///
/// A file that is missing, damaged, of another format than its extension says, without colour, or
/// of more than [`MAX_PIXELS`].
pub fn read_image(path: &Path) -> Result<Image, FilmError> {
    let format = Format::of(path)?;
    let bytes = fs::read(path).map_err(|cause| FilmError::Open { path: path.to_path_buf(), cause })?;
    match format {
        Format::Exr => exr::decode(path, &bytes),
        Format::Png => decode_png(path, &bytes),
        Format::Hdr => rgbe::decode(path, &bytes),
    }
}

/// Reads the text attributes of an EXR file, in the order in which they stand there: for a file of
/// this program, the `metadata` of its [`WriteOptions`].
///
/// # Errors
///
/// A file that is not EXR, missing or damaged.
pub fn read_metadata(path: &Path) -> Result<Vec<(String, String)>, FilmError> {
    if Format::of(path)? != Format::Exr {
        return Err(FilmError::NoMetadata { path: path.to_path_buf() });
    }
    let file = File::open(path).map_err(|cause| FilmError::Open { path: path.to_path_buf(), cause })?;
    exr::text_attributes(BufReader::new(file)).map_err(|cause| FilmError::decode(path, "EXR", cause))
}

/// Refuses what would not fit into memory.
pub(super) fn check_size(path: &Path, width: u64, height: u64) -> Result<(), FilmError> {
    match width.checked_mul(height) {
        Some(pixels) if pixels <= MAX_PIXELS => Ok(()),
        _ => Err(FilmError::TooLarge { path: path.to_path_buf(), width, height }),
    }
}

fn check_metadata(path: &Path, metadata: &[(String, String)]) -> Result<(), FilmError> {
    for (index, (key, _)) in metadata.iter().enumerate() {
        let repeated = metadata[..index].iter().any(|(earlier, _)| earlier == key);
        let fault = exr::key_fault(key).or(repeated.then_some("use every key once"));
        if let Some(rule) = fault {
            return Err(FilmError::MetadataKey { path: path.to_path_buf(), key: key.clone(), rule });
        }
    }
    Ok(())
}

fn unwritable(path: &Path) -> impl FnOnce(io::Error) -> FilmError {
    |cause| FilmError::Write { path: path.to_path_buf(), cause }
}

fn encode_png(file: impl Write, image: &Image, exposure: f32) -> io::Result<()> {
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

fn decode_png(path: &Path, bytes: &[u8]) -> Result<Image, FilmError> {
    let damaged = |error: image::ImageError| FilmError::decode(path, "PNG", error);
    let decoder = PngDecoder::new(Cursor::new(bytes)).map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    check_size(path, width.into(), height.into())?;
    // 8-bit codes become 16-bit codes by * 257, so code / largest code stays the same number.
    let codes = DynamicImage::from_decoder(decoder).map_err(damaged)?.into_rgb16();
    let pixels = codes
        .pixels()
        .map(|pixel| {
            let linear = |code: u16| srgb::decode(f64::from(code) / 65535.0) as f32;
            Vec3::from(pixel.0.map(linear))
        })
        .collect();
    Ok(Image::new(width, height, pixels))
}
