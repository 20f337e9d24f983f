//! Reload of the FPGA, while the world around it continues.

use super::fabric::Fabric;
use super::{ChangeCause, SimFpga};
use crate::modules::SimStepgen;
use crate::wire::Nanos;

impl SimFpga {
    /// Configures the FPGA again: all registers and the serial ports are as after power-up.
    ///
    /// Time and the world continue: remotes stay plugged in and powered, inputs and pins are driven
    /// as before, and motors keep turning until their drives react.
    ///
    /// The firmware of a serial port needs up to 142 us from here on until it takes commands;
    /// COMMAND, DATA and CS read 0 meanwhile, like those of an idle port.
    pub fn reload(&mut self) {
        self.reload_until(self.fabric.now);
    }

    /// Makes the FPGA lose its configuration, and have it again after `time`. Until then all pins
    /// are inputs, reads return all ones, like a bus that is not driven, and writes have no effect.
    pub fn reset_for(&mut self, time: Nanos) {
        let configured = self.fabric.now.saturating_add(time);
        self.reload_until(configured);
        self.fabric.reset_until = configured;
    }

    fn reload_until(&mut self, configured: Nanos) {
        self.fabric.reload(configured);
        self.show(ChangeCause::Reset);
    }

    /// True while the FPGA has no configuration.
    pub fn is_in_reset(&self) -> bool {
        self.fabric.is_in_reset()
    }
}

impl Fabric {
    /// Restarts everything now, and the serial ports' firmware at `configured`.
    fn reload(&mut self, configured: Nanos) {
        self.settle();
        self.io.reload();
        let times = [self.now, configured];
        self.modules.reload(&self.firmware, &self.io, times);
        self.plant
            .stepgen_reloaded(self.modules.first::<SimStepgen>());
        self.pins_changed();
    }
}

#[cfg(test)]
mod tests {
    use crate::machines;
    use crate::wire::Nanos;

    const COMMAND: u16 = 0x5B00;
    const DATA: u16 = 0x5C00;
    const CS: u16 = 0x5D00;

    /// A port of eight channels; 7I97 addresses (FACTS 9.2). Times: FACTS 11.1, and 14.9 us for the
    /// baud rate of each channel.
    #[test]
    fn serial_port_reads_0_and_is_busy_for_142_us_after_a_reload() {
        for reset in [0, 300_000] {
            let mut fpga = machines::i7i97(8);
            let from: Nanos = 5_000_000;
            fpga.advance_to(from);
            assert_eq!(fpga.read_register(DATA), 0xAA);
            fpga.reset_for(reset);
            let up = from + reset;
            fpga.advance_to(up + 10_000);
            for address in [COMMAND, DATA, CS] {
                assert_eq!(fpga.read_register(address), 0, "{address:04X}, {reset}");
            }
            // A local read written meanwhile is executed when the firmware is ready.
            fpga.advance_to(up + 50_000);
            fpga.write_register(COMMAND, 0x2003);
            fpga.advance_to(up + 140_000);
            assert_eq!(fpga.read_register(COMMAND), 0x2003, "{reset}");
            fpga.advance_to(up + 145_000);
            assert_eq!(fpga.read_register(COMMAND), 0, "{reset}");
            assert_eq!(fpga.read_register(DATA), 43, "{reset}");
        }
    }

    #[test]
    fn registers_are_as_after_power_up_and_the_world_stays() {
        let mut fpga = machines::i7i97(1);
        fpga.advance_to(5_000_000);
        fpga.set_input(3, true);
        fpga.drive_pin(40, Some(false));
        let untouched: Vec<_> = (0..0x4000).map(|n| n * 4).collect();
        let before: Vec<_> = untouched.iter().map(|&at| fpga.read_register(at)).collect();
        for address in [
            0x0C00, 0x1100, 0x1104, 0x1200, 0x4100, 0x4300, 0x7D00, 0x0200,
        ] {
            fpga.write_register(address, 0x0100_0FFF);
        }
        fpga.advance_to(6_000_000);
        fpga.reload();
        fpga.advance_to(6_500_000);
        let after: Vec<_> = untouched.iter().map(|&at| fpga.read_register(at)).collect();
        // The time stamp counter of the encoders keeps running.
        let stamp = 0x3900 / 4;
        let differs = before.iter().zip(&after).enumerate();
        let differs = differs.filter(|(at, (a, b))| a != b && *at != stamp);
        assert_eq!(differs.count(), 0);
        assert!(fpga.inputs().unwrap().terminal(3));
        assert!(!fpga.pin_level(40));
    }
}
