//! The host's side of a port: its registers, with separate in and out sides.

use super::{MAX_CHANNELS, MAX_INTERFACE_REGISTERS};
use crate::wire::Nanos;

/// A 32-bit register of a port, as the host sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Register {
    /// COMMAND, one for the port.
    Command,
    /// DATA, one for the port.
    Data,
    /// CS of a channel.
    Cs(u8),
    /// Interface register `.1` of channel `.0`.
    Interface(u8, u8),
}

/// Bit 31 of a COMMAND write: the write is ignored. FACTS 2.2.
const WRITE_IGNORE: u32 = 0x8000_0000;
/// Time after a clear of COMMAND in which its writes are lost. FACTS 3.4.
const SWALLOWED: Nanos = 20;

const BANK: usize = MAX_INTERFACE_REGISTERS + 1;

/// The register file between host and firmware. Register 0 of a channel is CS.
#[derive(Clone, Debug)]
pub(super) struct HostRegisters {
    command: u16,
    written_at: Nanos,
    /// The last two times at which the firmware cleared COMMAND: the effect of a step can be
    /// slightly in the future.
    cleared_at: [Option<Nanos>; 2],
    /// Set by a COMMAND write until the firmware polls it.
    pub doorbell: bool,
    /// Last host write to DATA.
    pub data_in: u8,
    /// Host reads of DATA: the value before a change, the value after it, and its time.
    data_before: u8,
    data_out: u8,
    data_at: Nanos,
    inward: [[u32; BANK]; MAX_CHANNELS],
    outward: [[u32; BANK]; MAX_CHANNELS],
    /// The last change of a CS: its channel, the value before it, and its time.
    cs_change: (usize, u32, Nanos),
}

impl HostRegisters {
    /// All registers zero.
    pub fn new() -> Self {
        Self {
            command: 0,
            written_at: 0,
            cleared_at: [None; 2],
            doorbell: false,
            data_in: 0,
            data_before: 0,
            data_out: 0,
            data_at: 0,
            inward: [[0; BANK]; MAX_CHANNELS],
            outward: [[0; BANK]; MAX_CHANNELS],
            cs_change: (0, 0, 0),
        }
    }

    /// Value of COMMAND at `now`.
    pub fn command(&self, now: Nanos) -> u16 {
        let gone =
            self.cleared_at.iter().flatten().any(|&cleared| {
                now >= cleared && self.written_at < cleared.saturating_add(SWALLOWED)
            });
        if gone { 0 } else { self.command }
    }

    /// Time of the next change of COMMAND, DATA or CS that the firmware has already decided.
    pub fn next_change(&self, now: Nanos) -> Option<Nanos> {
        let [last, before] = self.cleared_at;
        let (_, _, cs) = self.cs_change;
        [last, before, Some(self.data_at), Some(cs)]
            .into_iter()
            .flatten()
            .filter(|&at| at > now)
            .min()
    }

    /// Host write to COMMAND; `false` if it was ignored.
    pub fn write_command(&mut self, now: Nanos, value: u32) -> bool {
        if value & WRITE_IGNORE != 0 {
            return false;
        }
        self.command = value as u16;
        self.written_at = now;
        self.doorbell = true;
        true
    }

    /// Clears COMMAND at `at`, by the firmware.
    pub fn clear_command(&mut self, at: Nanos) {
        let [last, _] = self.cleared_at;
        self.cleared_at = [Some(at), last];
    }

    /// Value of DATA at `now`.
    pub fn data(&self, now: Nanos) -> u8 {
        if now < self.data_at {
            self.data_before
        } else {
            self.data_out
        }
    }

    /// Sets DATA at `at`, by the firmware.
    pub fn set_data(&mut self, at: Nanos, value: u8) {
        self.data_before = self.data_out;
        self.data_out = value;
        self.data_at = at;
    }

    /// Host write to a channel's register (0 is CS).
    pub fn write_inward(&mut self, channel: u8, register: usize, value: u32) {
        if let Some(slot) = slot(&mut self.inward, usize::from(channel), register) {
            *slot = value;
        }
    }

    /// The last host write to a channel's register.
    pub fn inward(&self, channel: usize, register: usize) -> u32 {
        self.inward
            .get(channel)
            .and_then(|bank| bank.get(register))
            .copied()
            .unwrap_or(0)
    }

    /// The value that host reads of a channel's CS return at `now`.
    pub fn cs(&self, now: Nanos, channel: usize) -> u32 {
        let (changed, before, at) = self.cs_change;
        if changed == channel && now < at {
            before
        } else {
            self.outward(channel, 0)
        }
    }

    /// Sets the value that host reads of a channel's CS return from `at` on, by the firmware. The
    /// changes of different channels are in the order of their times.
    pub fn set_cs(&mut self, at: Nanos, channel: usize, value: u32) {
        self.cs_change = (channel, self.outward(channel, 0), at);
        self.set_outward(channel, 0, value);
    }

    /// The value that host reads of a channel's register return.
    pub fn outward(&self, channel: usize, register: usize) -> u32 {
        self.outward
            .get(channel)
            .and_then(|bank| bank.get(register))
            .copied()
            .unwrap_or(0)
    }

    /// Sets the value that host reads of a channel's register return.
    pub fn set_outward(&mut self, channel: usize, register: usize, value: u32) {
        if let Some(slot) = slot(&mut self.outward, channel, register) {
            *slot = value;
        }
    }

    /// Sets all interface registers of a channel from process data, the least significant byte
    /// first; registers beyond `data` become zero.
    pub fn set_interface(&mut self, channel: usize, registers: usize, data: &[u8]) {
        for register in 0..registers {
            let mut word = [0; 4];
            for (byte, &value) in word.iter_mut().zip(data.iter().skip(4 * register)) {
                *byte = value;
            }
            self.set_outward(channel, register + 1, u32::from_le_bytes(word));
        }
    }
}

fn slot(
    bank: &mut [[u32; BANK]; MAX_CHANNELS],
    channel: usize,
    register: usize,
) -> Option<&mut u32> {
    bank.get_mut(channel)?.get_mut(register)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn host_registers_keep_written_and_read_words_apart() {
        let mut registers = HostRegisters::new();
        registers.write_inward(2, 1, 0x1234_5678);
        assert_eq!(registers.outward(2, 1), 0);
        assert_eq!(registers.inward(2, 1), 0x1234_5678);
        registers.set_outward(2, 1, 7);
        assert_eq!(registers.inward(2, 1), 0x1234_5678);
    }

    #[test]
    fn command_keeps_sixteen_bits_and_ignores_writes_with_bit_31() {
        let mut registers = HostRegisters::new();
        assert!(registers.write_command(0, 0x7FFF_1001));
        assert_eq!(registers.command(0), 0x1001);
        registers.doorbell = false;
        assert!(!registers.write_command(0, 0x8000_0800));
        assert_eq!(registers.command(0), 0x1001);
        assert!(!registers.doorbell);
    }

    #[test]
    fn write_directly_after_the_clearing_is_swallowed() {
        let mut registers = HostRegisters::new();
        registers.write_command(0, 0x1001);
        registers.clear_command(1_000);
        assert_eq!(registers.command(999), 0x1001);
        registers.write_command(1_010, 0x1002);
        assert_eq!(registers.command(1_010), 0);
        registers.write_command(1_020, 0x1002);
        assert_eq!(registers.command(1_020), 0x1002);
    }
}
