//! Commands of the host: decoding, completion, local reads and writes.

use super::firmware::Firmware;
use super::memory::global;
use super::timing::{self, Completion};

/// High bytes of the COMMAND register.
const STOP: u8 = 0x08;
pub(super) const NORMAL_START: u8 = 0x09;
pub(super) const SETUP_START: u8 = 0x0F;
const DOIT: u8 = 0x10;
const REQUEST: u8 = 0x20;
const WRITE: u8 = 0x80;

impl Firmware {
    /// Takes a new command, if there is one.
    ///
    /// While a command is in work only a stop is taken, and even that only ends the wait of the
    /// command in work: no channel is stopped, and a STOPALL (low byte zero) then never completes.
    /// FACTS 3.1, 3.2.
    pub(super) fn check_for_command(&mut self) {
        if !self.host.doorbell {
            return;
        }
        let [low, high] = self.host.command(self.now()).to_le_bytes();
        if self.memory.get(global::COMMAND_IN_WORK) == 0 {
            self.memory.set(global::COMMAND_IN_WORK, high);
            self.host.doorbell = false;
            self.busy = true;
            self.spend(timing::TAKE_COMMAND);
            // The stop that freed the port is 0 when it is read, unless it was overwritten.
            if core::mem::take(&mut self.freed) && [low, high] == [0, 0] {
                self.spend(timing::SIMPLE_COMMAND);
                self.reject_word(true);
            } else {
                self.execute(high, low);
            }
        } else if high == STOP {
            self.memory.set(global::COMMAND_IN_WORK, high);
            self.host.doorbell = false;
            self.ends_wait = true;
            self.busy = true;
        }
    }

    fn execute(&mut self, high: u8, low: u8) {
        if high & DOIT != 0 {
            self.start_transfers(low);
        } else if high == NORMAL_START || high == SETUP_START {
            self.start_after_division(high);
        } else if high == STOP {
            self.memory.set(global::STOP_BITS, low);
            if low == 0 {
                self.memory.set(global::INITIALIZED, 0);
            }
        } else if high & REQUEST != 0 {
            self.spend(timing::SIMPLE_COMMAND);
            self.local_access(high, low);
            self.complete();
        } else {
            self.spend(timing::SIMPLE_COMMAND);
            self.set_data(0xFF);
            self.complete();
        }
    }

    /// Handles any command with the DOIT bit; only 10NN itself ever completes. FACTS 3, T:t30.
    fn start_transfers(&mut self, mask: u8) {
        let requested = !self.memory.get(global::NOT_READY_BITS) & mask;
        self.memory.set(global::REQUEST_BITS, requested);
        self.memory.set(global::INVALID_BITS, requested);
        self.memory.set(global::NOT_DONE_BITS, requested);
        self.spend(timing::DOIT_COMMAND);
    }

    /// Continues a START of `kind`. COMMAND now selects the channels (FACTS 11.3), and its high
    /// byte the extent: a START that is neither setup nor normal stops after the discovery reply
    /// (T:u01).
    pub(super) fn start_channels(&mut self, kind: u8, written: u16) {
        let [mask, start_type] = written.to_le_bytes();
        let setup = kind == SETUP_START;
        let rate = if setup {
            timing::SETUP_TICK_RATE
        } else {
            timing::NORMAL_TICK_RATE
        };
        // The divider has 16 bits and counts two cycles more than its value.
        let divider = u64::from((self.clock.hz() / rate).wrapping_sub(2) & 0xFFFF);
        self.timer.set_period(self.cycle, divider + 2);
        if setup {
            self.memory
                .set(global::START_TIMEOUT, timing::SETUP_START_TIMEOUT);
            self.memory
                .set(global::RUN_TIMEOUT, timing::SETUP_RUN_TIMEOUT);
        } else {
            self.memory
                .set(global::START_TIMEOUT, timing::NORMAL_START_TIMEOUT);
        }
        self.memory.set(global::START_TYPE, start_type);
        // Only channels that do not run yet. The not-ready state of a stopped channel outside the
        // mask is cleared here (FACTS 5.5).
        let new = !self.memory.get(global::START_BITS) & mask;
        self.memory.set(global::NOT_READY_BITS, new);
        self.memory.set(global::NOT_STARTED_BITS, new);
        self.memory.set_bits(global::START_BITS, mask);
        self.spend(timing::START_COMMAND);
    }

    /// Completes the command in work if all its conditions are met.
    pub(super) fn check_completion(&mut self) {
        let mask = self.memory.get(global::CHANNEL_MASK);
        let not_ready = self.memory.get(global::NOT_READY_BITS);
        match self.memory.get(global::COMMAND_IN_WORK) {
            DOIT => {
                let waiting = !not_ready
                    & self.memory.get(global::START_BITS)
                    & mask
                    & self.memory.get(global::REQUEST_BITS)
                    & self.memory.get(global::NOT_DONE_BITS);
                if waiting == 0 {
                    let invalid = self.memory.get(global::INVALID_BITS);
                    self.complete_in_pass(timing::DOIT_DONE, invalid);
                } else {
                    self.spend(timing::PASS_TAIL + timing::PASS_TAIL_DOIT);
                }
            }
            kind @ (NORMAL_START | SETUP_START) => {
                let waiting = self.memory.get(global::NOT_STARTED_BITS) & not_ready & mask;
                if waiting == 0 {
                    self.memory.clear_bits(global::START_BITS, not_ready);
                    let times = if kind == SETUP_START {
                        timing::SETUP_START_DONE
                    } else {
                        timing::NORMAL_START_DONE
                    };
                    self.complete_in_pass(times, not_ready);
                } else {
                    self.spend(timing::PASS_TAIL + timing::PASS_TAIL_START);
                }
            }
            STOP if self.host.command(self.now()) & 0xFF != 0 => {
                let stopping = self.memory.get(global::STOP_BITS);
                let is_stop = self.host.command(self.now()) >> 8 == STOP.into();
                let ends_wait = core::mem::take(&mut self.ends_wait) && self.host.doorbell;
                self.freed = ends_wait && is_stop;
                if ends_wait && !is_stop {
                    self.end_wait();
                } else if stopping & mask == 0 {
                    self.complete_in_pass(timing::STOP_DONE, stopping);
                } else {
                    self.set_data(stopping);
                    self.spend(timing::PASS_TAIL);
                }
            }
            _ => self.spend(timing::PASS_TAIL),
        }
    }

    /// Ends the wait for a command in work by a word that is no stop and has not been taken: it is
    /// rejected, and DATA stays. A command that is written meanwhile is not noticed, and stays in
    /// COMMAND. FACTS 11.15, T:w02.
    fn end_wait(&mut self) {
        let times = timing::STOP_DONE;
        self.spend(times.until_clear);
        self.complete();
        self.spend(times.until_poll + timing::TAKE_COMMAND + timing::SIMPLE_COMMAND);
        self.reject_word(false);
    }

    fn complete_in_pass(&mut self, times: Completion, data: u8) {
        self.spend(times.until_clear);
        self.set_data(data);
        self.complete();
        self.spend(times.until_poll);
    }

    fn set_data(&mut self, value: u8) {
        let now = self.now();
        self.host.set_data(now, value);
    }

    fn local_access(&mut self, high: u8, low: u8) {
        let address = u16::from_be_bytes([high, low]) & 0x0FFF;
        if high & WRITE == 0 {
            let value = self.local_read(address);
            self.set_data(value);
        } else {
            self.local_write(address, self.host.data_in);
        }
    }

    /// Data memory has address bit 9 clear; all other addresses are hardware.
    fn memory_address(address: u16) -> Option<u16> {
        (address & 0x200 == 0).then_some(address >> 1 & 0x200 | address & 0x1FF)
    }

    fn local_read(&mut self, address: u16) -> u8 {
        if let Some(address) = Self::memory_address(address) {
            return self.memory.get(address);
        }
        let now = self.now();
        let index = usize::from(address & 0x0F);
        let byte = usize::from(address & 3);
        let uart = self.uarts.get_mut(index);
        match address {
            0x200 => self.host.command(now).to_le_bytes()[0],
            0x201 => self.host.command(now).to_be_bytes()[0],
            0x202 => self.host.data_in,
            0x203 => u8::from(self.host.doorbell),
            0x222 => self.timer.read(self.cycle) as u8,
            0x223 => (self.timer.read(self.cycle) >> 8) as u8,
            0x230..=0x233 => (self.clock.hz() >> (8 * byte)) as u8,
            0x234 => self.config.channels() as u8,
            0x280..=0x28F => uart.map_or(0, |uart| {
                uart.receiver.count(now);
                uart.receiver.pop()
            }),
            0x2C0..=0x2CF => uart.map_or(0, |uart| uart.receiver.count(now) as u8),
            0x2D0..=0x2DF => uart.map_or(0, |uart| uart.receiver.flags(now)),
            0x300..=0x3FF => {
                let channel = usize::from(address >> 2 & 7);
                let register = usize::from(address >> 5 & 7);
                (self.host.inward(channel, register) >> (8 * byte)) as u8
            }
            _ => 0,
        }
    }

    fn local_write(&mut self, address: u16, value: u8) {
        if let Some(address) = Self::memory_address(address) {
            self.memory.set(address, value);
            return;
        }
        let byte = u32::from(address & 3);
        match address {
            0x202 => self.set_data(value),
            0x203 => self.host.doorbell = false,
            0x300..=0x3FF => {
                let channel = usize::from(address >> 2 & 7);
                let register = usize::from(address >> 5 & 7);
                let old = self.host.outward(channel, register) & !(0xFF << (8 * byte));
                let new = old | u32::from(value) << (8 * byte);
                self.host.set_outward(channel, register, new);
            }
            _ => {}
        }
    }
}
