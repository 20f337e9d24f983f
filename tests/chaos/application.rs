//! The application: reads, compares the values read with the truth, and commands new outputs.

mod board;
mod encoders;
mod field;
mod pins;
mod ports;
mod queue;
mod steppers;

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{BoardState, Driver, RemoteState};
use mesa_hal::hal::{GroupId, GroupState, Input, Output, PinError, Pins};
use mesa_hal::sslbp::Channel;
use mesa_hal_sim::Stepper;

use board::BoardOutputs;
use encoders::Encoder;
use pins::Remote;
use queue::{Queue, is_queued};
pub use steppers::Jolts;
use steppers::StepAxis;

use super::journal::{BoardCommand, Level};
use super::machine::Gpio;
use super::oracle::{Checked, Oracle, Promise, ensure};
use super::plan::{Board, MICRO, Plan, scrambled};
use super::stage::{Stage, was};
use crate::common::chance::Chance;

/// A running application with the handles of its pins.
pub struct Application {
    remotes: Vec<Remote>,
    board: BoardOutputs,
    gpio_inputs: Vec<Input<bool>>,
    isolated: Vec<(Input<bool>, Input<bool>)>,
    encoders: Vec<Encoder>,
    steppers: Vec<StepAxis>,
    /// The commands of the steppers, and true once they are set up.
    steps: (Chance, bool),
    /// The output of each port that switches it on.
    runs: Vec<Output<bool>>,
    queue: Option<Queue>,
    sets_nan: bool,
    plan: Plan,
    /// The outputs of the timer that latches the encoders, where one is used.
    timer: Option<(Output<i32>, Output<f64>)>,
    /// The counting mode of the encoders is never changed.
    is_fast: bool,
    faults: u64,
    /// A separate random stream for later additions, so that earlier plans stay unchanged.
    side: Chance,
}

/// Longest delay until an isolated input shows a change: five scans of 50 us, one that has begun,
/// and the multiplexer's delay.
const FILTER: u64 = 500 * MICRO;

impl Application {
    pub fn new<B: RegisterBus + Clock>(
        driver: &Driver<B>,
        plan: &Plan,
        gpio: &Gpio,
    ) -> Result<Self, PinError> {
        let (pins, name) = (driver.pins(), driver.name());
        let mut remotes = Vec::new();
        for number in 0..plan.remotes() {
            let (port, channel) = plan.place(number);
            let channel = Channel::ALL[channel];
            let status = driver
                .ports()
                .get(port)
                .and_then(|port| port.remote(channel));
            let Some(status) = status else { continue };
            let prefix = &status.pins.prefix;
            let (card, place) = (plan.card(number), (port, channel));
            let group = (status.pins.group, plan.field_mode);
            let remote = Remote::new(pins, prefix, number, place, card, group)?;
            remotes.push(remote);
        }
        let gpio_inputs = gpio.inputs.iter();
        let gpio_inputs = gpio_inputs.map(|pin| pins.input(&format!("{name}.gpio.{pin:03}.in")));
        let own = if plan.board == Board::I7i97 {
            0..16
        } else {
            0..0
        };
        // A late duplicate of a set-up restarts the scanning of the inputs, which nothing reports.
        let scanned = if plan.is_homing { 0..0 } else { own };
        let isolated = scanned.map(|n| {
            let stem = format!("{name}.inmux.00");
            let raw = pins.input(&format!("{stem}.raw-input-{n:02}"))?;
            Ok((raw, pins.input(&format!("{stem}.input-{n:02}"))?))
        });
        Ok(Self {
            remotes,
            board: BoardOutputs::new(pins, name, plan, gpio)?,
            gpio_inputs: gpio_inputs.collect::<Result<_, _>>()?,
            isolated: isolated.collect::<Result<_, _>>()?,
            encoders: (0..plan.extras.axes)
                .filter_map(|axis| Encoder::new(pins, (name, plan.has_muxed()), axis).transpose())
                .collect::<Result<_, _>>()?,
            steppers: StepAxis::all(driver, plan),
            steps: (Chance(scrambled(plan.seed ^ 0x57E92)), false),
            queue: plan.extras.is_queued.then(|| Queue::new(driver)),
            sets_nan: plan.extras.sets_nan,
            timer: if plan.more.is_latched {
                let number = pins.output(&format!("{name}.encoder.timer-number"))?;
                let time = pins.output(&format!("{name}.dpll.01.timer-us"))?;
                Some((number, time))
            } else {
                None
            },
            plan: plan.clone(),
            is_fast: plan.extras.is_fast,
            runs: (0..plan.ports.len())
                .map(|port| pins.output(&format!("{name}.sserial.port-{port}.run")))
                .collect::<Result<_, _>>()?,
            faults: 0,
            side: Chance(scrambled(plan.seed ^ 0x51DE)),
        })
    }

    pub fn remotes(&self) -> usize {
        self.remotes.len()
    }

    /// A call has read the board by itself.
    pub fn was_read(&mut self) {
        self.encoders.iter_mut().for_each(Encoder::was_read);
    }

    /// Compares all valid inputs with the truth. The board's own values were read within the last
    /// `took`, and its encoders were latched up to `before` earlier than that. Its pins were
    /// released, or not, and driven again by a set-up.
    pub fn check_inputs<B: RegisterBus + Clock>(
        &mut self,
        driver: &Driver<B>,
        stage: &Stage,
        (took, before): (u64, u64),
        (is_released, is_set_up): (bool, bool),
    ) -> Checked {
        let pins = driver.pins();
        let now = pins.now().as_nanos();
        for remote in self
            .remotes
            .iter_mut()
            .filter(|remote| !remote.inputs.is_empty())
        {
            let state = pins.group_state(remote.group).expect("of this driver");
            let is_down = driver.board_state() != BoardState::Running || !state.armed;
            if is_down && let Some(field) = &mut remote.field {
                field.forget();
            }
            if !state.valid {
                continue;
            }
            let age = state.age.time.as_nanos() as u64;
            let shown = remote.inputs.iter().enumerate();
            let shown = shown.fold(0, |all, (n, pin)| {
                all | u32::from(pins.read(*pin).value) << n
            });
            let from = now.saturating_sub(age + 5 * MICRO);
            let is_true = |truth: &super::stage::Truth| {
                was(&truth.fields[remote.number], from, now, |pattern| {
                    pattern == shown
                })
            };
            ensure(stage.with_truth(is_true), Promise::Inputs, now, || {
                let newest = stage.with_truth(|truth| {
                    let history = &truth.fields[remote.number];
                    let was = history.iter().rev().find(|(_, pattern)| *pattern == shown);
                    format!("{was:x?}, newest {:x?}", history.last())
                });
                format!(
                    "remote {} shows {shown:#x} as valid and {age} ns old; it was: {newest}",
                    remote.number
                )
            })?;
        }
        self.check_fields(driver, stage)?;
        let state = pins.group_state(driver.group()).expect("of this driver");
        if !state.armed {
            self.forget_index();
        }
        if driver.board_state() != BoardState::Running || is_set_up {
            let encoders = self.encoders.iter_mut();
            encoders.for_each(|encoder| encoder.is_set_up_anew(is_released || is_set_up));
        }
        if state.valid {
            let from = now.saturating_sub(state.age.time.as_nanos() as u64 + took + 5 * MICRO);
            self.check_board_inputs(pins, stage, (from, now))?;
            let window = (from.saturating_sub(before), now);
            let mut encoders = self.encoders.iter_mut();
            let is_late = before > self.plan.period;
            let shared = (pins, stage, &self.plan);
            encoders.try_for_each(|encoder| encoder.check(shared, window, is_late))?;
        } else {
            self.was_read();
        }
        Ok(())
    }

    /// Voltages and MPGs of field I/O.
    fn check_fields<B: RegisterBus + Clock>(
        &mut self,
        driver: &Driver<B>,
        stage: &Stage,
    ) -> Checked {
        let pins = driver.pins();
        let now = pins.now().as_nanos();
        for remote in &mut self.remotes {
            let state = pins.group_state(remote.group).expect("of this driver");
            let age = state.age.time.as_nanos() as u64;
            if state.valid
                && let Some(field) = &mut remote.field
            {
                let window = (now.saturating_sub(age + 5 * MICRO), now);
                field.check((pins, stage, &self.plan), remote.number, window)?;
            }
        }
        Ok(())
    }

    fn check_board_inputs(&self, pins: &Pins, stage: &Stage, (from, now): (u64, u64)) -> Checked {
        stage.with_truth(|truth| {
            for (n, pin) in self.gpio_inputs.iter().enumerate() {
                let Some(shown) = pins.read(*pin).ok() else {
                    continue;
                };
                let is_true = was(&truth.gpio, from, now, |levels| {
                    (levels >> n & 1 != 0) == shown
                });
                ensure(is_true, Promise::Inputs, now, || {
                    format!("GPIO input {n} shows {shown} as valid, and was not so since {from}")
                })?;
            }
            for (n, (raw, filtered)) in self.isolated.iter().enumerate() {
                for (pin, slack) in [(raw, FILTER / 2), (filtered, FILTER)] {
                    // Not valid before it was scanned since the set-up.
                    let Some(shown) = pins.read(*pin).ok() else {
                        continue;
                    };
                    let from = from.saturating_sub(slack);
                    let is_true = was(&truth.isolated, from, now, |levels| {
                        (levels >> n & 1 != 0) == shown
                    });
                    ensure(is_true, Promise::Inputs, now, || {
                        format!(
                            "isolated input {n} shows {shown} as valid, and was not so since {from}"
                        )
                    })?;
                }
            }
            Ok(())
        })
    }

    fn forget_index(&mut self) {
        self.encoders.iter_mut().for_each(Encoder::forget_index);
    }

    /// Commands new values, where armed, and reports to the oracle the outputs from the next write
    /// on.
    pub fn command<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        chance: &mut Chance,
        (is_wild, set_anew): (bool, bool),
    ) {
        for remote in &mut self.remotes {
            remote.notice(is_armed(driver, remote.group));
        }
        if let Some((number, time)) = self.timer.take() {
            driver.pins_mut().set(number, 1);
            // Further before the read than the error of a locked DPLL.
            let quarter = self.plan.period as f64 / 4_000.0;
            driver.pins_mut().set(time, -quarter);
        }
        let tunes = self.plan.more.tunes_one_in;
        let tunes = tunes > 0 && is_wild && self.side.one_in(tunes);
        let directly = |remote: &&mut Remote| self.queue.is_none() || !is_queued(remote.card);
        if set_anew {
            for remote in self.remotes.iter_mut().filter(directly) {
                // Values set while a remote is not armed are forgotten.
                let side = (self.plan.more.tunes_one_in > 0).then_some(&mut self.side);
                let level = remote.command(driver.pins_mut(), chance, side, self.sets_nan);
                if remote.is_armed {
                    remote.set = level;
                }
            }
        }
        if tunes {
            for remote in &mut self.remotes {
                remote.tune(driver.pins_mut(), &mut self.side);
            }
        }
        if let Some(queue) = &mut self.queue {
            queue.take(driver, &mut self.remotes);
            if is_wild {
                queue.send(&self.remotes, chance);
            }
        }
        let is_armed = is_armed(driver, driver.group());
        if set_anew {
            let (pins, has_side) = (driver.pins_mut(), self.plan.more.tunes_one_in > 0);
            let side = has_side.then_some(&mut self.side);
            let set = self.board.command(pins, chance, side, self.sets_nan);
            if is_armed {
                self.board.set = set;
            }
        } else if tunes && self.plan.spares_the_board() {
            // A setting that was lost arrives a cycle later than the words written in every cycle.
            self.board.tune(driver.pins_mut(), &mut self.side);
        }
        if !is_armed {
            self.board.set = BoardCommand::default();
        }
        let (chance, is_set_up) = &mut self.steps;
        for stepper in &mut self.steppers {
            if !*is_set_up {
                let done = stepper.set_up(driver.pins_mut());
                done.expect("parameters within their limits");
            }
            stepper.command(driver.pins_mut(), chance, (is_armed, is_wild));
        }
        *is_set_up = true;
    }

    /// Compares the steppers with their motors, after a read that was `good` or not, and took that
    /// long.
    pub fn check_steppers<B: RegisterBus + Clock>(
        &mut self,
        driver: &Driver<B>,
        motors: &[Stepper],
        (took, now): (u64, u64),
        (jolts, good): (Jolts, bool),
    ) -> Checked {
        let pins = driver.pins();
        let runs = driver.board_state() == BoardState::Running;
        let armed = is_armed(driver, driver.group());
        for (stepper, motor) in self.steppers.iter_mut().zip(motors) {
            // A bus that is down reports no bite, whatever the driver takes it for.
            let is_unclear = matches!(
                driver.board_state(),
                BoardState::BusDown | BoardState::Reset
            );
            let is_off = matches!(
                driver.board_state(),
                BoardState::WatchdogBitten | BoardState::Reset
            );
            if is_off && !jolts.is_lost {
                stepper.check_stands(motor, now, jolts)?;
            }
            stepper.check_motor(motor, now, (jolts, good && runs && armed))?;
            stepper.jolted(jolts);
            if jolts.is_lost {
                stepper.lost(self.board.is_retimed, jolts.is_reset);
            } else if self.board.was_retimed && is_unclear {
                stepper.is_taken_for_reset();
            } else if good && runs {
                stepper.check_position(pins, motor, (took, now), jolts)?;
            }
        }
        self.board.is_retimed &= jolts.is_lost || !good || !runs;
        Ok(())
    }

    /// `Ok` if all steppers are where they were commanded to; otherwise the reason.
    pub fn steppers_have_arrived<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
        motors: &[Stepper],
    ) -> Result<(), String> {
        let mut steppers = self.steppers.iter().zip(motors);
        steppers.try_for_each(|(stepper, motor)| stepper.has_arrived(driver.pins(), motor))
    }

    /// Reports to the oracle the contents of the write that follows.
    pub fn announce<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
        oracle: &mut Oracle,
        now: u64,
    ) {
        for remote in &self.remotes {
            let is_armed = is_armed(driver, remote.group);
            oracle.command_remote(remote.number, now, remote.sent(), is_armed);
        }
        oracle.command_board(now, &self.board.scaled(), is_armed(driver, driver.group()));
    }

    /// Call after a function that may have disarmed: the values set are forgotten.
    pub fn notice<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) {
        for remote in &mut self.remotes {
            remote.notice(is_armed(driver, remote.group));
        }
        if !is_armed(driver, driver.group()) {
            self.board.set = BoardCommand::default();
        }
        let faults = driver
            .pins()
            .group_state(driver.group())
            .map_or(0, |state| state.faults);
        if std::mem::replace(&mut self.faults, faults) != faults {
            self.forget_index();
        }
    }

    /// The remotes that are armed as soon as they run.
    pub fn coming<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Vec<usize> {
        let coming = self.pending_groups(driver).into_iter();
        coming.filter_map(|group| group.checked_sub(1)).collect()
    }

    /// The groups that are not armed: 0 for the board's own, and the others by the number of the
    /// remote, from 1 on.
    pub fn waiting<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Vec<usize> {
        self.groups(driver, |state| !state.armed)
    }

    /// Those that are armed as soon as they run.
    pub fn pending_groups<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Vec<usize> {
        self.groups(driver, |state| state.rearm_pending)
    }

    /// Those that run: the board, and its remotes.
    pub fn running_groups<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Vec<usize> {
        let board = (driver.board_state() == BoardState::Running).then_some(0);
        let remotes = self.running(driver).map(|(number, _)| number + 1);
        board.into_iter().chain(remotes).collect()
    }

    fn groups<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
        holds: impl Fn(GroupState) -> bool,
    ) -> Vec<usize> {
        let remotes = self.remotes.iter();
        let remotes = remotes.map(|remote| (remote.number + 1, remote.group));
        let all = std::iter::once((0, driver.group())).chain(remotes);
        let state = |group| driver.pins().group_state(group);
        let held = all.filter(|(_, group)| state(*group).is_some_and(&holds));
        held.map(|(number, _)| number).collect()
    }

    /// Outputs start from their safe values after they were armed.
    pub fn rearmed<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>, board_was_down: bool) {
        self.notice(driver);
        if board_was_down {
            self.forget_index();
        }
    }

    /// Changes a setting.
    pub fn change_setting<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        chance: &mut Chance,
    ) -> String {
        let pins = driver.pins_mut();
        let which = chance.below(self.encoders.len().max(1) as u64) as usize;
        match (chance.below(5), self.encoders.get(which)) {
            (0, Some(encoder)) if !self.is_fast => {
                let filter = chance.one_in(2);
                let done = pins.set_param(encoder.filter, filter);
                format!("encoder filter {filter}: {done:?}")
            }
            (1, Some(encoder)) => {
                let scale = f64::from(1 + chance.below(4) as u32);
                let done = pins.set_param(encoder.scale, scale);
                format!("encoder scale {scale}: {done:?}")
            }
            (4, _) if let Some(told) = self.board.rescale(pins, chance) => told,
            (2, _) => self.board.change_watchdog(pins, chance),
            _ => self.board.change_direction(pins, chance),
        }
    }

    /// The first pin whose value in a snapshot differs from that of the cycle.
    pub fn shows_another<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) -> Option<String> {
        let queue = self.queue.as_mut()?;
        queue.shows_another(driver)
    }

    /// Requests the indexes of some encoders.
    pub fn ask_for_index<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        chance: &mut Chance,
        now: u64,
    ) {
        let is_armed = is_armed(driver, driver.group());
        if !is_armed || driver.board_state() != BoardState::Running {
            return;
        }
        for encoder in &mut self.encoders {
            // A request outlives a fault: asking again is no other one.
            let is_asked = driver.pins().read(encoder.index_enable).value;
            let is_asked = is_asked || encoder.asked.is_some();
            if !is_asked && encoder.is_known() && chance.one_in(2) {
                driver.pins_mut().set(encoder.index_enable, true);
                (encoder.asked, encoder.is_pending) = (Some(now), true);
            }
        }
    }

    /// `Ok` if everything is armed and valid; otherwise the reason.
    pub fn all_is_well<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Result<(), String> {
        if driver.board_state() != BoardState::Running {
            return Err(format!("the board is {:?}", driver.board_state()));
        }
        let state = |group| driver.pins().group_state(group).expect("of this driver");
        let board = state(driver.group());
        if !board.armed || !board.valid {
            return Err(format!("the board's own pins: {board:?}"));
        }
        let mut isolated = self.isolated.iter();
        if let Some((raw, _)) = isolated.find(|(raw, filtered)| {
            !driver.pins().read(*raw).valid || !driver.pins().read(*filtered).valid
        }) {
            return Err(format!("an isolated input is not valid: {raw:?}"));
        }
        for remote in &self.remotes {
            let group = state(remote.group);
            if !group.armed || !group.valid {
                let status = remote.state(driver);
                return Err(format!("remote {}: {status:?}, {group:?}", remote.number));
            }
        }
        Ok(())
    }

    /// Restarts all remotes that are not running, without waiting for their turn.
    pub fn restart_all<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>) {
        for remote in &self.remotes {
            if remote.state(driver) != Some(RemoteState::Running) {
                driver.restart(remote.id());
            }
        }
        self.notice(driver);
    }

    /// Restarts one remote, whatever its state.
    pub fn restart_one<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>, which: usize) {
        if let Some(remote) = self.remotes.get(which) {
            driver.restart(remote.id());
        }
        self.notice(driver);
    }

    /// Re-arms one remote.
    pub fn rearm_one<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        which: usize,
    ) -> Option<usize> {
        let remote = self.remotes.get_mut(which)?;
        let was_armed = driver.pins().group_state(remote.group)?.armed;
        driver.pins_mut().rearm(remote.group).ok()?;
        if !was_armed {
            remote.set = Level::OFF;
        }
        remote.is_armed = true;
        Some(remote.number)
    }

    /// Expected outputs of the board when all commands have been followed.
    pub fn expected_board(&self) -> super::journal::Parts {
        self.board.expected()
    }

    /// Expected state of the board's LED; `None` if it has none.
    pub fn expected_led(&self) -> Option<bool> {
        self.board.expected_led()
    }

    /// The first setting that accepts a value that is not a number.
    pub fn takes_nonsense<B: RegisterBus + Clock>(&self, driver: &mut Driver<B>) -> Option<String> {
        let pins = driver.pins_mut();
        let mut remotes = self.remotes.iter();
        let of_remotes = remotes.find_map(|remote| remote.takes_nonsense(pins));
        of_remotes.or_else(|| self.board.takes_nonsense(pins))
    }
}

fn is_armed<B: RegisterBus + Clock>(driver: &Driver<B>, group: GroupId) -> bool {
    driver
        .pins()
        .group_state(group)
        .is_some_and(|state| state.armed)
}
