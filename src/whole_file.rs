//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use tempfile::{Builder, NamedTempFile};

/// Whether a file could be written at `path`. Leaves no trace.
///
/// # Errors
/// A path that is a folder, a folder that is missing or that no file can be created in.
pub fn check(path: &Path) -> io::Result<()> {
    // Permission bits do not say enough (superuser, read-only file systems), so a file is created.
    beside(path).map(drop)
}

/// Writes a file under a temporary name, then renames it, replacing any file of that name. It gets the permissions of
/// any new file.
///
/// # Errors
/// What [`check`] finds, and a full disk.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    write_freely(path, |file| {
        let mut buffered = io::BufWriter::new(file);
        fill(&mut buffered)?;
        buffered.flush()
    })
}

/// As [`write()`], for a file that is not filled from its start to its end. It is not buffered.
///
/// # Errors
/// As [`write()`].
pub fn write_freely(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
    let mut file = beside(path)?;
    fill(file.as_file_mut())?;
    file.persist(path)?;
    Ok(())
}

fn beside(path: &Path) -> io::Result<NamedTempFile> {
    if path.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder; name a file"));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.prefix(".raywave-").tempfile_in(folder).map_err(|error| match fs::metadata(folder) {
        Err(_) => io::Error::new(error.kind(), format!("the folder {} is missing; create it", folder.display())),
        Ok(_) => error,
    })
}
