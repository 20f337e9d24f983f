//! One generator: its registers, and its cycle.

mod outage;

pub(super) use outage::LastRead;

use core::time::Duration;

use super::control::{ControlLaw, ControlLimits};
use super::counts::{AMBIGUOUS, SUB_COUNTS, StepCounts};
use super::firmware::Firmware;
use super::latch::AccumulatorLatch;
use super::pins::{Rows, StepgenPins, Switches};
use super::pulses::PulseChange;
use super::rate::RateRegister;
use super::registers::Registers;
use super::reports::Reports;
use super::timing::PulseTimes;
use crate::hal::{GroupId, PinMaker, PinStore, Place};
use crate::hostmot2::ModuleDescriptor;
use crate::modules::latch::LatchRequest;
use crate::modules::{ReadCycle, RegisterError, Registrar, WriteCycle};

/// Rate register for one step per tick of the clock.
const STEP_PER_TICK: f64 = 4_294_967_296.0;
/// Part of the highest rate from which on it counts as near.
const NEAR: f64 = 0.9;
/// A command is too fast when it is so much faster than the highest speed.
const TOO_FAST: f64 = 1.000_1;
/// Sub-counts in a period from which on a movement must be seen.
const VISIBLE: f64 = 4.0;
/// Steps in a period at most: the position is known without a doubt after a read that was missed.
const TRACEABLE: f64 = AMBIGUOUS / 2.0;

/// What all generators have in common in a write.
#[derive(Clone, Copy, Debug)]
pub(super) struct WriteTiming {
    /// The part of the period since the sample of the positions.
    pub delay: f64,
    pub period: Duration,
}

/// Factors that follow from the parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Factors {
    /// Units of position for a sub-count.
    units: f64,
    /// Rate register for a move of one unit in a period.
    rate: f64,
    /// Periods in a second, and its inverse.
    periods: f64,
    seconds: f64,
    /// Rate register from which on the rate is near the highest.
    near: u32,
    /// Rate register from which on each read shows a movement.
    visible: u32,
    /// A shorter time between two reads cannot be ambiguous, in ns.
    safe_gap_ns: u64,
    /// The speed that `maxvel` asks for, in steps per second.
    asked: f64,
}

/// A step generator.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Debug)]
pub(super) struct Generator {
    pins: StepgenPins,
    rows: Rows,
    /// The part of the group that has the parameters.
    parameters: GroupId,
    /// Its version when they were read last.
    version: Option<u64>,
    clock_hz: u32,
    registers: Registers,
    law: ControlLaw,
    limits: ControlLimits,
    factors: Factors,
    counts: StepCounts,
    latch: AccumulatorLatch,
    change: PulseChange,
    rate: RateRegister,
    reports: Reports,
    /// The position, as it was read or as it is expected without a read.
    position: f64,
    is_read: bool,
    switches: Switches,
    /// The generator follows its commands.
    is_enabled: bool,
    /// `position-reset` was on in the last write.
    was_reset: bool,
    /// The acceleration before a change of the scale at speed, in the units of after it and as a
    /// change of the move: for the way down to the highest speed. 0 at rest.
    old_ramp: f64,
    /// The pins were released since the last good read of a board that was set up.
    is_released: bool,
}

impl Generator {
    pub fn new(
        r: &mut Registrar<'_>,
        module: &ModuleDescriptor,
        instance: u8,
        number: u8,
        firmware: Firmware,
    ) -> Result<Self, RegisterError> {
        let stem = alloc::format!("stepgen.{number:02}.");
        let places = r.board.step_places(r.firmware, number);
        let place: Place = places.into_iter().collect();
        let mut pins = StepgenPins::new(r.maker_at(&stem, place.clone()), firmware)?;
        let parameters = r.pins.add_part(r.group)?;
        let stem = alloc::format!("{}.{stem}", r.name);
        let make = PinMaker::new(r.pins, parameters, stem.clone());
        pins.enable = make.at(place).output("enable", false)?;
        pins.add_parameters(PinMaker::new(r.pins, parameters, stem), firmware)?;
        r.pins.enabled_by(pins.position_cmd, pins.enable);
        r.pins.may_be_restated(pins.position_cmd);
        r.pins.enabled_by(pins.velocity_cmd, pins.enable);
        let clock_hz = firmware.clock_hz;
        let pulses = pins.pulses(r.pins, clock_hz);
        Ok(Self {
            rows: Rows::of(&pins, r.pins)?,
            pins,
            parameters,
            version: None,
            clock_hz,
            registers: Registers::new(r, module, instance, &pulses, firmware)?,
            law: ControlLaw::default(),
            limits: ControlLimits::new(0.0, 0.0, 1.0),
            factors: Factors::default(),
            counts: StepCounts::default(),
            latch: AccumulatorLatch::default(),
            change: PulseChange::new(pulses),
            rate: RateRegister::new(),
            reports: Reports::new(number),
            position: 0.0,
            is_read: false,
            switches: Switches::default(),
            is_enabled: false,
            was_reset: false,
            old_ramp: 0.0,
            is_released: false,
        })
    }

    pub const fn pins(&self) -> StepgenPins {
        self.pins
    }

    /// Takes the outcome of a write. If it did not arrive, the generator goes on with the rate of
    /// before.
    #[inline]
    pub fn written(&mut self, arrived: bool) {
        self.rate.written(arrived);
        if arrived {
            self.change.sent();
        }
        self.law.written(arrived);
    }

    /// Stops the generator with the next write.
    pub fn halt(&mut self) {
        self.law.halt(self.law.command());
        self.is_enabled = false;
    }

    /// The period has changed: factors and limits are prepared again.
    pub const fn period_changed(&mut self) {
        self.version = None;
    }

    /// The board has its set-up again, with a rate of 0.
    pub fn set_up_again(&mut self, was_released: bool) {
        self.counts.doubt.set_up_again();
        if was_released {
            self.counts.resume();
            self.change.restored();
        }
        self.latch.forget();
        self.halt();
        self.rate = RateRegister::new();
        self.is_released = false;
    }
}

/// The read.
impl Generator {
    /// Takes the accumulator. `gap_ns` is the time since the last good read. Returns true if a
    /// position that the application had is lost.
    pub fn read(&mut self, cycle: &mut ReadCycle<'_>, gap_ns: u64) -> bool {
        self.reports.report(cycle);
        let certain = cycle.certain;
        if self.change.read(certain) && self.rate.may_have_moved() {
            self.counts.doubt.add(true);
        }
        let is_ambiguous = gap_ns >= self.factors.safe_gap_ns && self.observe_gap(gap_ns, certain);
        self.rate.read(certain);
        let moved = self
            .counts
            .read(cycle.words.word(self.registers.accumulator));
        if self.rate.observe(moved, certain, self.factors.visible) {
            self.counts.doubt.add(true);
            let magnitude = self.rate.word.unsigned_abs();
            self.reports.stands(self.steps_per_second(magnitude));
        }
        let is_still = self.rate.word == 0 && moved == 0 && certain;
        self.change.observe_rest(cycle.now, is_still, self.clock_hz);
        if let Some(slot) = self.registers.shown_mode {
            if is_ambiguous {
                // The distance to a latched value is not known.
                self.latch.forget();
            }
            let mode = cycle.words.word(slot);
            self.take_latch(mode, certain, cycle.pins);
        }
        if self.switches.resets {
            let moved = self.reset();
            self.restate(cycle.pins, moved);
            self.shift(moved);
        }
        self.position = self.counts.sub_counts as f64 * self.factors.units;
        self.is_read = true;
        let (pins, to) = (&self.pins, &mut *cycle.pins);
        let (steps, is_unsure) = (self.counts.steps(), self.counts.doubt.is_unsure());
        let values = [self.position.into(), steps.into(), is_unsure.into()];
        to.publish_row(self.rows.read, values);
        if !self.is_enabled {
            to.set_safe(pins.position_cmd, self.position);
        }
        self.counts.doubt.read()
    }

    /// After a doubtful exchange an older rate than that of the last writes may have been in force.
    fn observe_gap(&mut self, gap_ns: u64, certain: bool) -> bool {
        let fastest = if certain {
            self.rate.fastest()
        } else {
            self.rate.fastest_of_late()
        };
        let gap = Duration::from_nanos(gap_ns);
        self.counts.observe_gap(gap, self.steps_per_second(fastest))
    }

    /// The rate of a magnitude of the rate register.
    fn steps_per_second(&self, magnitude: u32) -> f64 {
        f64::from(magnitude) / STEP_PER_TICK * f64::from(self.clock_hz)
    }

    fn take_latch(&mut self, mode: u32, certain: bool, pins: &mut PinStore) {
        let Some((event, latched)) = self.latch.observe(mode, certain) else {
            return;
        };
        let done = if event == LatchRequest::Index {
            let before = self.counts.sub_counts;
            self.counts.restart_at(latched);
            let moved = self.counts.sub_counts.wrapping_sub(before);
            self.restate(pins, moved);
            self.shift(moved);
            self.pins.index_enable
        } else {
            let at = self.counts.position_at(latched) as f64 * self.factors.units;
            if let Some(pin) = self.pins.position_latch {
                pins.publish(pin, at);
            }
            self.pins.probe_enable
        };
        if let Some(pin) = done {
            pins.publish(pin, false);
        }
    }
}

/// Positions that change their meaning.
///
/// The standing command changes with them, so that an old command never comes out in new
/// coordinates. At a read, every command is one of before. In a write, a command that was set
/// together with the change has the new coordinates already.
impl Generator {
    /// Makes the position 0; returns its change in sub-counts.
    fn reset(&mut self) -> i64 {
        let before = self.counts.sub_counts;
        self.counts.reset();
        before.wrapping_neg()
    }

    /// States the standing command for another origin, which is `moved` sub-counts away.
    fn restate(&self, pins: &mut PinStore, moved: i64) {
        if moved != 0 {
            let command = pins.commanded(self.pins.position_cmd);
            let distance = moved as f64 * self.factors.units;
            pins.restate(self.pins.position_cmd, command + distance);
        }
    }

    /// The position has another origin.
    fn shift(&mut self, moved: i64) {
        let distance = moved as f64 * self.factors.units;
        self.law.shift(distance);
        self.position += distance;
    }

    /// True if the command was not set together with what changes in this write: it is that of the
    /// last write, or that which arming has given to a generator at rest.
    fn is_standing(&self, pins: &PinStore) -> bool {
        let command = pins.commanded(self.pins.position_cmd).to_bits();
        command == self.law.command().to_bits()
            || !self.is_enabled && command == self.position.to_bits()
    }

    /// Takes `position-reset` in the write in which it is set.
    fn reset_in_write(&mut self, pins: &mut PinStore) {
        let is_standing = self.is_standing(pins);
        let moved = self.reset();
        if is_standing {
            self.restate(pins, moved);
        }
        self.shift(moved);
    }

    /// Takes another unit, `factor` of which are one of before: speeds in steps stay.
    fn rescale(&mut self, pins: &mut PinStore, factor: f64) {
        if self.is_standing(pins) {
            let command = pins.commanded(self.pins.position_cmd);
            pins.restate(self.pins.position_cmd, command * factor);
        }
        self.old_ramp = self.old_ramp.max(self.limits.max_change()) * factor.abs();
        if self.law.step() == 0.0 || !self.old_ramp.is_finite() {
            self.old_ramp = 0.0;
        }
        self.law.rescale(factor);
    }
}

/// The write.
impl Generator {
    pub fn write(&mut self, cycle: &mut WriteCycle<'_>, timing: &WriteTiming) {
        let version = cycle.pins.output_version(self.parameters);
        let has_changed = version != self.version;
        if !cycle.changed && !has_changed && self.is_idle() {
            return;
        }
        if has_changed {
            self.configure(cycle.pins);
            self.version = cycle.pins.output_version(self.parameters);
        }
        let has_changed = self.set_pulses(cycle) || has_changed;
        if has_changed {
            self.prepare(cycle.pins, timing.period);
        }
        if has_changed || self.latch.is_unsettled() {
            self.set_mode(cycle);
        }
        if !core::mem::take(&mut self.is_read) {
            self.position += self.law.step();
        }
        if cycle.hold && !cycle.is_running {
            self.rate.stop(cycle.now);
        }
        self.is_enabled = self.switches.is_on && !cycle.hold && !self.rate.stands();
        let lag = self.control(cycle, timing);
        self.rate.put((self.law.step() * self.factors.rate) as i32);
        let word = self.rate.word;
        cycle.words.put(self.registers.rate, word as u32);
        self.publish(cycle.pins, lag);
    }

    /// True if a write changes nothing as long as no pin does.
    fn is_idle(&self) -> bool {
        let is_still = self.rate.word == 0 && self.law.step() == 0.0;
        is_still && self.change.is_settled() && !self.is_enabled && !self.latch.is_unsettled()
    }

    /// Takes the switches, and the pulses that the parameters ask for.
    fn configure(&mut self, pins: &mut PinStore) {
        if let Some(asked) = self.pins.clip_times(pins, self.clock_hz) {
            let longest = PulseTimes::longest(self.clock_hz);
            self.reports.clipped(asked, longest);
        }
        let was_homed = self.switches.is_homed;
        self.switches = self.pins.switches(pins);
        if self.switches.is_homed && !was_homed {
            self.counts.doubt.settle();
        }
        if !self.switches.is_on {
            self.rate.disabled();
        }
        if self.switches.resets {
            self.reset_in_write(pins);
        }
        let wanted = self.pins.pulses(pins, self.clock_hz);
        let times = self.pins.times(pins);
        self.reports
            .observe_times(times, &wanted.ticks, self.clock_hz);
        self.change.want(wanted);
    }

    /// Prepares factors and limits, with the pulses that the board makes.
    fn prepare(&mut self, pins: &mut PinStore, period: Duration) {
        let (seconds, clock) = (period.as_secs_f64(), f64::from(self.clock_hz));
        let scale = pins.param(self.pins.position_scale);
        let highest = self.change.board().ticks.highest_rate(self.clock_hz);
        let highest = highest.min(TRACEABLE / seconds);
        let [speed, acceleration] =
            [self.pins.maxvel, self.pins.maxaccel].map(|limit| pins.param(limit).abs());
        let fastest = highest / scale.abs();
        let asked = speed * scale.abs();
        let is_limited = speed > 0.0 && speed < fastest;
        let speed = if is_limited { speed } else { fastest };
        let units = 1.0 / (SUB_COUNTS * scale);
        let before = self.factors.units;
        if before != 0.0 && before.to_bits() != units.to_bits() {
            self.rescale(pins, units / before);
        }
        let limits = ControlLimits::new(speed, acceleration, seconds)
            .with_resolution(units.abs())
            .with_brake(self.old_ramp);
        let factors = Factors {
            units,
            rate: scale * STEP_PER_TICK / (clock * seconds),
            periods: 1.0 / seconds,
            seconds,
            near: (NEAR * highest * STEP_PER_TICK / clock) as u32,
            // At least 1: a rate of 0 is no movement, however long the period is.
            visible: libm::ceil(VISIBLE * SUB_COUNTS / (clock * seconds)).max(1.0) as u32,
            safe_gap_ns: (AMBIGUOUS / highest * 1e9) as u64,
            asked,
        };
        // The version changes with each arming as well, and a change of the pulses has a limit of
        // its own.
        if (limits, factors) != (self.limits, self.factors) {
            (self.limits, self.factors) = (limits, factors);
            self.reports.limit_changed();
        }
        if !self.change.is_due() && asked > highest * TOO_FAST {
            self.reports.limited(asked, highest);
        }
        // The units may have changed.
        self.position = self.counts.sub_counts as f64 * self.factors.units;
    }

    /// Writes changed pulses to a generator that rests; returns true if it did.
    fn set_pulses(&mut self, cycle: &mut WriteCycle<'_>) -> bool {
        if cycle.hold {
            return false;
        }
        let change = self.change.take();
        if let Some((before, after)) = &change {
            self.registers.set(cycle, before, after);
        }
        change.is_some()
    }

    /// Sets the mode of the pulses and the request of the latch.
    fn set_mode(&mut self, cycle: &mut WriteCycle<'_>) {
        self.latch.request(self.switches.request);
        let mode = self.change.board().mode | self.latch.bits() | self.switches.edges;
        cycle.words.set(self.registers.mode, mode);
        if self.latch.is_unsettled() {
            cycle.words.repeat(self.registers.mode);
        }
    }

    /// Lets the law make the next move. Returns the distance of the position behind the command.
    fn control(&mut self, cycle: &mut WriteCycle<'_>, timing: &WriteTiming) -> f64 {
        let command = self.command(cycle.pins);
        let by_speed = self.switches.by_speed;
        let was_reset = core::mem::replace(&mut self.was_reset, self.switches.resets);
        // While the origin goes along with it, there is no way to a position.
        let has_origin = !(was_reset && self.switches.resets);
        let mut lag = 0.0;
        if self.is_enabled && !by_speed {
            lag = self.law.command() - self.position;
        }
        if cycle.hold || self.change.holds(self.rate.word == 0) {
            self.law.halt(command);
        } else if !self.is_enabled {
            let has_ramp = cycle.pins.param(self.pins.disable_ramp) && !self.rate.stands();
            if has_ramp && self.law.step() != 0.0 {
                self.law.brake(&self.limits, command);
            } else {
                self.law.halt(command);
            }
        } else {
            self.reports.enabled();
            self.counts.doubt.rely();
            if by_speed {
                let step = cycle.pins.fetch(self.pins.velocity_cmd) * self.factors.seconds;
                self.check_limit(step);
                self.law.track(&self.limits, step, command);
            } else if !has_origin {
                self.law.brake(&self.limits, command);
            } else {
                self.law
                    .follow(&self.limits, command, self.position, timing.delay);
                self.check_limit(self.law.feed());
                self.publish_debug(cycle.pins, -lag);
            }
        }
        lag
    }

    /// The commanded position; that of before if it is not finite, which is counted.
    fn command(&self, pins: &mut PinStore) -> f64 {
        let command = pins.commanded(self.pins.position_cmd);
        if !command.is_finite() {
            // Counts the value.
            let _ = pins.fetch(self.pins.position_cmd);
        }
        command
    }

    /// Reports a command that is faster than the limit, once.
    #[inline]
    fn check_limit(&mut self, step: f64) {
        if step.abs() > self.limits.max_move() * TOO_FAST && !self.change.is_due() {
            let steps = self.factors.rate * f64::from(self.clock_hz) / STEP_PER_TICK;
            let steps = steps.abs();
            self.reports
                .limited(step.abs() * steps, self.limits.max_move() * steps);
        }
    }

    fn publish(&self, to: &mut PinStore, lag: f64) {
        let speed = match self.rate.word {
            // A move that is less than the register can make.
            0 => 0.0,
            _ => self.law.step() * self.factors.periods,
        };
        let word = self.rate.word;
        let is_near = word.unsigned_abs() >= self.factors.near;
        let values = [speed.into(), is_near.into(), lag.into(), word.into()];
        to.publish_row(self.rows.written, values);
    }

    fn publish_debug(&self, to: &mut PinStore, beyond: f64) {
        let factors = &self.factors;
        let (feed, step) = (self.law.feed(), self.law.step());
        let error = step - feed;
        // Periods until the speed is that of the command.
        let periods = error.abs() * self.limits.per_max_change();
        let values = [
            feed * factors.periods,
            beyond,
            periods * factors.seconds,
            error * factors.periods,
            beyond + 0.5 * error * periods,
        ];
        to.publish_row(self.rows.debug, values.map(Into::into));
    }
}
