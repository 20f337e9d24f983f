//! Frames on the wire: sending with CRC, receiving, and counting errors.

use super::firmware::Firmware;
use super::memory::{channel, global};
use super::state::{self, error, status};
use super::{timing, uart};
use mesa_wire::lbp::crc8;

/// The longest frame: a command, 28 characters and a CRC.
const MAX_FRAME: usize = 32;

impl Firmware {
    /// Sends `bytes` and their CRC, and continues with `next`; `more` is the cost of this frame
    /// beyond that of a single command.
    ///
    /// Waiting characters are extra: they are counted, and the FIFO is cleared. Immediately
    /// afterwards the firmware checks bit 0 of the FIFO's count: a character that completed since
    /// the clear, or since the first check if none was waiting, is an overrun (FACTS 11.8).
    pub(super) fn send(&mut self, index: usize, bytes: &[u8], next: u8, more: u64) {
        self.wait_for_transmitter(index);
        let (until_look, rest) = timing::SEND_BEFORE;
        let (until_branch, until_second_look) = timing::SEND_LOOKS;
        self.spend(until_look);
        let has_extra = self.waiting_characters(index) != 0;
        self.spend(until_branch);
        if has_extra {
            self.count_error(index, channel::EXTRA_CHARACTERS, error::EXTRA_CHARACTER);
        } else {
            self.spend(until_second_look);
        }
        if self.waiting_characters(index) & 1 == 1 {
            self.count_error(index, channel::OVERRUNS, error::OVERRUN);
        }
        self.spend(rest);
        let mut frame = [0; MAX_FRAME];
        let mut length = 0;
        for (slot, &byte) in frame.iter_mut().zip(bytes) {
            *slot = byte;
            length += 1;
        }
        if self.memory.channel(index, channel::DISABLE_CRC) == 0
            && let Some(slot) = frame.get_mut(length)
        {
            *slot = crc8(bytes);
            length += 1;
        }
        let start = self.clock.nanos(self.cycle + timing::SEND_START);
        let capacity = Self::fifo_capacity(self.config);
        if let (Some(uart), Some(frame)) = (self.uarts.get_mut(index), frame.get(..length)) {
            if uart.rate.bit() == 0 {
                uart.stuck = true;
            } else {
                let gap = self.clock.nanos(timing::CHARACTER_GAP);
                uart.transmitter
                    .send(start, uart.rate, gap, frame, capacity);
                self.has_sent = true;
            }
        }
        self.spend(more + timing::SEND_END);
        self.start_timer(index);
        self.spend(timing::SEND_AFTER);
        self.go_to(index, next);
    }

    fn waiting_characters(&mut self, index: usize) -> usize {
        let now = self.now();
        let uart = self.uarts.get_mut(index);
        uart.map_or(0, |uart| uart.receiver.count(now))
    }

    /// Waits for the transmit FIFO to empty; the firmware does nothing else meanwhile.
    fn wait_for_transmitter(&mut self, index: usize) {
        let now = self.now();
        let Some(uart) = self.uarts.get(index) else {
            return;
        };
        if uart.stuck {
            self.hang();
        } else if let Some(empty) = uart.transmitter.fifo_empty_after(now) {
            self.cycle = self.cycle.max(self.clock.cycle_at(empty));
        }
    }

    /// Takes a reply of `size` characters and its CRC; false if it is incomplete or invalid.
    pub(super) fn receive(&mut self, index: usize, size: u8) -> bool {
        let crc = self.memory.channel(index, channel::DISABLE_CRC) == 0;
        let wanted = usize::from(size) + usize::from(crc);
        if wanted == 0 {
            return true;
        }
        self.spend(timing::RECEIVE_LOOK);
        let now = self.now();
        let Some(uart) = self.uarts.get_mut(index) else {
            return false;
        };
        let receiver = &mut uart.receiver;
        if receiver.count(now) < wanted {
            self.spend(timing::RECEIVE_NOTHING);
            return false;
        }
        self.cycle += match u64::from(size) {
            0 => timing::RECEIVE_CRC,
            size => timing::RECEIVE + timing::RECEIVE_CHARACTER * size,
        };
        if receiver.flags(now) & uart::BREAK != 0 {
            self.count_error(index, channel::BREAKS, error::BREAK);
            return false;
        }
        let mut reply = [0; MAX_FRAME];
        for slot in reply.iter_mut().take(usize::from(size)) {
            *slot = receiver.pop();
        }
        let reply = reply.get(..usize::from(size)).unwrap_or(&reply);
        let good = !crc || receiver.pop() == crc8(reply);
        self.store_reply(index, reply);
        if !good {
            self.count_error(index, channel::CRC_ERRORS, error::CRC);
        }
        good
    }

    /// Stores a reply at the addresses that the states use: 16 characters among the channel's
    /// variables, and the rest, which seven interface registers need, in a separate buffer.
    fn store_reply(&mut self, index: usize, reply: &[u8]) {
        for (offset, &byte) in (channel::RECEIVED..channel::STATE).zip(reply) {
            self.memory.set_channel(index, offset, byte);
        }
        if let Some(buffer) = self.long_replies.get_mut(index) {
            for (slot, &byte) in buffer.iter_mut().zip(reply.iter().skip(16)) {
                *slot = byte;
            }
        }
    }

    /// Character `n` of the last reply.
    pub(super) fn received(&self, index: usize, n: usize) -> u8 {
        if n < 16 {
            return self.memory.channel(index, channel::RECEIVED + n as u16);
        }
        self.long_replies
            .get(index)
            .and_then(|buffer| buffer.get(n - 16))
            .copied()
            .unwrap_or(0)
    }

    /// Four characters of the last reply as a word.
    pub(super) fn received_word(&self, index: usize, n: usize) -> u32 {
        u32::from_le_bytes([
            self.received(index, n),
            self.received(index, n + 1),
            self.received(index, n + 2),
            self.received(index, n + 3),
        ])
    }

    /// Clears the last reply, so that bytes that no reply fills read as zero.
    pub(super) fn clear_reply(&mut self, index: usize) {
        for offset in channel::RECEIVED..channel::STATE {
            self.memory.set_channel(index, offset, 0);
        }
        if let Some(buffer) = self.long_replies.get_mut(index) {
            *buffer = [0; 16];
        }
    }

    /// Stores the time of this frame.
    pub(super) fn start_timer(&mut self, index: usize) {
        let [low, high] = self.timer.read(self.cycle).to_le_bytes();
        self.memory.set_channel(index, channel::SENT_AT, low);
        self.memory.set_channel(index, channel::SENT_AT + 1, high);
    }

    /// Ticks since the last frame, modulo 256: the firmware compares a single byte.
    pub(super) fn ticks_since_sent(&mut self, index: usize) -> u8 {
        let now = self.timer.read(self.cycle) as u8;
        now.wrapping_sub(self.memory.channel(index, channel::SENT_AT))
    }

    /// True if the reply is overdue, which is then counted as an error.
    pub(super) fn timed_out(&mut self, index: usize) -> bool {
        self.spend(timing::CHECK_TIMER_BRANCH);
        self.check_timeout(index)
    }

    fn check_timeout(&mut self, index: usize) -> bool {
        let (before, after) = timing::CHECK_TIMER;
        self.spend(before);
        let overdue = self.ticks_since_sent(index) >= self.memory.channel(index, channel::TIMEOUT);
        self.spend(after);
        if overdue {
            self.count_error(index, channel::TIMEOUTS, error::TIMEOUT);
        }
        overdue
    }

    /// Restarts at the cookie if the reply is overdue, unless the limit of errors is exceeded.
    pub(super) fn restart_if_timed_out(&mut self, index: usize) {
        if self.check_timeout(index) && !self.has_too_many_errors(index) {
            self.go_to(index, state::START_TIMER);
        }
    }

    /// True if the count of one kind of error has exceeded the limit.
    pub(super) fn has_too_many_errors(&self, index: usize) -> bool {
        self.memory.channel(index, channel::ERROR_LOG) & error::TOO_MANY != 0
    }

    /// Counts an error; the first one above the limit sets the flag for too many errors. FACTS 4.4.
    pub(super) fn count_error(&mut self, index: usize, counter: u16, bit: u8) {
        let (until_clear, rest) = timing::COUNT_ERROR;
        self.spend(until_clear);
        let count = self.memory.channel(index, counter);
        let mut bits = bit;
        if count < self.memory.channel(index, channel::ERROR_LIMIT) {
            self.memory.set_channel(index, counter, count + 1);
        } else {
            bits |= error::TOO_MANY;
        }
        self.set_error(index, bits);
        self.spend(rest);
    }

    /// Records an error: a DOIT no longer waits for this channel, and the received data is
    /// discarded.
    pub(super) fn set_error(&mut self, index: usize, bits: u8) {
        let which = 1_u8 << index;
        self.memory
            .set_channel_bits(index, channel::ERROR_LOG, bits);
        self.memory.clear_bits(global::NOT_DONE_BITS, which);
        if self.has_too_many_errors(index) {
            self.memory.clear_bits(global::NOT_STARTED_BITS, which);
        }
        self.memory
            .set_channel_bits(index, channel::STATUS, status::ERROR);
        self.clear_receiver(index);
    }

    /// Changes the communication state.
    pub(super) fn go_to(&mut self, index: usize, next: u8) {
        self.memory.set_channel(index, channel::STATE, next);
    }
}
