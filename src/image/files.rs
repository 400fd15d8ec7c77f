//! Images to files and back.

use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Cursor, Read, Seek, Write};
use std::path::Path;

use ::image::ImageFormat;

use super::format::{Format, OutputFormat};
use super::{Encoding, Image, ImageError, ImageProblem, Texels, codes, exr, pfm, rgbe};
use crate::whole_file;

/// How an image becomes a file.
#[derive(Debug, Clone, Copy, Default)]
pub struct WriteOptions<'a> {
    /// Exposure of a PNG in stops: radiance is multiplied by 2^exposure. EXR and HDR hold radiance
    /// itself and ignore it.
    pub exposure: f32,
    /// Ordered (key, text) pairs that an EXR carries as text attributes. Keys differ, contain a dot
    /// (`raywave.samples`), and have at most 255 bytes. PNG and HDR carry none.
    pub metadata: &'a [(String, String)],
    /// The format, in place of the one that the file's name tells.
    pub format: Option<OutputFormat>,
}

/// Says whether [`write_image`] could write here, to be asked before the rendering begins. Leaves
/// no trace.
///
/// # Errors
///
/// An extension that is unknown where no `format` is asked for, a folder that is missing or takes no new file, a path
/// that is a folder, a file that is read-only.
pub fn check_output(path: &Path, format: Option<OutputFormat>) -> Result<(), ImageError> {
    Format::of_output(path, format).map_err(|problem| problem.at(path))?;
    whole_file::check(path).map_err(unwritable(path))
}

/// Writes an image in the format that is asked for or that the extension of `path` names:
///
/// - `.exr`: linear `f32` RGB, ZIP compressed, with the metadata. Every bit survives.
/// - `.hdr`: linear RGBE, mantissas rounded. Negative light and NaN become 0, infinity the largest
///   value.
/// - `.png`: 8-bit sRGB of radiance * 2^exposure, rounded. There is no tone curve: light above 1
///   is clamped. NaN is black.
///
/// The file appears under its name complete or not at all, as [`whole_file::write`] says. What is no plain file, such as
/// a FIFO or [`whole_file::STDOUT`], is written to: as EXR, where neither options nor extension name a format. The same
/// image and options give the same bytes.
///
/// # Errors
///
/// What [`check_output`] finds, an image without pixels, a metadata key that EXR cannot take, a
/// full disk.
pub fn write_image(path: &Path, image: &Image, options: &WriteOptions) -> Result<(), ImageError> {
    let format = check_image(path, image, options)?;
    whole_file::write_freely(path, |mut file| encode(&mut file, format, image, options)).map_err(unwritable(path))
}

/// The bytes that [`write_image`] puts into the file.
///
/// # Errors
///
/// As [`write_image`], as far as they do not concern the disk.
pub fn image_bytes(path: &Path, image: &Image, options: &WriteOptions) -> Result<Vec<u8>, ImageError> {
    let format = check_image(path, image, options)?;
    let mut bytes = Cursor::new(Vec::new());
    encode(&mut bytes, format, image, options).map_err(unwritable(path))?;
    Ok(bytes.into_inner())
}

/// Whether a file of that name can hold the image, and in which format.
fn check_image(path: &Path, image: &Image, options: &WriteOptions) -> Result<Format, ImageError> {
    let check = || {
        let format = Format::of_output(path, options.format)?;
        let pixels = image.pixels.len();
        if pixels == 0 || pixels as u64 != u64::from(image.width) * u64::from(image.height) {
            return Err(ImageProblem::Shape { width: image.width, height: image.height, pixels });
        }
        check_metadata(options.metadata)?;
        Ok(format)
    };
    check().map_err(|problem| problem.at(path))
}

/// Writes a file a few rows at a time, so that it needs hardly any memory beyond the image.
fn encode(
    file: &mut (impl Read + Write + Seek),
    format: Format,
    image: &Image,
    options: &WriteOptions,
) -> io::Result<()> {
    match format {
        Format::Exr => exr::encode(file, image, options.metadata),
        Format::Hdr => {
            let mut file = BufWriter::new(file);
            rgbe::encode(&mut file, image)?;
            file.flush()
        }
        Format::Png => codes::encode_png(file, image, options.exposure),
        _ => unreachable!("Format::of_output gives no format that is only read"),
    }
}

/// Reads an image as linear radiance, in the format that the extension of `path` names.
///
/// - `.exr`: `f16`, `f32` or `u32`, channels `R`, `G`, `B`, or `Y`, or a group `name.R`, `name.G`,
///   `name.B`: the only one, or the one whose name ends in `combined`, `beauty`, `rgba` or `color`.
///   The data window becomes the image.
/// - `.hdr`: its `EXPOSURE` and `COLORCORR` are divided out.
/// - `.pfm`: colour or grey; of its scale only the sign counts, which tells the order of bytes.
/// - `.png`, `.jpg`, `.webp`, `.tif`, `.tga`, `.bmp`: 8 or 16 bits, taken as sRGB whatever their
///   colour profile says. A TIFF may also hold `f32`, which are linear. Inks of a JPEG become light
///   by (1 - C)(1 - K).
///
/// Alpha is ignored in all of them.
///
/// # Errors
///
/// A file that is missing, damaged, of another format than its extension says, without colour, or
/// of more than [`MAX_PIXELS`](super::MAX_PIXELS).
pub fn read_image(path: &Path) -> Result<Image, ImageError> {
    let read = || {
        let format = Format::of_input(path)?;
        let bytes = fs::read(path).map_err(|cause| ImageProblem::Open { cause })?;
        decode(format, &bytes, Encoding::Srgb).map(Image::from)
    };
    read().map_err(|problem| problem.at(path))
}

/// Decodes the contents of an image file as [`read_image`] does, but goes by what they are rather
/// than by their name: images that others made, textures above all, often bear the wrong extension.
/// Only where the contents do not show their format, as of a TGA, `path` decides.
///
/// # Errors
///
/// As [`read_image`], as far as they do not concern the disk.
pub fn decode_image(path: &Path, bytes: &[u8]) -> Result<Image, ImageProblem> {
    decode_texels(path, bytes, Encoding::Srgb).map(Image::from)
}

/// Decodes the contents of an image file as [`decode_image`] does, with its alpha, and with integer codes taken for what
/// `encoding` says.
///
/// # Errors
///
/// As [`decode_image`].
pub fn decode_texels(path: &Path, bytes: &[u8], encoding: Encoding) -> Result<Texels, ImageProblem> {
    let format = Format::of_contents(bytes).or_else(|| Format::of_name(path));
    decode(format.ok_or(ImageProblem::UnknownContents)?, bytes, encoding)
}

fn decode(format: Format, bytes: &[u8], encoding: Encoding) -> Result<Texels, ImageProblem> {
    match format {
        Format::Exr => exr::decode(bytes),
        Format::Hdr => rgbe::decode(bytes),
        Format::Pfm => pfm::decode(bytes),
        Format::Png => codes::decode("PNG", ImageFormat::Png, bytes, encoding),
        Format::Jpeg if codes::has_unmarked_inks(bytes) => Err(ImageProblem::UnmarkedInks),
        Format::Jpeg => codes::decode("JPEG", ImageFormat::Jpeg, bytes, encoding),
        Format::WebP => codes::decode("WebP", ImageFormat::WebP, bytes, encoding),
        Format::Tiff => codes::decode("TIFF", ImageFormat::Tiff, bytes, encoding),
        Format::Tga => codes::decode("TGA", ImageFormat::Tga, bytes, encoding),
        Format::Bmp => codes::decode("BMP", ImageFormat::Bmp, bytes, encoding),
    }
}

/// Reads the text attributes of an EXR file, in the order in which they stand there: for a file of
/// this program, the `metadata` of its [`WriteOptions`].
///
/// # Errors
///
/// A file that is not EXR, missing or damaged.
pub fn read_metadata(path: &Path) -> Result<Vec<(String, String)>, ImageError> {
    let read = || {
        if Format::of_input(path)? != Format::Exr {
            return Err(ImageProblem::NoMetadata);
        }
        let file = File::open(path).map_err(|cause| ImageProblem::Open { cause })?;
        exr::text_attributes(BufReader::new(file)).map_err(|cause| ImageProblem::decode(exr::NAME, cause))
    };
    read().map_err(|problem| problem.at(path))
}

fn check_metadata(metadata: &[(String, String)]) -> Result<(), ImageProblem> {
    for (index, (key, _)) in metadata.iter().enumerate() {
        let repeated = metadata[..index].iter().any(|(earlier, _)| earlier == key);
        let fault = exr::key_fault(key).or(repeated.then_some("use every key once"));
        if let Some(rule) = fault {
            return Err(ImageProblem::MetadataKey { key: key.clone(), rule });
        }
    }
    Ok(())
}

fn unwritable(path: &Path) -> impl FnOnce(io::Error) -> ImageError {
    |cause| ImageProblem::Write { cause }.at(path)
}
