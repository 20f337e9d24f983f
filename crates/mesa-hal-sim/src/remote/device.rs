//! A simulated remote: the protocol around an [`Application`].

use super::{
    Application, ParameterPlace, ReplyFaults, SimEeprom, SimFlash, SimMemory, SimRemoteConfig,
    buffers::{MAX_FRAME, Queue, RemoteEvent, RemoteEvents, ReplyBuffer},
    config::{WorkingCopy, bit_of_index},
    line,
    parser::{Parsed, Parser, ReceivedRequest},
    program,
    rpc::RpcTable,
};
use crate::wire::{Burst, Nanos, RemoteEnd};
use mesa_wire::lbp::{
    Capabilities, DISCOVERY, LbpStatus, PROCESS_DATA, RemoteFaults, UNIT_NUMBER, crc8,
};

/// Length of a bit in the setup position of the jumper: 115200 baud, whatever the baud-rate
/// parameter is; and the frame timeout, in bit times. Manual: 7I77, "SETUP/OPERATE MODE",
/// "FRAMING".
const SETUP_BIT: Nanos = 8_681;
const SETUP_FRAME_TIMEOUT: u8 = 255;

/// A simulated remote on its serial line.
///
/// # Real time
/// Allocates when it is created, but not for a frame.
#[derive(Debug)]
pub struct SimRemote<A> {
    pub(super) config: SimRemoteConfig,
    pub(super) application: A,
    pub(super) state: RemoteProgress,
    pub(super) memory: SimMemory,
    pub(super) eeprom: SimEeprom,
    pub(super) flash: Option<SimFlash>,
    pub(super) reply_faults: ReplyFaults,
    parser: Parser,
    watchdog: RemoteTimer,
    powered: bool,
    now: Nanos,
    line_free: Nanos,
    queue: Queue,
    events: RemoteEvents,
}

/// State that a power cycle resets.
#[derive(Clone, Debug)]
pub(super) struct RemoteProgress {
    pub(super) mode: u8,
    pub(super) faults: RemoteFaults,
    pub(super) status: LbpStatus,
    pub(super) clear_count: u32,
    pub(super) crc_errors: u8,
    /// The value written to EC.
    pub(super) nonvolatile: u8,
    pub(super) rpc_access: u8,
    pub(super) rpc_table: RpcTable,
    pub(super) current: u16,
    pub(super) unit_id: u8,
    pub(super) leds: u8,
    pub(super) frame_timeout: u8,
    pub(super) busy_until: Nanos,
    pub(super) reset: bool,
    /// The program is missing or damaged.
    pub(super) in_bootloader: bool,
    /// D5 of the running program.
    pub(super) revision: u8,
}

impl RemoteProgress {
    fn power_up(config: &SimRemoteConfig) -> Self {
        Self {
            mode: config.initial_mode,
            faults: config.initial_faults,
            status: config.initial_status,
            clear_count: 0,
            crc_errors: 0,
            nonvolatile: 0,
            rpc_access: 0,
            rpc_table: RpcTable::default(),
            current: 0,
            unit_id: 0,
            leds: 0,
            frame_timeout: config.frame_timeout,
            busy_until: 0,
            reset: false,
            in_bootloader: false,
            revision: config.software_revision,
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct RemoteTimer {
    deadline: Option<Nanos>,
}

impl<A: Application> SimRemote<A> {
    /// A remote that was powered up at time 0.
    pub fn new(config: SimRemoteConfig, application: A) -> Self {
        let mut eeprom = SimEeprom::new(config.eeprom_write_time);
        // Until other values are stored, the EEPROM holds the initial values of the working copies.
        for copy in &config.working_copies {
            for offset in 0..copy.bytes {
                let byte = config.image.byte(copy.to.wrapping_add(offset));
                eeprom
                    .cells_mut()
                    .set_byte(copy.from.wrapping_add(offset), byte);
            }
        }
        let flash = config
            .capabilities
            .contains(Capabilities::FLASH)
            .then(|| program::factory(config.name, config.software_revision));
        let mut remote = Self {
            state: RemoteProgress::power_up(&config),
            parser: Parser::new(config.bit),
            memory: SimMemory::default(),
            config,
            application,
            eeprom,
            flash,
            reply_faults: ReplyFaults::default(),
            watchdog: RemoteTimer::default(),
            powered: true,
            now: 0,
            line_free: 0,
            queue: Queue::default(),
            events: RemoteEvents::default(),
        };
        remote.power_up();
        remote
    }

    /// Switches the supply on or off at `now`. Without power the remote is silent, its outputs are
    /// off, and it loses everything but the EEPROM and the flash.
    pub fn set_power(&mut self, now: Nanos, on: bool) {
        self.advance(now);
        if self.powered && !on {
            self.eeprom.power_off();
            if let Some(flash) = &mut self.flash {
                flash.power_off(self.now);
            }
            self.queue = Queue::default();
            self.watchdog.deadline = None;
            self.application.outputs_off(&mut self.memory);
        } else if !self.powered && on {
            self.power_up();
        }
        self.powered = on;
    }

    fn power_up(&mut self) {
        self.memory.clone_from(&self.config.image);
        for &WorkingCopy { from, to, bytes } in &self.config.working_copies {
            for offset in 0..bytes {
                let byte = self.eeprom.cells().byte(from.wrapping_add(offset));
                self.memory.set_byte(to.wrapping_add(offset), byte);
            }
        }
        if let Some(address) = self.config.baud_address {
            self.config.bit = bit_of_index(self.memory.byte(address));
        }
        self.state = RemoteProgress::power_up(&self.config);
        if self.config.setup_jumper {
            self.config.bit = SETUP_BIT;
            self.state.frame_timeout = SETUP_FRAME_TIMEOUT;
        }
        if let Some(flash) = &self.flash {
            let revision = program::revision(flash, self.config.name);
            self.state.in_bootloader = revision.is_none();
            self.state.revision = revision.unwrap_or_default();
        }
        if let Some(ParameterPlace { address, bytes }) = self.config.revision_place {
            let revision = self.state.revision.into();
            self.memory.set_word(address, bytes.into(), revision);
        }
        self.parser = Parser::new(self.config.bit);
        self.parser.timeout_bits = self.state.frame_timeout;
        self.watchdog.deadline = None;
        self.application.power_up(&mut self.memory);
    }

    /// True if the remote has power.
    pub const fn is_powered(&self) -> bool {
        self.powered
    }

    /// The configuration of the remote.
    pub const fn config(&self) -> &SimRemoteConfig {
        &self.config
    }

    /// Changes the configuration. Memory and power-up values apply from the next power-up on.
    pub fn configure(&mut self, change: impl FnOnce(&mut SimRemoteConfig)) {
        change(&mut self.config);
        self.parser.bit = self.config.bit;
    }

    /// The faults of the next replies.
    pub const fn reply_faults(&mut self) -> &mut ReplyFaults {
        &mut self.reply_faults
    }

    /// The application.
    pub const fn application(&self) -> &A {
        &self.application
    }

    /// Mutable access to the application, to act on its world.
    pub const fn application_mut(&mut self) -> &mut A {
        &mut self.application
    }

    /// Working memory.
    pub const fn memory(&self) -> &SimMemory {
        &self.memory
    }

    /// Mutable access to working memory, bypassing the line.
    pub const fn memory_mut(&mut self) -> &mut SimMemory {
        &mut self.memory
    }

    /// The EEPROM.
    pub const fn eeprom(&self) -> &SimEeprom {
        &self.eeprom
    }

    /// Mutable access to the EEPROM, to prepare it.
    pub const fn eeprom_mut(&mut self) -> &mut SimEeprom {
        &mut self.eeprom
    }

    /// The program flash, if it can be updated.
    pub const fn flash(&self) -> Option<&SimFlash> {
        self.flash.as_ref()
    }

    /// Mutable access to the program flash, to prepare or damage it.
    pub const fn flash_mut(&mut self) -> Option<&mut SimFlash> {
        self.flash.as_mut()
    }

    /// Removes the program flash: the remote cannot be updated from now on.
    pub fn take_flash(&mut self) -> Option<SimFlash> {
        self.flash.take()
    }

    /// True if the program is missing or damaged, so that only the bootloader replies.
    pub const fn is_in_bootloader(&self) -> bool {
        self.state.in_bootloader
    }

    /// True if the flash memory holds a valid program for this card, or if there is no flash
    /// memory.
    pub fn is_program_whole(&self) -> bool {
        let flash = self.flash.as_ref();
        flash.is_none_or(|flash| program::revision(flash, self.config.name).is_some())
    }

    /// D5: the revision of the running program; 0 in the bootloader.
    pub const fn revision(&self) -> u8 {
        self.state.revision
    }

    /// The current software mode.
    pub const fn mode(&self) -> u8 {
        self.state.mode
    }

    /// The fault byte.
    pub const fn faults(&self) -> RemoteFaults {
        self.state.faults
    }

    /// Sets the fault byte, as by an event: each bit stays until the host clears the faults, and
    /// meanwhile outputs are not applied (FACTS 1.5). The watchdog's bit also switches the outputs
    /// off.
    pub fn set_faults(&mut self, faults: RemoteFaults) {
        let news = faults - self.state.faults;
        if news.contains(RemoteFaults::WATCHDOG) {
            self.state.status |= LbpStatus::WATCHDOG;
            self.application.outputs_off(&mut self.memory);
        }
        self.state.faults = faults;
    }

    /// The LBP status.
    pub const fn status(&self) -> LbpStatus {
        self.state.status
    }

    /// Sets the LBP status, as by an event.
    pub fn set_status(&mut self, status: LbpStatus) {
        self.state.status = status;
    }

    /// The LEDs (F7).
    pub const fn leds(&self) -> u8 {
        self.state.leds
    }

    /// Takes the oldest event. The last sixteen are kept.
    pub fn take_event(&mut self) -> Option<(Nanos, RemoteEvent)> {
        self.events.pop()
    }

    /// Restarts the watchdog after process data.
    pub(super) fn feed_watchdog(&mut self, at: Nanos) {
        let time = match self.config.watchdog_address {
            Some(address) => self.memory.word(address, 2) * 1_000_000,
            None => self.config.watchdog,
        };
        self.watchdog.deadline = (time > 0).then_some(at + time);
    }

    /// Starts the watchdog after a clear of faults: from now on outputs can be set.
    pub(super) fn arm_watchdog(&mut self, at: Nanos) {
        if self.watchdog.deadline.is_none() {
            self.feed_watchdog(at);
        }
    }

    fn pass_time(&mut self, now: Nanos) {
        if self.powered && self.config.present {
            self.eeprom.advance(now);
            self.application.advance(now, self.state.mode, &self.memory);
            if let Some(deadline) = self.watchdog.deadline.filter(|&deadline| deadline <= now) {
                self.bite(deadline);
            }
            self.state.faults |= self.application.faults();
        }
        self.now = self.now.max(now);
    }

    fn bite(&mut self, deadline: Nanos) {
        self.watchdog.deadline = None;
        self.application.outputs_off(&mut self.memory);
        // A bite is a new event only after the host has cleared the previous fault.
        if !self.state.faults.contains(RemoteFaults::WATCHDOG) {
            self.state.faults |= RemoteFaults::WATCHDOG;
            self.state.status |= LbpStatus::WATCHDOG;
            self.events.push(deadline, RemoteEvent::WatchdogBites);
        }
    }

    fn character(&mut self, at: Nanos, byte: u8) {
        self.pass_time(at);
        self.parser.timeout_bits = self.state.frame_timeout;
        if let Some(dropped) = self.parser.expire(at) {
            self.state.status |= LbpStatus::FRAME_TIMEOUT;
            self.events.push(at, RemoteEvent::FrameTimeout(dropped));
        }
        let (config, state) = (&self.config, &self.state);
        let rpc_len = |command| match command {
            PROCESS_DATA => usize::from(config.sizes(state.mode).tx_size),
            DISCOVERY | UNIT_NUMBER => 0,
            stored => state.rpc_table.request_len(stored).unwrap_or(0),
        };
        match self.parser.push(at, byte, rpc_len) {
            Parsed::Request(request) => self.answer(at, &request),
            Parsed::CrcError => {
                self.state.status |= LbpStatus::CRC_ERROR;
                self.state.crc_errors = self.state.crc_errors.wrapping_add(1);
            }
            Parsed::Overflow => self.state.status |= LbpStatus::BUFFER_OVERFLOW,
            Parsed::Pending | Parsed::NotACommand => {}
        }
    }

    fn answer(&mut self, at: Nanos, request: &ReceivedRequest) {
        if let Some(reply) = self.execute(at, request) {
            self.send(at, &reply);
        }
        if self.state.reset {
            self.application.outputs_off(&mut self.memory);
            self.power_up();
        }
    }

    fn send(&mut self, at: Nanos, reply: &ReplyBuffer) {
        let faults = &mut self.reply_faults;
        if faults.drop > 0 {
            faults.drop -= 1;
            self.events.push(at, RemoteEvent::DropsReply);
            return;
        }
        let mut crc = crc8(reply.as_bytes());
        if faults.bad_crc > 0 {
            faults.bad_crc -= 1;
            crc ^= 0x55;
            self.events.push(at, RemoteEvent::BadCrc);
        }
        let late = faults.late.take();
        if late.is_some() {
            self.events.push(at, RemoteEvent::Late);
        }
        let latency = late.unwrap_or(self.config.latency);
        let ready = at.max(self.state.busy_until) + latency;
        let start = ready.max(self.line_free);
        let mut burst = Burst::new(start, self.config.bit, reply.as_bytes());
        burst.push(crc);
        let extra = core::mem::take(&mut faults.extra);
        for _ in 0..extra.min(MAX_FRAME as u32) {
            burst.push(0xA5);
        }
        if extra > 0 {
            self.events.push(at, RemoteEvent::Extra);
        }
        let short = core::mem::take(&mut faults.short);
        if short > 0 {
            burst.truncate(burst.len().saturating_sub(short as usize));
            self.events.push(at, RemoteEvent::Short);
        }
        if faults.breaks > 0 {
            faults.breaks -= 1;
            burst.is_break = true;
            self.events.push(at, RemoteEvent::Break);
        }
        self.line_free = burst.end();
        if !burst.is_empty() {
            self.queue.push(burst);
        }
    }
}

impl<A: Application> RemoteEnd for SimRemote<A> {
    fn advance(&mut self, now: Nanos) {
        self.pass_time(now);
    }

    fn next_event(&self) -> Option<Nanos> {
        let own = [self.watchdog.deadline, self.eeprom.busy_until()];
        let own = own.into_iter().flatten().min();
        own.filter(|_| self.powered && self.config.present)
    }

    fn receive(&mut self, burst: &Burst) {
        if self.powered && self.config.present {
            line::receive(burst, self.config.bit, |at, byte| self.character(at, byte));
        }
    }

    fn transmit(&mut self) -> Option<Burst> {
        self.queue.pop()
    }

    fn holds_line_low(&self) -> bool {
        !self.config.present && self.config.idles_low
    }
}
