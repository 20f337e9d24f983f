//! The states of a START, from the cookie to the first chatter frame. FACTS 4.

use super::commands::{NORMAL_START, SETUP_START};
use super::firmware::Firmware;
use super::memory::{channel, global};
use super::state::{
    self, CHECK_7I64, CHECK_8I20, CHECK_FAULT, CHECK_STATUS, GET_CLEAR_7I64, GET_CLEAR_8I20,
    GET_CLEAR_FAULTS, GET_CLEAR_STATUS, GET_CLEARED_8I20, GET_COOKIE, GET_DISCOVERY, GET_FAULT,
    GET_FAULTS_CLEARED, GET_FRAME_TIMEOUT, GET_MODE, GET_OUTPUTS_OFF, GET_STATUS, GET_UNIT_NUMBER,
    GO_ON_8I20, LAST_NAME, SEND_ACCESS, SEND_CHATTER, SEND_CLEAR_7I64, SEND_CLEAR_8I20,
    SEND_CLEAR_FAULTS, SEND_CLEAR_STATUS, SEND_CLEARED_8I20, SEND_COOKIE, SEND_DISCOVERY,
    SEND_FAULT, SEND_FAULTS_CLEARED, SEND_FRAME_TIMEOUT, SEND_MODE, SEND_NAME, SEND_OUTPUTS_OFF,
    SEND_STATUS, SEND_UNIT_NUMBER, START_TIMER, WAIT, error, status,
};
use super::timing;

const COOKIE: u8 = 0x5A;
/// Frame timeout set in the remote: four characters in bit times. FACTS 1.3.
const FRAME_TIMEOUT: u8 = 40;
/// Identity bytes of the two remotes with their own start sequence.
const IDENTITY_8I20: u8 = 0x80;
pub(super) const IDENTITY_7I64: u8 = 0x74;
/// Commands that write FFFF to the 8I20's address 0x0854, and read it back. FACTS 11.5.
const CLEAR_8I20: [u8; 5] = [0x65, 0x54, 0x08, 0xFF, 0xFF];
const READ_8I20: [u8; 3] = [0x45, 0x54, 0x08];
/// The watchdog bit in the data sent to a 7I64.
const WATCHDOG_7I64: u8 = 0x08;

/// LBP commands of a START. FACTS 1.2, 1.3, 4.1.
const READ_COOKIE: u8 = 0xDF;
const READ_STATUS: u8 = 0xC1;
const WRITE_STATUS: u8 = 0xE1;
const WRITE_FRAME_TIMEOUT: u8 = 0xEB;
const READ_NAME: u8 = 0xD0;
const WRITE_MODE: u8 = 0xE6;
const CLEAR_FAULTS: u8 = 0xE7;
const READ_CLEAR_FAULTS: u8 = 0xC7;
const READ_FAULT: u8 = 0xD7;
const UNIT_NUMBER_RPC: u8 = 0xBC;
const DISCOVERY_RPC: u8 = 0xBB;
pub(super) const PROCESS_DATA_RPC: u8 = 0xBD;

impl Firmware {
    /// Runs one pass of a channel in a START state.
    pub(super) fn run_start(&mut self, index: usize, which: u8, code: u8) {
        match code {
            state::RESET => self.reset_channel(index),
            START_TIMER => {
                let (before, after) = timing::START_TIMER;
                self.spend(before);
                self.start_timer(index);
                self.spend(after);
                self.go_to(index, WAIT);
            }
            WAIT => self.wait(index),
            SEND_COOKIE => self.send(index, &[READ_COOKIE], GET_COOKIE, 0),
            GET_COOKIE => self.get_cookie(index),
            SEND_FRAME_TIMEOUT => {
                let frame = [WRITE_FRAME_TIMEOUT, FRAME_TIMEOUT];
                self.send(index, &frame, GET_FRAME_TIMEOUT, timing::SEND_DATA_BYTE);
            }
            GET_FRAME_TIMEOUT => self.get(index, 0, SEND_CLEAR_STATUS),
            SEND_CLEAR_STATUS => {
                let frame = [WRITE_STATUS, 0];
                self.send(index, &frame, GET_CLEAR_STATUS, timing::SEND_ZERO_BYTE);
            }
            GET_CLEAR_STATUS => self.get(index, 0, SEND_STATUS),
            SEND_STATUS => self.send(index, &[READ_STATUS], GET_STATUS, 0),
            GET_STATUS => self.get(index, 1, CHECK_STATUS),
            CHECK_STATUS => self.check_status(index),
            SEND_UNIT_NUMBER => self.send(index, &[UNIT_NUMBER_RPC], GET_UNIT_NUMBER, 0),
            GET_UNIT_NUMBER => self.get_unit_number(index),
            SEND_NAME..=LAST_NAME => self.name(index, code),
            CHECK_8I20 => self.check_8i20(index, which),
            CHECK_7I64 => self.check_7i64(index, which),
            SEND_CLEAR_7I64 => {
                let frame = [PROCESS_DATA_RPC, 0, 0, 0, WATCHDOG_7I64];
                self.send(index, &frame, GET_CLEAR_7I64, 4 * timing::SEND_DATA_BYTE);
            }
            GET_CLEAR_7I64 => {
                let size = self.memory.channel(index, channel::RECEIVE_SIZE);
                self.get(index, size, SEND_CHATTER);
            }
            SEND_MODE => {
                let mode = (self.host.inward(index, 0) >> 24) as u8;
                self.send(index, &[WRITE_MODE, mode], GET_MODE, timing::SEND_MODE_BYTE);
            }
            GET_MODE => self.get(index, 0, SEND_DISCOVERY),
            SEND_DISCOVERY => self.send(index, &[DISCOVERY_RPC], GET_DISCOVERY, 0),
            GET_DISCOVERY => self.get_discovery(index, which),
            _ => self.clear_faults(index, code),
        }
    }

    /// The second half: outputs off, faults cleared, no fault remaining.
    fn clear_faults(&mut self, index: usize, code: u8) {
        match code {
            SEND_OUTPUTS_OFF => self.send_zeros(index, GET_OUTPUTS_OFF),
            GET_OUTPUTS_OFF => {
                let size = self.memory.channel(index, channel::RECEIVE_SIZE);
                if self.receive(index, size) {
                    self.spend(timing::GO_ON);
                    self.go_to(index, SEND_CLEAR_FAULTS);
                } else if self.timed_out(index) {
                    self.go_to(index, SEND_OUTPUTS_OFF);
                }
            }
            SEND_CLEAR_FAULTS => {
                let frame = [CLEAR_FAULTS, 0xFF];
                self.send(index, &frame, GET_CLEAR_FAULTS, timing::SEND_TRUE_BYTE);
            }
            GET_CLEAR_FAULTS => self.get(index, 0, SEND_FAULTS_CLEARED),
            SEND_FAULTS_CLEARED => self.send(index, &[READ_CLEAR_FAULTS], GET_FAULTS_CLEARED, 0),
            GET_FAULTS_CLEARED => {
                if self.receive(index, 1) {
                    self.spend(timing::STORE_FAULTS_CLEARED);
                    let pending = self.received(index, 0) != 0;
                    let next = if pending {
                        SEND_FAULTS_CLEARED
                    } else {
                        SEND_FAULT
                    };
                    self.go_to(index, next);
                } else {
                    self.restart_if_timed_out(index);
                }
            }
            SEND_FAULT => self.send(index, &[READ_FAULT], GET_FAULT, 0),
            GET_FAULT => self.get(index, 1, CHECK_FAULT),
            CHECK_FAULT => self.check_fault(index),
            _ => self.start_8i20(index, code),
        }
    }

    /// The start sequence of the 8I20: its word at 0x0854 is written, and read until it is 0. FACTS
    /// 11.5. The rest of the sequence is unknown.
    fn start_8i20(&mut self, index: usize, code: u8) {
        match code {
            SEND_CLEAR_8I20 => {
                let more = 4 * timing::SEND_DATA_BYTE;
                self.send(index, &CLEAR_8I20, GET_CLEAR_8I20, more);
            }
            GET_CLEAR_8I20 => self.get(index, 0, SEND_CLEARED_8I20),
            SEND_CLEARED_8I20 => {
                let more = 2 * timing::SEND_DATA_BYTE;
                self.send(index, &READ_8I20, GET_CLEARED_8I20, more);
            }
            GET_CLEARED_8I20 => {
                if self.receive(index, 2) {
                    self.spend(timing::STORE_FAULTS_CLEARED);
                    let is_clear = self.received(index, 0) == 0 && self.received(index, 1) == 0;
                    let next = if is_clear {
                        GO_ON_8I20
                    } else {
                        SEND_CLEARED_8I20
                    };
                    self.go_to(index, next);
                } else {
                    self.restart_if_timed_out(index);
                }
            }
            _ => {}
        }
    }

    /// A step that only needs a reply: continues with `next`, or returns to the cookie.
    fn get(&mut self, index: usize, size: u8, next: u8) {
        if self.receive(index, size) {
            self.spend(timing::GO_ON);
            self.go_to(index, next);
        } else {
            self.restart_if_timed_out(index);
        }
    }

    fn reset_channel(&mut self, index: usize) {
        self.clear_counters(index);
        self.clear_receiver(index);
        let timeout = self.memory.get(global::START_TIMEOUT);
        self.memory.set_channel(index, channel::TIMEOUT, timeout);
        self.go_to(index, START_TIMER);
        self.spend(timing::RESET_STATE);
    }

    fn wait(&mut self, index: usize) {
        let (before, after) = timing::WAIT;
        self.spend(before);
        let waited = self.ticks_since_sent(index);
        self.spend(after);
        if waited > self.memory.channel(index, channel::TIMEOUT) {
            self.go_to(index, SEND_COOKIE);
        }
    }

    fn get_cookie(&mut self, index: usize) {
        if self.timed_out(index) {
            self.go_to(index, START_TIMER);
        } else if self.receive(index, 1) {
            self.spend(timing::STORE_COOKIE);
            if self.received(index, 0) == COOKIE {
                self.go_to(index, SEND_FRAME_TIMEOUT);
            } else {
                self.count_error(index, channel::COOKIE_ERRORS, error::COOKIE);
                self.go_to(index, START_TIMER);
            }
        }
    }

    fn check_status(&mut self, index: usize) {
        self.spend(timing::CHECK_BYTE);
        if self.received(index, 0) == 0 {
            self.go_to(index, SEND_UNIT_NUMBER);
        } else {
            self.count_error(index, channel::REMOTE_FAULTS, error::REMOTE_FAULT);
            self.go_to(index, START_TIMER);
        }
    }

    /// In setup mode a remote without this RPC passes; in normal mode the channel stays here until
    /// the limit of timeouts is exceeded.
    fn get_unit_number(&mut self, index: usize) {
        if self.receive(index, 4) {
            let number = self.received_word(index, 0);
            self.host.set_outward(index, 1, number);
            self.spend(timing::STORE_UNIT_NUMBER);
            self.go_to(index, SEND_NAME);
        } else if self.timed_out(index) && self.is_setup() {
            self.go_to(index, SEND_NAME);
        }
    }

    fn name(&mut self, index: usize, code: u8) {
        let character = (code - SEND_NAME) / 2;
        if (code - SEND_NAME).is_multiple_of(2) {
            if let Some(previous) = character.checked_sub(1) {
                self.spend(timing::NAME_BEFORE);
                let received = self.received(index, 0);
                self.memory
                    .set_channel(index, channel::NAME + u16::from(previous), received);
            }
            self.send(index, &[READ_NAME + character], code + 1, 0);
        } else {
            self.get(index, 1, code + 1);
        }
    }

    fn check_8i20(&mut self, index: usize, which: u8) {
        let last = self.received(index, 0);
        self.memory.set_channel(index, channel::NAME + 3, last);
        let name = self.memory.channel_long(index, channel::NAME);
        self.host.set_outward(index, 2, name);
        self.spend(timing::COMPARE_8I20);
        if self.is_named(index, 0) {
            self.set_identity(index, which, IDENTITY_8I20, SEND_CLEAR_8I20);
        } else {
            self.go_to(index, CHECK_7I64);
        }
    }

    fn check_7i64(&mut self, index: usize, which: u8) {
        self.spend(timing::COMPARE_7I64);
        if self.is_named(index, 1) {
            self.set_identity(index, which, IDENTITY_7I64, SEND_CLEAR_7I64);
        } else {
            self.memory.set_channel(index, channel::GENERIC, 0xFF);
            self.go_to(index, SEND_MODE);
        }
    }

    /// True if the remote has the known name number `n`.
    fn is_named(&self, index: usize, n: u16) -> bool {
        (0..4).all(|i| {
            self.memory.channel(index, channel::NAME + i)
                == self.memory.get(global::KNOWN_NAMES + 4 * n + i)
        })
    }

    /// Sets up a remote with its own start sequence: fixed sizes, no mode, no discovery. FACTS 4.7.
    /// A START that is neither setup nor normal stays in this state (FACTS 11.12 for the 7I64;
    /// assumed for the 8I20).
    fn set_identity(&mut self, index: usize, which: u8, identity: u8, next: u8) {
        self.memory.set_channel(index, channel::IDENTITY, identity);
        self.memory.set_channel(index, channel::RECEIVE_SIZE, 8);
        self.memory.set_channel(index, channel::TRANSMIT_SIZE, 4);
        if self.is_setup() {
            self.finish_setup(index, which);
        } else if self.memory.get(global::START_TYPE) == NORMAL_START {
            let mut known = status::NO_IDENTITY;
            if identity == IDENTITY_7I64 {
                known |= status::REMOTE_FAULT;
            }
            self.memory
                .clear_channel_bits(index, channel::STATUS, known);
            self.go_to(index, next);
        }
    }

    fn get_discovery(&mut self, index: usize, which: u8) {
        if self.receive(index, 6) {
            let (receive, transmit) = (self.received(index, 0), self.received(index, 1));
            self.memory
                .set_channel(index, channel::RECEIVE_SIZE, receive);
            self.memory
                .set_channel(index, channel::TRANSMIT_SIZE, transmit);
            let pointers = self.received_word(index, 2);
            self.host.set_outward(index, 3, pointers);
            self.spend(timing::STORE_DISCOVERY);
            if self.is_setup() {
                self.finish_setup(index, which);
            } else if self.memory.get(global::START_TYPE) == NORMAL_START {
                self.memory
                    .clear_channel_bits(index, channel::STATUS, status::NO_IDENTITY);
                self.go_to(index, SEND_OUTPUTS_OFF);
            }
        } else if self.timed_out(index) && self.is_setup() {
            self.finish_setup(index, which);
        }
    }

    /// Completes a setup START: from here on the channel passes accesses through.
    fn finish_setup(&mut self, index: usize, which: u8) {
        let known = status::NOT_READY | status::NO_IDENTITY | status::REMOTE_FAULT;
        self.memory
            .clear_channel_bits(index, channel::STATUS, known);
        self.memory.clear_bits(global::NOT_READY_BITS, which);
        self.memory.clear_bits(global::NOT_STARTED_BITS, which);
        let timeout = self.memory.get(global::RUN_TIMEOUT);
        self.memory.set_channel(index, channel::TIMEOUT, timeout);
        self.go_to(index, SEND_ACCESS);
    }

    fn check_fault(&mut self, index: usize) {
        self.spend(timing::NO_FAULT);
        let fault = self.received(index, 0);
        if fault == 0 {
            self.memory
                .clear_channel_bits(index, channel::STATUS, status::REMOTE_FAULT);
            self.go_to(index, SEND_CHATTER);
        } else {
            self.memory.set_channel(index, channel::REMOTE_FAULT, fault);
            self.count_error(index, channel::REMOTE_FAULTS, error::REMOTE_FAULT);
            self.go_to(index, SEND_FAULT);
        }
    }

    fn is_setup(&self) -> bool {
        self.memory.get(global::START_TYPE) == SETUP_START
    }
}
