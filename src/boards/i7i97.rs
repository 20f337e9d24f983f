//! The 7I97: an Ethernet board with six analog outputs and enables, six encoders, 16 isolated
//! inputs with MPGs, six isolated outputs, a serial port and 17 expansion pins.
//!
//! The functions are those of its standard firmware. Custom firmware may use the expansion pins for
//! modules: its pin descriptors tell. Newer firmware may have InM for InMux, and OutM for SSR.
//!
//! Source: manual 7I97, "TB1 ENCODER 0 THROUGH 2" to "TB5 I/O"; FACTS 9.2.

use alloc::format;

use super::table::terminals;
use super::{
    AttachError, BoardHandles, BoardTable, Finder, FlashLayout, ModuleTerminals, PwmTable,
    Terminal, Terminals,
};
use crate::hal::{AnalogOut, Counter, DigitalIn, DigitalOut, Input, Invert, Output, Pins};
use crate::hostmot2::{Gtag, HostMot2, TickRate};

/// The 7I97.
pub const BOARD: BoardTable = BoardTable {
    name: "7I97",
    // Manual: 7I97, "MAXIMUM ENCODER COUNT RATE".
    encoder_rate: TickRate::MUX_7I97,
    // Manual: 7I97, "SUGGESTED PWM SETUP".
    pwm: PwmTable {
        hz: 48_000,
        hz_dither: 96_000,
        full_scale: 10.0,
        unit: "V",
        is_offset: true,
        outputs: ANALOG_AT,
        enables: ENABLES_AT,
        common_enable: &[0, 1, 2, 3],
    },
    terminals: &[
        ModuleTerminals {
            modules: &[Gtag::MUXED_ENCODER],
            terminals: ENCODERS_AT,
        },
        ModuleTerminals {
            modules: &[Gtag::IN_MUX, Gtag::IN_M],
            terminals: INPUTS_AT,
        },
        ModuleTerminals {
            modules: &[Gtag::SSR, Gtag::OUT_M],
            terminals: OUTPUTS_AT,
        },
        ModuleTerminals {
            modules: &[Gtag::IO_PORT],
            terminals: EXPANSION_AT,
        },
        // Manual: 7I97, "TB4 ISOLATED INPUT + RS-422 CONNECTOR".
        ModuleTerminals {
            modules: &[Gtag::SSERIAL, Gtag::SSERIAL_B],
            terminals: SERIAL_AT,
        },
    ],
    cards: &[],
    flash: Some(&FlashLayout::I7I97),
};

const ANALOG_AT: &[Terminals] = &[Terminals {
    connector: "TB3 pin ",
    first: 0,
    signals: &["AOUT#"],
    pins: &[4, 8, 12, 16, 20, 24],
}];

/// The switches of drives 0 to 3 are one pin of the FPGA, the enable of generator 0.
const ENABLES_AT: &[Terminals] = &[
    Terminals {
        connector: "TB3 pin ",
        first: 0,
        signals: &[
            "ENA0-", "ENA0+", "ENA1-", "ENA1+", "ENA2-", "ENA2+", "ENA3-", "ENA3+",
        ],
        pins: &[1, 2, 5, 6, 9, 10, 13, 14],
    },
    Terminals {
        connector: "TB3 pin ",
        first: 4,
        signals: &["ENA#-", "ENA#+"],
        pins: &[17, 18, 21, 22],
    },
];

const ENCODERS_AT: &[Terminals] = &[
    Terminals::encoders("TB1 pin ", 0),
    Terminals::encoders("TB2 pin ", 3),
];

const INPUTS_AT: &[Terminals] = &[
    Terminals {
        connector: "TB4 pin ",
        first: 0,
        signals: &["IN#"],
        pins: &[1, 2, 4, 5, 7, 8, 10, 11],
    },
    Terminals {
        connector: "TB5 pin ",
        first: 8,
        signals: &["IN#"],
        pins: &[1, 2, 4, 5, 7, 8, 10, 11],
    },
];

const OUTPUTS_AT: &[Terminals] = &[Terminals {
    connector: "TB5 pin ",
    first: 0,
    signals: &["OUT#-", "OUT#+"],
    pins: &[13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24],
}];

const EXPANSION_AT: &[Terminals] = &[
    Terminals {
        connector: "P1 pin ",
        first: 34,
        signals: &["IO#"],
        pins: &[1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, 15, 17, 19, 21, 23, 25],
    },
    Terminals {
        connector: "DB25 pin ",
        first: 34,
        signals: &["IO#"],
        pins: &[1, 14, 2, 15, 3, 16, 4, 17, 5, 6, 7, 8, 9, 10, 11, 12, 13],
    },
];

const SERIAL_AT: &[Terminals] = &[Terminals {
    connector: "TB4 pin ",
    first: 0,
    signals: &["RX+", "RX-", "TX+", "TX-"],
    pins: &[15, 16, 17, 18],
}];

/// The terminals of the six analog outputs.
pub const ANALOG_TERMINALS: [&[Terminal]; 6] = [
    terminals!["TB3 pin 4" "AOUT0"],
    terminals!["TB3 pin 8" "AOUT1"],
    terminals!["TB3 pin 12" "AOUT2"],
    terminals!["TB3 pin 16" "AOUT3"],
    terminals!["TB3 pin 20" "AOUT4"],
    terminals!["TB3 pin 24" "AOUT5"],
];

/// The terminals of the six enable switches. ENA0 to ENA3 switch together.
pub const ENABLE_TERMINALS: [&[Terminal]; 6] = [
    terminals!["TB3 pin 1" "ENA0-", "TB3 pin 2" "ENA0+"],
    terminals!["TB3 pin 5" "ENA1-", "TB3 pin 6" "ENA1+"],
    terminals!["TB3 pin 9" "ENA2-", "TB3 pin 10" "ENA2+"],
    terminals!["TB3 pin 13" "ENA3-", "TB3 pin 14" "ENA3+"],
    terminals!["TB3 pin 17" "ENA4-", "TB3 pin 18" "ENA4+"],
    terminals!["TB3 pin 21" "ENA5-", "TB3 pin 22" "ENA5+"],
];

/// The terminals of the six encoders, A, B and index of each.
pub const ENCODER_TERMINALS: [&[Terminal]; 6] = [
    terminals!["TB1 pin 1" "QA0", "TB1 pin 2" "/QA0", "TB1 pin 4" "QB0", "TB1 pin 5" "/QB0", "TB1 pin 7" "IDX0", "TB1 pin 8" "/IDX0"],
    terminals!["TB1 pin 9" "QA1", "TB1 pin 10" "/QA1", "TB1 pin 12" "QB1", "TB1 pin 13" "/QB1", "TB1 pin 15" "IDX1", "TB1 pin 16" "/IDX1"],
    terminals!["TB1 pin 17" "QA2", "TB1 pin 18" "/QA2", "TB1 pin 20" "QB2", "TB1 pin 21" "/QB2", "TB1 pin 23" "IDX2", "TB1 pin 24" "/IDX2"],
    terminals!["TB2 pin 1" "QA3", "TB2 pin 2" "/QA3", "TB2 pin 4" "QB3", "TB2 pin 5" "/QB3", "TB2 pin 7" "IDX3", "TB2 pin 8" "/IDX3"],
    terminals!["TB2 pin 9" "QA4", "TB2 pin 10" "/QA4", "TB2 pin 12" "QB4", "TB2 pin 13" "/QB4", "TB2 pin 15" "IDX4", "TB2 pin 16" "/IDX4"],
    terminals!["TB2 pin 17" "QA5", "TB2 pin 18" "/QA5", "TB2 pin 20" "QB5", "TB2 pin 21" "/QB5", "TB2 pin 23" "IDX5", "TB2 pin 24" "/IDX5"],
];

/// The terminals of the 16 isolated inputs.
pub const INPUT_TERMINALS: &[Terminal] = terminals![
    "TB4 pin 1" "IN0", "TB4 pin 2" "IN1", "TB4 pin 4" "IN2", "TB4 pin 5" "IN3", "TB4 pin 7" "IN4", "TB4 pin 8" "IN5", "TB4 pin 10" "IN6", "TB4 pin 11" "IN7", "TB5 pin 1" "IN8", "TB5 pin 2" "IN9", "TB5 pin 4" "IN10", "TB5 pin 5" "IN11", "TB5 pin 7" "IN12", "TB5 pin 8" "IN13", "TB5 pin 10" "IN14", "TB5 pin 11" "IN15"
];

/// The common terminals of the isolated inputs: each is shared by two inputs.
pub const INPUT_COMMONS: &[Terminal] = terminals![
    "TB4 pin 3" "IN COMMON 0,1", "TB4 pin 6" "IN COMMON 2,3", "TB4 pin 9" "IN COMMON 4,5", "TB4 pin 12" "IN COMMON 6,7", "TB5 pin 3" "IN COMMON 8,9", "TB5 pin 6" "IN COMMON 10,11", "TB5 pin 9" "IN COMMON 12,13", "TB5 pin 12" "IN COMMON 14,15"
];

/// The terminals of the six isolated outputs.
pub const OUTPUT_TERMINALS: [&[Terminal]; 6] = [
    terminals!["TB5 pin 13" "OUT0-", "TB5 pin 14" "OUT0+"],
    terminals!["TB5 pin 15" "OUT1-", "TB5 pin 16" "OUT1+"],
    terminals!["TB5 pin 17" "OUT2-", "TB5 pin 18" "OUT2+"],
    terminals!["TB5 pin 19" "OUT3-", "TB5 pin 20" "OUT3+"],
    terminals!["TB5 pin 21" "OUT4-", "TB5 pin 22" "OUT4+"],
    terminals!["TB5 pin 23" "OUT5-", "TB5 pin 24" "OUT5+"],
];

/// The expansion pins, I/O 34 to 50.
pub const EXPANSION: &[Terminal] = terminals![
    "P1 pin 1, DB25 pin 1" "IO34", "P1 pin 2, DB25 pin 14" "IO35", "P1 pin 3, DB25 pin 2" "IO36", "P1 pin 4, DB25 pin 15" "IO37", "P1 pin 5, DB25 pin 3" "IO38", "P1 pin 6, DB25 pin 16" "IO39", "P1 pin 7, DB25 pin 4" "IO40", "P1 pin 8, DB25 pin 17" "IO41", "P1 pin 9, DB25 pin 5" "IO42", "P1 pin 11, DB25 pin 6" "IO43", "P1 pin 13, DB25 pin 7" "IO44", "P1 pin 15, DB25 pin 8" "IO45", "P1 pin 17, DB25 pin 9" "IO46", "P1 pin 19, DB25 pin 10" "IO47", "P1 pin 21, DB25 pin 11" "IO48", "P1 pin 23, DB25 pin 12" "IO49", "P1 pin 25, DB25 pin 13" "IO50"
];

/// The first I/O pin of the expansion connector.
pub const FIRST_EXPANSION_PIN: usize = 34;

/// Full scale of the analog outputs in volts.
pub const FULL_SCALE: f64 = 10.0;

/// The rate at which the encoders are multiplexed: ClockLow/16.
/// Manual: 7I97, "MAXIMUM ENCODER COUNT RATE".
pub const ENCODER_HZ: u32 = 6_250_000;

/// The PWM frequency of the analog outputs: the manual allows 48 or 96 kHz.
pub const PWM_HZ: u32 = 48_000;

/// The same for firmware whose generators dither.
/// Manual: 7I97, "SUGGESTED PWM SETUP".
pub const PWM_HZ_DITHER: u32 = 96_000;

/// The terminals of the serial port's first channel.
/// Manual: 7I97, "TB4 ISOLATED INPUT + RS-422 CONNECTOR".
pub const SERIAL_TERMINALS: &[Terminal] = terminals![
    "TB4 pin 15" "RX+", "TB4 pin 16" "RX-", "TB4 pin 17" "TX+", "TB4 pin 18" "TX-"
];

/// Whether a firmware says that it is for a 7I97.
pub fn is_firmware_of(firmware: &HostMot2) -> bool {
    firmware.idrom().board_name.0.ends_with(b"7I97")
}

/// The terminal of an isolated input's common.
pub fn input_common(input: usize) -> Option<&'static Terminal> {
    INPUT_COMMONS.get(input / 2)
}

/// The pins of a 7I97's own functions. Remotes on its serial port have handles of their own; pins
/// that only this board's firmware has, such as the rates of its modules, are found by name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct I7i97 {
    /// The six encoders.
    pub encoders: [Counter; 6],
    /// AOUT0 to AOUT5, in volts. Each has 0 V while its own `enable` is false; AOUT0 to AOUT3 also
    /// while [`enable_0_to_3`](Self::enable_0_to_3) is.
    pub analog_out: [AnalogOut; 6],
    /// The switches ENA0 to ENA3, which are one output of the FPGA. It follows generator 0: this is
    /// the `enable` of AOUT0. Those of AOUT1 to AOUT3 have no switch, they only make 0 V.
    pub enable_0_to_3: Output<bool>,
    /// The switch ENA4: the `enable` of AOUT4.
    pub enable_4: Output<bool>,
    /// The switch ENA5: the `enable` of AOUT5.
    pub enable_5: Output<bool>,
    /// The 16 isolated inputs, filtered, of InMux or else InM.
    pub inputs: [DigitalIn; 16],
    /// The counts of the MPGs on IN0 to IN7.
    pub mpg_counts: [Input<i32>; 4],
    /// The six isolated outputs, of SSR or else OutM.
    pub outputs: [DigitalOut; 6],
    /// CR01 to CR04.
    pub leds: [Output<bool>; 4],
}

impl BoardHandles for I7i97 {
    const TABLE: &'static BoardTable = &BOARD;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        // The newer module only where the usual one is not: beside it, it is for something else.
        let either = |usual: &'static str, newer: &'static str, pin: &str| {
            let is_there = |module| pins.has(&format!("{module}.00.{pin}"));
            if !is_there(usual) && is_there(newer) {
                newer
            } else {
                usual
            }
        };
        let inputs = either("inmux", "inm", "input-00");
        let outputs = either("ssr", "outm", "out-00");
        let analog_out: [AnalogOut; 6] = pins.each(|n| {
            let pin = |name: &str| format!("pwmgen.{n:02}.{name}");
            Ok(AnalogOut {
                volts: pins.one(&pin("value"), Pins::output)?,
                enable: pins.one(&pin("enable"), Pins::output)?,
                full_scale: pins.one(&pin("scale"), Pins::parameter)?,
                ..AnalogOut::default()
            })
        })?;
        let [enable_0_to_3, _, _, _, enable_4, enable_5] = analog_out.map(|output| output.enable);
        Ok(Self {
            encoders: pins.numbered("encoder.", Counter::find)?,
            analog_out,
            enable_0_to_3,
            enable_4,
            enable_5,
            inputs: pins.numbered(&format!("{inputs}.00.input-"), DigitalIn::find)?,
            mpg_counts: pins
                .each(|n| pins.one(&format!("{inputs}.00.enc{n}-count"), Pins::input))?,
            outputs: pins.each(|n| {
                let pin = |name: &str| format!("{outputs}.00.{name}-{n:02}");
                Ok(DigitalOut {
                    pin: pins.one(&pin("out"), Pins::output)?,
                    invert: Some(Invert::Pin(pins.one(&pin("invert"), Pins::output)?)),
                })
            })?,
            leds: pins.each(|n| pins.one(&format!("led.CR{:02}", n + 1), Pins::output))?,
        })
    }
}
