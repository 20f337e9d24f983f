//! The board's own outputs: I/O pins, analog and isolated outputs, and an LED.

use mesa_hal::hal::{Output, Param, PinError, Pins};

use super::super::journal::{BoardCommand, PORTS, Parts};
use super::super::machine::Gpio;
use super::super::plan::{Board, LONGEST_WATCHDOG, MILLI, Plan};
use super::pins::{GpioPin, value};
use crate::common::chance::Chance;

/// Volts of an analog output at full scale.
const FULL: f64 = 10.0;
/// All drives are enabled.
const ALL: u32 = 0x3F;
/// Drive frequencies of the isolated outputs, in Hz.
const DRIVES: [u32; 3] = [1_000_000, 250_000, 0];

/// The board's own outputs, with their set values.
pub(super) struct BoardOutputs {
    gpio: Vec<GpioPin>,
    analog: Vec<(Output<f64>, Output<bool>)>,
    /// The scale of each analog output, and its value.
    scales: Vec<(Param<f64>, f64)>,
    led: Option<Output<bool>>,
    ssr: Vec<Output<bool>>,
    /// The drive of the isolated outputs, and true while it is on.
    drive: Option<Output<u32>>,
    is_driven: bool,
    watchdog: Param<u32>,
    /// Its watchdog has got another time since the last good read.
    pub(super) is_retimed: bool,
    /// It has ever got another time: in doubt the longest one of all counts.
    pub(super) was_retimed: bool,
    port_width: usize,
    /// Values set since the outputs were armed.
    pub(super) set: BoardCommand,
}

impl BoardOutputs {
    pub(super) fn new(pins: &Pins, name: &str, plan: &Plan, gpio: &Gpio) -> Result<Self, PinError> {
        let gpio_pins = gpio.outputs.iter().map(|&pin| {
            let stem = format!("{name}.gpio.{pin:03}");
            Ok(GpioPin {
                pin,
                out: pins.output(&format!("{stem}.out"))?,
                is_output: pins.parameter(&format!("{stem}.is_output"))?,
                drives: true,
            })
        });
        let has_analog = plan.board == Board::I7i97;
        let six = if has_analog { 0..6 } else { 0..0 };
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
        let drive = has_analog.then(|| pins.output(&format!("{name}.ssr.00.rate")));
        Ok(Self {
            gpio: gpio_pins.collect::<Result<_, _>>()?,
            analog: analog.collect::<Result<_, PinError>>()?,
            scales: scales.collect::<Result<_, PinError>>()?,
            led: has_led.then(|| pins.output(&led)).transpose()?,
            ssr: ssr.collect::<Result<_, _>>()?,
            drive: drive.transpose()?,
            is_driven: true,
            watchdog: pins.parameter(&format!("{name}.watchdog.timeout_ns"))?,
            is_retimed: false,
            was_retimed: false,
            port_width: gpio.width,
            set: BoardCommand::default(),
        })
    }

    /// Sets all outputs to new values. `side`: present where drives are enabled one by one.
    pub(super) fn command(
        &self,
        pins: &mut Pins,
        chance: &mut Chance,
        side: Option<&mut Chance>,
        sets_nan: bool,
    ) -> BoardCommand {
        let mut set = BoardCommand::default();
        for gpio in &self.gpio {
            let on = chance.one_in(2);
            pins.set(gpio.out, on);
            set.gpio[gpio.pin / self.port_width] |= u32::from(on) << (gpio.pin % self.port_width);
        }
        if !self.analog.is_empty() && !chance.one_in(8) {
            let mut some = None;
            if let Some(side) = side {
                some = side.one_in(3).then(|| side.below(1 << 6) as u32);
            }
            set.enables = some.unwrap_or(ALL);
        }
        for (n, (output, enable)) in self.analog.iter().enumerate() {
            let (volts, millivolts) = value(chance, sets_nan);
            pins.set(*output, volts);
            pins.set(*enable, set.enables >> n & 1 != 0);
            set.millivolts[n] = millivolts;
        }
        if let Some(led) = self.led {
            set.led = chance.one_in(2);
            pins.set(led, set.led);
        }
        for (n, out) in self.ssr.iter().enumerate() {
            let on = chance.one_in(2);
            pins.set(*out, on);
            set.ssr |= u32::from(on) << n;
        }
        set
    }

    /// Changes the drive of the isolated outputs, in a cycle in which the outputs themselves stay
    /// unchanged: the drive is written before them.
    pub(super) fn tune(&mut self, pins: &mut Pins, chance: &mut Chance) {
        if let Some(drive) = self.drive {
            let hz = chance.of(&DRIVES);
            pins.set(drive, hz);
            self.is_driven = hz > 0;
        }
    }

    /// The set values as scaled by the board, with the current scales.
    pub(super) fn scaled(&self) -> BoardCommand {
        let mut set = self.set;
        for (millivolts, (_, scale)) in set.millivolts.iter_mut().zip(&self.scales) {
            let part = f64::from(*millivolts) / 1000.0 / scale;
            *millivolts = (part.clamp(-1.0, 1.0) * 1000.0 * FULL).round() as i32;
        }
        if !self.is_driven {
            set.ssr = 0;
        }
        set
    }

    /// Expected outputs of the board when all commands have been followed.
    pub(super) fn expected(&self) -> Parts {
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

    /// Expected state of the LED; `None` for a board without one.
    pub(super) fn expected_led(&self) -> Option<bool> {
        self.led.map(|_| self.set.led)
    }

    /// Changes the scale of an analog output; `None` without any.
    pub(super) fn rescale(&mut self, pins: &mut Pins, chance: &mut Chance) -> Option<String> {
        if self.scales.is_empty() {
            return None;
        }
        let count = self.scales.len() as u64;
        let (param, scale) = &mut self.scales[chance.below(count) as usize];
        let new = chance.of(&[FULL, 5.0, 20.0, -FULL]);
        let done = pins.set_param(*param, new);
        if done.is_ok() {
            *scale = new;
        }
        Some(format!("scale of an analog output {new}: {done:?}"))
    }

    pub(super) fn change_watchdog(&mut self, pins: &mut Pins, chance: &mut Chance) -> String {
        let time = chance.of(&[6, 9, LONGEST_WATCHDOG / MILLI]) * MILLI;
        let done = pins.set_param(self.watchdog, time as u32);
        (self.is_retimed, self.was_retimed) = (true, true);
        format!("watchdog {time} ns: {done:?}")
    }

    /// Makes an I/O pin an output, or an input.
    pub(super) fn change_direction(&mut self, pins: &mut Pins, chance: &mut Chance) -> String {
        let count = self.gpio.len().max(1) as u64;
        let Some(gpio) = self.gpio.get_mut(chance.below(count) as usize) else {
            return "nothing to change".to_owned();
        };
        gpio.drives = !gpio.drives;
        let done = pins.set_param(gpio.is_output, gpio.drives);
        format!("GPIO {} drives {}: {done:?}", gpio.pin, gpio.drives)
    }

    /// The first scale that accepts a value that is not a number.
    pub(super) fn takes_nonsense(&self, pins: &mut Pins) -> Option<String> {
        let mut scales = self.scales.iter();
        let takes = scales.position(|(param, scale)| {
            let refused = [f64::NAN, f64::INFINITY, 0.0].map(|bad| pins.set_param(*param, bad));
            refused.iter().any(Result::is_ok) || pins.param(*param) != *scale
        })?;
        Some(format!("the scale of analog output {takes}"))
    }
}
