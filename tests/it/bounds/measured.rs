//! A process whose time and memory are measured.

use std::io::Read as _;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Measured run of a process: how it ended, and what it took.
#[derive(Debug)]
pub(super) struct Measured {
    pub(super) code: Option<i32>,
    /// Text that it wrote to both outputs.
    pub(super) said: String,
    pub(super) wall: Duration,
    /// The most memory that it held at once, as far as the system tells.
    pub(super) peak_bytes: u64,
}

/// Runs `command` to its end, which `limit` brings about.
pub(super) fn run(command: &mut Command, limit: Duration) -> Measured {
    let began = Instant::now();
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("a process");
    let (mut out, mut err) = (child.stdout.take().expect("its output"), child.stderr.take().expect("its errors"));
    let read = std::thread::spawn(move || {
        let mut text = Vec::new();
        let _ = err.read_to_end(&mut text);
        text
    });
    let (sender, output) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let mut text = Vec::new();
        let _ = out.read_to_end(&mut text);
        let _ = sender.send(text);
    });
    let mut peak_bytes = 0;
    let status = loop {
        peak_bytes = peak_bytes.max(peak_of(child.id()));
        if let Some(status) = child.try_wait().expect("its state") {
            break status;
        }
        if began.elapsed() > limit {
            child.kill().expect("killed");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let wall = began.elapsed();
    let said = [output.recv().unwrap_or_default(), read.join().unwrap_or_default()].concat();
    Measured { code: status.code(), said: String::from_utf8_lossy(&said).into_owned(), wall, peak_bytes }
}

/// The most memory that a process has held so far; 0 where the system does not tell.
pub(super) fn peak_of(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let kib = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
