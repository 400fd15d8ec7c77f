//! What can go wrong between a report and its files.

use std::path::PathBuf;

/// Why a report could not be written. Every message is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ExportError {
    #[error("{}: cannot write the report: {cause}", path.display())]
    Write { path: PathBuf, cause: std::io::Error },
    #[error("{}: two reports cannot be one file; name another", path.display())]
    Twice { path: PathBuf },
}
