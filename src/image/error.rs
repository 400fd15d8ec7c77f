//! What can go wrong between an image and its file.

use std::path::{Path, PathBuf};

/// An image file that could not be written or read. The message is one line, names the file and
/// says what to do; the cause is part of the text, so nothing is lost where sources are not printed.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct ImageError {
    /// The image file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: ImageProblem,
}

/// What is wrong with an image file, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ImageProblem {
    /// The file name does not say which format is meant.
    #[error("unknown image format; let the name end in {extensions}")]
    UnknownFormat {
        /// The extensions that are known.
        extensions: &'static str,
    },
    /// Neither contents nor name show a format.
    #[error("of no known image format; use EXR, HDR, PNG, JPEG, TGA or BMP")]
    UnknownContents,
    /// Nothing can be written there, or writing failed half-way and left nothing behind.
    #[error("cannot write the image: {cause}")]
    Write {
        /// What stands in the way.
        cause: std::io::Error,
    },
    /// The image has no pixels or not as many as its size says.
    #[error("cannot write an image of {width} x {height} with {pixels} pixels; render at least 1 x 1")]
    Shape {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Entries in the image.
        pixels: usize,
    },
    /// A metadata key that an EXR file cannot take.
    #[error("bad metadata key {key:?}: {rule}")]
    MetadataKey {
        /// The key.
        key: String,
        /// What a key must be.
        rule: &'static str,
    },
    /// The file could not be opened.
    #[error("cannot open the image ({cause}); check the path")]
    Open {
        /// What the system said.
        cause: std::io::Error,
    },
    /// The contents are not what the file's name or first bytes promise, or are damaged.
    #[error("not a readable {format} image ({cause}); write it anew or correct its extension")]
    Decode {
        /// Which format was expected.
        format: &'static str,
        /// What the decoder said.
        cause: String,
    },
    /// An EXR file without colour, or with several colours of which none is plain `R`, `G`, `B`.
    #[error("no colour to be found (R, G, B; or Y; or one group x.R, x.G, x.B) in: {channels}; save it as RGB")]
    NoColour {
        /// The channels it has.
        channels: String,
    },
    /// The file claims more pixels than this program reads.
    #[error("{width} x {height} pixels are more than the {most} that can be read; scale it down")]
    TooLarge {
        /// Width in pixels.
        width: u64,
        /// Height in pixels.
        height: u64,
        /// Pixels that can be read.
        most: u64,
    },
    /// Metadata was requested from a format that carries none here.
    #[error("only .exr files carry metadata; name one")]
    NoMetadata,
}

impl ImageProblem {
    /// What a decoder reports of damaged contents.
    pub(super) fn decode(format: &'static str, cause: impl ToString) -> Self {
        Self::Decode { format, cause: cause.to_string() }
    }

    /// The problem of the file at `path`.
    pub(super) fn at(self, path: &Path) -> ImageError {
        ImageError { path: path.to_path_buf(), problem: self }
    }
}
