//! Which format a file is in: by its name, or by its first bytes.

use std::ffi::OsStr;
use std::path::Path;

use super::{ImageProblem, exr};
use crate::whole_file;

/// The format of an image file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Exr,
    Hdr,
    Pfm,
    Png,
    Jpeg,
    WebP,
    Tiff,
    Tga,
    Bmp,
}

/// The format of an image file that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputFormat {
    /// Linear `f32`, with metadata.
    Exr,
    /// Linear RGBE.
    Hdr,
    /// 8-bit sRGB.
    Png,
}

impl From<OutputFormat> for Format {
    fn from(format: OutputFormat) -> Self {
        match format {
            OutputFormat::Exr => Self::Exr,
            OutputFormat::Hdr => Self::Hdr,
            OutputFormat::Png => Self::Png,
        }
    }
}

impl Format {
    /// The formats and the extensions of their names, those that are written first.
    const EXTENSIONS: [(&str, Self); 11] = [
        ("exr", Self::Exr),
        ("png", Self::Png),
        ("hdr", Self::Hdr),
        ("pfm", Self::Pfm),
        ("jpg", Self::Jpeg),
        ("jpeg", Self::Jpeg),
        ("webp", Self::WebP),
        ("tif", Self::Tiff),
        ("tiff", Self::Tiff),
        ("tga", Self::Tga),
        ("bmp", Self::Bmp),
    ];

    /// The format that the name's extension stands for, in upper or lower case.
    pub fn of_name(path: &Path) -> Option<Self> {
        let extension = path.extension().and_then(OsStr::to_str)?.to_ascii_lowercase();
        Self::EXTENSIONS.into_iter().find(|(name, _)| *name == extension).map(|(_, format)| format)
    }

    /// The format of a file to be written: the one that is asked for, or by its name, or EXR where what is written to is
    /// no file and its name says nothing.
    pub fn of_output(path: &Path, asked: Option<OutputFormat>) -> Result<Self, ImageProblem> {
        let is_written = |format: &Self| matches!(format, Self::Exr | Self::Png | Self::Hdr);
        let named = || Self::of_name(path).filter(is_written);
        let of_stream = || whole_file::is_stream(path).then_some(Self::Exr);
        let format = asked.map(Self::from).or_else(named).or_else(of_stream);
        format.ok_or(ImageProblem::UnknownFormat { extensions: ".exr, .png or .hdr" })
    }

    /// The format of a file to be read, by its name.
    pub fn of_input(path: &Path) -> Result<Self, ImageProblem> {
        Self::of_name(path).ok_or(ImageProblem::UnknownFormat {
            extensions: ".exr, .png, .hdr, .pfm, .jpg, .webp, .tif, .tga or .bmp",
        })
    }

    /// The format that a file's first bytes show. A TGA has no such bytes.
    pub fn of_contents(bytes: &[u8]) -> Option<Self> {
        const MAGIC: [(&[u8], Format); 11] = [
            (&exr::MAGIC, Format::Exr),
            (b"#?", Format::Hdr),
            (b"PF\n", Format::Pfm),
            (b"Pf\n", Format::Pfm),
            (b"\x89PNG\r\n\x1a\n", Format::Png),
            (b"\xff\xd8\xff", Format::Jpeg),
            (b"BM", Format::Bmp),
            (b"II*\0", Format::Tiff),
            (b"MM\0*", Format::Tiff),
            // Those of more than 4 GiB, or made for that.
            (b"II+\0", Format::Tiff),
            (b"MM\0+", Format::Tiff),
        ];
        if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
            return Some(Self::WebP);
        }
        MAGIC.into_iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, format)| format)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_contents_show_the_format() {
        let name = |name: &str| Format::of_name(Path::new(name));
        assert_eq!(
            [name("a.EXR"), name("b.c.jpeg"), name("jpg"), name("a.gif")],
            [Some(Format::Exr), Some(Format::Jpeg), None, None]
        );
        assert_eq!(Format::of_contents(b"#?RADIANCE\n"), Some(Format::Hdr));
        assert_eq!(Format::of_contents(b"\x89PNG\r\n\x1a\nIHDR"), Some(Format::Png));
        assert_eq!(Format::of_contents(b"RIFF\x1a\0\0\0WEBPVP8L"), Some(Format::WebP));
        assert_eq!(Format::of_contents(b"RIFF\x1a\0\0\0WAVEfmt "), None);
        assert_eq!(Format::of_contents(b"MM\0*"), Some(Format::Tiff));
        assert_eq!(Format::of_contents(b"\0\0\x02"), None, "a TGA shows nothing");
    }

    #[test]
    fn what_is_only_read_is_not_written() {
        for name in ["a.jpg", "a.jpeg", "a.tga", "a.bmp", "a.pfm", "a.webp", "a.tif", "a.TIFF"] {
            assert!(Format::of_input(Path::new(name)).is_ok());
            assert!(
                matches!(Format::of_output(Path::new(name), None), Err(ImageProblem::UnknownFormat { .. })),
                "{name}"
            );
        }
        let format = |name: &str, asked| Format::of_output(Path::new(name), asked).expect("it is written");
        assert_eq!(format("a.png", Some(OutputFormat::Hdr)), Format::Hdr);
        assert_eq!(format(whole_file::STDOUT, None), Format::Exr);
        assert_eq!(format(whole_file::STDOUT, Some(OutputFormat::Png)), Format::Png);
    }
}
