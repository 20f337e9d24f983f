//! Outputs: SSR, solid-state relays with an isolated drive, and OutM, levels on pins.
//!
//! Source: FACTS 13.7.

use alloc::format;
use alloc::vec::Vec;

use super::limit::Limit;
use super::registrar::DrivenModule;
use super::{ListenCycle, Module, RegisterError, Registrar, WriteCycle, bits_of};
use crate::bus::{ReadSlot, Setting, Stage, WriteSlot};
use crate::events::CorrectedValue;
use crate::hal::{DigitalOut, Invert, Output, Spec};
use crate::hostmot2::{Gtag, HostMot2Error, ModuleDescriptor, ModuleInstance};

/// One instance of SSR or OutM: `hm2_7i97.0.ssr.00.out-00`, `hm2_7i97.0.outm.00.out-00` and so on.
#[derive(Debug)]
pub struct Outputs {
    /// SSR or OutM.
    pub gtag: Gtag,
    numbered: Vec<NumberedOutput>,
    /// Frequency of the isolated drive in Hz; 0 switches all outputs off. Only with SSR.
    pub rate: Option<Output<u32>>,
    /// The number of the instance.
    instance: u8,
    /// The last value of `rate` that is not allowed.
    reported: Option<i64>,
    clock_hz: u32,
    data: WriteSlot,
    /// The outputs that another program has set. Only with SSR.
    state: Option<ReadSlot>,
    /// The register of the drive: without drive the relays are off whatever the data is.
    drive: Option<Setting>,
}

/// The pins of one output.
#[derive(Clone, Copy, Debug)]
struct NumberedOutput {
    /// The number within the module, used by names and by the bits of the register.
    number: u8,
    out: DigitalOut,
}

/// The usual drive frequency of the relays.
const DRIVE_HZ: u32 = 1_000_000;

impl Outputs {
    /// The outputs in ascending order of their numbers within the module; a firmware need not begin
    /// with 0. True closes an output, or sets it high; when inverted, false does.
    pub fn outputs(&self) -> impl ExactSizeIterator<Item = (u8, DigitalOut)> + '_ {
        let outputs = self.numbered.iter();
        outputs.map(|output| (output.number, output.out))
    }

    /// Registers all instances of both kinds.
    pub(crate) fn register(r: &mut Registrar<'_>) -> Result<(), RegisterError> {
        for module in r.each_driven(&[Gtag::SSR, Gtag::OUT_M], Self::new)? {
            r.add(module);
        }
        Ok(())
    }

    fn new(
        r: &mut Registrar<'_>,
        module: &DrivenModule,
        instance: u8,
    ) -> Result<Self, RegisterError> {
        let of = module.instance(instance);
        let ModuleInstance {
            gtag,
            instance: number,
        } = of;
        let module = &module.descriptor;
        let clock_hz = module.clock_hz;
        r.use_io(gtag, number)?;
        let name = if gtag == Gtag::SSR { "ssr" } else { "outm" };
        let stem = format!("{name}.{number:02}.");
        let data_address = module.register(0, instance)?;
        let data = r.image.output(data_address, 0);
        let (mut rate, mut drive, mut state) = (None, None, None);
        if gtag == Gtag::SSR {
            state = Some(r.image.read_back(data_address));
            rate = Some(r.maker(&stem).switch("rate", DRIVE_HZ)?);
            let address = module.register(1, instance)?;
            // Zero until the pins are driven by the module.
            r.image.step(Stage::Configure, address, 0);
            drive = Some(
                r.image
                    .setting(Stage::Enable, address, drive_rate(clock_hz, DRIVE_HZ)),
            );
        }
        let outputs = numbers(r, of).into_iter();
        let outputs = outputs.map(|number| output(r, &stem, of, number));
        Ok(Self {
            gtag,
            numbered: outputs.collect::<Result<_, _>>()?,
            rate,
            instance: number,
            reported: None,
            clock_hz,
            data,
            state,
            drive,
        })
    }
}

/// Checks the layout, in any version. A single instance needs no multiple registers.
pub(super) fn check(module: &ModuleDescriptor) -> Result<(), HostMot2Error> {
    let (registers, of_each) = match module.gtag {
        Gtag::SSR => (2, 0b11),
        _ => (1, 0b1),
    };
    let found = module.multiple_registers & of_each;
    module.check_layout(
        registers,
        if module.instances > 1 { of_each } else { found },
    )
}

fn output(
    r: &mut Registrar<'_>,
    stem: &str,
    of: ModuleInstance,
    number: u8,
) -> Result<NumberedOutput, RegisterError> {
    let place = r.board.place(r.firmware, of, number.into());
    let mut make = r.maker_at(stem, place);
    let invert = make.switch(format!("invert-{number:02}"), false)?;
    let invert = Some(Invert::Pin(invert));
    let spec = Spec {
        invert,
        ..Spec::from(format!("out-{number:02}"))
    };
    let pin = make.output(spec, false)?;
    let out = DigitalOut { pin, invert };
    Ok(NumberedOutput { number, out })
}

/// The numbers of the outputs that have pins, in ascending order. Their secondary pins are 0x81
/// (out-00) to 0xA0 (out-31); with SSR, 0xA0 is the reference and no output.
fn numbers(r: &Registrar<'_>, of: ModuleInstance) -> Vec<u8> {
    let end = if of.gtag == Gtag::SSR { 0xA0 } else { 0xA1 };
    let pins = r.firmware.pins_of(of.gtag, of.instance);
    let pins = pins.map(|(_, descriptor)| descriptor.secondary_pin);
    let outputs = pins.filter(|pin| (0x81..end).contains(pin));
    let mut numbers: Vec<u8> = outputs.map(|pin| pin.wrapping_sub(0x81)).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

impl Module for Outputs {
    /// An output is shown as it is at its terminal, after any inversion.
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        let Some(state) = self.state else {
            return;
        };
        let word = cycle.words.word(state);
        for NumberedOutput { number, out } in &self.numbered {
            cycle.show(out.pin, word >> (number & 31) & 1 != 0);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        if !cycle.changed {
            return;
        }
        if let (Some(rate), Some(drive)) = (self.rate, self.drive) {
            let limit = Limit {
                setting: CorrectedValue::SsrRate,
                number: self.instance.into(),
                lowest: 0,
                highest: i64::from(self.clock_hz / 4),
                instead: None,
            };
            let word = match limit.pin(cycle, rate, &mut self.reported) {
                0 => 0,
                hz => drive_rate(self.clock_hz, hz),
            };
            cycle.words.set(drive, word);
        }
        let outputs = self.numbered.iter();
        let outputs = outputs.map(|output| (output.number, output.out.pin));
        let word = bits_of(cycle.pins, outputs);
        cycle.words.put(self.data, word);
    }
}

/// Returns the rate register of SSR: 11..0 divisor, 12 enable. The drive frequency is
/// clock/(n+2)/2, which is at most the requested one if the divisor is large enough.
fn drive_rate(clock_hz: u32, drive_hz: u32) -> u32 {
    const ENABLE: u32 = 1 << 12;
    const LARGEST: u64 = 0xFFF;
    let divisor = u64::from(clock_hz).div_ceil((u64::from(drive_hz) * 2).max(1));
    divisor.saturating_sub(2).min(LARGEST) as u32 | ENABLE
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn one_megahertz_at_100_mhz_is_divisor_48() {
        assert_eq!(drive_rate(100_000_000, DRIVE_HZ), 0x1030);
        assert_eq!(drive_rate(100_000_000, 0), 0x1FFF);
        assert_eq!(drive_rate(1, u32::MAX), 0x1000);
    }

    proptest! {
        #[test]
        fn relays_are_never_driven_faster_than_asked_for(clock in 1_000_000u32.., hz in 20_000u32..) {
            let rate = drive_rate(clock, hz);
            prop_assert!((0x1000..0x2000).contains(&rate));
            let is_slowest = rate & 0xFFF == 0xFFF;
            prop_assert!(clock / ((rate & 0xFFF) + 2) / 2 <= hz || is_slowest);
        }
    }
}
