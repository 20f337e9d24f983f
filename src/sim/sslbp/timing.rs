//! How long the firmware takes, in clock cycles: one place for every calibrated cost.
//!
//! The processor executes one instruction a cycle, and its program is one endless loop over all
//! channels; these costs are those of the loop's parts. They were fitted to the transcripts
//! named at each of them (100 MHz, so 100 cycles are one microsecond) and leave the times of all
//! transcripts well within the allowed 15 us.

/// From release of bit 14 until COMMAND is cleared for the first time. T:t01 (0.13 us).
pub(super) const RESET_FIRST_CLEAR: u64 = 11;
/// From release of bit 14 until memory is set up and COMMAND is cleared again. T:t01b (22.3 us).
pub(super) const RESET_MEMORY: u64 = 2_228;
/// From there until DATA reads AA. T:t01 (DATA is still old when COMMAND just became 0).
pub(super) const RESET_DATA: u64 = 3;
/// From there until a COMMAND write counts again. T:t01 (a write 22.31 us after release is lost).
pub(super) const RESET_DOORBELL: u64 = 1;

/// Global initialisation apart from the channels. T:t02.
pub(super) const INITIALIZE: u64 = 60;
/// Global initialisation of one channel, nearly all of it a division. T:t02, t04c (14.9 us).
pub(super) const INITIALIZE_CHANNEL: u64 = 1_487;

/// One turn of the loop when there is nothing at all to do. T:t01 (a local read takes 0.5 us).
pub(super) const IDLE_LOOP: u64 = 16;
/// A pass over the channels: what comes before the first of them. T:t03b.
pub(super) const PASS_HEAD: u64 = 29;
/// One channel in a pass: what comes before its own work. T:t03b, t25.
pub(super) const CHANNEL_BEFORE: u64 = 10;
/// One channel in a pass: status to CS, and on to the next. T:t03b, t25.
pub(super) const CHANNEL_AFTER: u64 = 20;
/// Finding the routine of a running channel's state. T:t03b.
pub(super) const DISPATCH: u64 = 10;
/// A pass over the channels: the checks for completed commands. T:t03b.
pub(super) const PASS_TAIL: u64 = 20;
/// The look for a new command. T:t03b.
pub(super) const CHECK: u64 = 7;

/// Executing a local read or write, or rejecting a command. T:t01 (0.5 us with the polling).
pub(super) const SIMPLE_COMMAND: u64 = 25;
/// Setting up a DOIT. T:t07a.
pub(super) const DOIT_COMMAND: u64 = 35;
/// The division that gives the tick timer's divider. T:t03b, t09 (a START takes 16..18 us).
pub(super) const START_DIVISION: u64 = 1_480;
/// The rest of a START command. T:t03b.
pub(super) const START_COMMAND: u64 = 60;
/// Clearing one channel after a stop. T:t02b, t08.
pub(super) const STOP_CHANNEL: u64 = 75;

/// A small state without input or output. T:t03b.
pub(super) const SMALL_STATE: u64 = 10;
/// Comparing the name with a known one. T:t03b (states 16 and 17).
pub(super) const COMPARE_NAME: u64 = 30;
/// From a send state's entry to the first character. T:t03b (0.2 us before the new state shows).
pub(super) const SEND_BEFORE: u64 = 20;
/// From the first character's write to its start bit.
pub(super) const SEND_START: u64 = 3;
/// Each character sent. T:t06, t07d.
pub(super) const SEND_CHARACTER: u64 = 8;
/// After the last character. T:t03b.
pub(super) const SEND_AFTER: u64 = 10;
/// Looking for a reply that is not there yet. T:t12 (passes while waiting).
pub(super) const RECEIVE_NOTHING: u64 = 20;
/// Taking a reply, apart from its characters. T:t03b.
pub(super) const RECEIVE: u64 = 30;
/// Each character of a reply. T:t06.
pub(super) const RECEIVE_CHARACTER: u64 = 11;
/// Looking whether a reply is overdue. T:t12.
pub(super) const CHECK_TIMER: u64 = 7;
/// Counting an error.
pub(super) const COUNT_ERROR: u64 = 30;
/// Writing process data or pass-through data to the interface registers. T:t07d, t15a.
pub(super) const STORE_DATA: u64 = 45;

/// Ticks a second after a normal START. FACTS 4.2.
pub(super) const NORMAL_TICK_RATE: u32 = 500_000;
/// Ticks a second after a setup START. FACTS 4.2.
pub(super) const SETUP_TICK_RATE: u32 = 5_000;
/// Reply timeout in ticks during a normal START (400 us). FACTS 4.2.
pub(super) const NORMAL_START_TIMEOUT: u8 = 200;
/// Reply timeout in ticks during a setup START (1.2 ms). FACTS 4.2.
pub(super) const SETUP_START_TIMEOUT: u8 = 6;
/// Reply timeout in ticks of pass-through accesses (50 ms). FACTS 4.2.
pub(super) const SETUP_RUN_TIMEOUT: u8 = 250;
/// What is added to the last chatter exchange's time to give the DOIT timeout (40 us). FACTS 5.2.
pub(super) const DOIT_MARGIN: u8 = 20;
/// Errors of one kind that are allowed. FACTS 4.4.
pub(super) const ERROR_LIMIT: u8 = 20;
/// Baud rate after power-up.
pub(super) const DEFAULT_BAUD_RATE: u32 = 2_500_000;
