//! Temporary files beside the ones that they become, and those that a process which was killed has left.

use std::collections::BTreeSet;
use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex};

use tempfile::{Builder, NamedTempFile};

/// A file that becomes another one, or is removed.
pub struct Temporary<'a> {
    file: NamedTempFile<File>,
    path: &'a Path,
}

impl<'a> Temporary<'a> {
    /// Creates the file that becomes `path`, with what shall stay of an old file there. Removes what is left of others in
    /// that folder.
    pub fn beside(path: &'a Path, old: Option<&Metadata>) -> io::Result<Self> {
        let folder = path.parent().expect("the path is absolute and no folder");
        remove_leftovers_once(folder);
        let refused = |error: io::Error| {
            io::Error::new(error.kind(), format!("the folder {} takes no file: {error}", folder.display()))
        };
        let mut builder = Builder::new();
        builder.prefix(prefix().unwrap_or(".raywave-"));
        let create = |path: &Path| OpenOptions::new().read(true).write(true).create_new(true).open(path);
        loop {
            let file = builder.make_in(folder, create).map_err(refused)?;
            match file.as_file().try_lock() {
                // Another process may have taken it for a leftover before it was locked.
                Err(TryLockError::WouldBlock) => continue,
                Ok(()) if !file.path().exists() => continue,
                // Where files cannot be locked, nobody takes them for leftovers.
                Ok(()) | Err(TryLockError::Error(_)) => {}
            }
            old.map_or(Ok(()), |old| take_over(file.as_file(), old))?;
            return Ok(Self { file, path });
        }
    }

    /// Fills the file and renames it.
    pub fn fill(mut self, fill: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
        fill(self.file.as_file_mut())?;
        // Some file systems, of networks above all, tell only here that the disk is full.
        self.file.as_file().sync_all()?;
        self.file.persist(self.path)?;
        Ok(())
    }
}

#[cfg(unix)]
fn take_over(file: &File, old: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt, fchown};
    let new = file.metadata()?;
    let (user, group) = (Some(old.uid()), Some(old.gid()));
    if (user, group) != (Some(new.uid()), Some(new.gid())) {
        // Who may not give files away may still give them to a group of theirs; a file of the writer's is better than none.
        let _ = fchown(file, user, group).or_else(|_| fchown(file, None, group));
    }
    // After the owner, with which a system may take permissions away.
    if file.metadata()?.mode() != old.mode() { file.set_permissions(old.permissions()) } else { Ok(()) }
}

#[cfg(not(unix))]
fn take_over(_: &File, _: &Metadata) -> io::Result<()> {
    Ok(())
}

/// How the names of this machine's temporary files begin, since it was started. A lock tells whether the process that
/// writes a file is alive, but on a folder that machines share perhaps to those of its own machine alone.
fn prefix() -> Option<&'static str> {
    static PREFIX: LazyLock<Option<String>> = LazyLock::new(|| {
        let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?;
        Some(format!(".raywave-{}-", boot.trim()))
    });
    PREFIX.as_deref()
}

fn remove_leftovers_once(folder: &Path) {
    static CLEARED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let Some(prefix) = prefix() else { return };
    if CLEARED.lock().expect("no thread panics with the lock").insert(folder.to_path_buf()) {
        remove_leftovers(folder, prefix);
    }
}

/// Removes the files that no process has locked. What cannot be removed does no harm.
pub fn remove_leftovers(folder: &Path, prefix: &str) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_temporary = entry.file_name().to_str().is_some_and(|name| name.starts_with(prefix));
        if !is_temporary || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        let Ok(file) = OpenOptions::new().write(true).open(entry.path()) else { continue };
        if file.try_lock().is_ok() {
            let _ = fs::remove_file(entry.path());
        }
    }
}
