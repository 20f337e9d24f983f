//! The program of a remote in its flash memory, and the bootloader that starts it.

use crc::{CRC_32_ISO_HDLC, Crc, Table};

use super::SimFlash;

/// log2 of the size of an erase block and of a write block.
pub(super) const LOG2_ERASE: u8 = 12;
pub(super) const LOG2_WRITE: u8 = 8;

/// Bytes of the flash memory.
pub(super) const SIZE: usize = 0x8000;

/// Start of a program: after the block of the bootloader.
const START: usize = 1 << LOG2_ERASE;

/// Length of a simulated remote's factory program in bytes.
const FACTORY: usize = 6000;

/// First bytes of a simulated program.
const MAGIC: [u8; 4] = *b"PROG";

/// Bytes before the body: magic, name of the card, revision, three unused, length and CRC of the
/// body.
const HEADER: usize = 20;

const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// A firmware file for a simulated remote: an image of its flash memory from offset 0 on, with a
/// header that the bootloader checks before it starts a program. Real files have no such header, or
/// a different one.
///
/// `body` is the length of the program; `revision` is the value of D5 while it runs.
pub fn firmware_file(card: [u8; 4], revision: u8, body: usize) -> Vec<u8> {
    let noise = |mut state: u32, bytes: usize| -> Vec<u8> {
        let next = |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        (0..bytes).map(next).collect()
    };
    let card_noise = u32::from_le_bytes(card);
    // Placeholder for the bootloader: every file for a card contains it, and it is never written.
    let mut file = noise(card_noise, START);
    let body = noise(card_noise ^ u32::from(revision) << 8, body);
    file.extend(MAGIC);
    file.extend(card);
    file.extend([revision, 0, 0, 0]);
    file.extend((body.len() as u32).to_le_bytes());
    file.extend(CRC.checksum(&body).to_le_bytes());
    file.extend(body);
    file
}

/// A flash memory in factory state.
pub(super) fn factory(card: [u8; 4], revision: u8) -> SimFlash {
    let mut flash = SimFlash::new(SIZE, LOG2_ERASE, LOG2_WRITE);
    flash.load(&firmware_file(card, revision, FACTORY));
    flash
}

/// The revision of a valid program for this card; `None`: the bootloader does not start one.
pub(super) fn revision(flash: &SimFlash, card: [u8; 4]) -> Option<u8> {
    let program = flash.cells().get(START..)?;
    let (header, body) = program.split_at_checked(HEADER)?;
    let word = |at: usize| -> Option<[u8; 4]> { header.get(at..at + 4)?.try_into().ok() };
    let length = u32::from_le_bytes(word(12)?);
    let crc = u32::from_le_bytes(word(16)?);
    let body = body.get(..usize::try_from(length).ok()?)?;
    let is_whole = word(0)? == MAGIC && word(4)? == card && CRC.checksum(body) == crc;
    word(8).filter(|_| is_whole).map(|word| word[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bootloader_starts_only_a_complete_program_for_its_card() {
        let card = *b"7I77";
        assert_eq!(revision(&factory(card, 14), card), Some(14));
        assert_eq!(revision(&factory(*b"7I72", 14), card), None);
        let mut file = firmware_file(card, 15, 3000);
        let mut flash = SimFlash::new(SIZE, LOG2_ERASE, LOG2_WRITE);
        flash.load(&file);
        assert_eq!(revision(&flash, card), Some(15));
        let last = file.len() - 1;
        file[last] ^= 1;
        flash.load(&file);
        assert_eq!(revision(&flash, card), None);
    }
}
