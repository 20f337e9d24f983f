//! Factory content of a simulated board's flash memory: a boot block and configurations of a
//! Spartan
//! 6. Source: Xilinx UG380, "Configuration Data File Formats" and "Configuration Registers".

use mesa_hal::boards::FlashLayout;

/// Synchronisation word.
const SYNC: [u16; 2] = [0xAA99, 0x5566];
const NO_OPERATION: u16 = 0x2000;

/// Configuration registers.
const CMD: u16 = 0x05;
const CWDT: u16 = 0x0F;
const HC_OPT: u16 = 0x10;
const GENERAL1: u16 = 0x13;
const GENERAL2: u16 = 0x14;
const GENERAL3: u16 = 0x15;
const GENERAL4: u16 = 0x16;
const MODE: u16 = 0x18;

/// Values of CMD.
const NULL: u16 = 0x00;
const IPROG: u16 = 0x0E;

/// Fast read command of the flash memory.
const FAST_READ: u32 = 0x0B;

/// Page size of the flash memory.
const PAGE: usize = 256;

/// A boot block, which makes the FPGA load the user configuration, and the fallback if that cannot
/// be loaded. These are the bytes that mesaflash expects in the first page (FACTS 10.2).
pub fn boot_block(layout: &FlashLayout) -> Vec<u8> {
    let [user, fallback] = [layout.user.0, layout.fallback.0].map(|address| {
        let high = FAST_READ << 8 | address >> 16;
        (address as u16, high as u16)
    });
    let mut words = vec![0xFFFF; 5];
    words.extend(SYNC);
    for (register, value) in [
        (CWDT, 0xFFFF),
        (GENERAL1, user.0),
        (GENERAL2, user.1),
        (GENERAL3, fallback.0),
        (GENERAL4, fallback.1),
        (CMD, NULL),
        (MODE, 0x2100),
        (HC_OPT, 0x001F),
        (CMD, IPROG),
    ] {
        words.extend(write(register, value));
    }
    words.extend([NO_OPERATION; 7]);
    let mut bytes: Vec<u8> = words.into_iter().flat_map(u16::to_be_bytes).collect();
    bytes.resize(PAGE, 0);
    bytes
}

/// A packet that writes a word to a configuration register.
const fn write(register: u16, value: u16) -> [u16; 2] {
    [0x3001 | register << 5, value]
}

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
