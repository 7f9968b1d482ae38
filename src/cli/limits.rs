//! Limits on the time and the memory that a command may use for planning.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use super::CliError;
use crate::planning::Allowance;
use crate::settings::job_memory_bytes;

/// Limits on time and memory.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct LimitArgs {
    /// Maximum planning time, 1 to 604800 s; 0 for no limit. A plan that would take far longer is refused before it starts.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = secs)]
    max_secs: f64,
    /// Maximum memory, 256 MiB or more; 0 for 60 % of the machine's memory. A plan that would need more is refused before it
    /// starts.
    #[arg(long, value_name = "MIB", default_value_t = 0, value_parser = mebibytes)]
    max_memory: u64,
}

fn secs(text: &str) -> Result<f64, String> {
    let secs = text.parse().ok().filter(|secs| *secs == 0.0 || (1.0..=604_800.0).contains(secs));
    secs.ok_or_else(|| format!("is {text}; allowed is 0, or 1 to 604800"))
}

fn mebibytes(text: &str) -> Result<u64, String> {
    let mib = text.parse().ok().filter(|mib| *mib == 0 || (256..1 << 40).contains(mib));
    mib.ok_or_else(|| format!("is {text}; allowed is 0, or a whole number of 256 or more"))
}

impl LimitArgs {
    /// Allowance for planning on `threads` threads.
    pub(super) fn allowance(&self, threads: usize) -> Allowance {
        let core_secs = if self.max_secs > 0.0 { self.max_secs * threads as f64 } else { f64::INFINITY };
        let bytes = if self.max_memory > 0 { self.max_memory << 20 } else { job_memory_bytes() };
        Allowance { bytes: bytes as f64, core_secs }
    }

    /// Runs `work`, which ends when `cancel` is raised, and raises `cancel` when the time is up.
    pub(super) fn within<T>(&self, cancel: &AtomicBool, work: impl FnOnce() -> Result<T, CliError>) -> Result<T, CliError> {
        if self.max_secs == 0.0 {
            return work();
        }
        let (limit, late) = (Duration::from_secs_f64(self.max_secs), AtomicBool::new(false));
        let result = std::thread::scope(|scope| {
            let (done, ends) = mpsc::channel::<()>();
            let late = &late;
            scope.spawn(move || {
                // The sender is dropped when the work ends.
                if ends.recv_timeout(limit) == Err(RecvTimeoutError::Timeout) && !cancel.swap(true, Ordering::Relaxed) {
                    late.store(true, Ordering::Relaxed);
                }
            });
            let result = work();
            drop(done);
            result
        });
        if late.load(Ordering::Relaxed) {
            // The clock raised it, not the user: another part may follow.
            cancel.store(false, Ordering::Relaxed);
        }
        match result {
            Err(CliError::Cancelled(_)) if late.load(Ordering::Relaxed) => Err(CliError::BadInput(format!(
                "planning took longer than the {} s that --max-secs allows; use a simpler mesh, a larger part.patch_edge_mm or \
                 fewer candidates (fewer candidates.even_directions or rolls_deg), or raise the limit",
                self.max_secs
            ))),
            result => result,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(max_secs: f64) -> LimitArgs {
        LimitArgs { max_secs, max_memory: 0 }
    }

    /// Waits to be cancelled, for up to a minute.
    fn wait(cancel: &AtomicBool) -> Result<(), CliError> {
        for _ in 0..12_000 {
            if cancel.load(Ordering::Relaxed) {
                return Err(CliError::Cancelled("interrupted".into()));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }

    #[test]
    fn work_that_takes_too_long_is_ended_and_other_work_is_left_alone() {
        let cancel = AtomicBool::new(false);
        let error = limits(0.2).within(&cancel, || wait(&cancel)).expect_err("too long");
        assert!(error.exit_code() == 2 && error.to_string().contains("0.2 s that --max-secs allows"), "{error}");
        for max_secs in [0.0, 600.0] {
            let cancel = AtomicBool::new(false);
            assert_eq!(limits(max_secs).within(&cancel, || Ok(7)), Ok(7));
            assert!(!cancel.load(Ordering::Relaxed));
        }
        let cancel = AtomicBool::new(true);
        assert_eq!(limits(600.0).within(&cancel, || wait(&cancel)).expect_err("by the user").exit_code(), 4);
    }

    #[test]
    fn figures_out_of_range_are_refused_and_the_others_are_what_they_say() {
        assert!(secs("0.5").is_err() && secs("-1").is_err() && secs("nan").is_err() && secs("1e9").is_err());
        assert_eq!(secs("-1"), Err("is -1; allowed is 0, or 1 to 604800".to_owned()));
        assert!(mebibytes("255").is_err() && mebibytes("1.5").is_err());
        assert_eq!((secs("90"), mebibytes("512")), (Ok(90.0), Ok(512)));
        let allowance = LimitArgs { max_secs: 90.0, max_memory: 512 }.allowance(4);
        assert_eq!((allowance.core_secs, allowance.bytes), (360.0, 536_870_912.0));
        let default = limits(0.0).allowance(4);
        assert!(default.core_secs == f64::INFINITY && default.bytes > 1e8);
    }
}
