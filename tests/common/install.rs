//! Programs that tests put somewhere and run there.

use std::path::Path;
use std::process::Command;

/// Copies a program or script, so that it can be run. A process of its own does that: what this one writes, a child that
/// another test starts just then holds open for writing, and so long it cannot be run.
pub fn install(from: &Path, to: &Path) {
    let status = Command::new("install").arg(from).arg(to).status().expect("coreutils are there");
    assert!(status.success(), "{} is not there", from.display());
}
