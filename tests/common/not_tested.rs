//! How a test says that it did not test.

use std::io::Write;
use std::thread;

/// Tells that the test of this thread leaves something out, and why; `x test` counts these lines.
pub fn not_tested(why: &str) {
    let test = thread::current().name().unwrap_or("a test").to_owned();
    let line = format!("NOT TESTED: {test}: {why}\n");
    // Not by a macro: the harness would keep it, since the test passes. At once, since other tests write too.
    let _ = std::io::stderr().write_all(line.as_bytes());
}
