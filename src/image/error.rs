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
    #[error("of no known image format; use EXR, HDR, PFM, PNG, JPEG, WebP, TIFF, TGA or BMP")]
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
    /// An EXR file without colour.
    #[error("no colour to be found (R, G, B; or Y; or a group x.R, x.G, x.B) in: {channels}; save it as RGB")]
    NoColour {
        /// The channels it has.
        channels: String,
    },
    /// An EXR file with several colours, none of which has the name of the image itself.
    #[error("several colours, none of them called combined, beauty, rgba or color: {groups}; save one alone as RGB")]
    SeveralColours {
        /// The groups of channels that hold a colour.
        groups: String,
    },
    /// An EXR file with channels of fewer values than pixels.
    #[error("the channels {channels} have fewer values than pixels, which is not read; save it as RGB")]
    Subsampled {
        /// Those channels.
        channels: String,
    },
    /// A JPEG of four inks without the marker that says whether its codes are ink or light.
    #[error("a CMYK JPEG without Adobe's marker, which leaves its colours open; save it as RGB")]
    UnmarkedInks,
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
    /// The file claims more pixels than so short a file holds in any format.
    #[error("{width} x {height} pixels in a file of {bytes} bytes, which is damaged or cut off; write it anew")]
    TooShort {
        /// Width in pixels.
        width: u64,
        /// Height in pixels.
        height: u64,
        /// Length of the file.
        bytes: usize,
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
