//! Measured runs.

use std::ops::ControlFlow;
use std::time::Duration;

use mesa_hal::bus::{BusStatistics, RegisterBus};
use mesa_hal::driver::{DriverStatistics, Pace, RemoteState, SerialPort};
use mesa_hal::runner::{Cycle, Latency as Recorder, Realtime, RunStatistics, Runner};
use mesa_hal::{Driver, RemoteLabel, Settings};
use mesa_tools::diagnosis::{PacketMark, Packets};
use mesa_tools::setup::RemotePlace;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use super::setting::Setting;
use crate::board::bus::Bus;
use crate::board::modes::Modes;
use crate::board::running;
use crate::ui::context::{Context, Failure};
use crate::ui::output::complain;
use mesa_tools::advice::told;

/// Cycles at the start that are not counted, while caches fill and the board's DPLL locks.
const WARM_UP: u64 = 100;

/// Cycles to measure, with all outputs off.
pub struct Measurement {
    /// Paces to measure, one after the other.
    pub paces: &'static [Pace],
    /// Cycles per second.
    pub rate: u32,
    /// Number of cycles to count at each pace.
    pub cycles: u64,
    pub modes: Modes,
    pub realtime: Realtime,
    /// True if the clock is polled before a cycle instead of sleeping.
    pub is_spinning: bool,
}

/// Measurement at one pace.
pub struct Measured {
    /// Name of the board.
    pub board: String,
    pub recorder: Recorder,
    /// Number of counted cycles.
    pub cycles: u64,
    pub begin: Mark,
    pub end: Mark,
    /// Packets from the first cycle to the end.
    pub packets: Packets,
    /// Settings of the thread of the cycle, and of this computer, that decide how late cycles are.
    pub setting: Setting,
    /// Socket options that this host does not allow.
    pub refused: Vec<&'static str>,
    /// Remotes that did not run all the time.
    pub offline: Vec<Offline>,
    /// Error that ended the run, or that another program drives the board.
    pub stopped: Result<(), String>,
}

/// Counters at a point in time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mark {
    pub cycle: u64,
    pub cpu: Duration,
    pub bus: BusStatistics,
    pub driver: DriverStatistics,
    pub run: RunStatistics,
}

/// A remote that is or was offline.
#[derive(Clone, Debug, Serialize)]
pub struct Offline {
    #[serde(flatten, serialize_with = "place_and_card")]
    pub remote: RemoteLabel,
    /// True if the remote runs again.
    pub is_back: bool,
    pub reason: String,
}

impl Offline {
    /// Remotes of a driver that are or were offline.
    fn of(driver: &Driver<Bus>) -> Vec<Self> {
        let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
        let offline = remotes.filter_map(|remote| {
            let (is_back, reason) = match remote.state {
                RemoteState::Running if remote.restarts == 0 => return None,
                RemoteState::Running => (true, remote.first_fault),
                RemoteState::Offline { reason, .. } | RemoteState::Restarting { reason } => {
                    (false, Some(reason))
                }
                _ => (false, None),
            };
            let reason = reason.map(|reason| told(&reason));
            Some(Self {
                remote: remote.label,
                is_back,
                reason: reason.unwrap_or_else(|| "it was started again".to_owned()),
            })
        });
        offline.collect()
    }
}

/// The keys with which all commands show a remote.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn place_and_card<S: Serializer>(remote: &RemoteLabel, serializer: S) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(2))?;
    map.serialize_entry("place", &RemotePlace::Channel(remote.id))?;
    map.serialize_entry("card", &remote.name)?;
    map.end()
}

impl Mark {
    fn take(cycle: &Cycle<'_, Bus>) -> Self {
        Self {
            cycle: cycle.number,
            cpu: cpu_time(),
            bus: cycle.driver.bus().statistics(),
            driver: cycle.driver.statistics(),
            run: cycle.statistics,
        }
    }
}

/// Measures at each pace, one after the other, in the calling thread.
pub fn each(asked: &Measurement, bus: Bus, context: &Context) -> Result<Vec<Measured>, Failure> {
    asked.realtime.apply()?;
    let mut all: Vec<Measured> = Vec::new();
    let mut bus = Some(bus);
    for &pace in asked.paces {
        let Some(own) = bus.take().filter(|_| context.stop.signal().is_none()) else {
            break;
        };
        match one(asked, pace, own, context) {
            Ok((measured, same)) => {
                bus = measured.stopped.is_ok().then_some(same);
                all.push(measured);
            }
            Err(error) if all.is_empty() => return Err(error),
            Err(error) => without(pace, &error),
        }
    }
    Ok(all)
}

fn one(
    asked: &Measurement,
    pace: Pace,
    bus: Bus,
    context: &Context,
) -> Result<(Measured, Bus), Failure> {
    let mut driver = running::start(bus, settings(asked, pace))?;
    let mark = PacketMark::take(driver.bus_mut());
    let board = driver.name().to_owned();
    let mut recorder = Recorder::of(&driver);
    let mut runner = Runner::new(driver);
    if !asked.is_spinning {
        runner = runner.sleeping();
    }
    let (mut begin, mut end) = (Mark::default(), Mark::default());
    let mut offline = Vec::new();
    let last = WARM_UP + asked.cycles;
    let ended = runner.run(|cycle| {
        if cycle.number >= WARM_UP {
            recorder.record(cycle);
        }
        if cycle.number == WARM_UP {
            begin = Mark::take(cycle);
        }
        let is_alone = running::check_alone(cycle.driver.bus());
        if cycle.number < last && context.stop.signal().is_none() && is_alone.is_ok() {
            return ControlFlow::Continue(());
        }
        end = Mark::take(cycle);
        offline = Offline::of(cycle.driver);
        ControlFlow::Break(())
    });
    let stopped = ended.stopped.map_err(|error| told(&error));
    let mut bus = ended.driver.into_bus();
    let alone = running::check_alone(&bus).map_err(|failure| failure.to_string());
    let packets = mark.packets_since(&mut bus, pace);
    let measured = Measured {
        board,
        recorder,
        cycles: end.cycle.saturating_sub(WARM_UP),
        begin,
        end,
        packets,
        setting: Setting::now(),
        refused: bus.refused().to_vec(),
        offline,
        stopped: stopped.and(alone),
    };
    Ok((measured, bus))
}

fn settings(asked: &Measurement, pace: Pace) -> Settings {
    let mut settings = Settings {
        period: Duration::from_secs(1) / asked.rate,
        pace,
        watchdog: Some(running::WATCHDOG),
        ..Settings::default()
    };
    asked.modes.put(&mut settings);
    settings
}

/// CPU time of this thread so far.
fn cpu_time() -> Duration {
    let statistics = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanos = statistics.split(' ').next().and_then(|n| n.parse().ok());
    Duration::from_nanos(nanos.unwrap_or(0))
}

/// Reports a pace that could not be measured; the measurement at another pace is kept.
fn without(pace: Pace, why: &Failure) {
    complain(format_args!("mesa: paced by the {}: {why}", name(pace)));
}

/// Name of a pace on the command line.
pub const fn name(pace: Pace) -> &'static str {
    match pace {
        Pace::Host => "host",
        Pace::Board => "board",
    }
}
