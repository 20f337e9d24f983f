//! Outputs in the cycle: SSR and OutM.

use alloc::vec::Vec;

use super::{Making, PartError, Wiring};
use crate::boards::fpga::{OutputKind, OutputPins};
use crate::bus::{ImagePlan, WriteSlot};
use crate::driver::{Module, Put, SettingSlot, SetupList, Take};
use crate::hostmot2::{Gtag, HostMot2, OutM, Ssr, SsrRate};

/// One instance of SSR or OutM.
#[derive(Debug)]
pub(in crate::driver) struct OutputModule {
    /// The address of the outputs.
    outputs: u16,
    /// What switches isolated outputs; plain ones have none.
    drive: Option<Ssr>,
    pins: OutputPins,
    data: Option<WriteSlot>,
    rate: Option<SettingSlot>,
}

impl OutputModule {
    /// All instances of both kinds that a firmware has.
    pub fn build_all(parts: &mut Making<'_>) -> Result<Vec<Self>, PartError> {
        let mut all = Vec::new();
        for (gtag, kind) in [
            (Gtag::SSR, OutputKind::Ssr),
            (Gtag::OUT_M, OutputKind::OutM),
        ] {
            let module = parts.firmware.find(gtag);
            let instances = module.map_or(0, |module| module.instances);
            for instance in 0..instances {
                let (outputs, drive) = match kind {
                    OutputKind::Ssr => {
                        let registers = Ssr::locate(parts.firmware, instance)?;
                        (registers.data, Some(registers))
                    }
                    OutputKind::OutM => (OutM::locate(parts.firmware, instance)?.data, None),
                };
                let pins = make_pins(parts, kind, (gtag, instance))?;
                let made = match kind {
                    OutputKind::Ssr => &mut parts.made.ssr,
                    OutputKind::OutM => &mut parts.made.out_m,
                };
                made.push(pins.clone());
                all.push(Self {
                    outputs,
                    drive,
                    pins,
                    data: None,
                    rate: None,
                });
            }
        }
        Ok(all)
    }
}

fn make_pins(
    parts: &mut Making<'_>,
    kind: OutputKind,
    module: (Gtag, u8),
) -> Result<OutputPins, PartError> {
    let (gtag, instance) = module;
    parts.plan.use_module(parts.firmware, gtag, instance)?;
    let terminals = Wiring::of(parts.firmware).outputs(parts.firmware, module);
    let wired = numbers(parts.firmware, kind, module).into_iter().map(|n| {
        let known = terminals.get(usize::from(n)).copied();
        (n, known.unwrap_or(&[]))
    });
    let (group, board) = (parts.group, parts.board);
    let which = (kind, usize::from(instance));
    Ok(OutputPins::new(parts.pins, group, board, which, wired)?)
}

/// The numbers of the outputs that have pins, rising. Their secondary pins are 0x81 (out-00) to
/// 0xA0 (out-31), which is the reference of SSR and no output.
fn numbers(firmware: &HostMot2, kind: OutputKind, (gtag, instance): (Gtag, u8)) -> Vec<u8> {
    let end = match kind {
        OutputKind::Ssr => 0xA0,
        OutputKind::OutM => 0xA1,
    };
    let mut numbers: Vec<u8> = firmware
        .pins_of(gtag, instance)
        .map(|(_, descriptor)| descriptor.secondary_pin)
        .filter(|pin| (0x81..end).contains(pin))
        .map(|pin| pin - 0x81)
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

impl Module for OutputModule {
    fn set_up(&self, list: &mut SetupList) {
        list.push(self.outputs, 0);
        if let Some(drive) = self.drive {
            list.push(drive.rate, 0);
        }
    }

    /// The drive only now, because before it the pins are not driven by the module.
    fn start(&self, list: &mut SetupList) {
        if let Some(drive) = self.drive {
            match drive.start(list) {
                Ok(()) => {}
                Err(never) => match never {},
            }
        }
    }

    fn claim(&mut self, plan: &mut ImagePlan) {
        self.data = Some(plan.write_data(self.outputs, 0));
        self.rate = self
            .drive
            .map(|drive| SettingSlot::claim(plan, drive.rate, drive.drive().0));
    }

    fn take(&mut self, _: &mut Take<'_>) {}

    fn put(&mut self, cycle: &mut Put<'_>) {
        if let (Some(drive), Some(rate)) = (self.drive, self.pins.rate) {
            let rate = match cycle.pins.fetch(rate) {
                0 => SsrRate(0),
                hz => drive.rate_for(hz),
            };
            cycle.change(self.rate, rate.0);
        }
        if let Some(slot) = self.data {
            let word = self.pins.data(cycle.pins);
            cycle.image.put(slot, word);
        }
    }
}
