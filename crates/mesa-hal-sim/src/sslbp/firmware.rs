//! The firmware's main loop: initialisation, passes over the channels, and the poll for commands
//! between them.
//!
//! Every part of a pass is one step that takes its time (see `timing`). The effects of a step are
//! visible to the host from the beginning of the step on, less than a microsecond early; only
//! COMMAND, DATA and CS change at their own times.

use super::clock::{Clock, TickTimer};
use super::memory::{Memory, channel, global};
use super::registers::HostRegisters;
use super::state::{RESET, status};
use super::uart::{BitRate, Receiver, Transmitter};
use super::{InterfaceRegisters, MAX_CHANNELS, PortConfig, timing};
use crate::wire::Nanos;

/// Position in the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Bit 14 of COMMAND is set.
    Reset,
    /// Released from reset; COMMAND will be cleared next.
    Released,
    /// Memory set-up.
    MemorySetup,
    /// Initialisation: DATA becomes AA.
    Initialize,
    /// Initialisation: commands are accepted again, bit rates are computed.
    InitializeChannels,
    /// End of the initialisation.
    Initialized,
    /// Start of a pass.
    Head,
    /// Turn of this channel in the pass.
    Channel(usize),
    /// The checks for completed commands.
    Tail,
    /// The poll for a new command.
    Check,
    /// The end of the rejection of a word that was cleared before it was read.
    Reject { changes_data: bool },
    /// A START of this kind has done its division, and now takes its mask.
    TakeMask(u8),
    /// No event is possible until COMMAND is written; passes of `length` cycles continue from
    /// `since`.
    Asleep {
        since: u64,
        length: u64,
        in_passes: bool,
    },
    /// Waits for a stopped transmitter; only a reset recovers.
    Hung,
}

/// The UART of a channel.
#[derive(Clone, Debug)]
pub(super) struct Uart {
    pub rate: BitRate,
    pub transmitter: Transmitter,
    pub receiver: Receiver,
    /// Set by characters written while the bit rate was zero.
    pub stuck: bool,
}

/// The processor with everything that it accesses.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Clone, Debug)]
pub(super) struct Firmware {
    pub config: PortConfig,
    pub clock: Clock,
    /// The cycle at which the next step begins; within a step, the present one.
    pub cycle: u64,
    pub memory: Memory,
    pub host: HostRegisters,
    pub timer: TickTimer,
    pub uarts: [Uart; MAX_CHANNELS],
    /// Characters from index 16 on of the last replies.
    pub long_replies: [[u8; 16]; MAX_CHANNELS],
    phase: Phase,
    /// Set by events in this pass that may matter in the next one.
    pub busy: bool,
    /// Set by a stop that was taken while another command was in work, of which it ends the wait.
    pub ends_wait: bool,
    /// Set by such a stop, or another one behind it, that was completed before it was read.
    pub freed: bool,
    /// Set by a frame that a transmitter got, until [`take_has_sent`](Self::take_has_sent).
    pub has_sent: bool,
    head_cycle: u64,
}

impl Firmware {
    /// The firmware at power-up.
    pub fn new(config: PortConfig) -> Self {
        let capacity = Self::fifo_capacity(config);
        let clock = Clock::new(config.clock_hz());
        let delay = clock.nanos(timing::RECEIVER_DELAY);
        Self {
            config,
            clock,
            cycle: timing::RESET_FIRST_CLEAR,
            memory: Memory::new(),
            host: HostRegisters::new(),
            timer: TickTimer::new(),
            uarts: core::array::from_fn(|_| Uart {
                rate: BitRate::default(),
                transmitter: Transmitter::default(),
                receiver: Receiver::new(capacity, delay),
                stuck: false,
            }),
            long_replies: [[0; 16]; MAX_CHANNELS],
            phase: Phase::Released,
            busy: true,
            ends_wait: false,
            freed: false,
            has_sent: false,
            head_cycle: 0,
        }
    }

    /// The same firmware with power-up at `now`.
    pub fn begun_at(mut self, now: Nanos) -> Self {
        let power_up = self.clock.cycle_at(now);
        self.cycle += power_up;
        self.timer.read(power_up);
        self
    }

    /// Capacity of a FIFO in characters: 16, and 32 where seven interface registers need more
    /// (assumed, no transcript shows that variant).
    pub fn fifo_capacity(config: PortConfig) -> usize {
        match config.interface_registers() {
            InterfaceRegisters::Three => 16,
            InterfaceRegisters::Seven => 32,
        }
    }

    /// The present time.
    pub fn now(&self) -> Nanos {
        self.clock.nanos(self.cycle)
    }

    /// Advances by a number of cycles.
    pub fn spend(&mut self, cycles: u64) {
        self.cycle += cycles;
    }

    /// Start of the next step; `None` while only the host can start something.
    pub fn next_step(&self) -> Option<Nanos> {
        match self.phase {
            Phase::Reset | Phase::Asleep { .. } | Phase::Hung => None,
            _ => Some(self.now()),
        }
    }

    /// True if a transmitter got a frame since the last call.
    pub fn take_has_sent(&mut self) -> bool {
        core::mem::take(&mut self.has_sent)
    }

    /// True if the processor is held in reset.
    pub fn in_reset(&self) -> bool {
        self.phase == Phase::Reset
    }

    /// Handles a write to COMMAND at `now`.
    pub fn command_written(&mut self, now: Nanos) {
        let reset = self.host.command(now) & 0x4000 != 0;
        if reset {
            self.phase = Phase::Reset;
        } else if self.phase == Phase::Reset {
            self.cycle = self.clock.cycle_at(now) + timing::RESET_FIRST_CLEAR;
            self.phase = Phase::Released;
        } else {
            self.wake(now);
        }
    }

    /// Continues a START after its division; until then the host may write another mask.
    pub fn start_after_division(&mut self, kind: u8) {
        self.spend(timing::START_DIVISION);
        self.phase = Phase::TakeMask(kind);
    }

    /// Continues with the rejection of a word that was cleared before it was read.
    pub fn reject_word(&mut self, changes_data: bool) {
        self.phase = Phase::Reject { changes_data };
    }

    /// Hangs the firmware until a reset.
    pub fn hang(&mut self) {
        self.phase = Phase::Hung;
    }

    /// Continues at the place in the loop that corresponds to `now`.
    fn wake(&mut self, now: Nanos) {
        let Phase::Asleep {
            since,
            length,
            in_passes,
        } = self.phase
        else {
            return;
        };
        let (tail, phase) = if in_passes {
            (timing::PASS_TAIL + timing::CHECK, Phase::Tail)
        } else {
            (0, Phase::Check)
        };
        let first = since + length.saturating_sub(tail);
        let missing = self.clock.cycle_at(now).saturating_sub(first);
        self.cycle = first + missing.div_ceil(length.max(1)) * length;
        self.phase = phase;
        self.busy = true;
    }

    /// Executes one step.
    pub fn step(&mut self) {
        match self.phase {
            Phase::Reset | Phase::Asleep { .. } | Phase::Hung => {}
            Phase::Released => self.set_up_memory(),
            Phase::MemorySetup => {
                let now = self.now();
                self.host.clear_command(now);
                self.spend(timing::RESET_DATA);
                self.phase = Phase::Initialize;
            }
            Phase::Initialize => {
                let now = self.now();
                self.host.set_data(now, 0xAA);
                self.spend(timing::RESET_DOORBELL);
                self.phase = Phase::InitializeChannels;
            }
            Phase::InitializeChannels => self.initialize_channels(),
            Phase::Initialized => {
                self.memory.set(global::INITIALIZED, 0xFF);
                let minor = self.config.minor_revision();
                self.memory.set(global::MINOR_REVISION, minor);
                self.busy = true;
                let [mask, _] = self.host.command(self.now()).to_le_bytes();
                if self.memory.get(global::COMMAND_IN_WORK) == 0x08 && mask == 0 {
                    self.complete();
                }
                self.phase = Phase::Check;
            }
            Phase::Head => self.head(),
            Phase::Channel(index) => self.channel_turn(index),
            Phase::Tail => {
                self.phase = Phase::Check;
                self.check_completion();
                self.spend(timing::CHECK);
            }
            Phase::Reject { changes_data } => {
                if changes_data {
                    let now = self.now();
                    self.host.set_data(now, 0xFF);
                }
                self.host.doorbell = false;
                self.busy = true;
                self.phase = Phase::Head;
            }
            Phase::Check => {
                self.phase = Phase::Head;
                self.check_for_command();
            }
            Phase::TakeMask(kind) => {
                self.phase = Phase::Head;
                let written = self.host.command(self.now());
                self.start_channels(kind, written);
            }
        }
    }

    /// Completes the command in work: COMMAND becomes 0.
    pub fn complete(&mut self) {
        self.memory.set(global::COMMAND_IN_WORK, 0);
        let now = self.now();
        self.host.clear_command(now);
        self.busy = true;
    }

    fn channels(&self) -> usize {
        usize::from(self.memory.get(global::CHANNELS)).clamp(1, self.config.channels())
    }

    fn set_up_memory(&mut self) {
        // Memory is still in the state before the reset. FACTS 11.16: only a build of eight
        // channels.
        let all = self.config.channels() == MAX_CHANNELS;
        if all && self.memory.get(global::INITIALIZED) != 0 && self.is_idle() {
            let now = self.now();
            self.host.clear_command(now);
        }
        let channels = self.config.channels();
        self.memory
            .set_up(channels as u8, timing::DEFAULT_BAUD_RATE);
        let memory = timing::RESET_MEMORY + timing::RESET_MEMORY_CHANNEL * channels as u64;
        self.spend(memory - timing::RESET_FIRST_CLEAR);
        self.phase = Phase::MemorySetup;
    }

    fn initialize_channels(&mut self) {
        self.host.doorbell = false;
        self.memory.set(global::START_TYPE, 0);
        self.memory.set(global::STOP_BITS, 0xFF);
        let channels = self.channels();
        let mask = ((1_u16 << channels) - 1) as u8;
        self.memory.set(global::CHANNEL_MASK, mask);
        let now = self.now();
        let hz = self.clock.hz();
        for (index, uart) in self.uarts.iter_mut().enumerate().take(channels) {
            let baud = self.memory.channel_long(index, channel::BAUD_RATE);
            uart.rate = BitRate::new(baud, hz);
            uart.receiver.clear(now);
            uart.receiver.clear_flags(now);
            uart.receiver.set_rate(uart.rate);
        }
        self.spend(timing::INITIALIZE + timing::INITIALIZE_CHANNEL * channels as u64);
        self.phase = Phase::Initialized;
    }

    fn head(&mut self) {
        if self.memory.get(global::INITIALIZED) == 0 {
            self.phase = Phase::Initialize;
            return;
        }
        if self.is_idle() {
            if self.host.doorbell {
                self.spend(timing::IDLE_LOOP);
                self.phase = Phase::Check;
            } else {
                self.sleep(timing::IDLE_LOOP, false);
            }
            return;
        }
        // A command written since the last check is work as well.
        if !self.busy && !self.host.doorbell {
            self.sleep(self.cycle - self.head_cycle, true);
            return;
        }
        self.busy = false;
        self.head_cycle = self.cycle;
        self.spend(timing::PASS_HEAD);
        self.phase = Phase::Channel(0);
    }

    /// True if a pass over the channels has no work. A build of fewer than eight channels is never
    /// idle: the stop bits of the missing channels stay set.
    fn is_idle(&self) -> bool {
        let work = self.memory.get(global::COMMAND_IN_WORK)
            | self.memory.get(global::STOP_BITS)
            | self.memory.get(global::CHATTER_BITS);
        work == 0
    }

    fn sleep(&mut self, length: u64, in_passes: bool) {
        self.phase = Phase::Asleep {
            since: self.cycle,
            length,
            in_passes,
        };
    }

    fn channel_turn(&mut self, index: usize) {
        let which = 1_u8 << index;
        self.phase = if index + 1 < self.channels() {
            Phase::Channel(index + 1)
        } else {
            Phase::Tail
        };
        self.spend(timing::TURN_BEFORE);
        if self.memory.get(global::STOP_BITS) & which != 0 {
            self.stop_channel(index, which);
        }
        if self.memory.get(global::START_BITS) & which != 0 {
            self.spend(timing::DISPATCH);
            self.run_channel(index, which);
            self.spend(timing::DISPATCH_BACK);
        }
        let cs = u32::from_le_bytes([
            self.memory.channel(index, channel::ERROR_LOG),
            self.memory.channel(index, channel::STATUS),
            self.memory.channel(index, channel::STATE),
            self.memory.channel(index, channel::REMOTE_FAULT),
        ]);
        let now = self.now();
        self.host.set_cs(now, index, cs);
        self.spend(timing::TURN_AFTER);
    }

    fn stop_channel(&mut self, index: usize, which: u8) {
        use status::{NO_IDENTITY, NOT_READY, REMOTE_FAULT};
        let memory = &mut self.memory;
        memory.set_channel(
            index,
            channel::STATUS,
            NOT_READY | NO_IDENTITY | REMOTE_FAULT,
        );
        memory.set_channel(index, channel::STATE, RESET);
        for offset in [
            channel::ERROR,
            channel::ERROR_LOG,
            channel::IDENTITY,
            channel::GENERIC,
        ] {
            memory.set_channel(index, offset, 0);
        }
        memory.clear_bits(global::STOP_BITS, which);
        memory.clear_bits(global::START_BITS, which);
        memory.set_bits(global::NOT_STARTED_BITS, which);
        memory.set_bits(global::NOT_READY_BITS, which);
        memory.clear_bits(global::REQUEST_BITS, which);
        self.clear_counters(index);
        let registers = self.config.interface_registers().count();
        self.host.set_interface(index, registers, &[]);
        self.clear_receiver(index);
        self.spend(timing::STOP_CHANNEL);
        self.busy = true;
    }

    /// Clears the error counters and sets the error limit.
    pub fn clear_counters(&mut self, index: usize) {
        for offset in channel::CRC_ERRORS..=channel::REMOTE_FAULTS {
            self.memory.set_channel(index, offset, 0);
        }
        self.memory
            .set_channel(index, channel::ERROR_LIMIT, timing::ERROR_LIMIT);
    }

    /// Empties a channel's receive FIFO, and clears its flags two instructions later: a character
    /// that completes in between stays without its flag. FACTS 11.14.
    pub fn clear_receiver(&mut self, index: usize) {
        let now = self.now();
        let later = self.clock.nanos(self.cycle + timing::CLEAR_FLAGS);
        if let Some(uart) = self.uarts.get_mut(index) {
            uart.receiver.clear(now);
            uart.receiver.clear_flags(later);
        }
    }
}
