//! What the program says: data on stdout, messages on stderr.

use std::fmt;
use std::io::{self, ErrorKind, Write};

use anyhow::Context;

/// Writes a line to stderr, as `eprintln` does, but never panics.
macro_rules! tell {
    ($($words:tt)*) => { $crate::messages::tell(format_args!($($words)*)) };
}

/// Writes a line to stderr. Where that is closed or full there is nobody to tell, and no work is given up for it.
pub fn tell(words: fmt::Arguments<'_>) {
    // In one piece, which other processes' lines do not come between.
    let _ = io::stderr().write_all(format!("{words}\n").as_bytes());
}

/// Prints data. A reader that has read enough, as `head` does, is no error.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome.context("cannot print"),
    }
}
