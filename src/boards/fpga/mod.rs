//! The pins of an FPGA board's own modules, named as LinuxCNC names them.
//!
//! Each type holds the handles of one module or instance. Names, types and directions follow
//! LinuxCNC 2.9; see its manual page `hostmot2(9)` for what each pin does.

mod encoder;
mod gpio;
mod host;
mod in_mux;
mod outputs;
mod pwm;

pub use encoder::{EncoderBankPins, EncoderPins};
pub use gpio::{GpioPins, PinUse};
pub use host::{DpllPins, EthernetPins, WatchdogPins};
pub use in_mux::{InMuxInput, InMuxKind, InMuxPins};
pub use outputs::{InvertibleOutput, LedPins, OutputKind, OutputPins};
pub use pwm::{PwmBankPins, PwmPins, PwmUse};

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use super::Terminal;
use crate::hal::{
    GroupId, InOut, Input, Output, OutputRule, Param, PinError, PinStore, Spec, Value,
};

/// The pins of everything that a firmware has.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FpgaPins {
    /// The watchdog.
    pub watchdog: WatchdogPins,
    /// The connection.
    pub ethernet: EthernetPins,
    /// The phase-locked loop.
    pub dpll: Option<DpllPins>,
    /// All encoders together.
    pub encoder_bank: Option<EncoderBankPins>,
    /// The encoders.
    pub encoders: Vec<EncoderPins>,
    /// All PWM generators together.
    pub pwm_bank: Option<PwmBankPins>,
    /// The PWM generators.
    pub pwm: Vec<PwmPins>,
    /// The multiplexed inputs, by instance.
    pub in_mux: Vec<InMuxPins>,
    /// The inputs with a pin each, by instance.
    pub in_m: Vec<InMuxPins>,
    /// The isolated outputs, by instance.
    pub ssr: Vec<OutputPins>,
    /// The plain outputs, by instance.
    pub out_m: Vec<OutputPins>,
    /// The LEDs.
    pub leds: Option<LedPins>,
    /// All I/O pins by number.
    pub io: Vec<GpioPins>,
}

/// Makes pins that share the beginning of their names.
struct Maker<'a> {
    pins: &'a mut PinStore,
    group: GroupId,
    stem: String,
    terminals: &'a [Terminal],
}

impl<'a> Maker<'a> {
    fn new(pins: &'a mut PinStore, group: GroupId, stem: String) -> Self {
        Self {
            pins,
            group,
            stem,
            terminals: &[],
        }
    }

    fn at(mut self, terminals: &'a [Terminal]) -> Self {
        self.terminals = terminals;
        self
    }

    fn spec(&self, name: &str) -> Spec {
        at_terminals(Spec::new(format!("{}{name}", self.stem)), self.terminals)
    }

    fn input<T: Value>(&mut self, name: &str) -> Result<Input<T>, PinError> {
        let spec = self.spec(name);
        self.pins.add_input(self.group, spec)
    }

    /// An output that is safe at zero or off.
    fn output<T: Value>(&mut self, name: &str) -> Result<Output<T>, PinError> {
        let spec = self.spec(name);
        let rule = OutputRule::safe_at(T::default());
        self.pins.add_output(self.group, spec, rule)
    }

    /// A pin that tells the driver how to work: faults do not touch it.
    fn switch<T: Value>(&mut self, name: &str, initial: T) -> Result<Output<T>, PinError> {
        let spec = self.spec(name);
        let rule = OutputRule::switch(initial);
        self.pins.add_output(self.group, spec, rule)
    }

    fn inout<T: Value>(&mut self, name: &str) -> Result<InOut<T>, PinError> {
        let spec = self.spec(name);
        let rule = OutputRule::switch(T::default());
        self.pins.add_inout(self.group, spec, rule)
    }

    fn setting<T: Value>(&mut self, name: &str, initial: T) -> Result<Param<T>, PinError> {
        let spec = Spec::new(format!("{}{name}", self.stem));
        self.pins.add_setting(self.group, spec, initial)
    }

    fn property<T: Value>(&mut self, name: &str, initial: T) -> Result<Param<T>, PinError> {
        let spec = Spec::new(format!("{}{name}", self.stem));
        self.pins.add_property(self.group, spec, initial)
    }
}

/// Adds the terminals of something to its pin.
pub(super) fn at_terminals(spec: Spec, terminals: &[Terminal]) -> Spec {
    match terminals {
        [] => spec,
        [one] => spec.at(one.place, one.signal),
        several => {
            let join = |get: fn(&Terminal) -> &'static str| {
                let words: Vec<_> = several.iter().map(get).collect();
                words.join(", ")
            };
            spec.at(join(|t| t.place), join(|t| t.signal))
        }
    }
}
