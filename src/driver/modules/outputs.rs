//! Isolated outputs in the cycle.

use alloc::vec::Vec;

use super::{Making, PartError, Wiring};
use crate::boards::Terminal;
use crate::boards::fpga::SsrPins;
use crate::bus::{ImagePlan, WriteSlot};
use crate::driver::{Module, Put, SettingSlot, SetupList, Take};
use crate::hostmot2::{Gtag, HostMot2, Ssr, SsrRate};

/// One instance of SSR.
#[derive(Debug)]
pub(in crate::driver) struct SsrModule {
    registers: Ssr,
    pins: SsrPins,
    data: Option<WriteSlot>,
    rate: Option<SettingSlot>,
}

impl SsrModule {
    /// All instances that a firmware has.
    pub fn build_all(parts: &mut Making<'_>) -> Result<Vec<Self>, PartError> {
        let module = parts.firmware.find(Gtag::SSR);
        let instances = module.map_or(0, |module| module.instances);
        let wiring = Wiring::of(parts.firmware);
        let mut all = Vec::new();
        for instance in 0..instances {
            let registers = Ssr::locate(parts.firmware, instance)?;
            parts.plan.use_module(parts.firmware, Gtag::SSR, instance)?;
            let terminals: Vec<&[Terminal]> = (0..outputs(parts.firmware, instance))
                .map(|n| if instance == 0 { wiring.output(n) } else { &[] })
                .collect();
            let number = usize::from(instance);
            let pins = SsrPins::new(parts.pins, parts.group, parts.board, number, &terminals)?;
            parts.made.ssr.push(pins.clone());
            all.push(Self {
                registers,
                pins,
                data: None,
                rate: None,
            });
        }
        Ok(all)
    }
}

/// How many outputs have pins: the secondary pins 0x81 (out-00) to 0xA0, which is the reference
/// and no output.
fn outputs(firmware: &HostMot2, instance: u8) -> usize {
    firmware
        .pins_of(Gtag::SSR, instance)
        .filter(|(_, descriptor)| (0x81..0xA0).contains(&descriptor.secondary_pin))
        .count()
}

impl Module for SsrModule {
    fn set_up(&self, list: &mut SetupList) {
        list.push(self.registers.data, 0);
        list.push(self.registers.rate, 0);
    }

    /// Only now, because before it the pins are not driven by the module.
    fn start(&self, list: &mut SetupList) {
        match self.registers.start(list) {
            Ok(()) => {}
            Err(never) => match never {},
        }
    }

    fn claim(&mut self, plan: &mut ImagePlan) {
        let registers = &self.registers;
        self.data = Some(plan.write_data(registers.data, 0));
        let drive = registers.drive().0;
        self.rate = Some(SettingSlot::claim(plan, registers.rate, drive));
    }

    fn take(&mut self, _: &mut Take<'_>) {}

    fn put(&mut self, cycle: &mut Put<'_>) {
        let rate = match cycle.pins.fetch(self.pins.rate) {
            0 => SsrRate(0),
            hz => self.registers.rate_for(hz),
        };
        cycle.change(self.rate, rate.0);
        if let Some(slot) = self.data {
            let word = self.pins.data(cycle.pins);
            cycle.image.put(slot, word);
        }
    }
}
