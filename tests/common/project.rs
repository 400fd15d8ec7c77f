//! Where the project's files and its program are: where cargo had them at build time or, in tests that were carried to
//! another machine, in the folder that `RAYWAVE_PROJECT` names.
#![allow(dead_code, reason = "each test file uses its part")]

use std::path::{Path, PathBuf};

/// The folder of tests that were carried away (`bundle/run-tests`).
fn carried() -> Option<PathBuf> {
    std::env::var_os("RAYWAVE_PROJECT").map(PathBuf::from)
}

/// A file of the project, by its path from the project's folder.
pub fn project_file(path: &str) -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = || package.ancestors().find(|folder| folder.join("scenes").is_dir()).expect("scenes are at the root");
    carried().unwrap_or_else(|| root().to_path_buf()).join(path)
}

/// The program that is tested, for the tests of its package.
pub fn program() -> PathBuf {
    let built =
        || option_env!("CARGO_BIN_EXE_raywave").map(PathBuf::from).expect("tests of crates/cli have the program");
    carried().map_or_else(built, |folder| folder.join("raywave"))
}

/// A folder, perhaps not yet made, for what a failed test leaves to be looked at.
pub fn output_folder() -> PathBuf {
    carried().map_or_else(|| PathBuf::from(env!("CARGO_TARGET_TMPDIR")), |folder| folder.join("test-output"))
}
