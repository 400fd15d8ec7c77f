//! Where the bytes of a scene come from, and what is noted while they are read: the scene's hash
//! and its warnings.

use std::{
    io,
    path::{Component, Path},
};

use super::{
    error::{Location, SceneError},
    text::one_line,
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
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        match self {
            Self::Disk => std::fs::read(path),
            Self::Embedded(files) => files
                .iter()
                .find(|(name, _)| path == Path::new(name))
                .map(|(_, contents)| contents.to_vec())
                .ok_or_else(|| io::ErrorKind::NotFound.into()),
        }
    }

    fn has(&self, path: &Path) -> bool {
        match self {
            Self::Disk => path.is_file(),
            Self::Embedded(files) => files.iter().any(|(name, _)| path == Path::new(name)),
        }
    }
}

/// The files of one scene.
#[derive(Debug)]
pub(super) struct Sources<'a> {
    files: Files,
    /// Folder of the scene file; names count relative to it in the hash.
    folder: &'a Path,
    hash: blake3::Hasher,
    warnings: Vec<String>,
}

impl<'a> Sources<'a> {
    /// Nothing read yet; `path` is the scene file.
    pub fn new(files: Files, path: &'a Path) -> Self {
        let folder = path.parent().unwrap_or(Path::new(""));
        Self { files, folder, hash: blake3::Hasher::new(), warnings: Vec::new() }
    }

    /// Reads a file, which then counts in the scene's hash.
    pub fn read(&mut self, path: &Path) -> io::Result<Vec<u8>> {
        let bytes = self.files.read(path)?;
        self.add_to_hash(path, &bytes);
        Ok(bytes)
    }

    /// Reads a file that the scene cannot do without. `named_at` is where the user finds its name.
    pub fn require(&mut self, path: &Path, named_at: &Location) -> Result<Vec<u8>, SceneError> {
        self.read(path).map_err(|error| {
            let file = one_line(&path.to_string_lossy());
            named_at.refuse(format!("cannot read `{file}` ({error}); check the name"))
        })
    }

    /// Whether there is such a file.
    pub fn has(&self, path: &Path) -> bool {
        self.files.has(path)
    }

    /// Notes what the user should know but need not act on, in one line.
    pub fn warn(&mut self, warning: String) {
        self.warnings.push(warning);
    }

    /// The hash of all that was read, and the warnings.
    pub fn finish(self) -> (String, Vec<String>) {
        (self.hash.finalize().to_hex().to_string(), self.warnings)
    }

    /// Adds a file's name and contents to the hash. The name counts relative to the scene's folder,
    /// so that a scene keeps its hash when its folder moves. Lengths go first, so that no two lists
    /// of files feed the hash the same bytes.
    fn add_to_hash(&mut self, path: &Path, contents: &[u8]) {
        let path = path.strip_prefix(self.folder).unwrap_or(path);
        let parts: Vec<_> = path
            .components()
            .filter(|part| *part != Component::CurDir)
            .map(|part| part.as_os_str().to_string_lossy())
            .collect();
        for bytes in [parts.join("/").as_bytes(), contents] {
            self.hash.update(&(bytes.len() as u64).to_le_bytes());
            self.hash.update(bytes);
        }
    }
}
