//! What can be wrong with the files of a scene: one line each, with the place and what to do.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use super::text::one_line;

/// A file and, where one is to blame, a line in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The file, as it was named by the user or by the file that refers to it.
    pub path: PathBuf,
    /// Line number, counted from 1.
    pub line: Option<usize>,
}

impl Place {
    pub(super) fn file(path: &Path) -> Self {
        Self { path: path.to_path_buf(), line: None }
    }

    pub(super) fn line(path: &Path, line: usize) -> Self {
        Self { path: path.to_path_buf(), line: Some(line) }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&one_line(&self.path.to_string_lossy()))?;
        match self.line {
            Some(line) => write!(f, ":{line}"),
            None => Ok(()),
        }
    }
}

/// Why a scene was refused. Every message is one line: `FILE:LINE: what is wrong; what to do`.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file that cannot be read, or that is neither TOML nor OBJ.
    #[error("{place}: {problem}")]
    File {
        /// Where the file is named, or the file itself.
        place: Place,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A scene file that breaks the format.
    #[error("{place}: {problem}")]
    Toml {
        /// The line to blame.
        place: Place,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A mesh that breaks the format, or that holds nothing to render.
    #[error("{place}: {problem}")]
    Obj {
        /// The line to blame.
        place: Place,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A material that breaks the format.
    #[error("{place}: {problem}")]
    Mtl {
        /// The line to blame.
        place: Place,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A texture or an environment that cannot be used.
    #[error("{place}: {problem}")]
    Image {
        /// The line that names the image.
        place: Place,
        /// The image, what is wrong with it, and what to do.
        problem: String,
    },
    /// More vertices or triangles than 32-bit indices reach.
    #[error("{place}: {problem}")]
    TooLarge {
        /// The file that crosses the limit.
        place: Place,
        /// What there is too much of, and what to do.
        problem: String,
    },
    /// A generated file that cannot be written.
    #[error("{place}: {problem}")]
    Write {
        /// The file.
        place: Place,
        /// What is wrong and what to do.
        problem: String,
    },
}

impl SceneError {
    /// The file and line to blame.
    pub fn place(&self) -> &Place {
        match self {
            Self::File { place, .. }
            | Self::Toml { place, .. }
            | Self::Obj { place, .. }
            | Self::Mtl { place, .. }
            | Self::Image { place, .. }
            | Self::TooLarge { place, .. }
            | Self::Write { place, .. } => place,
        }
    }
}
