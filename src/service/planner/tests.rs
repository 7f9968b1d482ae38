//! Files of running jobs that cannot be read.

#![cfg(target_os = "linux")]

use std::cell::Cell;
use std::path::Path;

use super::*;
use crate::service::tests::{BAD_SECTOR, source};

#[test]
fn a_disk_that_does_not_give_a_file_back_ends_the_job_by_the_file_s_name() {
    let (source, tried) = (source(Path::new(BAD_SECTOR)), Cell::new(0));
    let read = || {
        tried.set(tried.get() + 1);
        source.read("/mesh_id", 1000, &|| false).map(drop)
    };
    let ended = read_again(read, &|| tried.get() > MAX_READ_FAILURES, &|| {});
    let Err(JobError::Damaged(said)) = ended else { panic!("{ended:?}") };
    assert!(said.contains(&source.sha256) && said.contains("upload the same file again"), "{said}");
    assert_eq!(tried.get(), MAX_READ_FAILURES);
}

#[test]
fn a_moment_of_a_bad_disk_and_any_shortage_are_waited_out() {
    let (eio, emfile) = (rustix::io::Errno::IO, rustix::io::Errno::MFILE);
    for (errno, times) in [(eio, MAX_READ_FAILURES - 1), (emfile, 10 * MAX_READ_FAILURES)] {
        let left = Cell::new(times);
        let read = || {
            if left.get() == 0 {
                return Ok("read");
            }
            left.set(left.get() - 1);
            Err(read_error("part", &io::Error::from_raw_os_error(errno.raw_os_error())))
        };
        assert_eq!(read_again(read, &|| false, &|| {}), Ok("read"), "{errno:?}");
    }
    let read = || -> Result<(), JobError> { Err(read_error("part", &emfile.into())) };
    assert_eq!(read_again(read, &|| true, &|| {}), Err(JobError::Cancelled));
}
