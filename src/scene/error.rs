//! What can be wrong with the files of a scene: one line each, with the place and what to do.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use super::text::one_line;

/// A file and, where one is to blame, a line in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    /// The file, as it was named by the user or by the file that refers to it.
    pub path: PathBuf,
    /// Line number, counted from 1.
    pub line: Option<usize>,
}

impl Location {
    /// A whole file.
    pub(super) fn file(path: &Path) -> Self {
        Self { path: path.to_path_buf(), line: None }
    }

    /// A line of a file.
    pub(super) fn line(path: &Path, line: usize) -> Self {
        Self { path: path.to_path_buf(), line: Some(line) }
    }

    /// The error that blames this place. The problem says what is wrong and what to do.
    pub(super) fn refuse(&self, problem: impl Into<String>) -> SceneError {
        SceneError { location: self.clone(), problem: problem.into() }
    }
}

impl fmt::Display for Location {
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
#[error("{location}: {problem}")]
pub struct SceneError {
    /// The file and line to blame: where a file cannot be used, the line that names it.
    pub location: Location,
    /// What is wrong and what to do.
    pub problem: String,
}
