//! Chatter, process data and pass-through accesses. FACTS 4.8, 5, 6.

use super::firmware::Firmware;
use super::memory::{channel, global};
use super::start::{IDENTITY_7I64, PROCESS_DATA_RPC};
use super::state::{
    GET_7I64, GET_ACCESS, GET_CHATTER, GET_PROCESS_DATA, GO_ON_8I20, SEND_7I64, SEND_ACCESS,
    SEND_CHATTER, SEND_PROCESS_DATA, error, status,
};
use super::{MAX_INTERFACE_REGISTERS, timing};

/// Bits of an LBP command. FACTS 1.4.
const COMMAND: u8 = 0x40;
const WRITE: u8 = 0x20;
const WITH_ADDRESS: u8 = 0x04;
const LOCAL: u8 = 0xC0;
const SIZE: u8 = 0x03;

/// Maximum number of characters of process data in one frame.
const MAX_DATA: usize = 4 * MAX_INTERFACE_REGISTERS;

impl Firmware {
    /// Runs one pass of a running channel.
    pub(super) fn run_channel(&mut self, index: usize, which: u8) {
        let code = self.memory.channel(index, channel::STATE);
        let requested = self.memory.get(global::REQUEST_BITS) & which != 0;
        let waits_for_request = matches!(code, SEND_ACCESS | SEND_PROCESS_DATA | SEND_7I64);
        if waits_for_request && !requested || code == GO_ON_8I20 {
            self.spend(timing::NO_REQUEST);
            return;
        }
        self.busy = true;
        match code {
            SEND_CHATTER => {
                self.spend(timing::CHATTER_BEFORE);
                self.log_errors(index);
                self.memory.set_bits(global::CHATTER_BITS, which);
                self.send_zeros(index, GET_CHATTER);
            }
            GET_CHATTER => self.get_chatter(index, which, requested),
            SEND_PROCESS_DATA => {
                self.spend(timing::PROCESS_DATA_BEFORE);
                self.log_errors(index);
                self.send_process_data(index);
            }
            GET_PROCESS_DATA => self.get_process_data(index, which),
            SEND_7I64 => {
                self.spend(timing::PROCESS_DATA_BEFORE);
                self.log_errors(index);
                self.send_7i64(index);
            }
            GET_7I64 => self.get_7i64(index, which),
            SEND_ACCESS => {
                self.spend(timing::ACCESS_BEFORE);
                self.log_errors(index);
                self.send_access(index, which);
            }
            GET_ACCESS => self.get_access(index, which),
            _ => self.run_start(index, which, code),
        }
    }

    /// Sends process data of zeros, in the size of the remote.
    pub(super) fn send_zeros(&mut self, index: usize, next: u8) {
        let size = usize::from(self.memory.channel(index, channel::TRANSMIT_SIZE));
        let mut frame = [0; MAX_DATA + 3];
        if let Some(first) = frame.first_mut() {
            *first = PROCESS_DATA_RPC;
        }
        let length = (size + 1).min(frame.len());
        let more = timing::SEND_ZEROS + timing::SEND_ZERO * size as u64;
        self.send(index, frame.get(..length).unwrap_or(&frame), next, more);
    }

    fn log_errors(&mut self, index: usize) {
        let errors = self.memory.channel(index, channel::ERROR);
        self.memory
            .set_channel_bits(index, channel::ERROR_LOG, errors);
        self.memory.set_channel(index, channel::ERROR, 0);
    }

    fn get_chatter(&mut self, index: usize, which: u8, requested: bool) {
        let size = self.memory.channel(index, channel::RECEIVE_SIZE);
        if self.receive(index, size) {
            let measured = self.ticks_since_sent(index);
            self.memory
                .set_channel(index, channel::MEASURED_TIME, measured);
            self.memory
                .clear_channel_bits(index, channel::STATUS, status::NOT_READY);
            self.memory.clear_bits(global::NOT_READY_BITS, which);
            self.memory.clear_bits(global::NOT_STARTED_BITS, which);
            if requested {
                self.spend(timing::CHATTER_END);
                let timeout = measured.wrapping_add(timing::DOIT_MARGIN);
                self.memory.set_channel(index, channel::TIMEOUT, timeout);
                self.clear_reply(index);
                self.end_chatter(index);
            } else {
                self.spend(timing::CHATTER_ON);
                self.go_to(index, SEND_CHATTER);
            }
        } else if self.timed_out(index) {
            self.memory.clear_bits(global::REQUEST_BITS, which);
            if !self.has_too_many_errors(index) {
                self.go_to(index, SEND_CHATTER);
            }
        }
    }

    /// Ends the chatter permanently, at the first DOIT.
    fn end_chatter(&mut self, index: usize) {
        if self.memory.channel(index, channel::GENERIC) != 0 {
            self.go_to(index, SEND_PROCESS_DATA);
        } else if self.memory.channel(index, channel::IDENTITY) == IDENTITY_7I64 {
            self.go_to(index, SEND_7I64);
        }
    }

    /// Sends bytes of the interface registers: as many as the remote takes, at most as many as
    /// exist.
    fn send_process_data(&mut self, index: usize) {
        let registers = self.config.interface_registers().count();
        let size = usize::from(self.memory.channel(index, channel::TRANSMIT_SIZE));
        let size = size.min(4 * registers);
        let mut frame = [0; MAX_DATA + 1];
        if let Some(first) = frame.first_mut() {
            *first = PROCESS_DATA_RPC;
        }
        for register in 0..registers {
            let word = self.host.inward(index, register + 1).to_le_bytes();
            for (slot, byte) in frame.iter_mut().skip(1 + 4 * register).zip(word) {
                *slot = byte;
            }
        }
        let more = timing::SEND_PROCESS_DATA + timing::SEND_PROCESS_BYTE * size as u64;
        let frame = frame.get(..=size).unwrap_or(&frame);
        self.send(index, frame, GET_PROCESS_DATA, more);
    }

    fn get_process_data(&mut self, index: usize, which: u8) {
        let size = self.memory.channel(index, channel::RECEIVE_SIZE);
        if self.receive(index, size) {
            self.memory.clear_bits(global::REQUEST_BITS, which);
            let fault = self.received(index, 0);
            self.memory.set_channel(index, channel::REMOTE_FAULT, fault);
            if fault != 0 {
                self.memory
                    .set_channel_bits(index, channel::STATUS, status::REMOTE_FAULT);
                self.set_error(index, error::REMOTE_FAULT);
            }
            let registers = self.config.interface_registers().count();
            for register in 0..registers {
                let word = self.received_word(index, 1 + 4 * register);
                self.host.set_outward(index, register + 1, word);
            }
            self.transfer_done(index, which, SEND_PROCESS_DATA);
        } else if self.timed_out(index) {
            self.transfer_failed(index, which, SEND_PROCESS_DATA);
        }
    }

    fn transfer_done(&mut self, index: usize, which: u8, next: u8) {
        if self.memory.channel(index, channel::ERROR) == 0 {
            self.memory.clear_bits(global::INVALID_BITS, which);
        }
        self.memory.clear_bits(global::NOT_DONE_BITS, which);
        self.spend(timing::STORE_DATA);
        self.go_to(index, next);
    }

    fn transfer_failed(&mut self, index: usize, which: u8, next: u8) {
        self.memory.clear_bits(global::REQUEST_BITS, which);
        self.go_to(index, next);
    }

    /// Sends to a 7I64, which takes 24 outputs and no watchdog bit. FACTS 4.7, T:t26.
    fn send_7i64(&mut self, index: usize) {
        let [a, b, c, _] = self.host.inward(index, 1).to_le_bytes();
        let more = timing::SEND_PROCESS_DATA + 4 * timing::SEND_DATA_BYTE;
        self.send(index, &[PROCESS_DATA_RPC, a, b, c, 0], GET_7I64, more);
    }

    fn get_7i64(&mut self, index: usize, which: u8) {
        let size = self.memory.channel(index, channel::RECEIVE_SIZE);
        if self.receive(index, size) {
            self.memory.clear_bits(global::REQUEST_BITS, which);
            let inputs = self.received_word(index, 0);
            self.host.set_outward(index, 1, inputs & 0x00FF_FFFF);
            if inputs & 0x0800_0000 != 0 {
                self.memory
                    .set_channel_bits(index, channel::STATUS, status::REMOTE_FAULT);
            }
            let analog = self.received_word(index, 4);
            self.host.set_outward(index, 2, analog);
            self.transfer_done(index, which, SEND_7I64);
        } else if self.timed_out(index) {
            self.transfer_failed(index, which, SEND_7I64);
        }
    }

    /// Passes any command with bit 6 through, whatever its meaning to the remote. FACTS 6.1.
    fn send_access(&mut self, index: usize, which: u8) {
        let [address_low, address_high, _, command] = self.host.inward(index, 0).to_le_bytes();
        if command & COMMAND == 0 {
            self.memory.clear_bits(global::REQUEST_BITS, which);
            return;
        }
        let writes = command & WRITE != 0;
        let mut frame = [0; 11];
        let mut length = 0;
        let mut push = |byte: u8| {
            if let Some(slot) = frame.get_mut(length) {
                *slot = byte;
                length += 1;
            }
        };
        push(command);
        let mut size = 1_usize;
        if command < LOCAL {
            size <<= command & SIZE;
            if command & WITH_ADDRESS != 0 {
                push(address_low);
                push(address_high);
            }
        }
        if writes {
            let low = self.host.inward(index, 1).to_le_bytes();
            let high = self.host.inward(index, 2).to_le_bytes();
            low.into_iter().chain(high).take(size).for_each(&mut push);
        }
        let reply = if writes { 0 } else { size as u8 };
        self.memory.set_channel(index, channel::REPLY_SIZE, reply);
        let more = timing::ACCESS_CHARACTER * (length as u64).saturating_sub(1);
        self.send(
            index,
            frame.get(..length).unwrap_or(&frame),
            GET_ACCESS,
            more,
        );
    }

    fn get_access(&mut self, index: usize, which: u8) {
        let size = self.memory.channel(index, channel::REPLY_SIZE);
        if self.receive(index, size) {
            self.memory.clear_bits(global::REQUEST_BITS, which);
            if size != 0 {
                let mask = u64::MAX >> (64 - 8 * u32::from(size.min(8)));
                let data = u64::from(self.received_word(index, 0))
                    | u64::from(self.received_word(index, 4)) << 32;
                self.host.set_outward(index, 1, (data & mask) as u32);
                self.host
                    .set_outward(index, 2, ((data & mask) >> 32) as u32);
            }
            self.transfer_done(index, which, SEND_ACCESS);
        } else if self.timed_out(index) {
            self.transfer_failed(index, which, SEND_ACCESS);
        }
    }
}
