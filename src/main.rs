//! The `robert` command: parse, run, turn the error into an exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    robert::cli::main(std::env::args_os())
}
