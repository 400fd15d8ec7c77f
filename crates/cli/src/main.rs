//! The command line of raywave.

use std::process::ExitCode;

fn main() -> ExitCode {
    raywave_cli::main()
}
