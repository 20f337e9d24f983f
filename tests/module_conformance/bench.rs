//! The bench to which the stimuli of a recording are applied.

use mesa_hal_sim::wire::Nanos;
use mesa_hal_sim::{SimFirmware, SimFpga, gtag};

use crate::register::Register;
use crate::transcript::Level;

/// A simulated FPGA with the surroundings of a recording's bench.
///
/// `Err` means that the model has no such register, pin or input, which counts as a difference.
pub trait Bench {
    /// The FPGA without its surroundings.
    fn inner(&mut self) -> &mut FpgaBench;

    /// Lets time pass up to `to`.
    fn advance(&mut self, to: Nanos) {
        self.inner().fpga.advance_to(to);
    }

    /// Writes a register at the current time.
    fn write(&mut self, register: Register, value: u32) -> Result<(), String> {
        let address = self.inner().address(register)?;
        self.inner().fpga.write_register(address, value);
        Ok(())
    }

    /// Reads a register at the current time. The runner reads 1 ns before the time of the line: at
    /// an edge, a register shows its value before the edge.
    fn read(&mut self, register: Register) -> Result<u32, String> {
        let address = self.inner().address(register)?;
        Ok(self.inner().fpga.read_register(address))
    }

    /// The current level of a pin.
    fn pin(&mut self, pin: &str) -> Result<Level, String> {
        self.inner().level(pin)
    }

    /// Drives a pin from outside, or releases it.
    fn drive(&mut self, pin: &str, level: Level) -> Result<(), String> {
        Err(format!("{pin} cannot be driven to {level:?}"))
    }

    /// The lines A, B, Z of an encoder, in front of the multiplexer.
    fn encoder(&mut self, encoder: u8, abz: [bool; 3]) -> Result<(), String> {
        Err(format!("no encoder {encoder} to stand at {abz:?}"))
    }

    /// An input at the external multiplexer.
    fn input(&mut self, input: u8, level: bool) -> Result<(), String> {
        Err(format!("no input {input} to be {level}"))
    }
}

/// A simulated FPGA without surroundings.
pub struct FpgaBench {
    /// The FPGA.
    pub fpga: SimFpga,
}

impl FpgaBench {
    /// An FPGA that has just been configured.
    pub fn new(firmware: SimFirmware) -> Self {
        Self {
            fpga: SimFpga::new(firmware),
        }
    }

    /// The I/O pin with a name in a recording.
    pub fn io_pin(&self, name: &str) -> Result<usize, String> {
        let firmware = self.fpga.firmware();
        let pin = find_pin(firmware, name).filter(|&pin| pin < firmware.pins.len());
        pin.ok_or_else(|| format!("the firmware has no pin {name}"))
    }

    fn level(&self, pin: &str) -> Result<Level, String> {
        let level = match pin.strip_prefix("LED") {
            Some(led) => Some(!self.fpga.leds().is_lit(3 - number(led)?.min(3))),
            None => self.fpga.driven_level(self.io_pin(pin)?),
        };
        Ok(match level {
            None => Level::Released,
            Some(false) => Level::Low,
            Some(true) => Level::High,
        })
    }

    fn address(&self, register: Register) -> Result<u16, String> {
        let address = register.address(self.fpga.firmware());
        address.ok_or_else(|| format!("the firmware has no {register:?}"))
    }
}

impl Bench for FpgaBench {
    fn inner(&mut self) -> &mut FpgaBench {
        self
    }

    fn drive(&mut self, pin: &str, level: Level) -> Result<(), String> {
        let level = match level {
            Level::Low => Some(false),
            Level::High => Some(true),
            Level::Released | Level::Conflict => None,
        };
        let pin = self.io_pin(pin)?;
        self.fpga.drive_pin(pin, level);
        Ok(())
    }
}

/// The number of an I/O pin: `IO` and its number, or the signal of a module.
fn find_pin(firmware: &SimFirmware, name: &str) -> Option<usize> {
    let letters = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let number: u8 = name[letters.len()..].parse().unwrap_or(0);
    match letters {
        "IO" => Some(usize::from(number)),
        "STEP" => firmware.pin(gtag::STEPGEN, number, 0x81),
        "DIR" => firmware.pin(gtag::STEPGEN, number, 0x82),
        "TABLE2_" => firmware.pin(gtag::STEPGEN, number, 0x83),
        "TABLE3_" => firmware.pin(gtag::STEPGEN, number, 0x84),
        "TABLE4_" => firmware.pin(gtag::STEPGEN, number, 0x85),
        "TABLE5_" => firmware.pin(gtag::STEPGEN, number, 0x86),
        "INDEX" => firmware.pin(gtag::STEPGEN, number, 0x09),
        "PROBE" => firmware.pin(gtag::STEPGEN, 0x80, 0x0A),
        "PWM" => firmware.pin(gtag::PWM, number, 0x81),
        "PWMB" => firmware.pin(gtag::PWM, number, 0x82),
        "/ENA" => firmware.pin(gtag::PWM, number, 0x83),
        "SSR" => firmware.pin(gtag::SSR, 0, 0x81 + number),
        "SSRREF" => firmware.pin(gtag::SSR, 0, 0xA0),
        "MUXSEL" | "MUXSEL_A" => firmware.pin(gtag::MUX_SELECT, 0, 0x81),
        "MUXSEL_B" => firmware.pin(gtag::MUX_SELECT, 6, 0x81),
        "MUXADR" => firmware.pin(gtag::IN_MUX, 0, 0x81 + number),
        "IN" => firmware.pin(gtag::IN_M, 0, 0x01 + number),
        _ => None,
    }
}

fn number(text: &str) -> Result<usize, String> {
    text.parse().map_err(|error| format!("{text}: {error}"))
}
