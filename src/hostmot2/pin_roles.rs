//! Names of the pins of each kind of module.
//!
//! Source: FACTS 13.1; the pin constants of Mesa's public VHDL sources (`IDROMConst.vhd`).

use super::Gtag;
use alloc::format;
use alloc::string::{String, ToString};

/// Names of secondary pins.
type Names = &'static [(u8, &'static str)];

/// Ranges of numbered pins: first and last, and the name before the number.
type PinRanges = &'static [(u8, u8, &'static str)];

/// The name of secondary pin `pin` of a module of this kind: `TX0`, `A`, `/Enable`. `None` if no
/// name is known. Numbers count from 0, decimal; `/` marks an output that is active low.
pub(super) fn role(gtag: Gtag, pin: u8) -> Option<String> {
    let (names, numbered) = known(gtag);
    if let Some((_, name)) = names.iter().find(|(number, _)| *number == pin) {
        return Some((*name).to_string());
    }
    let range = numbered
        .iter()
        .find(|(first, last, _)| (*first..=*last).contains(&pin))?;
    let (first, _, stem) = range;
    Some(format!("{stem}{}", pin - first))
}

const ENCODER: Names = &[
    (0x01, "A"),
    (0x02, "B"),
    (0x03, "Index"),
    (0x04, "IndexMask"),
    (0x05, "Probe"),
    // The index of a pair of muxed encoders whose two halves share the line.
    (0x06, "SharedIndex"),
];

/// 09 and 0A are index and probe; older sources have 01 and 02 (FACTS 13.1).
const STEPGEN: Names = &[
    (0x81, "Step"),
    (0x82, "Dir"),
    // The first two outputs of a table are those of step and direction.
    (0x83, "Table2"),
    (0x84, "Table3"),
    (0x85, "Table4"),
    (0x86, "Table5"),
    (0x87, "Table6"),
    (0x88, "Table7"),
    (0x01, "Index"),
    (0x02, "Probe"),
    (0x09, "Index"),
    (0x0A, "Probe"),
];

const SPI: Names = &[(0x81, "Frame"), (0x82, "Out"), (0x83, "Clk"), (0x04, "In")];

const SSERIAL: PinRanges = &[
    (0x01, 0x0F, "RX"),
    (0x81, 0x8F, "TX"),
    (0x91, 0x9F, "TXEN"),
    (0xA1, 0xAF, "/TXEN"),
];

const TRANSMIT: Names = &[(0x81, "TX"), (0x82, "TXEN"), (0x83, "/TXEN")];

const RESOLVER: Names = &[
    (0x81, "PowerEnable"),
    (0x82, "PDM+"),
    (0x83, "PDM-"),
    (0x87, "SPICS"),
    (0x88, "SPIClk"),
    (0x89, "Test"),
];

const SSI: Names = &[
    (0x81, "Clk"),
    (0x82, "ClkEn"),
    (0x03, "Data"),
    (0x84, "DataValid"),
    (0x85, "/ClkEn"),
];

const DPLL: Names = &[
    (0x01, "Sync"),
    (0x82, "MSB"),
    (0x83, "F"),
    (0x84, "Post"),
    (0x85, "SyncToggle"),
];

const THREE_PHASE_PWM: Names = &[
    (0x81, "A"),
    (0x82, "B"),
    (0x83, "C"),
    (0x84, "/A"),
    (0x85, "/B"),
    (0x86, "/C"),
    (0x87, "Enable"),
    (0x08, "Fault"),
];

const BISS: Names = &[
    (0x81, "Clk"),
    (0x82, "ClkEn"),
    (0x03, "Data"),
    (0x84, "DataValid"),
    (0x85, "TestData"),
    (0x86, "SampleTime"),
    (0x87, "/ClkEn"),
];

const FABS: Names = &[
    (0x81, "Request"),
    (0x82, "RequestEn"),
    (0x03, "Data"),
    (0x84, "DataValid"),
    (0x85, "TestClk"),
    (0x86, "/RequestEn"),
];

const HM2DPLL: Names = &[
    (0x01, "Sync"),
    (0x82, "Ref"),
    (0x83, "Timer1"),
    (0x84, "Timer2"),
    (0x85, "Timer3"),
    (0x86, "Timer4"),
];

fn known(gtag: Gtag) -> (Names, PinRanges) {
    match gtag {
        Gtag::ENCODER | Gtag::MUXED_ENCODER | Gtag::MUXED_ENCODER_MIM => (ENCODER, &[]),
        Gtag::STEPGEN => (STEPGEN, &[]),
        Gtag::PWM => (&[(0x81, "Out"), (0x82, "Dir"), (0x83, "/Enable")], &[]),
        Gtag::SPI => (SPI, &[]),
        Gtag::BUFFERED_SPI | Gtag::DECODED_SPI => (SPI, &[(0x85, 0x8C, "CS")]),
        Gtag::SSI => (SSI, &[]),
        Gtag::UART_TX | Gtag::PACKET_UART_TX => (TRANSMIT, &[]),
        Gtag::UART_RX | Gtag::PACKET_UART_RX => (&[(0x01, "RX")], &[]),
        Gtag::MUX_SELECT | Gtag::MUX_SELECT_MIM => (&[], &[(0x81, 0x82, "Select")]),
        Gtag::DPLL => (DPLL, &[]),
        Gtag::THREE_PHASE_PWM => (THREE_PHASE_PWM, &[]),
        Gtag::WAVEGEN => (
            &[(0x81, "PDMA"), (0x82, "PDMB")],
            &[(0x83, 0x86, "Trigger")],
        ),
        Gtag::DAQ_FIFO => (&[(0x41, "Strobe"), (0x81, "Full")], &[(0x01, 0x1F, "Data")]),
        Gtag::BINARY_OSCILLATOR => (&[], &[(0x81, 0x9F, "Out")]),
        Gtag::BISS => (BISS, &[]),
        Gtag::FABS => (FABS, &[]),
        Gtag::HM2DPLL => (HM2DPLL, &[]),
        Gtag::SCALER => (&[(0x01, "A"), (0x02, "B")], &[]),
        _ => known_of_io(gtag),
    }
}

/// Modules of inputs and outputs, and of connections to other circuits.
fn known_of_io(gtag: Gtag) -> (Names, PinRanges) {
    match gtag {
        Gtag::IN_MUX => (&[(0x01, "Data")], &[(0x81, 0x85, "Addr")]),
        Gtag::IN_M => (&[], &[(0x01, 0x20, "In")]),
        Gtag::DATA_PAINTER => (&[(0x81, "Data"), (0x82, "Clk")], &[]),
        Gtag::XY2_MOD => (
            &[
                (0x81, "DataX"),
                (0x82, "DataY"),
                (0x83, "Clk"),
                (0x84, "Sync"),
                (0x05, "Status"),
            ],
            &[],
        ),
        Gtag::RC_PWM => (&[(0x81, "Out")], &[]),
        Gtag::OUT_M => (&[], &[(0x81, 0xA0, "Out")]),
        Gtag::RESOLVER => (RESOLVER, &[(0x84, 0x86, "Channel"), (0x09, 0x0A, "SPIIn")]),
        Gtag::SSERIAL | Gtag::SSERIAL_B => (&[(0xB1, "Test")], SSERIAL),
        Gtag::TWIDDLER => (
            &[],
            &[(0x01, 0x1F, "In"), (0x81, 0x9F, "Out"), (0xC1, 0xDF, "IO")],
        ),
        Gtag::SSR => (&[(0xA0, "ACRef")], &[(0x81, 0x9F, "Out")]),
        Gtag::CP_DRIVE => (&[(0x81, "High"), (0x82, "Low")], &[]),
        Gtag::DSAD => (
            &[(0x90, "PWM")],
            &[
                (0x01, 0x0F, "Compare+"),
                (0x11, 0x1F, "Compare-"),
                (0x81, 0x8F, "Feedback"),
            ],
        ),
        Gtag::ONE_SHOT => (
            &[
                (0x01, "Trigger1"),
                (0x02, "Trigger2"),
                (0x83, "Out1"),
                (0x84, "Out2"),
            ],
            &[],
        ),
        Gtag::PERIOD => (&[(0x01, "In")], &[]),
        _ => (&[], &[]),
    }
}
