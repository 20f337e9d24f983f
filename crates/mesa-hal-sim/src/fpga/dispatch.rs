//! Dispatch of accesses to the modules.

use super::{SimFpga, UNDRIVEN, gtag};
use crate::modules::{Inputs, SimStepgen};

impl SimFpga {
    pub(super) fn read_module(&mut self, gtag: u8, register: u8, instance: u8, port: u8) -> u32 {
        let now = self.now;
        match gtag {
            gtag::WATCHDOG => self.watchdog.read(now, register),
            gtag::IO_PORT => {
                self.settle_inputs();
                let levels = |pin| self.module_level(pin);
                self.io.read(register, instance, &levels)
            }
            gtag::ENCODER | gtag::MUXED_ENCODER => {
                self.settle();
                let bank = self.bank(gtag);
                bank.map_or(0, |index| {
                    self.plant.read_encoder(index, now, register, instance)
                })
            }
            gtag::STEPGEN => {
                self.settle();
                let generators = self.plant.stepgen.as_ref();
                generators.map_or(0, |steps| steps.read(register, instance))
            }
            gtag::PWM => {
                let pwm = self.pwm.as_ref();
                pwm.map_or(0, |pwm| pwm.read(register))
            }
            gtag::IN_MUX | gtag::IN_M => {
                self.settle_inputs();
                let inputs = self.field_inputs(gtag);
                let word = inputs.map_or(0, |inputs| inputs.read(now, register));
                Inputs::word_of(&self.firmware, gtag, instance, register, word)
            }
            gtag::SSR => self.ssr.as_ref().map_or(0, |ssr| ssr.read(register)),
            gtag::OUT_M => self.out_m.as_ref().map_or(0, |out| out.read(register)),
            gtag::DPLL => {
                self.settle();
                let dpll = self.dpll.as_mut();
                dpll.map_or(0, |dpll| dpll.read(now, register))
            }
            gtag::LED => UNDRIVEN,
            gtag::SSERIAL | gtag::SSERIAL_B => {
                let serial = self.serial.get_mut(usize::from(port));
                serial.map_or(0, |serial| serial.read(now, register, instance))
            }
            _ => {
                self.settle_foreign();
                let foreign = self.foreign.get_mut(gtag);
                let word = foreign.map_or(0, |module| module.read(now, register, instance));
                self.plant.modules_changed(&self.foreign, &self.io);
                word
            }
        }
    }

    pub(super) fn write_module(
        &mut self,
        gtag: u8,
        register: u8,
        instance: u8,
        port: u8,
        value: u32,
    ) {
        let now = self.now;
        match gtag {
            gtag::WATCHDOG => self.watchdog.write(now, register, value),
            gtag::IO_PORT => {
                self.settle();
                self.io.write(register, instance, value);
                self.pins_changed();
            }
            gtag::ENCODER | gtag::MUXED_ENCODER => {
                self.settle();
                if let Some(index) = self.bank(gtag) {
                    self.plant
                        .write_encoder(index, now, register, instance, value);
                }
            }
            gtag::STEPGEN => self.write_stepgen(register, instance, value),
            gtag::PWM | gtag::SSR | gtag::OUT_M | gtag::LED => {
                self.write_outputs(gtag, register, instance, value);
            }
            gtag::IN_MUX | gtag::IN_M => {
                self.settle_inputs();
                if let Some(inputs) = self.field_inputs(gtag) {
                    inputs.write(now, register, value);
                }
            }
            gtag::DPLL => {
                self.settle();
                if let Some(dpll) = &mut self.dpll {
                    dpll.write(now, register, value);
                }
            }
            gtag::SSERIAL | gtag::SSERIAL_B => {
                if let Some(serial) = self.serial.get_mut(usize::from(port)) {
                    serial.write(now, register, instance, value);
                }
            }
            _ => self.write_foreign(gtag, register, instance, value),
        }
    }

    /// Writes a register of the step generators. A timer that is selected while it is 1, in place of
    /// one that was 0, samples the accumulators at once. FACTS 14.13.
    fn write_stepgen(&mut self, register: u8, instance: u8, value: u32) {
        self.settle();
        let now = self.now;
        let selected = |fpga: &Self| {
            let stepgen = fpga.plant.stepgen.as_ref();
            stepgen.map_or(0, SimStepgen::selected_timer)
        };
        let before = selected(self);
        self.plant.write_stepgen(now, register, instance, value);
        let after = selected(self);
        let Some(dpll) = self.dpll.as_ref().filter(|_| before != after) else {
            return;
        };
        let was_high = dpll.level(now.saturating_sub(1), before);
        let rises = was_high == Some(false) && dpll.level(now, after) == Some(true);
        if let Some(stepgen) = self.plant.stepgen.as_mut().filter(|_| rises) {
            stepgen.sample();
        }
    }

    /// Writes a register of a module that drives outputs.
    fn write_outputs(&mut self, gtag: u8, register: u8, instance: u8, value: u32) {
        let now = self.now;
        match gtag {
            gtag::PWM => {
                self.settle();
                if let Some(pwm) = &mut self.pwm {
                    pwm.write(now, register, instance, value);
                    self.plant.pwm_changed(pwm, &self.io);
                }
            }
            gtag::SSR => {
                if let Some(ssr) = &mut self.ssr {
                    ssr.write(now, register, value);
                }
            }
            gtag::OUT_M => {
                if let Some(out) = &mut self.out_m {
                    out.write(now, register, value);
                }
            }
            _ => self.leds.write(value),
        }
    }

    /// Writes a register of a module that is not the simulator's own.
    fn write_foreign(&mut self, gtag: u8, register: u8, instance: u8, value: u32) {
        self.settle_foreign();
        if let Some(module) = self.foreign.get_mut(gtag) {
            module.write(self.now, register, instance, value);
        }
        self.plant.modules_changed(&self.foreign, &self.io);
    }

    /// The field inputs of a firmware, multiplexed or not.
    fn field_inputs(&mut self, gtag: u8) -> Option<&mut Inputs> {
        if gtag == gtag::IN_MUX {
            self.in_mux.as_mut()
        } else {
            self.in_m.as_mut()
        }
    }

    /// A module's present output on a pin, regardless of the pin's set-up.
    pub(super) fn module_level(&self, number: usize) -> bool {
        let Some(&pin) = self.firmware.pins.get(number) else {
            return false;
        };
        match pin.secondary {
            // No module: the alternate source is 0.
            0 => false,
            gtag::STEPGEN => {
                let steps = self.plant.stepgen.as_ref();
                steps.is_none_or(|steps| steps.level(pin.unit, pin.pin, self.now))
            }
            gtag::PWM => {
                let pwm = self.pwm.as_ref();
                pwm.is_none_or(|pwm| pwm.level(pin.unit, pin.pin, self.now))
            }
            gtag::SSR => self
                .ssr
                .as_ref()
                .is_none_or(|ssr| ssr.level(self.now, pin.pin)),
            gtag::OUT_M => self
                .out_m
                .as_ref()
                .is_none_or(|out| out.level(self.now, pin.pin)),
            gtag::IN_MUX => {
                let line = pin.pin.checked_sub(0x81);
                let inputs = self.in_mux.as_ref().zip(line);
                inputs.is_none_or(|(inputs, line)| inputs.address_line(self.now, line))
            }
            gtag::MUX_SELECT => {
                let mut banks = self.plant.banks.iter();
                let bank = banks.find(|bank| bank.is_multiplexed());
                bank.is_none_or(|bank| bank.select_level(self.now))
            }
            // Idle serial lines are at 1, and so are all other signals between their pulses.
            gtag => {
                let foreign = self.foreign.get(gtag);
                foreign.is_none_or(|module| module.level(self.now, pin.unit, pin.pin))
            }
        }
    }

    /// Moves motors up to the present before an access to a module that may drive one.
    fn settle_foreign(&mut self) {
        if self.plant.is_driven_by_modules() {
            self.settle();
        }
    }

    /// Index of the encoder module with this GTAG.
    pub(super) fn bank(&self, gtag: u8) -> Option<usize> {
        let multiplexed = gtag == gtag::MUXED_ENCODER;
        let mut banks = self.plant.banks.iter();
        banks.position(|bank| bank.is_multiplexed() == multiplexed)
    }
}
