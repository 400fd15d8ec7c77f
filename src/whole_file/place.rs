//! What a path leads to.

use std::ffi::OsStr;
use std::fs::{self, FileType, Metadata};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// The standard output, by a name that is understood on every system.
pub const STDOUT: &str = "/dev/stdout";

/// Links that a path may lead over, as many as Linux follows.
const MOST_LINKS: usize = 40;

/// Where output goes. Paths are absolute and lead over no link.
pub enum Place {
    Stdout,
    /// A FIFO, or a descriptor that is open in some process.
    Stream(PathBuf),
    Device(PathBuf),
    /// A plain file, or none yet.
    File {
        path: PathBuf,
        old: Option<Metadata>,
    },
}

impl Place {
    /// Follows links by hand: one that leads to an open descriptor has a meaning that its target's name has not.
    pub fn of(path: &Path) -> io::Result<Self> {
        if path == Path::new(STDOUT) {
            return Ok(Self::Stdout);
        }
        let mut path = path.to_path_buf();
        for _ in 0..MOST_LINKS {
            let Some(name) = path.file_name() else { return Err(folder_error()) };
            let folder = folder_of(&path)?;
            let place = folder.join(name);
            let found = match fs::symlink_metadata(&place) {
                Ok(found) => found,
                Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self::File { path: place, old: None }),
                Err(error) => return Err(error),
            };
            if let Some(own) = descriptors(&folder) {
                return Ok(if own && name == OsStr::new("1") { Self::Stdout } else { Self::Stream(place) });
            }
            if !found.is_symlink() {
                return Self::at(place, found);
            }
            path = folder.join(fs::read_link(&place)?);
        }
        Err(io::Error::other("it leads over too many links"))
    }

    fn at(path: PathBuf, found: Metadata) -> io::Result<Self> {
        match found.file_type() {
            kind if kind.is_dir() => Err(folder_error()),
            kind if kind.is_file() => Ok(Self::File { path, old: Some(found) }),
            kind if is_socket(kind) => Err(io::Error::other("it is a socket; name a file")),
            kind if is_device(kind) => Ok(Self::Device(path)),
            _ => Ok(Self::Stream(path)),
        }
    }
}

fn folder_error() -> io::Error {
    io::Error::new(ErrorKind::IsADirectory, "it is a folder; name a file")
}

fn folder_of(path: &Path) -> io::Result<PathBuf> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    folder.canonicalize().map_err(|error| match error.kind() {
        ErrorKind::NotFound => {
            io::Error::new(error.kind(), format!("the folder {} is missing; create it", folder.display()))
        }
        _ => error,
    })
}

/// Whether a folder, without links in its path, is that of the descriptors of a process, and if so whether of this one.
fn descriptors(folder: &Path) -> Option<bool> {
    let own = ["/proc/self/fd", "/dev/fd"].into_iter().filter_map(|own| Path::new(own).canonicalize().ok());
    let is_own = own.into_iter().any(|own| own == folder);
    (is_own || (folder.starts_with("/proc") && folder.ends_with("fd"))).then_some(is_own)
}

#[cfg(unix)]
fn is_device(kind: FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_char_device() || kind.is_block_device()
}

#[cfg(unix)]
fn is_socket(kind: FileType) -> bool {
    std::os::unix::fs::FileTypeExt::is_socket(&kind)
}

#[cfg(not(unix))]
fn is_device(_: FileType) -> bool {
    false
}

#[cfg(not(unix))]
fn is_socket(_: FileType) -> bool {
    false
}
