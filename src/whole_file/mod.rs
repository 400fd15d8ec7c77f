//! Files that appear whole or not at all.
//!
//! A plain file is written under a temporary name beside its place and renamed, so that the old one stays as it was
//! until the new one is complete. What is no plain file, such as a device, a FIFO or [`STDOUT`], is never replaced but
//! written to.

mod place;
mod temporary;

use std::fs::OpenOptions;
use std::io::{self, BufWriter, Cursor, ErrorKind, Read, Seek, Write};
use std::path::Path;

use place::Place;
pub use place::STDOUT;
use temporary::Temporary;

/// What [`write_freely`] fills.
pub trait Contents: Read + Write + Seek {}

impl<T: Read + Write + Seek> Contents for T {}

/// Whether a file could be written at `path`. Leaves no trace.
///
/// # Errors
/// A path that is a folder or a socket, a folder that is missing or that no file can be created in, a file that is
/// read-only.
pub fn check(path: &Path) -> io::Result<()> {
    match Place::of(path)? {
        Place::Stdout | Place::Stream(_) => Ok(()),
        Place::Device(path) => OpenOptions::new().write(true).open(path).map(drop),
        Place::File { path, old } => {
            // A rename does not ask for the file's permission.
            old.as_ref().map_or(Ok(()), |_| OpenOptions::new().write(true).open(&path).map(drop))?;
            // Permission bits do not say enough (superuser, read-only file systems), so a file is created.
            Temporary::beside(&path, old.as_ref()).map(drop)
        }
    }
}

/// Whether what is written there is gone at once, to a device, a FIFO or an open descriptor, instead of becoming a file
/// that can be written anew.
pub fn is_stream(path: &Path) -> bool {
    matches!(Place::of(path), Ok(Place::Stdout | Place::Stream(_) | Place::Device(_)))
}

/// Whether `path` is the standard output, by any of its names.
pub fn is_stdout(path: &Path) -> bool {
    matches!(Place::of(path), Ok(Place::Stdout))
}

/// Whether one of two outputs would spoil the other, however their paths are spelled and whatever links they lead over.
/// A device such as `/dev/null` takes any number.
///
/// # Errors
/// Paths at which nothing can be written.
pub fn is_same(a: &Path, b: &Path) -> io::Result<bool> {
    Ok(match (Place::of(a)?, Place::of(b)?) {
        (Place::Stdout, Place::Stdout) => true,
        (Place::Stream(a), Place::Stream(b)) | (Place::File { path: a, .. }, Place::File { path: b, .. }) => a == b,
        _ => false,
    })
}

/// Writes a file under a temporary name, then renames it. It replaces a file of that name, unless that is read-only, and
/// takes over its permissions and, as far as the system allows, its owner; else it gets the permissions of any new file.
/// At a link, the file that it leads to is replaced. What is no plain file is written to.
///
/// # Errors
/// What [`check`] finds, and a full disk. Then the old file is as it was, and no temporary one is left.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let fill = |sink: &mut dyn Write| {
        let mut buffered = BufWriter::new(sink);
        fill(&mut buffered)?;
        buffered.flush()
    };
    match Place::of(path)? {
        Place::File { path, old } => Temporary::beside(&path, old.as_ref())?.fill(|file| fill(file)),
        stream => fill(&mut *open(&stream)?),
    }
}

/// As [`write()`], for a file that is not filled from its start to its end. It is not buffered.
///
/// # Errors
/// As [`write()`].
pub fn write_freely(path: &Path, fill: impl FnOnce(&mut dyn Contents) -> io::Result<()>) -> io::Result<()> {
    match Place::of(path)? {
        Place::File { path, old } => Temporary::beside(&path, old.as_ref())?.fill(|file| fill(file)),
        stream => {
            let mut bytes = Cursor::new(Vec::new());
            fill(&mut bytes)?;
            let mut sink = open(&stream)?;
            sink.write_all(bytes.get_ref())?;
            sink.flush()
        }
    }
}

/// As [`write()`], for a text. The reader of a stream that has read enough of it, as `head` does, is no error.
///
/// # Errors
/// As [`write()`].
pub fn write_text(path: &Path, text: &str) -> io::Result<()> {
    match write(path, |file| file.write_all(text.as_bytes())) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome,
    }
}

/// Opens what is no plain file.
fn open(place: &Place) -> io::Result<Box<dyn Write>> {
    Ok(match place {
        // Not by its name: opened anew, a file that a shell has put there would be written from its start.
        Place::Stdout => Box::new(io::stdout()),
        // Another's descriptor may be of a file that has contents.
        Place::Stream(path) => Box::new(OpenOptions::new().append(true).open(path)?),
        Place::Device(path) | Place::File { path, .. } => Box::new(OpenOptions::new().write(true).open(path)?),
    })
}
