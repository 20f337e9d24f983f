//! PWM generators in the cycle.

use alloc::vec::Vec;

use super::{Making, PartError, Wiring};
use crate::boards::fpga::{PwmBankPins, PwmPins};
use crate::bus::{ImagePlan, WriteSlot};
use crate::driver::{Module, Put, SettingSlot, SetupList, Take};
use crate::hal::{PinStore, Pins};
use crate::hostmot2::{Gtag, PdmRate, PwmGenerators, PwmOutput, PwmRate, PwmScale, PwmWidth};

/// All PWM generators.
#[derive(Debug)]
pub(in crate::driver) struct PwmModule {
    registers: PwmGenerators,
    bank: PwmBankPins,
    channels: Vec<Channel>,
    rates: Rates,
    enables: Option<WriteSlot>,
    master_rate: Option<SettingSlot>,
    pdm_rate: Option<SettingSlot>,
}

#[derive(Debug)]
struct Channel {
    pins: PwmPins,
    /// Channels that must be enabled for this one to be.
    switched_by: Option<usize>,
    /// As the generator was set up.
    initial: PwmScale,
    value: Option<WriteSlot>,
    mode: Option<SettingSlot>,
}

/// Frequencies asked for, and what the hardware makes of them.
#[derive(Clone, Copy, Debug)]
struct Rates {
    hz: (u32, u32),
    pwm: PwmRate,
    pdm: PdmRate,
}

impl PwmModule {
    /// The generators of a firmware, if it has any, at `hz` or at what the board is made for.
    pub fn build(parts: &mut Making<'_>, hz: Option<u32>) -> Result<Option<Self>, PartError> {
        if parts.firmware.find(Gtag::PWM).is_none() {
            return Ok(None);
        }
        let registers = PwmGenerators::locate(parts.firmware)?;
        let wiring = Wiring::of(parts.firmware);
        let hz = hz.unwrap_or_else(|| wiring.pwm_hz(registers.can_dither()));
        let bank = PwmBankPins::new(parts.pins, parts.group, parts.board, hz)?;
        let rates = Rates::of(&registers, &bank, parts.pins);
        let mut channels = Vec::new();
        for number in 0..registers.instances() {
            parts.plan.use_module(parts.firmware, Gtag::PWM, number)?;
            let number = usize::from(number);
            let usage = wiring.pwm(number);
            let pins = PwmPins::new(parts.pins, parts.group, parts.board, number, usage)?;
            channels.push(Channel {
                switched_by: usage.switched_by,
                initial: scale(&registers, &rates, &pins, parts.pins),
                pins,
                value: None,
                mode: None,
            });
        }
        parts.made.pwm_bank = Some(bank);
        parts.made.pwm = channels.iter().map(|channel| channel.pins).collect();
        Ok(Some(Self {
            registers,
            bank,
            channels,
            rates,
            enables: None,
            master_rate: None,
            pdm_rate: None,
        }))
    }
}

impl PwmModule {
    /// The enables register as the pins say: bit n is generator n.
    fn enables(&self, pins: &mut PinStore) -> u32 {
        let channels = self.channels.iter().enumerate();
        channels.fold(0, |word, (index, channel)| {
            word | u32::from(pins.fetch(channel.pins.enable)) << (index & 31)
        })
    }
}

impl Rates {
    fn of(registers: &PwmGenerators, bank: &PwmBankPins, pins: &Pins) -> Self {
        let hz = (
            pins.param(bank.pwm_frequency),
            pins.param(bank.pdm_frequency),
        );
        Self {
            hz,
            pwm: registers.rate_for(f64::from(hz.0), false),
            pdm: PdmRate::new(registers.clock_hz(), f64::from(hz.1)),
        }
    }
}

const fn is_set(word: u32, bit: usize) -> bool {
    word >> (bit & 31) & 1 != 0
}

/// From a fraction of full scale to a duty: the pins have scaled and limited the value.
fn scale(registers: &PwmGenerators, rates: &Rates, of: &PwmPins, pins: &Pins) -> PwmScale {
    let output = match pins.param(of.output_type) {
        2 => PwmOutput::UpDown,
        3 => PwmOutput::PdmDir,
        4 => PwmOutput::DirPwm,
        _ => PwmOutput::PwmDir,
    };
    let pdm = output == PwmOutput::PdmDir;
    PwmScale {
        scale: 1.0,
        width: if pdm {
            PwmWidth::Bits12
        } else {
            rates.pwm.width
        },
        symmetrical: rates.pwm.symmetrical && !pdm,
        output,
        offset: pins.param(of.offset_mode),
        dither: registers.can_dither(),
    }
}

impl Module for PwmModule {
    fn set_up(&self, list: &mut SetupList) {
        let scales: Vec<_> = self
            .channels
            .iter()
            .map(|channel| channel.initial)
            .collect();
        let (pwm, pdm) = (self.rates.pwm, self.rates.pdm);
        match self.registers.set_up(list, pwm, pdm, &scales) {
            Ok(()) => {}
            Err(never) => match never {},
        }
    }

    fn claim(&mut self, plan: &mut ImagePlan) {
        let registers = &self.registers;
        self.enables = Some(plan.write_data(registers.enables, 0));
        let rate = self.rates.pwm.rate.into();
        self.master_rate = Some(SettingSlot::claim(plan, registers.master_rate, rate));
        let rate = self.rates.pdm.rate.into();
        self.pdm_rate = Some(SettingSlot::claim(plan, registers.pdm_rate, rate));
        for (index, channel) in (0u8..).zip(&mut self.channels) {
            let rest = channel.initial.encode(0.0).word;
            let mode = channel.initial.mode().0;
            let value = registers.value.address(index);
            channel.value = value.map(|address| plan.write_data(address, rest));
            let address = registers.mode.address(index);
            channel.mode = address.map(|address| SettingSlot::claim(plan, address, mode));
        }
    }

    fn take(&mut self, _: &mut Take<'_>) {}

    fn put(&mut self, cycle: &mut Put<'_>) {
        let bank = &self.bank;
        let hz = (
            cycle.pins.param(bank.pwm_frequency),
            cycle.pins.param(bank.pdm_frequency),
        );
        if hz != self.rates.hz {
            self.rates = Rates::of(&self.registers, bank, cycle.pins);
            cycle.change(self.master_rate, self.rates.pwm.rate.into());
            cycle.change(self.pdm_rate, self.rates.pdm.rate.into());
        }
        let enables = self.enables(cycle.pins);
        for (index, channel) in self.channels.iter().enumerate() {
            let scale = scale(&self.registers, &self.rates, &channel.pins, cycle.pins);
            let fraction = channel.pins.fraction(cycle.pins);
            let switch = channel.switched_by.unwrap_or(index);
            let enabled = is_set(enables, index) && is_set(enables, switch);
            let fraction = if enabled { fraction } else { 0.0 };
            if let Some(value) = channel.value {
                cycle.image.put(value, scale.encode(fraction).word);
            }
            cycle.change(channel.mode, scale.mode().0);
        }
        if let Some(slot) = self.enables {
            cycle.image.put(slot, enables);
        }
    }
}
