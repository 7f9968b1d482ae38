//! The `vantage` binary.

use clap::Parser;
use std::sync::atomic::AtomicBool;
use vantage::cli::plan::PlanArgs;

#[derive(Parser)]
enum Command {
    Plan(PlanArgs),
}

fn main() -> std::process::ExitCode {
    let Command::Plan(args) = Command::parse();
    match vantage::cli::plan::run(&args, &AtomicBool::new(false)) {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            std::process::ExitCode::from(error.exit_code())
        }
    }
}
