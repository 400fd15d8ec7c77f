//! Where bytes come from: the disk, or files compiled into the program.

use std::{
    io,
    path::{Component, Path},
};

/// A place that files are read from by their path.
#[derive(Debug, Clone, Copy)]
pub(super) enum Files {
    /// The file system.
    Disk,
    /// Names and contents that are part of the program.
    Embedded(&'static [(&'static str, &'static [u8])]),
}

impl Files {
    pub(super) fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        match self {
            Self::Disk => std::fs::read(path),
            Self::Embedded(files) => files
                .iter()
                .find(|(name, _)| path == Path::new(name))
                .map(|(_, contents)| contents.to_vec())
                .ok_or_else(|| io::ErrorKind::NotFound.into()),
        }
    }

    pub(super) fn has(&self, path: &Path) -> bool {
        match self {
            Self::Disk => path.is_file(),
            Self::Embedded(files) => files.iter().any(|(name, _)| path == Path::new(name)),
        }
    }
}

/// A running hash over names and contents. Lengths go first, so that no two lists of files feed
/// it the same bytes.
#[derive(Debug, Default)]
pub(super) struct Fingerprint(blake3::Hasher);

impl Fingerprint {
    /// Adds a file. Its name counts relative to `folder`, so that a scene keeps its hash when its
    /// folder moves.
    pub(super) fn add(&mut self, folder: &Path, path: &Path, contents: &[u8]) {
        let path = path.strip_prefix(folder).unwrap_or(path);
        let parts: Vec<_> = path
            .components()
            .filter(|part| *part != Component::CurDir)
            .map(|part| part.as_os_str().to_string_lossy())
            .collect();
        for bytes in [parts.join("/").as_bytes(), contents] {
            self.0.update(&(bytes.len() as u64).to_le_bytes());
            self.0.update(bytes);
        }
    }

    pub(super) fn finish(&self) -> String {
        self.0.finalize().to_hex().to_string()
    }
}
