//! An ABB controller with EGM to rehearse against: it reports in every cycle, follows the guidance it gets, and ends it when none
//! came for the time-out.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::time::{Instant, timeout_at};

use crate::execution::protocol::egm::{EgmGuidance, EgmGuide, EgmMotors, EgmRapid, EgmReport, ExternalAxes};

/// A controller with its program at `EGMRunJoint`.
pub struct EgmController {
    /// Address of the client.
    pub client: SocketAddr,
    /// Sample time.
    pub cycle: Duration,
    /// Time without guidance after which it ends, counted from the first guidance: `\CommTimeout`.
    pub comm_timeout: Duration,
    /// Joints at the beginning, degrees.
    pub joints_deg: [f64; 6],
    /// External axes at the beginning.
    pub external: ExternalAxes,
}

/// Course of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EgmSession {
    /// Joints as measured, degrees.
    pub joints_deg: [f64; 6],
    /// External axes as measured.
    pub external: ExternalAxes,
    /// Frames of guidance taken.
    pub guides: u64,
    /// Largest step of an axis within a cycle, degrees.
    pub max_step_deg: f64,
}

impl EgmController {
    /// Runs until the guidance ends; calls `look` after every cycle.
    ///
    /// # Errors
    /// Errors of the socket.
    pub async fn run(&self, mut look: impl FnMut(&EgmSession)) -> io::Result<EgmSession> {
        let socket = UdpSocket::bind(if self.client.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" }).await?;
        let mut session = EgmSession { joints_deg: self.joints_deg, external: self.external, ..EgmSession::default() };
        let start = Instant::now();
        let (mut due, mut sequence, mut guided_at) = (start, 0, None);
        while guided_at.is_none_or(|at: Instant| at.elapsed() <= self.comm_timeout) {
            due += self.cycle;
            // Nobody may listen yet.
            let _ = socket.send_to(&session.report(sequence, start.elapsed()).encode(), self.client).await;
            sequence += 1;
            if let Some(guide) = next_guide(&socket, due).await {
                session.follow(&guide);
                guided_at = Some(Instant::now());
            }
            look(&session);
            tokio::time::sleep_until(due).await;
        }
        Ok(session)
    }
}

async fn next_guide(socket: &UdpSocket, due: Instant) -> Option<EgmGuide> {
    let mut buffer = [0; 4096];
    loop {
        let (length, _) = timeout_at(due, socket.recv_from(&mut buffer)).await.ok()?.ok()?;
        if let Ok(guide) = EgmGuide::decode(&buffer[..length]) {
            return Some(guide);
        }
    }
}

impl EgmSession {
    fn report(&self, sequence: u32, time: Duration) -> EgmReport {
        EgmReport {
            sequence,
            time_ms: time.as_millis() as u32,
            joints_deg: self.joints_deg,
            external: self.external,
            planned: Some((self.joints_deg, self.external)),
            motors: EgmMotors::On,
            guidance: EgmGuidance::Running,
            converged: true,
            rapid: EgmRapid::Running,
        }
    }

    fn follow(&mut self, guide: &EgmGuide) {
        let axes = |joints: &[f64; 6], external: &ExternalAxes| joints.iter().chain(&external.deg).copied().collect::<Vec<_>>();
        let external = if guide.external.count > 0 { guide.external } else { self.external };
        let (to, from) = (axes(&guide.joints_deg, &external), axes(&self.joints_deg, &self.external));
        self.max_step_deg = to.iter().zip(&from).map(|(to, from)| (to - from).abs()).fold(self.max_step_deg, f64::max);
        (self.joints_deg, self.external, self.guides) = (guide.joints_deg, external, self.guides + 1);
    }
}
