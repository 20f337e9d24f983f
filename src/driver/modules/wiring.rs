//! Where the modules of a firmware are connected: what the boards' tables know.

use crate::boards::fpga::PwmUse;
use crate::boards::{Terminal, i7i77, i7i97};
use crate::hostmot2::{Gtag, HostMot2, TickRate};

/// The board whose tables apply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wiring {
    /// Everything is on the board itself.
    I7i97,
    /// A board with connectors for cards.
    Connectors,
}

impl Wiring {
    pub fn of(firmware: &HostMot2) -> Self {
        if i7i97::is_firmware_of(firmware) {
            Self::I7i97
        } else {
            Self::Connectors
        }
    }

    /// The multiplexer rate that the board is made for (manuals: 7I77 and 7I97, "MAXIMUM ENCODER
    /// COUNT RATE").
    pub const fn mux_rate(self) -> TickRate {
        match self {
            Self::I7i97 => TickRate::MUX_7I97,
            Self::Connectors => TickRate::MUX_7I77,
        }
    }

    /// The terminals of an encoder: those of the board, or of the card whose pins it has.
    pub fn encoder(self, firmware: &HostMot2, number: usize) -> &'static [Terminal] {
        let terminals = match self {
            Self::I7i97 => i7i97::ENCODER_TERMINALS.get(number),
            Self::Connectors => i7i77::encoder_of_card(firmware, number)
                .and_then(|encoder| i7i77::ENCODER_TERMINALS.get(encoder)),
        };
        terminals.copied().unwrap_or(&[])
    }

    pub fn pwm(self, number: usize) -> PwmUse {
        match self {
            Self::I7i97 => i7i97::analog_use(number),
            Self::Connectors => PwmUse {
                scale: 1.0,
                ..PwmUse::default()
            },
        }
    }

    /// The usual PWM frequency: a generator that dithers keeps its resolution at twice the rate
    /// (manual: 7I97, "SUGGESTED PWM SETUP"); elsewhere LinuxCNC's.
    pub const fn pwm_hz(self, dithers: bool) -> u32 {
        match (self, dithers) {
            (Self::I7i97, true) => i7i97::PWM_HZ_DITHER,
            (Self::I7i97, false) => i7i97::PWM_HZ,
            (Self::Connectors, _) => 20_000,
        }
    }

    /// The terminals of an input module, if it is the one at the isolated inputs.
    pub fn inputs(self, firmware: &HostMot2, module: (Gtag, u8)) -> &'static [Terminal] {
        match self {
            Self::I7i97 if module == (i7i97::input_module(firmware), 0) => i7i97::INPUT_TERMINALS,
            _ => &[],
        }
    }

    /// The terminals of an output module, by output, if it is the one at the isolated outputs.
    pub fn outputs(
        self,
        firmware: &HostMot2,
        module: (Gtag, u8),
    ) -> &'static [&'static [Terminal]] {
        match self {
            Self::I7i97 if module == (i7i97::output_module(firmware), 0) => {
                &i7i97::OUTPUT_TERMINALS
            }
            _ => &[],
        }
    }

    /// The terminals of I/O pin `number`.
    pub fn io(self, number: usize) -> &'static [Terminal] {
        match self {
            Self::I7i97 => i7i97::expansion_terminals(number),
            Self::Connectors => &[],
        }
    }
}
