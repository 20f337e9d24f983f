//! Factory content of a simulated board's flash memory: configurations of a Spartan 6, beside the
//! boot block of its layout. Source: Xilinx UG380, "Configuration Data File Formats".

/// A configuration in the format of a bitfile. The part between its first and its last packets is
/// invented and short.
pub fn configuration(number: u8) -> Vec<u8> {
    let mut bytes = vec![0xFF; 16];
    // Synchronisation word, no operation, reset of the CRC, IDCODE of a 6SLX9.
    bytes.extend([0xAA, 0x99, 0x55, 0x66, 0x20, 0x00, 0x30, 0xA1, 0x00, 0x07]);
    bytes.extend([0x31, 0xC2, 0x04, 0x00, 0x10, 0x93]);
    let body = (0..3000_u32).map(|n| n.wrapping_add(number.into()));
    bytes.extend(body.map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8));
    // DESYNC, and no operation.
    bytes.extend([0x30, 0xA1, 0x00, 0x0D, 0x20, 0x00, 0x20, 0x00]);
    bytes
}
