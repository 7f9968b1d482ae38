//! A KUKA controller with RSI to rehearse against: it sends a telegram in every cycle, takes the corrections of answers that come in
//! time, holds the last ones otherwise (`HOLDON`), and breaks off when more answers than its budget were late or missing.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::time::{Instant, timeout_at};

use crate::execution::protocol::kuka_rsi::{RsiCorrection, RsiNames, RsiReport};

/// A controller with its program at `RSI_MOVECORR`.
pub struct RsiController {
    /// Address of the client.
    pub client: SocketAddr,
    /// Names of its configuration.
    pub names: RsiNames,
    /// Interpolation cycle.
    pub cycle: Duration,
    /// Late answers in a row after which it breaks off; those before the first answer do not count.
    pub timeout_cycles: u32,
    /// Axes where RSI is switched on, degrees, and external axis 1.
    pub base_deg: ([f64; 6], f64),
    /// Distance at which the axes stand beside where they are commanded to, degrees.
    pub beside_deg: [f64; 6],
}

/// Course of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RsiSession {
    /// Axes as commanded, degrees.
    pub axes_deg: [f64; 6],
    /// External axis 1 as measured, degrees.
    pub table_deg: f64,
    /// Answers taken.
    pub answers: u64,
    /// Answers that were late, missing or wrong.
    pub late: u32,
    /// Largest step of an axis within a cycle, degrees.
    pub max_step_deg: f64,
}

impl RsiController {
    /// Runs until the budget is spent; calls `look` after every cycle.
    ///
    /// # Errors
    /// Errors of the socket.
    pub async fn run(&self, mut look: impl FnMut(&RsiSession)) -> io::Result<RsiSession> {
        let socket = UdpSocket::bind(if self.client.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" }).await?;
        let (base_deg, table_deg) = self.base_deg;
        let mut session = RsiSession { axes_deg: base_deg, table_deg, ..RsiSession::default() };
        let (mut ipoc, mut in_a_row) = (4_208_163_634, 0);
        let mut due = Instant::now();
        while in_a_row <= self.timeout_cycles {
            due += self.cycle;
            let external_deg = Some([session.table_deg, 0.0, 0.0, 0.0, 0.0, 0.0]);
            let report = RsiReport {
                axes_deg: std::array::from_fn(|axis| session.axes_deg[axis] + self.beside_deg[axis]),
                commanded_deg: Some(base_deg),
                external_deg,
                late: Some(session.late),
                ipoc,
            };
            // Nobody may listen yet.
            let _ = socket.send_to(report.encode().as_bytes(), self.client).await;
            match self.answer(&socket, ipoc, due).await {
                Some(correction) => {
                    session.take(&correction, &self.base_deg);
                    in_a_row = 0;
                }
                None if session.answers > 0 => (session.late, in_a_row) = (session.late + 1, in_a_row + 1),
                None => {}
            }
            look(&session);
            ipoc += self.cycle.as_millis() as u64;
            tokio::time::sleep_until(due).await;
        }
        Ok(session)
    }

    /// The answer to a telegram, if it comes in time.
    async fn answer(&self, socket: &UdpSocket, ipoc: u64, due: Instant) -> Option<RsiCorrection> {
        let mut buffer = [0; 4096];
        loop {
            let (length, _) = timeout_at(due, socket.recv_from(&mut buffer)).await.ok()?.ok()?;
            let answer = RsiCorrection::decode(&buffer[..length], &self.names).ok();
            if let Some(correction) = answer.filter(|answer| answer.ipoc == ipoc) {
                return Some(correction);
            }
        }
    }
}

impl RsiSession {
    fn take(&mut self, correction: &RsiCorrection, (base_deg, table_base_deg): &([f64; 6], f64)) {
        let axes_deg = std::array::from_fn(|axis| base_deg[axis] + correction.axes_deg[axis]);
        let table_deg = correction.table.map_or(self.table_deg, |(_, deg)| table_base_deg + deg);
        let steps = axes_deg.iter().zip(&self.axes_deg).map(|(to, from): (&f64, &f64)| (to - from).abs());
        self.max_step_deg = steps.chain([(table_deg - self.table_deg).abs()]).fold(self.max_step_deg, f64::max);
        (self.axes_deg, self.table_deg, self.answers) = (axes_deg, table_deg, self.answers + 1);
    }
}
