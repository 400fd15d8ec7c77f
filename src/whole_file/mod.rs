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

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn names_in(folder: &Path) -> Vec<String> {
        let names = fs::read_dir(folder).expect("the folder is there");
        let mut names: Vec<_> =
            names.map(|entry| entry.expect("it is readable").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn what_fails_leaves_the_old_file_and_no_other() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a");
        fs::write(&path, "old").expect("a temporary file");
        let broken = |file: &mut dyn Write| {
            file.write_all(&[0; 100_000])?;
            Err(io::Error::from(ErrorKind::StorageFull))
        };
        assert_eq!(write(&path, broken).expect_err("it is full").kind(), ErrorKind::StorageFull);
        assert_eq!(fs::read(&path).expect("it is there"), b"old");
        assert_eq!(names_in(folder.path()), ["a"]);

        // A rename that fails.
        let renamed = folder.path().join("b");
        let blocked = |file: &mut dyn Write| {
            fs::create_dir_all(renamed.join("full"))?;
            file.write_all(b"new")
        };
        write(&renamed, blocked).expect_err("no file replaces a folder");
        assert_eq!(names_in(folder.path()), ["a", "b"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn nobody_removes_what_is_being_written() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let is_done = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_done.load(std::sync::atomic::Ordering::Relaxed) {
                    temporary::remove_leftovers(folder.path(), ".raywave-");
                }
            });
            for number in 0..200 {
                let path = folder.path().join(number.to_string());
                write_text(&path, "whole").expect("it can be written");
                assert_eq!(fs::read(&path).expect("it is there"), b"whole");
            }
            is_done.store(true, std::sync::atomic::Ordering::Relaxed);
        });
        assert_eq!(names_in(folder.path()).len(), 200);
    }

    #[test]
    fn outputs_are_told_apart_by_where_they_lead() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [a, b, link] = ["a", "b", "link"].map(|name| folder.path().join(name));
        let same = |a: &Path, b: &Path| is_same(a, b).expect("both can be written");
        assert!(same(&a, &a) && !same(&a, &b));
        assert!(same(&a, &folder.path().join("..").join(folder.path().file_name().expect("it has a name")).join("a")));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("a", &link).expect("a link");
            assert!(same(&a, &link) && !same(&b, &link));
            assert!(!same(Path::new("/dev/null"), Path::new("/dev/null")));
        }
        assert!(same(Path::new(STDOUT), Path::new(STDOUT)) && is_stdout(Path::new(STDOUT)));
        assert!(is_same(folder.path(), &a).is_err());
    }
}
