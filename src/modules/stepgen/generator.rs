//! One generator: its registers, and its cycle.

use core::time::Duration;

use super::control::{ControlLaw, ControlLimits};
use super::counts::{AMBIGUOUS, SUB_COUNTS, StepCounts};
use super::latch::{AccumulatorLatch, LatchRequest, bits};
use super::pins::{PulseSetup, StepgenPins};
use super::registers::Registers;
use super::{Firmware, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::bus::Instant;
use crate::hal::{GroupId, PinMaker, PinStore};
use crate::hostmot2::ModuleDescriptor;
use crate::modules::events::EventKind;

/// Rate register for one step per tick of the clock.
const STEP_PER_TICK: f64 = 4_294_967_296.0;
/// Part of the highest rate from which on it counts as near.
const NEAR: f64 = 0.9;
/// A command is too fast when it is so much faster than the highest speed.
const TOO_FAST: f64 = 1.000_1;
/// Number of reads after which no packet of a set-up is in flight any more.
const HORIZON: u32 = 100;
/// Least number of reads for which a generator must have stood still to be at rest.
const STILL_READS: u32 = 2;

/// What all generators have in common in a write.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// The part of the period since the sample of the positions.
    pub delay: f64,
    pub period: Duration,
}

/// Factors that follow from the parameters.
#[derive(Clone, Copy, Debug, Default)]
struct Factors {
    /// Units of position for a sub-count.
    units: f64,
    /// Rate register for a move of one unit in a period.
    rate: f64,
    /// Periods in a second.
    periods: f64,
    /// The highest rate of the gateware in steps per second.
    highest: f64,
    /// Rate register from which on the rate is near the highest.
    near: u32,
    /// A shorter time between two reads cannot be ambiguous.
    safe_gap: Duration,
}

/// A step generator.
#[expect(clippy::struct_excessive_bools, reason = "independent conditions")]
#[derive(Debug)]
pub(super) struct Generator {
    number: u8,
    pins: StepgenPins,
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
    /// The pulses that the board makes, and those that the parameters ask for.
    pulses: PulseSetup,
    wanted: PulseSetup,
    /// The pulses were changed by the last writes, and no read has confirmed it yet.
    awaits: bool,
    /// A write has been sent since then.
    is_sent: bool,
    /// Number of further reads during which a packet of the last set-up may be in flight: executed
    /// again, it would cut a pulse off.
    set_up_for: u32,
    /// Time and number of reads for which the generator has stood still with a rate of 0.
    still: Option<(Instant, u32)>,
    /// It has stood still for so long that no timer of a step runs.
    rests: bool,
    /// The position, as it was read or as it is expected without a read.
    position: f64,
    is_read: bool,
    /// `position-reset` is true.
    resets: bool,
    /// The generator follows its commands.
    is_enabled: bool,
    /// The rate register, and the magnitude of the fastest one since the last read.
    rate: i32,
    fastest: u32,
    /// The limit of the speed has been reported since it changed.
    has_said_limit: bool,
    /// Events to report with the next read.
    news: [Option<EventKind>; 2],
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
        let place = r
            .board
            .step_places(r.firmware, number)
            .into_iter()
            .collect();
        let mut pins = StepgenPins::new(r.maker_at(&stem, place), firmware)?;
        let parameters = r.pins.add_part(r.group)?;
        let stem = alloc::format!("{}.{stem}", r.name);
        pins.add_parameters(PinMaker::new(r.pins, parameters, stem), firmware)?;
        r.pins.enabled_by(pins.position_cmd, pins.enable);
        r.pins.enabled_by(pins.velocity_cmd, pins.enable);
        let clock_hz = firmware.clock_hz;
        let pulses = pins.pulses(r.pins, clock_hz);
        let registers = Registers::new(r, module, instance, &pulses, firmware)?;
        Ok(Self {
            number,
            pins,
            parameters,
            version: None,
            clock_hz,
            registers,
            law: ControlLaw::default(),
            limits: ControlLimits::new(0.0, 0.0, 1.0),
            factors: Factors::default(),
            counts: StepCounts::default(),
            latch: AccumulatorLatch::default(),
            pulses,
            wanted: pulses,
            awaits: false,
            is_sent: false,
            set_up_for: HORIZON,
            still: None,
            rests: true,
            position: 0.0,
            is_read: false,
            resets: false,
            is_enabled: false,
            rate: 0,
            fastest: 0,
            has_said_limit: false,
            news: [None; 2],
        })
    }

    pub const fn pins(&self) -> StepgenPins {
        self.pins
    }

    /// Takes the outcome of a write. If it did not arrive, the generator goes on with the rate of
    /// before.
    pub const fn written(&mut self, arrived: bool) {
        if arrived {
            self.is_sent = true;
        } else {
            self.law.not_written();
        }
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
    pub fn restored(&mut self) {
        self.counts.resume();
        self.latch.forget();
        self.halt();
        (self.rate, self.rests, self.still) = (0, false, None);
        self.set_up_for = HORIZON;
    }
}

/// The read.
impl Generator {
    /// Takes the accumulator. `gap` is the time since the last good read.
    pub fn read(&mut self, cycle: &mut ReadCycle<'_>, gap: Duration) {
        for event in &mut self.news {
            if let Some(event) = event.take() {
                cycle.events.tell(cycle.now, event);
            }
        }
        self.awaits &= !(cycle.certain && self.is_sent);
        if self.set_up_for > 0 {
            self.set_up_for = self.set_up_for.saturating_sub(1);
            self.counts.is_unsure |= !cycle.certain && self.fastest > 0;
        }
        if gap >= self.factors.safe_gap {
            self.observe_gap(gap, cycle.certain);
        }
        self.fastest = self.rate.unsigned_abs();
        let accumulator = cycle.words.word(self.registers.accumulator);
        let moved = self.counts.read(accumulator);
        self.observe_rest(cycle.now, moved == 0 && cycle.certain);
        if let Some(slot) = self.registers.shown_mode {
            let mode = cycle.words.word(slot);
            self.take_latch(mode, cycle.certain, cycle.pins);
        }
        if self.resets {
            self.counts.reset();
        }
        self.position = self.counts.sub_counts as f64 * self.factors.units;
        self.is_read = true;
        let (pins, to) = (&self.pins, &mut *cycle.pins);
        to.publish(pins.counts, self.counts.steps());
        to.publish(pins.position_fb, self.position);
        to.publish(pins.position_unsure, self.counts.is_unsure);
        if !self.is_enabled {
            to.set_safe(pins.position_cmd, self.position);
        }
    }

    /// After a doubtful exchange an older rate than that of the last writes may have been in force.
    fn observe_gap(&mut self, gap: Duration, certain: bool) {
        let register = f64::from(self.fastest) / STEP_PER_TICK;
        let fastest = if certain {
            register * f64::from(self.clock_hz)
        } else {
            self.factors.highest
        };
        self.counts.observe_gap(gap, fastest);
    }

    /// Takes a read in which the generator `is_still`.
    fn observe_rest(&mut self, now: Instant, is_still: bool) {
        if self.rate != 0 || !is_still {
            (self.still, self.rests) = (None, false);
            return;
        }
        if self.rests {
            return;
        }
        let (since, reads) = self.still.unwrap_or((now, 0));
        let reads = reads.saturating_add(1);
        self.still = Some((since, reads));
        let settling = self.pulses.ticks.settling(self.clock_hz);
        self.rests = reads > STILL_READS && now.since(since).as_secs_f64() >= settling;
    }

    fn take_latch(&mut self, mode: u32, certain: bool, pins: &mut PinStore) {
        let Some((event, latched)) = self.latch.observe(mode, certain) else {
            return;
        };
        let done = if event == LatchRequest::Index {
            self.counts.restart_at(latched);
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

/// The write.
impl Generator {
    pub fn write(&mut self, cycle: &mut WriteCycle<'_>, moment: &Moment) {
        let version = cycle.pins.output_version(self.parameters);
        let has_changed = version != self.version;
        if !cycle.changed && !has_changed && self.is_idle() {
            return;
        }
        if has_changed {
            self.configure(cycle.pins);
            self.version = cycle.pins.output_version(self.parameters);
        }
        if self.set_pulses(cycle) || has_changed {
            self.prepare(cycle.pins, moment.period);
        }
        if !core::mem::take(&mut self.is_read) {
            self.position += self.law.step();
        }
        self.is_enabled = cycle.pins.fetch(self.pins.enable) && !cycle.hold;
        self.resets = cycle.pins.fetch(self.pins.position_reset);
        self.set_latch(cycle);
        self.control(cycle, moment);
        self.rate = (self.law.step() * self.factors.rate) as i32;
        self.fastest = self.fastest.max(self.rate.unsigned_abs());
        cycle.words.put(self.registers.rate, self.rate as u32);
        self.publish(cycle.pins);
    }

    /// True if a write changes nothing as long as no pin does.
    fn is_idle(&self) -> bool {
        let is_still = self.rate == 0 && self.law.step() == 0.0;
        let has_settled = self.pulses == self.wanted && !self.awaits;
        is_still && has_settled && !self.is_enabled && !self.latch.is_unsettled()
    }

    /// Takes the pulses that the parameters ask for.
    fn configure(&mut self, pins: &mut PinStore) {
        if let Some(asked) = self.pins.clip_times(pins, self.clock_hz) {
            let [_, time] = &mut self.news;
            *time = Some(EventKind::StepTimeClipped {
                generator: self.number.into(),
                asked,
                longest: super::timing::PulseTimes::longest(self.clock_hz),
            });
        }
        self.wanted = self.pins.pulses(pins, self.clock_hz);
    }

    /// Prepares factors and limits, with the pulses that the board makes.
    fn prepare(&mut self, pins: &PinStore, period: Duration) {
        let (seconds, clock) = (period.as_secs_f64(), f64::from(self.clock_hz));
        let scale = pins.param(self.pins.position_scale);
        let highest = self.pulses.ticks.highest_rate(self.clock_hz);
        let [speed, acceleration] =
            [self.pins.maxvel, self.pins.maxaccel].map(|limit| pins.param(limit).abs());
        let fastest = highest / scale.abs();
        self.has_said_limit = false;
        if speed > fastest * TOO_FAST {
            self.say_limit(speed * scale.abs(), highest);
        }
        let is_limited = speed > 0.0 && speed < fastest;
        let speed = if is_limited { speed } else { fastest };
        self.limits = ControlLimits::new(speed, acceleration, seconds);
        self.factors = Factors {
            units: 1.0 / (SUB_COUNTS * scale),
            rate: scale * STEP_PER_TICK / (clock * seconds),
            periods: 1.0 / seconds,
            highest,
            near: (NEAR * highest * STEP_PER_TICK / clock) as u32,
            safe_gap: Duration::try_from_secs_f64(AMBIGUOUS / highest).unwrap_or(Duration::ZERO),
        };
        // The units may have changed.
        self.position = self.counts.sub_counts as f64 * self.factors.units;
    }

    /// Writes changed pulses to a generator that rests; returns true if it did.
    fn set_pulses(&mut self, cycle: &mut WriteCycle<'_>) -> bool {
        if self.pulses == self.wanted || !self.rests || cycle.hold {
            return false;
        }
        self.registers.set(cycle, &self.pulses, &self.wanted);
        self.pulses = self.wanted;
        (self.awaits, self.is_sent) = (true, false);
        true
    }

    fn set_latch(&mut self, cycle: &mut WriteCycle<'_>) {
        let mut mode = self.pulses.mode;
        if let (Some(index), Some(probe)) = (self.pins.index_enable, self.pins.probe_enable) {
            let enables = [index, probe].map(|pin| cycle.pins.fetch(pin));
            self.latch.request(match enables {
                [true, _] => LatchRequest::Index,
                [false, true] => LatchRequest::Probe,
                [false, false] => LatchRequest::None,
            });
            mode |= self.latch.bits();
            let edges = [
                (self.pins.index_invert, bits::INDEX_RISES),
                (self.pins.probe_invert, bits::PROBE_RISES),
            ];
            for (pin, bit) in edges {
                let rises = pin.is_some_and(|pin| cycle.pins.fetch(pin));
                mode |= if rises { bit } else { 0 };
            }
        }
        cycle.words.set(self.registers.mode, mode);
        if self.latch.is_unsettled() {
            cycle.words.repeat(self.registers.mode);
        }
    }

    /// Lets the law make the next move.
    fn control(&mut self, cycle: &mut WriteCycle<'_>, moment: &Moment) {
        let command = self.command(cycle.pins);
        let mut lag = 0.0;
        if cycle.hold || self.awaits || self.waits_for_rest() {
            self.law.halt(command);
        } else if !self.is_enabled {
            let has_ramp = cycle.pins.param(self.pins.disable_ramp);
            if has_ramp && self.law.step() != 0.0 {
                self.law.brake(&self.limits, command);
            } else {
                self.law.halt(command);
            }
        } else if cycle.pins.fetch(self.pins.control_type) {
            let speed = cycle.pins.fetch(self.pins.velocity_cmd);
            let step = speed / self.factors.periods;
            self.check_limit(step);
            self.law.track(&self.limits, step, command);
        } else {
            lag = self.law.command() - self.position;
            self.law
                .follow(&self.limits, command, self.position, moment.delay);
            self.check_limit(self.law.feed());
            self.publish_debug(cycle.pins, -lag);
        }
        cycle.pins.publish(self.pins.position_lag, lag);
    }

    /// True if the pulses are to change and the generator, which has no rate, does not rest yet: no
    /// motion begins with the old ones.
    fn waits_for_rest(&self) -> bool {
        self.pulses != self.wanted && self.rate == 0
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
    fn check_limit(&mut self, step: f64) {
        if step.abs() > self.limits.top() * TOO_FAST && !self.has_said_limit {
            let steps = self.factors.rate * f64::from(self.clock_hz) / STEP_PER_TICK;
            let steps = steps.abs();
            self.say_limit(step.abs() * steps, self.limits.top() * steps);
        }
    }

    fn say_limit(&mut self, asked: f64, limit: f64) {
        self.has_said_limit = true;
        let [speed, _] = &mut self.news;
        *speed = Some(EventKind::StepRateLimited {
            generator: self.number.into(),
            asked: asked as u32,
            limit: limit as u32,
        });
    }

    fn publish(&self, to: &mut PinStore) {
        let pins = &self.pins;
        let speed = match self.rate {
            // A move that is less than the register can make.
            0 => 0.0,
            _ => self.law.step() * self.factors.periods,
        };
        to.publish(pins.velocity_fb, speed);
        let is_near = self.rate.unsigned_abs() >= self.factors.near;
        to.publish(pins.near_max_rate, is_near);
        to.publish(pins.debug.step_rate, self.rate);
    }

    fn publish_debug(&self, to: &mut PinStore, beyond: f64) {
        let (debug, factors) = (&self.pins.debug, &self.factors);
        let (feed, step) = (self.law.feed(), self.law.step());
        let error = step - feed;
        // Periods until the speed is that of the command.
        let periods = error.abs() * self.limits.per_ramp();
        to.publish(debug.ff_vel, feed * factors.periods);
        to.publish(debug.pos_minus_prev_cmd, beyond);
        to.publish(debug.s_to_match, periods / factors.periods);
        to.publish(debug.vel_error, error * factors.periods);
        to.publish(debug.err_at_match, beyond + 0.5 * error * periods);
    }
}
