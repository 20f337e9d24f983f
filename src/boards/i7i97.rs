//! The 7I97: an Ethernet board with six analog outputs and enables, six encoders, 16 isolated
//! inputs with MPGs, six isolated outputs, a serial port and 17 expansion pins.
//!
//! The functions are those of its standard firmware. Custom firmware may use the expansion pins for
//! modules, as its pin descriptors show. Newer firmware may have InM instead of InMux, and OutM
//! instead of SSR.
//!
//! Source: manual 7I97, "TB1 ENCODER 0 THROUGH 2" to "TB5 I/O"; FACTS 9.2.

use alloc::format;

use super::{
    AttachError, BoardHandles, BoardTable, DB25, Finder, FlashLayout, ModuleTerminals, PwmTable,
    i7i76, i7i77,
};
use crate::hal::{
    AnalogOut, Counter, DigitalIn, DigitalOut, Input, Invert, Output, Pins, Terminals,
};
use crate::hostmot2::{Gtag, TickRate};

/// The 7I97.
pub const BOARD: BoardTable = BoardTable {
    name: "7I97",
    // Manual: 7I97, "MAXIMUM ENCODER COUNT RATE".
    encoder_rate: Some(TickRate::MUX_7I97),
    // Manual: 7I97, "SUGGESTED PWM SETUP".
    pwm: PwmTable {
        hz: 48_000,
        // The second one is for the 7I97T, whose clock is 160 MHz.
        hz_dither: &[96_000, 75_000],
        generators: 6,
        full_scale: 10.0,
        unit: "V",
        is_offset: true,
        outputs: ANALOG_AT,
        enables: ENABLES_AT,
        common_enable: &[0, 1, 2, 3],
    },
    terminals: &[
        ModuleTerminals::new(&[Gtag::MUXED_ENCODER], ENCODERS_AT),
        ModuleTerminals::new(&[Gtag::IN_MUX, Gtag::IN_M], INPUTS_AT),
        ModuleTerminals::new(&[Gtag::SSR, Gtag::OUT_M], OUTPUTS_AT),
        ModuleTerminals::new(&[Gtag::IO_PORT], EXPANSION_AT),
        ModuleTerminals::new(&[Gtag::SSERIAL, Gtag::SSERIAL_B], SERIAL_AT),
    ],
    // On P1, with suitable firmware.
    cards: &[&i7i77::CARD, &i7i76::CARD, &i7i76::CARD_MUXED],
    flash: Some(&FlashLayout::I7I97),
};

const ANALOG_AT: &[Terminals] = &[Terminals::new(
    "TB3 pin ",
    0,
    &["AOUT#"],
    &[4, 8, 12, 16, 20, 24],
)];

/// The switches of drives 0 to 3 are one pin of the FPGA, the enable of generator 0.
const ENABLES_AT: &[Terminals] = &[
    Terminals::new(
        "TB3 pin ",
        0,
        &[
            "ENA0-", "ENA0+", "ENA1-", "ENA1+", "ENA2-", "ENA2+", "ENA3-", "ENA3+",
        ],
        &[1, 2, 5, 6, 9, 10, 13, 14],
    ),
    Terminals::new("TB3 pin ", 4, &["ENA#-", "ENA#+"], &[17, 18, 21, 22]),
];

const ENCODERS_AT: &[Terminals] = &[
    Terminals::encoders("TB1 pin ", 0),
    Terminals::encoders("TB2 pin ", 3),
];

const INPUTS_AT: &[Terminals] = &[
    Terminals::new("TB4 pin ", 0, &["IN#"], &[1, 2, 4, 5, 7, 8, 10, 11]),
    Terminals::new("TB5 pin ", 8, &["IN#"], &[1, 2, 4, 5, 7, 8, 10, 11]),
];

const OUTPUTS_AT: &[Terminals] = &[Terminals::new(
    "TB5 pin ",
    0,
    &["OUT#-", "OUT#+"],
    &[13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24],
)];

const EXPANSION_AT: &[Terminals] = &[
    Terminals::new(
        "P1 pin ",
        34,
        &["IO#"],
        &[1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, 15, 17, 19, 21, 23, 25],
    ),
    Terminals::new("DB25 pin ", 34, &["IO#"], &DB25),
];

/// Manual: 7I97, "TB4 ISOLATED INPUT + RS-422 CONNECTOR".
const SERIAL_AT: &[Terminals] = &[Terminals::new(
    "TB4 pin ",
    0,
    &["RX+", "RX-", "TX+", "TX-"],
    &[15, 16, 17, 18],
)];

/// The common terminals of the isolated inputs: number n is shared by inputs 2n and 2n + 1.
pub const INPUT_COMMONS: &[Terminals] = &[
    Terminals::new("TB4 pin ", 0, &["IN COMMON"], &[3, 6, 9, 12]),
    Terminals::new("TB5 pin ", 4, &["IN COMMON"], &[3, 6, 9, 12]),
];

/// The pins of a 7I97's own functions. Remotes on its serial port have separate handles; pins that
/// only this board's firmware has, such as the rates of its modules, are found by name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct I7i97 {
    /// The six encoders.
    pub encoders: [Counter; 6],
    /// AOUT0 to AOUT5, in volts. Each has 0 V while its own `enable` is false; AOUT0 to AOUT3 also
    /// while [`enable_0_to_3`](Self::enable_0_to_3) is false. [`AnalogOut::enable`] switches both.
    pub analog_out: [AnalogOut; 6],
    /// The switches ENA0 to ENA3, which are one output of the FPGA. The output follows generator 0
    /// and is the `enable` of AOUT0. The enables of AOUT1 to AOUT3 have no switch; they only cause
    /// 0 V.
    pub enable_0_to_3: Output<bool>,
    /// The switch ENA4: the `enable` of AOUT4.
    pub enable_4: Output<bool>,
    /// The switch ENA5: the `enable` of AOUT5.
    pub enable_5: Output<bool>,
    /// The 16 isolated inputs, filtered, from InMux or else InM.
    pub inputs: [DigitalIn; 16],
    /// The counts of the MPGs on IN0 to IN7.
    pub mpg_counts: [Input<i32>; 4],
    /// The six isolated outputs, from SSR or else OutM.
    pub outputs: [DigitalOut; 6],
    /// CR01 to CR04.
    pub leds: [Output<bool>; 4],
}

impl BoardHandles for I7i97 {
    const TABLE: &'static BoardTable = &BOARD;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        // The newer module is used only without the usual one: beside that, it has another purpose.
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
