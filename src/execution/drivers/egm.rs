//! ABB arms by Externally Guided Motion, with the table as an external axis where `N` is 7. The controller's program runs
//! `EGMActJoint` and `EGMRunJoint`; every report is answered, until a target is given with where the arm is commanded to stand: the
//! guidance ends without answers, which is the watchdog (`\CommTimeout` of `EGMSetupUC`).

use std::sync::Arc;
use std::time::Duration;

use super::datagrams::Datagrams;
use super::streamed::{MAX_FOLLOWING_ERROR_RAD, StreamStep, Streamed, StreamedLink, StreamedProtocol, StreamedReport, apart_rad};
use crate::cell::AbbEgmSpec;
use crate::execution::device::{Condition, DeviceError, Identity, WireLog};
use crate::execution::protocol::egm::{EgmGuidance, EgmGuide, EgmMotors, EgmRapid, EgmReport, ExternalAxes};

/// Time by which a report that another overtook may be older, ms. What is older still is of another start of the controller.
const MAX_OVERTAKEN_MS: u32 = 1000;

/// An arm by ABB, with the table in place 7 where `N` is 7.
pub type AbbArm<const N: usize> = Streamed<N, AbbEgm>;

/// Protocol of [`AbbArm`].
#[derive(Clone)]
pub struct AbbEgm {
    spec: AbbEgmSpec,
    log: Arc<dyn WireLog>,
}

impl AbbEgm {
    /// The arm of a specification.
    #[must_use]
    pub fn arm<const N: usize>(spec: &AbbEgmSpec, log: Arc<dyn WireLog>) -> AbbArm<N> {
        Streamed::new(Self { spec: spec.clone(), log })
    }
}

/// Open link of [`AbbEgm`].
pub struct AbbEgmLink {
    spec: AbbEgmSpec,
    datagrams: Datagrams,
    /// External axes as first reported: those that are not the table's stay there.
    external: Option<ExternalAxes>,
    latest: EgmReport,
    /// Latest answer, which the same report gets again.
    answered: Option<EgmGuide>,
}

impl<const N: usize> StreamedProtocol<N> for AbbEgm {
    type Link = AbbEgmLink;

    async fn open(&self) -> Result<(Identity, Self::Link), DeviceError> {
        let spec = self.spec.clone();
        let datagrams = Datagrams::bind(&spec.address, spec.controller_host, self.log.clone(), "arm").await?;
        // EGM tells nothing of itself.
        let identity =
            Identity { maker: "ABB".to_owned(), model: "controller with EGM".to_owned(), serial: None, firmware: None };
        Ok((identity, AbbEgmLink { spec, datagrams, external: None, latest: EgmReport::default(), answered: None }))
    }
}

impl AbbEgmLink {
    fn table_index(&self) -> usize {
        usize::from(self.spec.table_axis.clamp(1, 6)) - 1
    }

    /// Axes 1 to 6 and the table's, radians.
    fn axes_rad<const N: usize>(&self, joints_deg: &[f64; 6], external: &ExternalAxes) -> Result<[f64; N], DeviceError> {
        let index = self.table_index();
        let table = external.deg.get(index).filter(|_| index < external.count);
        let mut axes_rad = [0.0; N];
        for (axis, rad) in axes_rad.iter_mut().enumerate() {
            let deg = joints_deg.get(axis).or(table);
            *rad = deg.ok_or_else(|| DeviceError::Malformed { what: format!("no external axis {}", index + 1) })?.to_radians();
        }
        Ok(axes_rad)
    }

    /// Returns true if a report was sent before the latest that was answered, by its number and its time: its cycle is over.
    fn is_overtaken(&self, report: &EgmReport) -> bool {
        let [numbers, ms] = [(self.latest.sequence, report.sequence), (self.latest.time_ms, report.time_ms)]
            .map(|(latest, of)| latest.wrapping_sub(of));
        self.answered.is_some() && (1..=u32::MAX / 2).contains(&numbers) && (1..=MAX_OVERTAKEN_MS).contains(&ms)
    }

    /// Waits for a report that has no answer yet, and skips those that were overtaken. One that comes again, by its number and its
    /// time, gets its answer again: the set point of a further cycle would take the arm twice as far in this one.
    async fn unanswered(&mut self) -> Result<EgmReport, DeviceError> {
        loop {
            let report = EgmReport::decode(self.datagrams.receive().await?)?;
            if self.is_overtaken(&report) {
                continue;
            }
            let is_repeated = (report.sequence, report.time_ms) == (self.latest.sequence, self.latest.time_ms);
            match self.answered.as_ref().filter(|_| is_repeated) {
                Some(answered) => self.datagrams.send(&answered.encode()).await?,
                None => return Ok(report),
            }
        }
    }
}

impl<const N: usize> StreamedLink<N> for AbbEgmLink {
    const ALWAYS_FOLLOWS: bool = true;

    fn cycle(&self) -> Duration {
        Duration::from_millis(self.spec.cycle_ms.into())
    }

    async fn report(&mut self) -> Result<StreamedReport<N>, DeviceError> {
        let report = self.unanswered().await?;
        let positions_rad = self.axes_rad(&report.joints_deg, &report.external)?;
        let planned = report.planned.map(|(joints_deg, external)| self.axes_rad(&joints_deg, &external));
        // A report without a plan, or with one of another motion, leaves what is measured.
        let held_rad = planned.and_then(Result::ok).filter(|held| apart_rad(held, &positions_rad) <= MAX_FOLLOWING_ERROR_RAD);
        let held_rad = held_rad.unwrap_or(positions_rad);
        self.external.get_or_insert(report.external);
        self.latest = report;
        let (condition, hindrance) = (condition(&report), hindrance(&report));
        Ok(StreamedReport { positions_rad, held_rad, condition, hindrance, is_behind: false })
    }

    async fn arm(&mut self, _watchdog: Duration) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn answer(&mut self, step: &StreamStep<N>) -> Result<(), DeviceError> {
        let sequence = self.answered.map_or(0, |before| before.sequence).wrapping_add(1);
        let mut external = self.external.unwrap_or_default();
        let index = self.table_index();
        if let (Some(table_rad), Some(deg)) = (step.set_point_rad.get(6), external.deg.get_mut(index)) {
            *deg = table_rad.to_degrees();
        }
        let guide = EgmGuide {
            sequence,
            time_ms: self.latest.time_ms,
            joints_deg: std::array::from_fn(|axis| step.set_point_rad.get(axis).copied().unwrap_or_default().to_degrees()),
            external,
        };
        self.answered = Some(guide);
        self.datagrams.send(&guide.encode()).await
    }

    async fn close(self) {}
}

fn condition(report: &EgmReport) -> Condition {
    let powered = report.motors == EgmMotors::On;
    Condition { powered, brakes_open: powered, paused: report.rapid == EgmRapid::Stopped, ..Condition::READY }
}

fn hindrance(report: &EgmReport) -> Option<&'static str> {
    match (report.motors, report.guidance) {
        (EgmMotors::Off | EgmMotors::Unknown, _) => Some("its motors are off; switch them on at the controller"),
        (EgmMotors::On, EgmGuidance::Running) => None,
        (EgmMotors::On, EgmGuidance::Error | EgmGuidance::Stopped | EgmGuidance::Unknown) => {
            Some("its guidance does not run; start the program with EGMRunJoint on the controller")
        }
    }
}
