//! Baud rates of a card in operate mode.

/// Name of the parameter with the index of a card's baud rate in operate mode.
pub const BAUD_RATE_PARAMETER: &str = "NVBaudRate";

/// The highest index of a baud rate.
pub(super) const HIGHEST_INDEX: u8 = 11;

/// The baud rate in operate mode for a value of [`BAUD_RATE_PARAMETER`], 0 to 11; `None` for
/// others.
///
/// The value is used from the next power-up on. Cards are delivered with 9, 2.5 Mbaud, the rate at
/// which an FPGA starts its serial ports. In setup mode a card has 115200 baud whatever the value
/// is.
///
/// Manual: 7I77, "OPERATE MODE BAUD RATE".
pub const fn operate_baud_rate(index: u64) -> Option<u32> {
    Some(match index {
        0 => 9_600,
        1 => 19_200,
        2 => 38_400,
        3 => 57_600,
        4 => 115_200,
        5 => 230_400,
        6 => 460_800,
        7 => 921_600,
        8 => 1_250_000,
        9 => 2_500_000,
        10 => 5_000_000,
        11 => 10_000_000,
        _ => return None,
    })
}
