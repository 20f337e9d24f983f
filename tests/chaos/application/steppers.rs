//! Step generators: positions against the steps that arrive at the motors.

use mesa_hal::hal::{PinError, Pins};
use mesa_hal::modules::stepgen::{StepgenPins, Stepgens};

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::Driver;
use mesa_hal_sim::Stepper;

use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{LONGEST_WATCHDOG, MICRO, Plan, scrambled};
use crate::common::chance::Chance;

/// Steps for a unit, and the greatest speed in units per second.
const SCALE: f64 = 1_000.0;
const SPEED: f64 = 5.0;
/// Steps by which a good position may differ from the motor's: rounding, and a pulse that waits.
const ROUGH: f64 = 2.5;
/// Good cycles after which the command to stand still has arrived, whatever was lost.
const ARRIVED: u32 = 12;
/// Scales that the application changes to.
const SCALES: [f64; 5] = [500.0, 1_000.0, 2_000.0, -1_000.0, -250.0];

/// A step generator, and the knowledge about it.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
pub(super) struct StepAxis {
    number: usize,
    pins: StepgenPins,
    /// The commanded position, and where it goes: in units of [`SCALE`].
    command: f64,
    target: f64,
    /// Steps for a unit now.
    scale: f64,
    /// The usual speed times this.
    speed: f64,
    /// Units of [`SCALE`] per second squared.
    acceleration: f64,
    /// It changes scales, and is silent after arming.
    is_odd: bool,
    /// Decides that.
    side: Chance,
    was_armed: bool,
    /// It is off, and commanded to where it stands, until it stands for sure.
    parks: bool,
    /// Cycles left in which nothing is commanded, from the arming or the parking on.
    silent_for: u32,
    /// Looks at the motor since then.
    silent_looks: u32,
    is_on: bool,
    is_resetting: bool,
    /// Steps of the motor while the position is 0: the least and the greatest that all reads
    /// permit.
    zero: Option<[f64; 2]>,
    /// The same before the board was lost, by a bite and nothing else, and the edges since.
    estimate: Option<([f64; 2], u32)>,
    /// The driver has read it.
    is_begun: bool,
    /// The board was set up again since, and the position was not reset.
    must_doubt: bool,
    /// Steps at the last look, and its time.
    seen: Option<(i64, u64)>,
    /// Good cycles since it was switched off.
    off_for: u32,
}

/// What has happened since the last look.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Clone, Copy, Debug, Default)]
pub struct Jolts {
    /// Number of bites, resets and set-ups: each makes edges on pins that are driven or released.
    pub edges: u32,
    /// The board has bitten or was reset, and this may not have been detected.
    pub is_lost: bool,
    /// One of them was a reset.
    pub is_reset: bool,
    /// Time by which the driver may mistake the last write that has arrived.
    pub mistaken_by: u64,
    /// The driver has no reason for doubts.
    pub is_calm: bool,
    /// The network can repeat a write, or hold it back: a rate of before then moves the motor until
    /// the next write.
    pub has_old_writes: bool,
}

impl StepAxis {
    /// Steps of a time at the highest speed. The board is not looked at to the microsecond.
    fn at_full_speed(&self, nanos: u64) -> i64 {
        let steps = nanos as f64 * 1e-9 * SPEED * self.speed * SCALE * 1.01;
        steps.ceil() as i64 + 3
    }

    /// All axes of a driver.
    pub(super) fn all<B: RegisterBus + Clock>(driver: &Driver<B>, plan: &Plan) -> Vec<Self> {
        let pins = driver.modules::<Stepgens>().flat_map(Stepgens::pins);
        let all = pins.enumerate().map(|(number, pins)| Self {
            number,
            pins,
            command: 0.0,
            target: 0.0,
            scale: SCALE,
            speed: plan.steppers.speed.into(),
            acceleration: plan.steppers.acceleration,
            is_odd: plan.steppers.is_odd,
            side: Chance(scrambled(plan.seed ^ 0x0DD5_7E95 ^ number as u64)),
            was_armed: true,
            parks: false,
            silent_for: 0,
            silent_looks: 0,
            is_on: false,
            is_resetting: false,
            zero: None,
            estimate: None,
            is_begun: false,
            must_doubt: false,
            seen: None,
            off_for: 0,
        });
        all.collect()
    }

    /// Sets the generator up, as each process does.
    pub(super) fn set_up(&mut self, pins: &mut Pins) -> Result<(), PinError> {
        self.set_scale(pins, SCALE)?;
        let times = [
            self.pins.steplen,
            self.pins.stepspace,
            self.pins.dirsetup,
            self.pins.dirhold,
        ];
        times
            .into_iter()
            .try_for_each(|time| pins.set_param(time, 2_500))
    }

    /// Changes the scale; speed and acceleration of the motor stay the same.
    fn set_scale(&mut self, pins: &mut Pins, scale: f64) -> Result<(), PinError> {
        let units = SCALE / scale.abs();
        pins.set_param(self.pins.position_scale, scale)?;
        pins.set_param(self.pins.maxvel, SPEED * self.speed * units)?;
        pins.set_param(self.pins.maxaccel, self.acceleration * units)?;
        self.scale = scale;
        Ok(())
    }

    /// Begins silence: after arming, or where it has been parked.
    fn falls_silent(&mut self) {
        (self.silent_for, self.silent_looks) = (5 + self.side.below(40) as u32, 0);
    }

    /// Parks it sometimes. Returns true in such a cycle.
    fn is_parked(&mut self, pins: &mut Pins) -> bool {
        self.parks |= self.is_odd && self.silent_for == 0 && self.side.one_in(100);
        if !self.parks {
            return false;
        }
        let at = pins.read(self.pins.position_fb);
        self.is_on = false;
        pins.set(self.pins.position_reset, false);
        pins.set(self.pins.enable, false);
        pins.set(self.pins.position_cmd, at.value);
        if self.off_for > ARRIVED && at.valid {
            self.parks = false;
            self.falls_silent();
        }
        true
    }

    /// After arming or parking, commands nothing for some cycles, and changes the meaning of
    /// positions meanwhile. Returns true in such a cycle.
    fn is_silent(&mut self, pins: &mut Pins, is_armed: bool, is_wild: bool) -> bool {
        let is_new = is_armed && !std::mem::replace(&mut self.was_armed, is_armed);
        if is_new && self.is_odd && is_wild && self.side.one_in(2) {
            self.falls_silent();
        }
        if !is_armed || !is_wild {
            (self.silent_for, self.parks) = (0, false);
            return false;
        }
        if self.is_parked(pins) {
            return true;
        }
        let Some(left) = self.silent_for.checked_sub(1) else {
            return false;
        };
        self.silent_for = left;
        let resets = self.side.one_in(8);
        self.is_resetting |= resets;
        pins.set(self.pins.position_reset, resets);
        if self.side.one_in(8) {
            let scale = self.side.of(&SCALES);
            self.set_scale(pins, scale).expect("a scale");
        }
        self.is_on = !self.side.one_in(4);
        pins.set(self.pins.enable, self.is_on);
        if self.is_on {
            self.off_for = 0;
        }
        if left == 0 {
            // From the next cycle on, from where it stands.
            let command: f64 = pins.commanded(self.pins.position_cmd);
            self.command = command * self.scale / SCALE;
        }
        true
    }

    /// Commands a position, which moves to one target after the other.
    pub(super) fn command(
        &mut self,
        pins: &mut Pins,
        chance: &mut Chance,
        (is_armed, is_wild): (bool, bool),
    ) {
        if is_wild && chance.one_in(40) {
            self.target = (chance.below(400) as f64 / SCALE - 0.2) * self.speed;
        }
        let jumps = is_wild && chance.one_in(100);
        if self.is_silent(pins, is_armed, is_wild) {
            return;
        }
        if self.is_odd && is_wild && self.side.one_in(100) {
            let scale = self.side.of(&SCALES);
            self.set_scale(pins, scale).expect("a scale");
        }
        let fastest = 0.003 * self.speed;
        let way = (self.target - self.command).clamp(-fastest, fastest);
        self.command = if jumps {
            self.target
        } else {
            self.command + way
        };
        let toggles = chance.one_in(if self.is_on { 60 } else { 30 });
        self.is_on = !is_wild || self.is_on != toggles;
        let resets = pins.read(self.pins.position_unsure).value && chance.one_in(8);
        // Until the next position that is looked at.
        self.is_resetting |= resets;
        pins.set(self.pins.position_reset, resets);
        pins.set(self.pins.enable, self.is_on);
        pins.set(self.pins.position_cmd, self.command * SCALE / self.scale);
        if self.is_on {
            self.off_for = 0;
        }
    }

    /// The board has been set up again, or will be: its steps meanwhile are not known. If the last
    /// write gives another time to the watchdog and the host stalls in it, nobody knows which one
    /// was in force.
    pub(super) fn lost(&mut self, is_retimed: bool, is_reset: bool) {
        self.must_doubt |= self.is_begun;
        let wrong = if is_retimed {
            self.at_full_speed(LONGEST_WATCHDOG) as f64
        } else {
            0.0
        };
        let zero = self.zero.take().filter(|_| !is_reset);
        if let Some([least, most]) = zero {
            self.estimate = Some(([least - wrong, most + wrong], 0));
        }
    }

    /// The driver cannot tell the bite from a reset.
    pub(super) fn is_taken_for_reset(&mut self) {
        self.estimate = None;
    }

    /// Notes the edges of the last cycle, which a bite and a set-up make.
    pub(super) fn jolted(&mut self, jolts: Jolts) {
        if let Some((_, edges)) = &mut self.estimate {
            *edges += jolts.edges;
        }
        self.estimate = self.estimate.filter(|_| !jolts.is_reset);
    }

    /// Compares the estimate of a position after a bite with the motor.
    fn check_estimate(&mut self, at: f64, rough: f64, now: u64, jolts: Jolts) -> Checked {
        let Some(([least, most], edges)) = self.estimate.take() else {
            return Ok(());
        };
        let (number, edges) = (self.number, f64::from(2 * edges));
        let wrong = self.at_full_speed(jolts.mistaken_by) as f64 + rough + edges;
        let is_near = (least - wrong..=most + wrong).contains(&at);
        ensure(is_near, Promise::Inputs, now, || {
            format!(
                "stepper {number} has its zero at {at} after a bite, and had it at {least} to {most}"
            )
        })
    }

    /// Checks the movement of the motor since the last look.
    pub(super) fn check_motor(
        &mut self,
        motor: &Stepper,
        now: u64,
        (jolts, is_good): (Jolts, bool),
    ) -> Checked {
        let (number, steps) = (self.number, motor.commanded());
        let edges = 2 * i64::from(jolts.edges);
        let seen = self.seen.replace((steps, now));
        let Some((before, since)) = seen else {
            return Ok(());
        };
        let moved = (steps - before).abs();
        let limit = self.at_full_speed(now - since) + edges;
        ensure(moved <= limit, Promise::Commanded, now, || {
            format!(
                "stepper {number} makes {moved} steps in {} us, more than its speed allows",
                (now - since) / MICRO
            )
        })?;
        if self.off_for > ARRIVED {
            ensure(moved <= edges, Promise::Commanded, now, || {
                format!("stepper {number} makes {moved} steps although it is off")
            })?;
        }
        if self.silent_for > 0 {
            self.silent_looks += 1;
            let is_silent = self.silent_looks > 2 && !jolts.has_old_writes && !jolts.is_lost;
            // A rounded position may be on the boundary of a step.
            let stands = moved <= edges + 1;
            ensure(!is_silent || stands, Promise::Commanded, now, || {
                format!("stepper {number} makes {moved} steps without a command since it was armed")
            })?;
        }
        if is_good && !self.is_on {
            self.off_for += 1;
        }
        Ok(())
    }

    /// Checks a motor of a board whose pins are off.
    pub(super) fn check_stands(&self, motor: &Stepper, now: u64, jolts: Jolts) -> Checked {
        let number = self.number;
        let Some((before, since)) = self.seen else {
            return Ok(());
        };
        let moved = motor.commanded() - before;
        let edges = 2 * i64::from(jolts.edges);
        let old = if jolts.has_old_writes {
            self.at_full_speed(now - since)
        } else {
            0
        };
        ensure(moved.abs() <= edges + old, Promise::Safe, now, || {
            format!("stepper {number} makes {moved} steps, and the board is not armed")
        })
    }

    /// Compares a position that was read within the last `took` with the steps of the motor.
    pub(super) fn check_position(
        &mut self,
        pins: &Pins,
        motor: &Stepper,
        (took, now): (u64, u64),
        jolts: Jolts,
    ) -> Checked {
        let number = self.number;
        self.is_begun = true;
        let is_unsure = pins.read(self.pins.position_unsure).value;
        if std::mem::take(&mut self.is_resetting) {
            (self.must_doubt, self.zero, self.estimate) = (false, None, None);
            return Ok(());
        }
        ensure(is_unsure || !self.must_doubt, Promise::Inputs, now, || {
            format!("stepper {number} has no doubts, but the board was set up anew")
        })?;
        ensure(!is_unsure || !jolts.is_calm, Promise::Inputs, now, || {
            format!("stepper {number} has doubts without a reason")
        })?;
        let shown = pins.read(self.pins.position_fb).value * self.scale;
        let rough = ROUGH + (took + 20 * MICRO) as f64 * 1e-9 * SPEED * self.speed * SCALE;
        let at = motor.commanded() as f64 - shown;
        if is_unsure {
            self.zero = None;
            return self.check_estimate(at, rough, now, jolts);
        }
        self.estimate = None;
        let [least, most] = self.zero.unwrap_or([f64::MIN, f64::MAX]);
        let zero = [least.max(at - rough), most.min(at + rough)];
        self.zero = Some(zero);
        ensure(zero[0] <= zero[1], Promise::Inputs, now, || {
            format!(
                "stepper {number} shows {shown} steps, its motor has made {}, and its zero was at {least} to {most}",
                motor.commanded()
            )
        })
    }

    /// `Ok` if the motor is where it was commanded to; otherwise the reason.
    pub(super) fn has_arrived(&self, pins: &Pins, motor: &Stepper) -> Result<(), String> {
        let number = self.number;
        let Some([least, most]) = self.zero else {
            return Err(format!("the zero of stepper {number} is not known"));
        };
        let wanted = self.target * SCALE;
        let steps = motor.commanded() as f64;
        let is_there = (least - 1.0..=most + 1.0).contains(&(steps - wanted));
        let shown = pins.read(self.pins.position_fb).value * self.scale;
        if is_there && (shown - wanted).abs() < 0.01 {
            return Ok(());
        }
        Err(format!(
            "stepper {number} is to be at {wanted}, shows {shown}, and its motor is at {steps}, with its zero at {least} to {most}"
        ))
    }
}
