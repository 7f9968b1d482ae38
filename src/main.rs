//! The `vantage` binary: hands over to the command line.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(vantage::cli::main())
}
