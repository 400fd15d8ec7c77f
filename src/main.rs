//! The command line of raywave.

use std::process::ExitCode;

fn main() -> ExitCode {
    raywave::cli::main()
}
