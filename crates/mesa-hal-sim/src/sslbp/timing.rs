//! Execution times of the firmware in clock cycles: all calibrated costs.
//!
//! The processor executes one instruction per cycle, and its program is one endless loop over all
//! channels; these are the costs of the loop's parts. They were fitted to the transcripts named
//! with each (100 MHz, so 100 cycles are one microsecond) and keep the times of all transcripts
//! well within the permitted 15 us.

/// From release of bit 14 until COMMAND is cleared for the first time, for a reset of the idle
/// loop. T:t01 (0.13 us), u08 (0.09 us), t01c.
pub(super) const RESET_FIRST_CLEAR: u64 = 10;
/// From release of bit 14 until memory is set up and COMMAND is cleared, without channels. T:t01b
/// (22.3 us with eight), t01c (21.5 us with three).
pub(super) const RESET_MEMORY: u64 = 2_099;
/// Additional time of the same per channel. FACTS 11.1.
pub(super) const RESET_MEMORY_CHANNEL: u64 = 16;
/// From there until DATA reads AA. T:t01 (DATA is still old immediately after COMMAND became 0),
/// FACTS 11.13.
pub(super) const RESET_DATA: u64 = 9;
/// From there until COMMAND writes are accepted again. T:t01 (a write 22.31 us after release is
/// lost).
pub(super) const RESET_DOORBELL: u64 = 1;

/// Global initialisation apart from the channels. T:t02.
pub(super) const INITIALIZE: u64 = 60;
/// Global initialisation of one channel, nearly all of it a division. T:t02, t04c (14.9 us).
pub(super) const INITIALIZE_CHANNEL: u64 = 1_487;

/// One iteration of the loop without any work. T:t01 (a local read takes 0.5 us).
pub(super) const IDLE_LOOP: u64 = 15;
/// A pass over the channels: the part before the first of them. T:t03b.
pub(super) const PASS_HEAD: u64 = 29;
/// Turn of a channel: checks for a stop and for a running channel. T:t03b, t25.
pub(super) const TURN_BEFORE: u64 = 10;
/// Turn of a running channel: dispatch to the routine of its state. T:t03b, t25.
pub(super) const DISPATCH: u64 = 6;
/// Turn of a running channel: return from the routine. T:t03b.
pub(super) const DISPATCH_BACK: u64 = 1;
/// Turn of a channel: status to CS, and on to the next channel. T:t25 (the turns of 8 chattering
/// channels follow each other at exactly 1.00 us).
pub(super) const TURN_AFTER: u64 = 20;
/// The checks for completed commands after the last channel, without any in work. T:t03b.
pub(super) const PASS_TAIL: u64 = 19;
/// Additional time of the same while a START is in work. T:t03b.
pub(super) const PASS_TAIL_START: u64 = 4;
/// Additional time of the same while a DOIT is in work. T:t07a.
pub(super) const PASS_TAIL_DOIT: u64 = 7;
/// Times of the completion of a command. T:t06b, r002.
#[derive(Clone, Copy, Debug)]
pub(super) struct Completion {
    /// From the end of the last channel's turn until COMMAND is cleared.
    pub until_clear: u64,
    /// From there to the poll for a new command. A command that is written in between is taken in
    /// the same pass.
    pub until_poll: u64,
}

/// Completion of a DOIT.
pub(super) const DOIT_DONE: Completion = Completion {
    until_clear: 17,
    until_poll: 18,
};
/// Completion of a normal START.
pub(super) const NORMAL_START_DONE: Completion = Completion {
    until_clear: 18,
    until_poll: 13,
};
/// Completion of a setup START.
pub(super) const SETUP_START_DONE: Completion = Completion {
    until_clear: 23,
    until_poll: 8,
};
/// Completion of a stop.
pub(super) const STOP_DONE: Completion = Completion {
    until_clear: 25,
    until_poll: 4,
};
/// The poll for a new command. T:t03b.
pub(super) const CHECK: u64 = 6;

/// Start of a command.
pub(super) const TAKE_COMMAND: u64 = 8;
/// Execution of a local read or write, or rejection of a command. T:t01 (0.5 us with the polling).
pub(super) const SIMPLE_COMMAND: u64 = 33;
/// Set-up of a DOIT. T:t07a.
pub(super) const DOIT_COMMAND: u64 = 24;
/// The division for the tick timer's divider. T:t03b, t09 (a START takes 16..18 us).
pub(super) const START_DIVISION: u64 = 1_480;
/// The rest of a START command. T:t03b.
pub(super) const START_COMMAND: u64 = 30;
/// Clearing of one channel after a stop. T:t02b, t08.
pub(super) const STOP_CHANNEL: u64 = 60;

/// State 00: counters, receiver and timeout. T:t03b.
pub(super) const RESET_STATE: u64 = 22;
/// State 01: before and after the read of the timer. T:t03b (3.14 us a pass).
pub(super) const START_TIMER: (u64, u64) = (2, 6);
/// State 02: before and after the read of the timer. T:r002.
pub(super) const WAIT: (u64, u64) = (1, 10);
/// Check of one byte and choice of the next state. T:t03b (state 0B).
pub(super) const CHECK_BYTE: u64 = 5;
/// State 16. T:t03b (3.34 us a pass).
pub(super) const COMPARE_8I20: u64 = 29;
/// State 17. T:t03b (3.28 us a pass).
pub(super) const COMPARE_7I64: u64 = 24;

/// Sending: from the start of the routine to the check for waiting characters, and from the second
/// check to the write of the first character. T:t03b, t25.
pub(super) const SEND_BEFORE: (u64, u64) = (8, 6);
/// Sending: from the first check to the branch that counts and clears extra characters, and from
/// there to the second check if none was waiting: five instructions in all. FACTS 11.8.
pub(super) const SEND_LOOKS: (u64, u64) = (3, 2);
/// From the write of the first character to the falling edge of its start bit. T:t03b.
pub(super) const SEND_START: u64 = 5;
/// Gap between two characters on the wire. T:t03 (two characters take 8.03 us, six 24.15 us).
pub(super) const CHARACTER_GAP: u64 = 3;
/// Sending: CRC and time stamp. T:t03b.
pub(super) const SEND_END: u64 = 6;
/// Sending: after the time stamp. T:t03b.
pub(super) const SEND_AFTER: u64 = 6;
/// Sending: additional time for a command with one data byte. T:t08 (EB 28: 0.73 us a turn, DF:
/// 0.68 us).
pub(super) const SEND_DATA_BYTE: u64 = 5;
/// Sending: additional time for a command with a zero instead of another byte. T:t08 (E1 00: 0.75
/// us).
pub(super) const SEND_ZERO_BYTE: u64 = 7;
/// Sending: additional time for the clearing of faults. T:t25 (E7 FF).
pub(super) const SEND_TRUE_BYTE: u64 = 8;
/// Sending: additional time for the mode. T:t08 (E6 00: 0.76 us).
pub(super) const SEND_MODE_BYTE: u64 = 8;
/// Before the second to fourth name request. T:t08 (0.70 us).
pub(super) const NAME_BEFORE: u64 = 2;
/// Zeros as process data: additional time to a single command. T:t08 (two zeros: 0.94 us).
pub(super) const SEND_ZEROS: u64 = 6;
/// Zeros as process data: time per zero. T:t08.
pub(super) const SEND_ZERO: u64 = 10;
/// Chatter: before the frame. T:t25 (1.00 us a turn).
pub(super) const CHATTER_BEFORE: u64 = 6;
/// DOIT: before the frame. T:t25.
pub(super) const PROCESS_DATA_BEFORE: u64 = 10;
/// DOIT: additional time to a single command. T:t25 (two bytes: 1.00 us a turn).
pub(super) const SEND_PROCESS_DATA: u64 = 6;
/// DOIT: time per byte of process data. T:t08 (six bytes: 1.32 us a turn).
pub(super) const SEND_PROCESS_BYTE: u64 = 8;
/// Pass-through: before the frame.
pub(super) const ACCESS_BEFORE: u64 = 30;
/// Pass-through: time per further character of the frame.
pub(super) const ACCESS_CHARACTER: u64 = 10;

/// Receiving: until the number of characters is read. T:r022 (a reply that was just in time).
pub(super) const RECEIVE_LOOK: u64 = 11;
/// Receiving: continuation without a reply. T:t12 (passes while waiting).
pub(super) const RECEIVE_NOTHING: u64 = 7;
/// Receiving: a reply that is only a CRC. T:t03b.
pub(super) const RECEIVE_CRC: u64 = 23;
/// Receiving: a reply with data, the data not included. T:t03b.
pub(super) const RECEIVE: u64 = 28;
/// Receiving: each character of a reply. T:t06.
pub(super) const RECEIVE_CHARACTER: u64 = 11;
/// From the middle of a stop bit until the character is counted. T:t06b.
pub(super) const RECEIVER_DELAY: u64 = 6;
/// Check for an overdue reply: before and after the read of the timer. T:t12.
pub(super) const CHECK_TIMER: (u64, u64) = (2, 8);
/// Additional time of the same if a timeout does not mean a restart. T:t03b, t12.
pub(super) const CHECK_TIMER_BRANCH: u64 = 3;
/// Continuation after a reply. T:t03b.
pub(super) const GO_ON: u64 = 4;
/// Continuation after the cookie. T:t03b.
pub(super) const STORE_COOKIE: u64 = 4;
/// Continuation after the reply to C7. T:t25.
pub(super) const STORE_FAULTS_CLEARED: u64 = 7;
/// Continuation after a reply to D7 without a fault. T:t25.
pub(super) const NO_FAULT: u64 = 7;
/// Check for a request. T:t06b.
pub(super) const NO_REQUEST: u64 = 5;
/// Continuation after the unit number. T:t03b.
pub(super) const STORE_UNIT_NUMBER: u64 = 12;
/// Continuation after the discovery reply. T:t03b.
pub(super) const STORE_DISCOVERY: u64 = 26;
/// Continuation in chatter. T:t06b, t25.
pub(super) const CHATTER_ON: u64 = 18;
/// The end of chatter. T:t06b.
pub(super) const CHATTER_END: u64 = 27;
/// Writing of process data or pass-through data to the interface registers. T:t07d, t15a.
pub(super) const STORE_DATA: u64 = 43;
/// Counting of an error: until the receive FIFO is cleared, and the return, which is the time in
/// which a character becomes an overrun. T:r002 (the attempts on an absent channel), FACTS 11.8.
pub(super) const COUNT_ERROR: (u64, u64) = (17, 2);

/// From the clearing of a receive FIFO to that of its flags. T:w07.
pub(super) const CLEAR_FLAGS: u64 = 2;

/// Ticks per second after a normal START. FACTS 4.2.
pub(super) const NORMAL_TICK_RATE: u32 = 500_000;
/// Ticks per second after a setup START. FACTS 4.2.
pub(super) const SETUP_TICK_RATE: u32 = 5_000;
/// Reply timeout in ticks during a normal START (400 us). FACTS 4.2.
pub(super) const NORMAL_START_TIMEOUT: u8 = 200;
/// Reply timeout in ticks during a setup START (1.2 ms). FACTS 4.2.
pub(super) const SETUP_START_TIMEOUT: u8 = 6;
/// Reply timeout in ticks of pass-through accesses (50 ms). FACTS 4.2.
pub(super) const SETUP_RUN_TIMEOUT: u8 = 250;
/// Margin added to the time of the last chatter exchange for the DOIT timeout (40 us). FACTS 5.2.
pub(super) const DOIT_MARGIN: u8 = 20;
/// Permitted number of errors of one kind. FACTS 4.4.
pub(super) const ERROR_LIMIT: u8 = 20;
/// Baud rate after power-up.
pub(super) const DEFAULT_BAUD_RATE: u32 = 2_500_000;
