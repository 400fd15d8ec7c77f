//! Where the bytes of a scene come from, and what is noted while they are read: the scene's hash
//! and its warnings.

use std::{
    io,
    path::{Component, Path},
};

use super::{
    LoadOptions,
    error::{Location, SceneError},
    text::one_line,
};

/// What is wrong with a file that is not in the scene's folder, and what to do.
pub(super) const OUTSIDE: &str = "lies outside of the scene's folder; move it there, or pass --allow-outside";

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

/// What the user should know but need not act on.
#[derive(Debug, Clone)]
pub(super) struct Warning {
    /// What it is one of. Of each kind the first is shown, with how many there are.
    pub kind: &'static str,
    pub location: Location,
    /// What it says, in one line.
    pub text: String,
}

/// The files of one scene.
#[derive(Debug)]
pub(super) struct Sources<'a> {
    files: Files,
    pub options: &'a LoadOptions,
    /// Folder of the scene file; names count relative to it in the hash.
    folder: &'a Path,
    hash: blake3::Hasher,
    /// Lines, and of each kind the first, with how many there were.
    warnings: Vec<(String, Option<&'static str>, usize)>,
}

impl<'a> Sources<'a> {
    /// Nothing read yet; `path` is the scene file.
    pub fn new(files: Files, path: &'a Path, options: &'a LoadOptions) -> Self {
        let folder = path.parent().unwrap_or(Path::new(""));
        Self { files, options, folder, hash: blake3::Hasher::new(), warnings: Vec::new() }
    }

    /// Whether a file may not be read because it is not in the scene's folder. Scenes come from anywhere, and pictures of
    /// them may go anywhere: what they name is not to reach the rest of a disk. Names are compared, links not followed.
    pub fn is_outside(&self, path: &Path) -> bool {
        if self.options.allow_outside {
            return false;
        }
        let Ok(name) = path.strip_prefix(self.folder) else { return true };
        let mut depth = 0_i64;
        name.components().any(|part| {
            depth += match part {
                Component::Normal(_) => 1,
                Component::CurDir => 0,
                Component::ParentDir => -1,
                Component::RootDir | Component::Prefix(_) => i64::MIN / 2,
            };
            depth < 0
        })
    }

    /// Reads a file, which then counts in the scene's hash.
    pub fn read(&mut self, path: &Path) -> io::Result<Vec<u8>> {
        if self.is_outside(path) {
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, OUTSIDE));
        }
        let bytes = self.files.read(path)?;
        self.add_to_hash(path, &bytes);
        Ok(bytes)
    }

    /// Reads a file that the scene cannot do without. `named_at` is where the user finds its name.
    pub fn require(&mut self, path: &Path, named_at: &Location) -> Result<Vec<u8>, SceneError> {
        let file = one_line(&path.to_string_lossy());
        if self.is_outside(path) {
            return Err(named_at.refuse(format!("`{file}` {OUTSIDE}")));
        }
        self.read(path).map_err(|error| named_at.refuse(format!("cannot read `{file}` ({error}); check the name")))
    }

    /// Whether there is such a file, and it may be read.
    pub fn has(&self, path: &Path) -> bool {
        !self.is_outside(path) && self.files.has(path)
    }

    /// The name of a file that differs from that path in capital letters only, if there is no such file.
    pub fn in_another_case(&self, path: &Path) -> Option<String> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = path.file_name()?.to_str()?;
        let names = std::fs::read_dir(folder).ok()?.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        names.into_iter().find(|other| other != name && other.to_lowercase() == name.to_lowercase())
    }

    /// Notes what the user should know but need not act on, in one line.
    pub fn warn(&mut self, warning: String) {
        self.warnings.push((warning, None, 1));
    }

    /// Notes one of a kind, of which there may be many.
    pub fn note(&mut self, warning: &Warning) {
        self.note_first(warning, 1);
    }

    /// Notes so many of a kind, of which this is the first.
    pub fn note_first(&mut self, warning: &Warning, count: usize) {
        let Warning { kind, location, text } = warning;
        match self.warnings.iter_mut().find(|(_, known, _)| *known == Some(kind)) {
            Some((_, _, known)) => *known += count,
            None => self.warnings.push((format!("{location}: {text}"), Some(kind), count)),
        }
    }

    /// Whether one of a kind was noted.
    pub fn has_noted(&self, kind: &str) -> bool {
        self.warnings.iter().any(|(_, known, _)| *known == Some(kind))
    }

    /// The hash of all that was read, and the warnings.
    pub fn finish(self) -> (String, Vec<String>) {
        let line = |(text, _, count): (String, Option<&str>, usize)| match count {
            1 => text,
            count => format!("{text} (the first of {count})"),
        };
        let warnings = self.warnings.into_iter().map(line).collect();
        (self.hash.finalize().to_hex().to_string(), warnings)
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
