//! KUKA arms by the Robot Sensor Interface, with the table as an external axis where `N` is 7. The controller's program switches RSI
//! on with `#ABSOLUTE`; corrections are counted from the axes of the first telegram, and the first answers hold them. RSI stops the
//! arm by itself when too many answers are late or missing: that is the watchdog, its budget is set on the controller.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use super::datagrams::Datagrams;
use super::streamed::{StreamStep, Streamed, StreamedLink, StreamedProtocol, StreamedReport};
use crate::cell::KukaRsiSpec;
use crate::execution::device::{Condition, DeviceError, Identity, WireLog};
use crate::execution::protocol::kuka_rsi::{RsiCorrection, RsiNames, RsiReport};

/// Jump of the time stamp after which RSI was switched off and on again, unless this machine stood still for as long, ms.
const RESTARTED_MS: u64 = 1000;

/// An arm by KUKA, with the table in place 7 where `N` is 7.
pub type KukaArm<const N: usize> = Streamed<N, KukaRsi>;

/// Protocol of [`KukaArm`].
#[derive(Clone)]
pub struct KukaRsi {
    spec: KukaRsiSpec,
    log: Arc<dyn WireLog>,
}

impl KukaRsi {
    /// The arm of a specification; `device` is its name in the log.
    #[must_use]
    pub fn arm<const N: usize>(spec: &KukaRsiSpec, log: Arc<dyn WireLog>) -> KukaArm<N> {
        Streamed::new(Self { spec: spec.clone(), log })
    }
}

/// Open link of [`KukaRsi`].
pub struct KukaRsiLink<const N: usize> {
    spec: KukaRsiSpec,
    names: RsiNames,
    datagrams: Datagrams,
    /// Axes that corrections are counted from, degrees.
    base_deg: Option<[f64; N]>,
    ipoc: u64,
    /// Latest answer, which the same telegram gets again.
    answered: Option<RsiCorrection>,
    /// Late answers by the latest telegram, where it counts them.
    late: Option<u32>,
    /// Time at which this machine was last seen to run.
    awake_at: Instant,
    /// Longest time since the latest telegram in which it was not.
    held_up: Duration,
}

impl<const N: usize> StreamedProtocol<N> for KukaRsi {
    type Link = KukaRsiLink<N>;

    async fn open(&self) -> Result<(Identity, Self::Link), DeviceError> {
        let spec = self.spec.clone();
        let datagrams = Datagrams::bind(&spec.address, spec.controller_host, self.log.clone(), "arm").await?;
        let names = RsiNames {
            sender_type: spec.sender_type.clone(),
            axis_tag: spec.axis_tag.clone(),
            table_tag: spec.table_tag.clone(),
        };
        // RSI tells nothing of itself.
        let identity =
            Identity { maker: "KUKA".to_owned(), model: "controller with RSI".to_owned(), serial: None, firmware: None };
        let (awake_at, held_up) = (Instant::now(), Duration::ZERO);
        let (base_deg, ipoc, answered, late) = (None, 0, None, None);
        Ok((identity, KukaRsiLink { spec, names, datagrams, base_deg, ipoc, answered, late, awake_at, held_up }))
    }
}

impl<const N: usize> KukaRsiLink<N> {
    /// Axes 1 to 6 and the table's, degrees.
    fn axes_deg(&self, arm_deg: &[f64; 6], external_deg: Option<&[f64; 6]>) -> Result<[f64; N], DeviceError> {
        let table = external_deg.map(|deg| deg[usize::from(self.spec.table_axis.clamp(1, 6)) - 1]);
        let mut axes_deg = [0.0; N];
        for (axis, deg) in axes_deg.iter_mut().enumerate() {
            *deg = arm_deg.get(axis).copied().or(table).ok_or_else(|| DeviceError::Malformed {
                what: "a telegram without EIPos; the configuration must send DEF_EIPos for the table".to_owned(),
            })?;
        }
        Ok(axes_deg)
    }

    /// Notes that this machine runs: the thread asks for a telegram again and again while none comes.
    fn note_awake(&mut self) {
        let now = Instant::now();
        self.held_up = self.held_up.max(now.duration_since(self.awake_at));
        self.awake_at = now;
    }

    /// Waits for a telegram that has no answer yet. One that comes again gets its answer again: the set point of a further cycle
    /// would take the arm twice as far in this one.
    async fn unanswered(&mut self) -> Result<RsiReport, DeviceError> {
        loop {
            self.note_awake();
            let report = RsiReport::decode(self.datagrams.receive().await?)?;
            self.note_awake();
            match &self.answered {
                Some(answered) if answered.ipoc == report.ipoc => {
                    self.datagrams.send(answered.encode(&self.names).as_bytes()).await?;
                }
                Some(_) | None => return Ok(report),
            }
        }
    }

    /// Skips a telegram that was overtaken, and refuses one of another start of RSI: its corrections are counted from other axes.
    fn follow(&mut self, ipoc: u64) -> Result<(), DeviceError> {
        let (before, held_up_ms) = (self.ipoc, self.held_up.as_millis());
        if before > 0 && ipoc.abs_diff(before) > RESTARTED_MS {
            let reason = if held_up_ms > u128::from(RESTARTED_MS) {
                format!("this machine stood still for {held_up_ms} ms, in which RSI was not answered and may have been restarted")
            } else {
                format!("RSI was restarted: its time went from {before} to {ipoc}")
            };
            return Err(DeviceError::Closed { reason });
        }
        if ipoc < before {
            return Err(DeviceError::Malformed { what: format!("a telegram of {ipoc} after that of {before}") });
        }
        (self.ipoc, self.held_up) = (ipoc, Duration::ZERO);
        Ok(())
    }
}

impl<const N: usize> StreamedLink<N> for KukaRsiLink<N> {
    const ALWAYS_FOLLOWS: bool = true;

    fn cycle(&self) -> Duration {
        Duration::from_millis(self.spec.cycle_ms.into())
    }

    async fn report(&mut self) -> Result<StreamedReport<N>, DeviceError> {
        let report = self.unanswered().await?;
        let measured_deg = self.axes_deg(&report.axes_deg, report.external_deg.as_ref())?;
        self.follow(report.ipoc)?;
        let base_deg = match self.base_deg {
            Some(base_deg) => base_deg,
            None => self.axes_deg(&report.commanded_deg.unwrap_or(report.axes_deg), report.external_deg.as_ref())?,
        };
        self.base_deg = Some(base_deg);
        let is_behind = self.late.zip(report.late).is_some_and(|(before, late)| late > before);
        self.late = report.late;
        // RSI runs only while the drives are on and the program is under way.
        let [positions_rad, held_rad] = [measured_deg, base_deg].map(|axes_deg| axes_deg.map(f64::to_radians));
        Ok(StreamedReport { positions_rad, held_rad, condition: Condition::READY, hindrance: None, is_behind })
    }

    async fn arm(&mut self, _watchdog: Duration) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn answer(&mut self, step: &StreamStep<N>) -> Result<(), DeviceError> {
        let Some(base_deg) = self.base_deg else { return Ok(()) };
        let correction_deg = |axis: usize| Some(step.set_point_rad.get(axis)?.to_degrees() - base_deg.get(axis)?);
        let answered = self.answered.insert(RsiCorrection {
            axes_deg: std::array::from_fn(|axis| correction_deg(axis).unwrap_or(0.0)),
            table: correction_deg(6).map(|deg| (self.spec.table_axis, deg)),
            ipoc: self.ipoc,
        });
        self.datagrams.send(answered.encode(&self.names).as_bytes()).await
    }

    async fn close(self) {}
}
