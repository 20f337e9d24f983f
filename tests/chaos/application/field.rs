//! Other values of field I/O: voltages and MPGs.

use mesa_hal::hal::{Input, PinError, Pins};

use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::Plan;
use super::super::stage::{Stage, was};

/// One and a half steps of the converter.
const STEP: f64 = 0.22;
/// Field voltages that a plan sets, and the possible voltages of an input that is on.
const VOLTS: [f64; 5] = [24.0, 36.0, 5.0, 3.0, 0.0];

/// The pins of the modes 1 to 3.
pub(super) struct Field {
    volts: Vec<Input<f64>>,
    supply: Option<Input<f64>>,
    mpgs: Vec<Mpg>,
}

struct Mpg {
    count: Input<i32>,
    /// Possible values of the card's counter while `count` is 0.
    zero: [bool; 256],
}

impl Field {
    pub(super) fn new(pins: &Pins, prefix: &str, mode: u8) -> Result<Self, PinError> {
        let analog = if mode >= 1 { 0..4 } else { 0..0 };
        let volts = analog.map(|n| pins.input(&format!("{prefix}.analogin{n}")));
        let mpgs = if mode == 3 { 0..2 } else { 0..0 };
        let mpgs = mpgs.map(|n| {
            Ok(Mpg {
                count: pins.input(&format!("{prefix}.enc{n}.count"))?,
                zero: [true; 256],
            })
        });
        let supply = (mode >= 2).then(|| pins.input(&format!("{prefix}.fieldvoltage")));
        Ok(Self {
            volts: volts.collect::<Result<_, _>>()?,
            supply: supply.transpose()?,
            mpgs: mpgs.collect::<Result<_, PinError>>()?,
        })
    }

    /// The counters of the card may have been reset.
    pub(super) fn forget(&mut self) {
        for mpg in &mut self.mpgs {
            mpg.zero = [true; 256];
        }
    }

    /// Compares all valid values with the truth.
    pub(super) fn check(
        &mut self,
        (pins, stage, plan): (&Pins, &Stage, &Plan),
        remote: usize,
        (from, now): (u64, u64),
    ) -> Checked {
        let is_near = |shown: f64, volts: f64| (shown - volts).abs() <= STEP;
        // Other voltages are faults.
        let has_faults = plan
            .faults
            .iter()
            .any(|fault| fault.kind.fault_bit().is_some());
        let possible = if has_faults { &VOLTS[..] } else { &VOLTS[..1] };
        for (n, pin) in self.volts.iter().enumerate() {
            let shown = pins.read(*pin).value;
            let is_on = possible.iter().any(|volts| is_near(shown, *volts));
            let is_off = is_near(shown, 0.0);
            let is_true = stage.with_truth(|truth| {
                was(&truth.fields[remote], from, now, |pattern| {
                    if pattern >> n & 1 != 0 { is_on } else { is_off }
                })
            });
            ensure(is_true, Promise::Inputs, now, || {
                format!("remote {remote}: analog input {n} is {shown} V since {from}")
            })?;
        }
        if let Some(supply) = self.supply {
            let shown = pins.read(supply).value;
            let is_true = possible.iter().any(|volts| is_near(shown, *volts));
            ensure(is_true, Promise::Inputs, now, || {
                format!("remote {remote}: field voltage is {shown} V")
            })?;
        }
        for (n, mpg) in self.mpgs.iter_mut().enumerate() {
            let count = pins.read(mpg.count).value as u8;
            let mut could = [false; 256];
            stage.with_truth(|truth| {
                was(&truth.mpgs[remote], from, now, |counts| {
                    could[usize::from(counts[n].wrapping_sub(count))] = true;
                    false
                })
            });
            for (zero, could) in mpg.zero.iter_mut().zip(could) {
                *zero &= could;
            }
            ensure(mpg.zero.contains(&true), Promise::Inputs, now, || {
                format!("remote {remote}: MPG {n} counts {count}, and did not turn like that")
            })?;
        }
        Ok(())
    }
}
