//! Pushed binary states, and servo targets.

use std::io;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{MissedTickBehavior, interval};

use super::Shared;
use crate::execution::protocol::hans::{HansFrames, HansRequest};

/// Cycle of the controller.
const CYCLE_MS: i32 = 4;

/// Pushes the binary state each cycle until the client goes.
pub(super) async fn push_states(stream: TcpStream, shared: &Shared) {
    let cut = shared.faults.next_cut();
    tokio::select! {
        () = cut => {}
        _ = push(stream, shared) => {}
    }
}

async fn push(mut stream: TcpStream, shared: &Shared) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let mut cycle = interval(Duration::from_millis(CYCLE_MS.unsigned_abs().into()));
    cycle.set_missed_tick_behavior(MissedTickBehavior::Skip);
    loop {
        cycle.tick().await;
        let frame = {
            let (arm, now) = shared.arm();
            arm.realtime(CYCLE_MS, now).encode()
        };
        if !shared.faults.state().is_silent {
            stream.write_all(&frame).await?;
        }
    }
}

/// Follows the servo commands of one client until it goes; they have no replies.
pub(super) async fn take_targets(stream: TcpStream, shared: &Shared) {
    let cut = shared.faults.next_cut();
    tokio::select! {
        () = cut => {}
        _ = follow(stream, shared) => {}
    }
}

async fn follow(mut stream: TcpStream, shared: &Shared) -> io::Result<()> {
    let (mut frames, mut chunk) = (HansFrames::default(), [0; 4096]);
    loop {
        let read = stream.read(&mut chunk).await?;
        if read == 0 {
            return Ok(());
        }
        frames.push(&chunk[..read]);
        while let Some(message) = frames.next_message() {
            let request = message.and_then(|message| HansRequest::parse(&message));
            if let Ok(request @ (HansRequest::StartServo { .. } | HansRequest::PushServoJ { .. })) = request {
                let (mut arm, now) = shared.arm();
                // Nobody reads a refusal here: the state shows it.
                let _ = arm.answer(&request, now);
            }
        }
    }
}
