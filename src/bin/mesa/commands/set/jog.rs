//! The cycle of a jog: safe, set, safe again.

use std::ops::ControlFlow;
use std::time::Duration;

use mesa_hal::bus::Instant;
use mesa_hal::hal::{AnyValue, GroupId, PinId, PinInfo, Pins};
use mesa_hal::runner::{Cycle, Runner};
use mesa_hal::transport::udp::UdpError;
use mesa_hal::{Driver, UdpBus};

use super::report::{Change, Outcome, Report};
use crate::context::{Context, Failure};
use crate::output::complain;
use crate::running;

/// How long everything may take until it runs.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long inputs are looked at before, with everything off, and afterwards.
const REST: Duration = Duration::from_millis(200);

/// An output that is set for a time.
pub struct Jog {
    pin: PinId,
    value: AnyValue,
    safe: AnyValue,
    enable: Option<PinId>,
    time: Duration,
    groups: Vec<GroupId>,
    phase: Phase,
    begun: Option<Instant>,
    told: Vec<Told>,
    failure: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Until the groups run.
    Start,
    Before(Instant),
    Set(Instant),
    After(Instant),
    Done,
}

/// An input, and what it showed at the end of each phase; `None` while it is not valid.
struct Told {
    pin: PinId,
    before: Option<AnyValue>,
    during: Option<AnyValue>,
    after: Option<AnyValue>,
}

impl Jog {
    pub fn new(
        driver: &Driver<UdpBus>,
        (pin, value, safe): (PinId, AnyValue, AnyValue),
        enable: Option<PinId>,
        time: Duration,
    ) -> Self {
        let pins = driver.pins();
        let driven = [Some(pin), enable].into_iter().flatten();
        let groups = driven.filter_map(|pin| Some(pins.info_of(pin)?.group));
        let told = super::told(pins).into_iter().map(|pin| Told {
            pin,
            before: None,
            during: None,
            after: None,
        });
        Self {
            pin,
            value,
            safe,
            enable,
            time,
            groups: groups.collect(),
            phase: Phase::Start,
            begun: None,
            told: told.collect(),
            failure: None,
        }
    }

    /// Runs it to its end, with everything safe then.
    pub fn run(
        mut self,
        driver: Driver<UdpBus>,
        context: &Context,
        info: &PinInfo,
    ) -> Result<Report, Failure> {
        let infos = driver.pins().infos().to_vec();
        let mut signal = None;
        let ended = Runner::new(driver).run(|cycle| {
            signal = context.stop.signal();
            match signal {
                Some(_) => self.end(cycle),
                None => self.step(cycle),
            }
        });
        if let Some(signal) = signal {
            complain(format_args!("mesa: ended by {signal}"));
        }
        if let Err(error) = ended.stopped {
            return Err(Failure::refused(format_args!(
                "{}: the ports could not be stopped: {error}; the watchdogs switch all outputs off",
                info.name
            )));
        }
        complain("mesa: all outputs are off, and the ports are stopped");
        // What it was told to do may have failed because of somebody else.
        if self.failure.is_some()
            && let Err(error @ UdpError::OtherHost { .. }) = ended.driver.into_bus().check_alone()
        {
            self.failure = Some(error.to_string());
        }
        let outcome = match (&self.failure, signal) {
            (Some(reason), _) => Outcome::Failed(reason.clone()),
            (None, Some(signal)) => Outcome::Stopped(signal.to_string()),
            (None, None) => Outcome::Done,
        };
        let changes = self.told.iter().filter(|told| told.has_changed());
        let changes = changes.filter_map(|told| {
            Some(Change::new(
                infos.get(told.pin.index())?,
                [told.before, told.during, told.after],
            ))
        });
        let changes = changes.collect();
        Ok(Report::new(info, self.value, self.time, outcome, changes))
    }

    /// Its share of a cycle; it breaks when it is over, with the pin safe.
    pub fn step(&mut self, cycle: &mut Cycle<'_, UdpBus>) -> ControlFlow<()> {
        match self.cycle(cycle) {
            ControlFlow::Continue(()) => ControlFlow::Continue(()),
            ControlFlow::Break(()) => self.end(cycle),
        }
    }

    fn end(&self, cycle: &mut Cycle<'_, UdpBus>) -> ControlFlow<()> {
        // A parameter, such as an inversion, would hold for the last words as well.
        let _ = cycle.pins_mut().set_any(self.pin, self.safe);
        ControlFlow::Break(())
    }

    /// Why it was over before its time.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_, UdpBus>) -> ControlFlow<()> {
        let now = cycle.pins().now();
        let begun = *self.begun.get_or_insert(now);
        if let Err(failure) = running::check(cycle.driver) {
            self.failure = Some(failure.to_string());
            return ControlFlow::Break(());
        }
        if self.phase != Phase::Start
            && let Some(reason) = self.reason(cycle.driver)
        {
            self.failure = Some(reason);
            return ControlFlow::Break(());
        }
        let is_over = |since: Instant, time| now.since(since) >= time;
        match self.phase {
            Phase::Start => {
                if self.reason(cycle.driver).is_none() {
                    self.phase = Phase::Before(now);
                } else if is_over(begun, PATIENCE) {
                    self.failure = self.reason(cycle.driver);
                    return ControlFlow::Break(());
                }
            }
            Phase::Before(since) => {
                self.look(cycle.pins(), |told| &mut told.before);
                if is_over(since, REST) {
                    return self.set(cycle, self.value, true, Phase::Set(now));
                }
            }
            Phase::Set(since) => {
                self.look(cycle.pins(), |told| &mut told.during);
                if is_over(since, self.time) {
                    return self.set(cycle, self.safe, false, Phase::After(now));
                }
            }
            Phase::After(since) => {
                self.look(cycle.pins(), |told| &mut told.after);
                if is_over(since, REST) {
                    self.phase = Phase::Done;
                }
            }
            Phase::Done => return ControlFlow::Break(()),
        }
        ControlFlow::Continue(())
    }

    fn set(
        &mut self,
        cycle: &mut Cycle<'_, UdpBus>,
        value: AnyValue,
        enabled: bool,
        next: Phase,
    ) -> ControlFlow<()> {
        self.phase = next;
        let pins = cycle.pins_mut();
        let enable = self.enable.map(|pin| pins.set_any(pin, enabled.into()));
        let set = pins.set_any(self.pin, value).and(enable.unwrap_or(Ok(())));
        if let Err(error) = set {
            self.failure = Some(error.to_string());
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }

    /// Why the pin can not be driven, or is not any more.
    fn reason(&self, driver: &Driver<UdpBus>) -> Option<String> {
        let group = self.groups.iter().copied().find(|&group| {
            let state = driver.pins().group_state(group);
            let is_disarmed = state.is_none_or(|state| !state.armed);
            // Single transfers may fail.
            is_disarmed || self.phase == Phase::Start && state.is_none_or(|state| !state.valid)
        })?;
        let remotes = driver.ports().iter().flat_map(|port| {
            let number = port.layout().instance;
            port.remotes().map(move |remote| (number, remote))
        });
        let remote = remotes
            .into_iter()
            .find(|(_, remote)| remote.pins.group == group);
        let Some((port, remote)) = remote else {
            return Some("the board's own inputs are not valid".to_owned());
        };
        let place = format!(
            "{} on port {port}, channel {}",
            remote.descriptor.name,
            remote.started.channel.index()
        );
        Some(match remote.first_fault {
            Some(reason) => format!("the {place} went offline: {reason}"),
            None => format!("the {place} does not run"),
        })
    }

    fn look(&mut self, pins: &Pins, at: impl Fn(&mut Told) -> &mut Option<AnyValue>) {
        for told in &mut self.told {
            *at(told) = pins.read_any(told.pin).ok();
        }
    }
}

impl Told {
    fn has_changed(&self) -> bool {
        // Without a moment in which it was set there is nothing to tell.
        self.during.is_some() && self.before != self.during
    }
}
