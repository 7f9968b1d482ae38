//! Whole runs through the drivers of Han's controllers and the MINAS A6 over a network of chance: two clients, devices that fault,
//! connections that are late, held, lost, cut and refused, each run from a seed. Whatever happens, nothing moves that is not armed,
//! nobody moves without the lease, and every run ends.

use std::collections::BTreeMap;
use std::panic::catch_unwind;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use tokio::time::{Instant, sleep, timeout};

use super::rehearsal::{CELL, Chance, attend, hashes, in_simulated_time, job, on_deep_stacks, planned, short_job, until};
use super::rough_cell::{RoughCell, SeenBytes};
use super::simulated_network::{Passage, Weather};
use crate::execution::device::Trigger;
use crate::execution::session::{Authority, DeviceRole, Leases, RunHandle, RunOptions, RunState, RunStatus, StopCause, live};
use crate::execution::simulators::faults::FaultCommand;
use crate::execution::twin::{TriggerAccess, TwinTrigger};

const SEEDS: u64 = 2000;
/// Time in which something may happen.
const ROUGH: Duration = Duration::from_millis(2500);
/// Longest time from healing to the end.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs of a seed, with the watch over each.
struct Scene {
    seed: u64,
    cell: RoughCell,
    leases: Leases,
    seen: Mutex<Vec<Arc<SeenBytes>>>,
    triggers: Mutex<Vec<TriggerAccess>>,
}

impl Scene {
    /// A client takes the lease, and runs the program from beginning to end, if it can.
    async fn client(&self, name: &str, mut chance: Chance) -> Option<RunStatus> {
        let ttl = Duration::from_millis(300 + chance.of(2000));
        let lease = loop {
            match self.leases.acquire(CELL, name, ttl) {
                Ok(lease) => break lease,
                Err(_) => sleep(Duration::from_millis(1 + chance.of(200))).await,
            }
        };
        let (machine, seen) = self.cell.drivers();
        let trigger = TwinTrigger::new(1.0);
        self.triggers.lock().expect("whole").push(trigger.access());
        let options = RunOptions { single_step: chance.of(4) == 0, ..RunOptions::default() };
        let handle = self.run(machine, trigger, options);
        seen.follow(handle.watch_status(), self.leases.clone(), lease.token);
        self.seen.lock().expect("whole").push(seen);
        let attendant = attend(&handle, &self.leases, lease.token);
        until(&handle, RunState::Ready).await;
        // What is refused is refused.
        let _ = handle.arm(lease.token).await;
        let began = Instant::now();
        while began.elapsed() < ROUGH {
            sleep(Duration::from_millis(1 + chance.of(400))).await;
            match chance.of(12) {
                0 => drop(handle.pause().await),
                1..7 => drop(handle.resume(Some(lease.token)).await),
                7 => drop(handle.set_override(Some(lease.token), 0.2 + 0.008 * chance.of(100) as f64).await),
                8 if chance.of(8) == 0 => handle.stop(StopCause::Client),
                9 if chance.of(6) == 0 => attendant.abort(),
                10 if chance.of(8) == 0 => drop(self.leases.release(CELL, lease.token)),
                _ => {}
            }
        }
        let ended = self.see_to_its_end(&handle, Some(lease.token)).await;
        attendant.abort();
        let _ = self.leases.release(CELL, lease.token);
        Some(ended)
    }

    fn run<T: Trigger + 'static>(&self, machine: super::rough_cell::RoughPair, trigger: T, options: RunOptions) -> RunHandle {
        let authority = Authority { leases: self.leases.clone(), cell: CELL.into() };
        live(short_job(0.5, [hashes(), hashes()]), machine, trigger, authority, options)
    }

    /// Goes on with whatever is paused, until it ends.
    async fn see_to_its_end(&self, handle: &RunHandle, token: Option<crate::execution::session::Fence>) -> RunStatus {
        let (mut status, began) = (handle.watch_status(), Instant::now());
        loop {
            let ended = timeout(Duration::from_millis(500), status.wait_for(|status| status.state.is_final())).await;
            if let Ok(Ok(status)) = ended {
                return status.clone();
            }
            assert!(began.elapsed() < PATIENCE, "seed {}: {:?} does not end", self.seed, handle.status());
            let _ = handle.resume(token).await;
        }
    }

    /// Plants faults and changes the weather, for a while.
    async fn rage(&self, mut chance: Chance) {
        let began = Instant::now();
        for network in &self.cell.networks {
            network.set_weather(Weather { max_delay_ms: 1 + chance.of(8), max_pieces: 1 + chance.of(4), ..Weather::FAIR });
        }
        // A quarter of the seeds has slow networks and two clients alone.
        let is_quiet = chance.of(4) == 0;
        while began.elapsed() < ROUGH {
            sleep(Duration::from_millis(1 + chance.of(1200))).await;
            if is_quiet {
                continue;
            }
            let device = [DeviceRole::Arm, DeviceRole::Table][chance.of(2) as usize];
            let network = self.cell.network(device);
            match chance.of(15) {
                0 => network.set_passage(Passage::Held),
                1 => network.set_passage(Passage::Lost),
                2 => network.set_passage(Passage::Refused),
                3 => network.cut(),
                4 => network.set_weather(Weather { max_delay_ms: 1 + chance.of(60), ..network.weather() }),
                5 => network.set_weather(Weather { is_garbled: true, ..network.weather() }),
                6 => self.cell.apply(device, FaultCommand::EmergencyStop(true)),
                7 => self.cell.apply(device, FaultCommand::Guard(true)),
                8 => self.cell.apply(device, FaultCommand::Alarm(Some(2400))),
                9 => self.cell.apply(device, FaultCommand::Late(Duration::from_millis(1 + chance.of(150)))),
                10 => self.cell.apply(device, FaultCommand::Silent(true)),
                11 => self.cell.apply(DeviceRole::Table, FaultCommand::WordOrder(true)),
                12 => self.triggers.lock().expect("whole").iter().for_each(|trigger| trigger.silence(true)),
                _ => network.set_weather(Weather { passage: Passage::Open, is_garbled: false, ..network.weather() }),
            }
        }
        self.cell.heal_all();
    }

    /// Holds what moves against what may, forever.
    async fn look(&self) {
        let axes = planned().cell.axes();
        let mut before = self.cell.configuration();
        loop {
            sleep(Duration::from_millis(5)).await;
            let here = self.cell.configuration();
            let (seed, seen) = (self.seed, self.seen.lock().expect("whole"));
            seen.iter().for_each(|seen| seen.look_at_lease());
            assert!(axes.allow(&here), "seed {seed}: {here:?} is beyond limits");
            let moves = [here.joints_rad != before.joints_rad, (here.table_rad - before.table_rad).abs() > 1e-12];
            for (device, moves) in [DeviceRole::Arm, DeviceRole::Table].into_iter().zip(moves) {
                let may = seen.iter().any(|seen| seen.may_move(device));
                assert!(may || !moves, "seed {seed}: the {device} moves, and nobody armed it");
            }
            before = here;
            drop(seen);
        }
    }
}

/// Ends of the runs of a seed.
async fn runs_of(seed: u64) -> Vec<RunStatus> {
    let mut chance = Chance(seed);
    let scene = Scene {
        seed,
        cell: RoughCell::new(chance.next()),
        leases: Leases::default(),
        seen: Mutex::default(),
        triggers: Mutex::default(),
    };
    let (first, second, rage) = (Chance(chance.next()), Chance(chance.next()), Chance(chance.next()));
    let has_second = chance.of(3) == 0;
    let clients = async {
        let second = async { if has_second { scene.client("second", second).await } else { None } };
        let (ends, _) = tokio::join!(async { tokio::join!(scene.client("first", first), second) }, async {
            scene.rage(rage).await;
            // A scanner that fell silent is seen to by somebody; whoever begins later finds it well.
            scene.triggers.lock().expect("whole").iter().for_each(|trigger| trigger.silence(false));
        });
        [ends.0, ends.1].into_iter().flatten().collect::<Vec<_>>()
    };
    tokio::select! {
        ends = async {
            let ends = clients.await;
            // Arms without a stop finish one move; then nothing moves any more.
            sleep(Duration::from_secs(6)).await;
            let rest = scene.cell.configuration();
            sleep(Duration::from_secs(3)).await;
            assert_eq!(scene.cell.configuration(), rest, "seed {seed}: something moves after every end");
            ends
        } => {
            for seen in scene.seen.lock().expect("whole").iter() {
                assert_eq!(seen.breaches(), [""; 0], "seed {seed}");
            }
            ends
        }
        () = scene.look() => unreachable!("it never ends"),
    }
}

fn simulated(seed: u64) -> Vec<RunStatus> {
    in_simulated_time(runs_of(seed))
}

fn processor_secs() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

#[test]
#[ignore = "long: tests/all runs it"]
fn on_a_network_of_chance_only_what_is_armed_moves_in_order_within_limits_and_every_run_ends() {
    let (first, count) = match std::env::var("SEED").ok().and_then(|seed| seed.parse().ok()) {
        Some(seed) => (seed, 1),
        None => (0, SEEDS),
    };
    planned();
    let before = processor_secs();
    let found: Vec<_> =
        on_deep_stacks(|| (first..first + count).into_par_iter().map(|seed| catch_unwind(|| simulated(seed))).collect());
    let failed: Vec<u64> = (first..).zip(&found).filter(|(_, ends)| ends.is_err()).map(|(seed, _)| seed).collect();
    assert!(failed.is_empty(), "{} seeds fail; SEED=number runs one alone: {failed:?}", failed.len());
    let ends: Vec<Vec<RunStatus>> = found.into_iter().flatten().collect();
    let mut counted: BTreeMap<(RunState, &str), usize> = BTreeMap::new();
    for status in ends.iter().flatten() {
        assert!(!status.reason.to_string().is_empty());
        if std::env::var_os("REASONS").is_some() {
            println!("{:?} {}", status.state, status.reason);
        }
        *counted.entry((status.state, status.reason.code())).or_default() += 1;
    }
    println!("{count} seeds, {:.1} s of processor time: {counted:?}", processor_secs() - before);
    if count == SEEDS {
        for state in [RunState::Done, RunState::Stopped, RunState::Failed] {
            assert!(counted.keys().any(|(found, _)| *found == state), "{state:?} is met");
        }
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_seed_gives_the_same_run_each_time() {
    planned();
    on_deep_stacks(|| (0..20).into_par_iter().for_each(|seed| assert_eq!(simulated(seed), simulated(seed), "seed {seed}")));
}

/// The planned part through both drivers, on a network that is up to 2 ms late: its real cycle time is the plan's within 5 %, whatever
/// else the machine does.
#[test]
fn a_planned_part_takes_its_planned_time() {
    planned();
    let record = on_deep_stacks(|| {
        in_simulated_time(async {
            let cell = RoughCell::new(1);
            cell.networks.iter().for_each(|network| network.set_weather(Weather { max_delay_ms: 2, ..Weather::FAIR }));
            let (machine, _) = cell.drivers();
            let leases = Leases::default();
            let token = leases.acquire(CELL, "operator", Duration::from_secs(5)).expect("free").token;
            let authority = Authority { leases: leases.clone(), cell: CELL.into() };
            let handle = live(job(), machine, TwinTrigger::new(1.0), authority, RunOptions::default());
            let attendant = attend(&handle, &leases, token);
            assert_eq!(until(&handle, RunState::Ready).await, RunState::Ready, "{}", handle.status().reason);
            handle.arm(token).await.expect("may");
            let record = handle.ended().await;
            attendant.abort();
            record
        })
    });
    assert_eq!(record.status.state, RunState::Done, "{}", record.status.reason);
    let (planned, real) = (record.planned_secs, record.real_secs);
    println!("planned {planned:.3} s, took {real:.3} s: {:.4}", real / planned);
    for step in &record.steps {
        println!("{:?} planned {:.3} took {:.3}", step.kind, step.planned_secs, step.real_secs);
    }
    assert!((real / planned - 1.0).abs() < 0.05, "{real} {planned}");
}
