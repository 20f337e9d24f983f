//! The application: it reads, compares what it reads with the truth, and commands something new.

mod encoders;
mod field;
mod pins;
mod queue;

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{BoardState, Driver, OfflineReason, RemoteState};
use mesa_hal::hal::{GroupId, GroupState, Input, Output, Param, PinError, Pins};
use mesa_hal::sslbp::Channel;

use encoders::Encoder;
use pins::{GpioPin, Remote, value};
use queue::{Queue, is_queued};

use super::journal::{Level, PORTS};
use super::machine::Gpio;
use super::oracle::{BoardCommand, Checked, Oracle, Promise, ensure};
use super::plan::{Board, MICRO, MILLI, Plan};
use super::stage::{Stage, was};
use crate::common::chance::Chance;

/// A running application with the handles of its pins.
pub struct Application {
    remotes: Vec<Remote>,
    gpio: Vec<GpioPin>,
    gpio_inputs: Vec<Input<bool>>,
    isolated: Vec<(Input<bool>, Input<bool>)>,
    analog: Vec<(Output<f64>, Output<bool>)>,
    /// The scale of each analog output, and what it is.
    scales: Vec<(Param<f64>, f64)>,
    led: Option<Output<bool>>,
    ssr: Vec<Output<bool>>,
    encoders: Vec<Encoder>,
    watchdog: Param<u32>,
    /// Of each port.
    runs: Vec<Output<bool>>,
    port_width: usize,
    queue: Option<Queue>,
    turn: u32,
    sets_nan: bool,
    plan: Plan,
    /// Nobody changes how an encoder counts.
    is_fast: bool,
    set: BoardCommand,
    faults: u64,
}

/// Volts of an analog output at full scale.
const FULL: f64 = 10.0;

/// How long after it has changed an isolated input shows it at the latest: five scans of 50 us, one
/// that has begun, and the multiplexer's delay.
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
        let gpio_pins = gpio.outputs.iter().map(|&pin| {
            let stem = format!("{name}.gpio.{pin:03}");
            Ok(GpioPin {
                pin,
                out: pins.output(&format!("{stem}.out"))?,
                is_output: pins.parameter(&format!("{stem}.is_output"))?,
                drives: true,
            })
        });
        let gpio_inputs = gpio.inputs.iter();
        let gpio_inputs = gpio_inputs.map(|pin| pins.input(&format!("{name}.gpio.{pin:03}.in")));
        let own = if plan.board == Board::I7i97 {
            0..16
        } else {
            0..0
        };
        // A late duplicate of a set-up lets the inputs be scanned anew, which nothing tells.
        let scanned = if plan.is_homing { 0..0 } else { own.clone() };
        let isolated = scanned.map(|n| {
            let stem = format!("{name}.inmux.00");
            let raw = pins.input(&format!("{stem}.raw-input-{n:02}"))?;
            Ok((raw, pins.input(&format!("{stem}.input-{n:02}"))?))
        });
        let six = own.clone().take(6);
        let analog = six.clone().map(|n| {
            let stem = format!("{name}.pwmgen.{n:02}");
            Ok((
                pins.output(&format!("{stem}.value"))?,
                pins.output(&format!("{stem}.enable"))?,
            ))
        });
        let scales = six.clone().map(|n| {
            let scale = pins.parameter(&format!("{name}.pwmgen.{n:02}.scale"))?;
            Ok((scale, FULL))
        });
        let led = format!("{name}.led.CR01");
        let has_led = pins.infos().iter().any(|info| info.name == led);
        let ssr = six.map(|n| pins.output(&format!("{name}.ssr.00.out-{n:02}")));
        Ok(Self {
            remotes,
            gpio: gpio_pins.collect::<Result<_, _>>()?,
            gpio_inputs: gpio_inputs.collect::<Result<_, _>>()?,
            isolated: isolated.collect::<Result<_, _>>()?,
            analog: analog.collect::<Result<_, PinError>>()?,
            scales: scales.collect::<Result<_, PinError>>()?,
            led: has_led.then(|| pins.output(&led)).transpose()?,
            ssr: ssr.collect::<Result<_, _>>()?,
            encoders: (0..plan.extras.axes)
                .filter_map(|axis| Encoder::new(pins, name, axis).transpose())
                .collect::<Result<_, _>>()?,
            queue: plan.extras.is_queued.then(|| Queue::new(driver)),
            turn: plan.extras.turn,
            sets_nan: plan.extras.sets_nan,
            plan: plan.clone(),
            is_fast: plan.extras.is_fast,
            watchdog: pins.parameter(&format!("{name}.watchdog.timeout_ns"))?,
            runs: (0..plan.ports.len())
                .map(|port| pins.output(&format!("{name}.sserial.port-{port}.run")))
                .collect::<Result<_, _>>()?,
            port_width: gpio.width,
            set: BoardCommand::default(),
            faults: 0,
        })
    }

    pub fn remotes(&self) -> usize {
        self.remotes.len()
    }

    /// Compares all valid inputs with the truth. What the board itself shows was read in the
    /// `took` before.
    pub fn check_inputs<B: RegisterBus + Clock>(
        &mut self,
        driver: &Driver<B>,
        stage: &Stage,
        took: u64,
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
        if state.valid {
            let from = now.saturating_sub(state.age.time.as_nanos() as u64 + took + 5 * MICRO);
            self.check_board_inputs(pins, stage, (from, now))?;
            let turn = self.turn;
            let mut encoders = self.encoders.iter_mut();
            encoders.try_for_each(|encoder| encoder.check(pins, stage, (from, now), turn))?;
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
                    // Not before it was scanned since the set-up.
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

    /// Commands something else, where armed, and tells the oracle what holds from the next write on.
    pub fn command<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        chance: &mut Chance,
        (is_wild, set_anew): (bool, bool),
    ) {
        for remote in &mut self.remotes {
            remote.notice(is_armed(driver, remote.group));
        }
        let directly = |remote: &&mut Remote| self.queue.is_none() || !is_queued(remote.card);
        if set_anew {
            for remote in self.remotes.iter_mut().filter(directly) {
                // What is set while it is not armed is forgotten.
                let level = remote.command(driver.pins_mut(), chance, self.sets_nan);
                if remote.is_armed {
                    remote.set = level;
                }
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
            let set = self.command_board(driver.pins_mut(), chance);
            if is_armed {
                self.set = set;
            }
        }
        if !is_armed {
            self.set = BoardCommand::default();
        }
    }

    fn command_board(&self, pins: &mut Pins, chance: &mut Chance) -> BoardCommand {
        let mut set = BoardCommand::default();
        for gpio in &self.gpio {
            let on = chance.one_in(2);
            pins.set(gpio.out, on);
            set.gpio[gpio.pin / self.port_width] |= u32::from(on) << (gpio.pin % self.port_width);
        }
        set.enabled = !self.analog.is_empty() && !chance.one_in(8);
        for (n, (output, enable)) in self.analog.iter().enumerate() {
            let (volts, millivolts) = value(chance, self.sets_nan);
            pins.set(*output, volts);
            pins.set(*enable, set.enabled);
            set.millivolts[n] = millivolts;
        }
        if let Some(led) = self.led {
            pins.set(led, chance.one_in(2));
        }
        for (n, out) in self.ssr.iter().enumerate() {
            let on = chance.one_in(2);
            pins.set(*out, on);
            set.ssr |= u32::from(on) << n;
        }
        set
    }

    /// Tells the oracle what the write that follows carries.
    pub fn announce<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
        oracle: &mut Oracle,
        now: u64,
    ) {
        for remote in &self.remotes {
            let is_armed = is_armed(driver, remote.group);
            oracle.command_remote(remote.number, now, remote.set, is_armed);
        }
        oracle.command_board(now, &self.scaled(), is_armed(driver, driver.group()));
    }

    /// What the board makes of what is set, by the scales of now.
    fn scaled(&self) -> BoardCommand {
        let mut set = self.set;
        for (millivolts, (_, scale)) in set.millivolts.iter_mut().zip(&self.scales) {
            let part = f64::from(*millivolts) / 1000.0 / scale;
            *millivolts = (part.clamp(-1.0, 1.0) * 1000.0 * FULL).round() as i32;
        }
        set
    }

    /// After a call that may have disarmed: what was set is forgotten.
    pub fn notice<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) {
        for remote in &mut self.remotes {
            remote.notice(is_armed(driver, remote.group));
        }
        if !is_armed(driver, driver.group()) {
            self.set = BoardCommand::default();
        }
        let faults = driver
            .pins()
            .group_state(driver.group())
            .map_or(0, |state| state.faults);
        if std::mem::replace(&mut self.faults, faults) != faults {
            self.forget_index();
        }
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
            (4, _) if !self.scales.is_empty() => {
                let count = self.scales.len() as u64;
                let (param, scale) = &mut self.scales[chance.below(count) as usize];
                let new = chance.of(&[FULL, 5.0, 20.0, -FULL]);
                let done = pins.set_param(*param, new);
                if done.is_ok() {
                    *scale = new;
                }
                format!("scale of an analog output {new}: {done:?}")
            }
            (2, _) => {
                let time = chance.of(&[6, 9, 20]) * MILLI;
                let done = pins.set_param(self.watchdog, time as u32);
                format!("watchdog {time} ns: {done:?}")
            }
            _ => {
                let count = self.gpio.len().max(1) as u64;
                let Some(gpio) = self.gpio.get_mut(chance.below(count) as usize) else {
                    return "nothing to change".to_owned();
                };
                gpio.drives = !gpio.drives;
                let done = pins.set_param(gpio.is_output, gpio.drives);
                format!("GPIO {} drives {}: {done:?}", gpio.pin, gpio.drives)
            }
        }
    }

    /// The first pin of which a snapshot shows something else than the cycle has.
    pub fn shows_another<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) -> Option<String> {
        let queue = self.queue.as_mut()?;
        queue.shows_another(driver)
    }

    /// Asks some encoders for their indexes.
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
            if encoder.asked.is_none() && encoder.is_known() && chance.one_in(2) {
                driver.pins_mut().set(encoder.index_enable, true);
                (encoder.asked, encoder.is_pending) = (Some(now), true);
            }
        }
    }

    /// Everything armed and valid, and why not.
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

    /// Restarts what is not running, without waiting for its turn.
    pub fn restart_all<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>) {
        for remote in &self.remotes {
            if remote.state(driver) != Some(RemoteState::Running) {
                driver.restart(remote.place.0 as u8, remote.place.1.index());
            }
        }
        self.notice(driver);
    }

    /// Restarts one remote, whatever it does.
    pub fn restart_one<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>, which: usize) {
        if let Some(remote) = self.remotes.get(which) {
            driver.restart(remote.place.0 as u8, remote.place.1.index());
        }
        self.notice(driver);
    }

    /// Switches a port off, or on again; whether it is on.
    pub fn switch_port<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        port: usize,
    ) -> bool {
        let Some(run) = self.runs.get(port).copied() else {
            return true;
        };
        let is_on = !driver.pins().commanded(run);
        driver.pins_mut().set(run, is_on);
        is_on
    }

    /// Switches all ports on.
    pub fn switch_ports_on<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>) {
        for run in &self.runs {
            driver.pins_mut().set(*run, true);
        }
    }

    /// Remotes that run, by number.
    pub fn running<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
    ) -> impl Iterator<Item = (usize, GroupState)> {
        let runs = |remote: &&Remote| remote.state(driver) == Some(RemoteState::Running);
        self.remotes.iter().filter(runs).filter_map(|remote| {
            let state = driver.pins().group_state(remote.group)?;
            Some((remote.number, state))
        })
    }

    /// The number of the remote at a place.
    pub fn number(&self, place: (usize, usize)) -> Option<usize> {
        let at = |remote: &&Remote| (remote.place.0, remote.place.1.index().into()) == place;
        self.remotes.iter().find(at).map(|remote| remote.number)
    }

    /// Why each remote went offline first, since it was re-armed.
    pub fn first_faults<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
    ) -> impl Iterator<Item = (usize, Option<OfflineReason>)> {
        self.remotes.iter().filter_map(|remote| {
            let (port, channel) = remote.place;
            let status = driver.ports().get(port)?.remote(channel)?;
            Some((remote.number, status.first_fault))
        })
    }

    /// Whether a remote is armed, is valid, and how old its inputs are.
    pub fn remote_state<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
        number: usize,
    ) -> Option<mesa_hal::hal::GroupState> {
        let remote = self.remotes.iter().find(|remote| remote.number == number)?;
        driver.pins().group_state(remote.group)
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

    /// What the board must drive when everything follows.
    pub fn expected_board(&self) -> super::journal::Parts {
        let mut set = self.scaled();
        for gpio in self.gpio.iter().filter(|gpio| !gpio.drives) {
            set.gpio[gpio.pin / self.port_width] &= !(1 << (gpio.pin % self.port_width));
        }
        debug_assert!(
            self.gpio
                .iter()
                .all(|gpio| gpio.pin / self.port_width < PORTS)
        );
        set.parts()
    }
}

fn is_armed<B: RegisterBus + Clock>(driver: &Driver<B>, group: GroupId) -> bool {
    driver
        .pins()
        .group_state(group)
        .is_some_and(|state| state.armed)
}
