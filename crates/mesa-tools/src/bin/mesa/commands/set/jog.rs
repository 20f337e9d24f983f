//! The cycle of a jog: safe, set, safe again.

use std::ops::{ControlFlow, RangeBounds};
use std::time::Duration;

use mesa_hal::Driver;
use mesa_hal::bus::{BusError, Instant};
use mesa_hal::driver::SerialPort;
use mesa_hal::hal::{AnyValue, GroupId, PinId, PinInfo, Pins, Role};
use mesa_hal::modules::gpio::Gpio;
use mesa_hal::runner::{Cycle, Runner};

use super::announcer::Announcer;
use super::plan::{JogPlan, Progress, Step};
use super::report::{Change, Inputs, Outcome, SetReport};
use crate::board::bus::Bus;
use crate::board::reason::{self, Reason};
use crate::board::running;
use crate::ui::context::{Context, Failure};
use crate::ui::output::complain;
use mesa_tools::advice::told;

/// Time within which a machine that was just started must run.
pub const PATIENCE: Duration = Duration::from_secs(5);
/// Time for which inputs are observed before and after the jog, with everything off.
const REST: Duration = Duration::from_millis(200);
/// Time within which inputs must become valid; those that do not are not reported.
const SETTLE: Duration = Duration::from_secs(1);
/// Consecutive reads of a level other than the driven one after which the jog fails.
const CONTRADICTIONS: u32 = 3;

/// An output that is set for a time.
pub struct Jog {
    /// Pins to set, in order: those that must be on for the output to reach its terminal, then the
    /// output itself.
    steps: Vec<Step>,
    time: Duration,
    patience: Duration,
    groups: Vec<GroupId>,
    level: Option<Level>,
    phase: Phase,
    begun: Option<Instant>,
    told: Vec<Told>,
    /// True once the output was set: its value may have been sent.
    was_sent: bool,
    /// True once the output was confirmed to have its value.
    was_set: bool,
    /// True once the output was confirmed to have its safe value again.
    is_safe: bool,
    failure: Option<Reason>,
}

/// Input that shows the level of the output at its terminal.
#[derive(Clone, Copy, Debug)]
struct Level {
    pin: PinId,
    expected: AnyValue,
    contradictions: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Before the groups run.
    Start,
    Before(Instant),
    /// The output is set, but not enabled.
    Ready,
    Set(Instant),
    After(Instant),
    Done,
}

/// An input with its value at the end of each phase; `None` while it is not valid.
struct Told {
    pin: PinId,
    before: Option<AnyValue>,
    during: Option<AnyValue>,
    after: Option<AnyValue>,
}

impl Jog {
    /// Prepares to set the output and the pins that [enable](Pins::enables) it; the caller has
    /// consent for those as well.
    pub fn new(driver: &Driver<Bus>, plan: JogPlan) -> Self {
        let pins = driver.pins();
        let enables = pins.enables(plan.output.pin).map(|pin| Step {
            pin,
            value: true.into(),
            safe: pins.read_any(pin).value,
        });
        let mut steps: Vec<_> = enables.collect();
        steps.reverse();
        steps.push(plan.output);
        let groups = steps
            .iter()
            .filter_map(|s| Some(pins.info_of(s.pin)?.group));
        let told = reported_inputs(pins).into_iter().map(|pin| Told {
            pin,
            before: None,
            during: None,
            after: None,
        });
        Self {
            level: steps.last().and_then(|output| level(driver, output)),
            groups: groups.collect(),
            steps,
            time: plan.time,
            patience: plan.patience,
            phase: Phase::Start,
            begun: None,
            told: told.collect(),
            was_sent: false,
            was_set: false,
            is_safe: false,
            failure: None,
        }
    }

    /// Runs the jog to its end, and makes everything safe.
    pub fn run(
        mut self,
        driver: Driver<Bus>,
        context: &Context,
        info: &PinInfo,
        mut announcer: Announcer,
    ) -> Result<SetReport, Failure> {
        let infos = driver.pins().infos().to_vec();
        let mut signal = None;
        let ended = Runner::new(driver).run(|cycle| {
            signal = context.stop.signal();
            let flow = match signal {
                Some(_) => self.end(cycle),
                None => self.step(cycle),
            };
            announcer.show(self.progress(cycle.pins().now()));
            flow
        });
        announcer.end();
        if let Some(signal) = signal {
            complain(format_args!("mesa: ended by {signal}"));
        }
        running::say_losses(ended.driver.bus());
        let not_reached = running::not_reached(ended.stopped)?;
        for remote in &not_reached {
            complain(format_args!("mesa: NOT REACHED: {remote}"));
        }
        let other = if not_reached.is_empty() { "" } else { "other " };
        complain(format_args!(
            "mesa: all {other}outputs are off, and the ports are stopped"
        ));
        // The failure may have been caused by another program that drives the board.
        if self.failure.is_some()
            && let Err(error @ BusError::OtherHost { .. }) = ended.driver.into_bus().check_alone()
        {
            self.failure = Some(Reason::new(told(&error)));
        }
        let value = self.steps.last().map(|step| step.value);
        let value = value.unwrap_or(AnyValue::from(false));
        let (time, inputs) = (self.time, self.inputs(&infos));
        let signal = signal.map(|signal| signal.to_string());
        let lost = not_reached.first().map(Reason::new);
        let outcome = self.outcome(signal, lost);
        Ok(SetReport::new(
            info,
            value,
            time,
            outcome,
            inputs,
            not_reached,
        ))
    }

    /// Outcome of a jog that was ended by a signal, or after which a remote is `lost`.
    fn outcome(self, signal: Option<String>, lost: Option<Reason>) -> Outcome {
        let is_contradicted = self.level.is_some_and(|level| level.contradictions > 0);
        match (self.failure.or(lost), signal) {
            (Some(reason), _) if self.was_set => Outcome::Failed(reason),
            (None, Some(signal)) if self.was_set => Outcome::Stopped(signal),
            (None, None) if self.was_set => Outcome::Done,
            (reason, signal) => {
                let reason = reason.or(signal.map(Reason::new));
                let reason = reason.unwrap_or_else(|| Reason::new("no transfer has got through"));
                if self.was_sent && !is_contradicted {
                    Outcome::NotConfirmed(reason)
                } else {
                    Outcome::NotSet(reason)
                }
            }
        }
    }

    /// The observed inputs; `infos` are those of all pins.
    fn inputs(&self, infos: &[PinInfo]) -> Inputs {
        let changes = self.told.iter().filter(|told| told.has_changed());
        let changes = changes.filter_map(|told| {
            let info = infos.get(told.pin.index())?;
            let values = [told.before, told.during, told.after];
            Some(Change::new(info, values))
        });
        let not_seen = self.told.iter().filter(|told| told.before.is_none());
        Inputs {
            changes: changes.collect(),
            not_seen: not_seen.count(),
        }
    }

    /// Runs the jog's part of a cycle. Breaks when the jog is over, with the pin safe.
    pub fn step(&mut self, cycle: &mut Cycle<'_, Bus>) -> ControlFlow<()> {
        match self.cycle(cycle) {
            ControlFlow::Continue(()) => ControlFlow::Continue(()),
            ControlFlow::Break(()) => self.end(cycle),
        }
    }

    fn end(&self, cycle: &mut Cycle<'_, Bus>) -> ControlFlow<()> {
        // Parameters are included: one such as the direction of an I/O pin would otherwise apply to
        // the last writes as well.
        for step in &self.steps {
            let _ = cycle.pins_mut().set_any(step.pin, step.safe);
        }
        ControlFlow::Break(())
    }

    fn progress(&self, now: Instant) -> Progress {
        match self.phase {
            Phase::Set(since) if self.was_set => Progress::Set {
                left: self.time.saturating_sub(now.since(since)),
            },
            _ if self.is_safe => Progress::Safe,
            _ => Progress::Waiting,
        }
    }

    /// True once the output was confirmed to have its value.
    pub const fn is_confirmed(&self) -> bool {
        self.was_set
    }

    /// Reason for an end before the time.
    pub fn failure(&self) -> Option<&Reason> {
        self.failure.as_ref()
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_, Bus>) -> ControlFlow<()> {
        let now = cycle.pins().now();
        self.check(cycle.driver)?;
        let is_over = |since: Instant, time| now.since(since) >= time;
        match self.phase {
            Phase::Start => return self.start(cycle, now),
            Phase::Before(since) => {
                self.look(cycle.pins(), |told| &mut told.before);
                if is_over(since, REST) {
                    // The value comes before the enable, so that no other value reaches the
                    // terminal.
                    self.phase = Phase::Ready;
                    self.was_sent = true;
                    let output = self.steps.len().saturating_sub(1);
                    return self.set(cycle, output.., true);
                }
            }
            Phase::Ready => {
                self.phase = Phase::Set(now);
                return self.set(cycle, .., true);
            }
            Phase::Set(since) => {
                self.look(cycle.pins(), |told| &mut told.during);
                self.verify(cycle.pins(), now.since(since))?;
                if is_over(since, self.time) {
                    self.phase = Phase::After(now);
                    return self.set(cycle, .., false);
                }
            }
            Phase::After(since) => {
                self.look(cycle.pins(), |told| &mut told.after);
                self.is_safe |= self.is_transferred(cycle.pins(), now.since(since));
                if is_over(since, REST) {
                    self.phase = Phase::Done;
                }
            }
            Phase::Done => return ControlFlow::Break(()),
        }
        ControlFlow::Continue(())
    }

    /// Fails once the machine does not run any more, or the output cannot be driven any more.
    fn check(&mut self, driver: &Driver<Bus>) -> ControlFlow<()> {
        self.failure = match running::check(driver) {
            Err(failure) => Some(Reason::new(failure)),
            Ok(()) if self.phase == Phase::Start => None,
            Ok(()) => self.reason(driver),
        };
        match self.failure {
            Some(_) => ControlFlow::Break(()),
            None => ControlFlow::Continue(()),
        }
    }

    /// Waits until the groups run and the inputs have been read.
    fn start(&mut self, cycle: &mut Cycle<'_, Bus>, now: Instant) -> ControlFlow<()> {
        let waited = now.since(*self.begun.get_or_insert(now));
        // All outputs are off: groups that the proof of the watchdogs disarmed may be driven again.
        cycle.pins_mut().rearm_all();
        let reason = self.reason(cycle.driver);
        self.look(cycle.pins(), |told| &mut told.before);
        let is_seen = self.told.iter().all(|told| told.before.is_some());
        if reason.is_none() && (is_seen || waited >= SETTLE) {
            self.phase = Phase::Before(now);
        } else if waited >= self.patience {
            self.failure = reason;
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }

    fn set(
        &mut self,
        cycle: &mut Cycle<'_, Bus>,
        steps: impl RangeBounds<usize>,
        is_on: bool,
    ) -> ControlFlow<()> {
        for (_, step) in (0..).zip(&self.steps).filter(|(n, _)| steps.contains(n)) {
            let value = if is_on { step.value } else { step.safe };
            if let Err(error) = cycle.pins_mut().set_any(step.pin, value) {
                self.failure = Some(Reason::new(told(&error)));
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    }

    /// Checks that the output has had its value for `set`, as far as it can be read back: a
    /// transfer begun since then has succeeded, and the level at the terminal agrees, if it is
    /// read.
    fn verify(&mut self, pins: &Pins, set: Duration) -> ControlFlow<()> {
        if !self.is_transferred(pins, set) {
            return ControlFlow::Continue(());
        }
        if let Some(level) = &mut self.level
            && pins.read_any(level.pin).ok() != Some(level.expected)
        {
            level.contradictions += 1;
            if level.contradictions < CONTRADICTIONS {
                return ControlFlow::Continue(());
            }
            self.failure = Some(Reason::new(
                "its terminal shows the opposite of what is driven: something else drives it, or it \
                 is shorted",
            ));
            return ControlFlow::Break(());
        }
        if let Some(level) = &mut self.level {
            level.contradictions = 0;
        }
        self.was_set = true;
        ControlFlow::Continue(())
    }

    /// True if a transfer that has begun within `time` has succeeded in each group.
    fn is_transferred(&self, pins: &Pins, time: Duration) -> bool {
        let states = self.groups.iter().map(|&group| pins.group_state(group));
        let mut states = states.map(|state| state.filter(|state| state.valid));
        states.all(|state| state.is_some_and(|state| state.age.time < time))
    }

    /// Reason why the pin cannot be driven, or is not driven any more.
    fn reason(&self, driver: &Driver<Bus>) -> Option<Reason> {
        let group = self.groups.iter().copied().find(|&group| {
            let state = driver.pins().group_state(group);
            let is_disarmed = state.is_none_or(|state| !state.armed);
            // Single transfers may fail once the groups have run.
            is_disarmed || self.phase == Phase::Start && state.is_none_or(|state| !state.valid)
        })?;
        let mut remotes = driver.ports().iter().flat_map(SerialPort::remotes);
        let Some(remote) = remotes.find(|remote| remote.pins.group == group) else {
            return Some(Reason::new("the board's own inputs are not valid"));
        };
        let (state, first) = (remote.state, remote.first_fault);
        Some(reason::of_remote(remote.label, state, first))
    }

    fn look(&mut self, pins: &Pins, at: impl Fn(&mut Told) -> &mut Option<AnyValue>) {
        for told in &mut self.told {
            *at(told) = pins.read_any(told.pin).ok();
        }
    }
}

impl Told {
    fn has_changed(&self) -> bool {
        // An input that was not valid before, or is not valid any more, shows nothing about the
        // output.
        self.before.is_some() && self.during.is_some() && self.before != self.during
    }
}

/// Finds the input that shows the level of an I/O pin which is driven low and high.
fn level(driver: &Driver<Bus>, output: &Step) -> Option<Level> {
    let pins = driver.pins();
    let all = driver.modules::<Gpio>().flat_map(Gpio::pins);
    let is_it = |out| PinId::from(out) == output.pin;
    let found = all.into_iter().find(|pin| pin.out.is_some_and(is_it))?;
    let is_set = |flag: Option<_>| flag.is_some_and(|flag| pins.param(flag));
    if is_set(found.is_opendrain) {
        return None;
    }
    let is_on = output.value == AnyValue::from(true);
    Some(Level {
        pin: found.input?.pin.into(),
        expected: AnyValue::from(is_on != is_set(found.invert_output)),
        contradictions: 0,
    })
}

/// True for pins that show the effect of an output: inputs at terminals, and read-back of I/O pins.
fn is_reported(info: &PinInfo) -> bool {
    // Ends of names of pins that duplicate others.
    let more = [
        "-not",
        "_not",
        ".rawcounts",
        ".velocity-rpm",
        ".count-unsure",
    ];
    info.role == Role::Input
        && !info.place.terminal.is_empty()
        && !more.iter().any(|end| info.name.ends_with(end))
}

/// Inputs to report, in their order.
fn reported_inputs(pins: &Pins) -> Vec<PinId> {
    let ids = pins.ids();
    let inputs = ids.filter(|&pin| pins.info_of(pin).is_some_and(is_reported));
    inputs.collect()
}
