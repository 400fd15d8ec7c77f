//! What can go wrong between an image and its file.

use std::path::{Path, PathBuf};

/// Why an image could not be written or read. Every message is one line, names the file and says
/// what to do; the cause is part of the text, so nothing is lost where sources are not printed.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The file name does not say which format is meant.
    #[error("{}: unknown image format; let the name end in .exr, .png or .hdr", path.display())]
    UnknownFormat {
        /// The image file.
        path: PathBuf,
    },
    /// Nothing can be written there, or writing failed half-way and left nothing behind.
    #[error("{}: cannot write the image: {cause}", path.display())]
    Write {
        /// The image file.
        path: PathBuf,
        /// What stands in the way.
        cause: std::io::Error,
    },
    /// The image has no pixels or not as many as its size says.
    #[error(
        "{}: cannot write an image of {width} x {height} with {pixels} pixels; render at least 1 x 1",
        path.display()
    )]
    Shape {
        /// The image file.
        path: PathBuf,
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Entries in the image.
        pixels: usize,
    },
    /// A metadata key that an EXR file cannot take.
    #[error("{}: bad metadata key {key:?}: {rule}", path.display())]
    MetadataKey {
        /// The image file.
        path: PathBuf,
        /// The key.
        key: String,
        /// What a key must be.
        rule: &'static str,
    },
    /// The file could not be opened.
    #[error("{}: cannot open the image ({cause}); check the path", path.display())]
    Open {
        /// The image file.
        path: PathBuf,
        /// What the system said.
        cause: std::io::Error,
    },
    /// The contents are not what the file name promises, or are damaged.
    #[error(
        "{}: not a readable {format} image ({cause}); write it anew or correct its extension",
        path.display()
    )]
    Decode {
        /// The image file.
        path: PathBuf,
        /// Which format was expected.
        format: &'static str,
        /// What the decoder said.
        cause: String,
    },
    /// An EXR file without colour, or with several colours of which none is plain `R`, `G`, `B`.
    #[error(
        "{}: no colour to be found (R, G, B; or Y; or one group x.R, x.G, x.B) in: {channels}; save it as RGB",
        path.display()
    )]
    NoColour {
        /// The image file.
        path: PathBuf,
        /// The channels it has.
        channels: String,
    },
    /// The file claims more pixels than this program reads.
    #[error(
        "{}: {width} x {height} pixels are more than the {} that can be read; scale it down",
        path.display(),
        super::MAX_PIXELS
    )]
    TooLarge {
        /// The image file.
        path: PathBuf,
        /// Width in pixels.
        width: u64,
        /// Height in pixels.
        height: u64,
    },
    /// Metadata was asked of a format that holds none here.
    #[error("{}: only .exr files carry metadata; name one", path.display())]
    NoMetadata {
        /// The image file.
        path: PathBuf,
    },
}

impl FilmError {
    /// What a decoder reports of damaged contents.
    pub(super) fn decode(path: &Path, format: &'static str, cause: impl ToString) -> Self {
        Self::Decode { path: path.to_path_buf(), format, cause: cause.to_string() }
    }
}
