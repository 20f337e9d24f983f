//! A simulated Ethernet board: LBP16 in front of the FPGA.

mod areas;
mod capture;
mod config;
mod control;
mod eeprom;
mod ethernet_chip;
mod flash;
mod gateware;
mod icap;
mod pci;
mod pointers;
mod state;
#[cfg(test)]
mod tests;
mod udp;

pub use capture::{Endpoint, PcapWriter, Tap};
pub use config::{AddressJumpers, BoardConfig};
pub use gateware::Gateware;
pub use pci::SimPciBus;
pub use state::StateError;
pub use udp::{Mishaps, UdpClient, UdpCounters, UdpFace};

use self::{
    areas::{end, info_area},
    control::{Words, count_error, microseconds, status_after_reset, waits_for},
    eeprom::Eeprom,
    ethernet_chip::EthernetChip,
    flash::{Flash, FlashError},
    icap::Icap,
    pci::Spi,
    pointers::AddressPointers,
};
use super::wire::Nanos;
use mesa_wire::lbp16::{
    ErrorRegister, InfoArea, MAX_PACKET, Operation, Operations, Space,
    registers::{
        control as control_registers, read_only as card_registers, timer as timer_registers,
    },
};

/// A simulated Ethernet board.
///
/// Pure: takes bytes and a time, and returns bytes and a time. All eight spaces behave as in the
/// manual. Where the manual leaves a case open, the simulation behaves as follows (none of it is
/// confirmed on hardware):
/// - a request is executed up to its first parse error, and the data read before is sent;
/// - a command that its space rejects counts as one memory error, or write error, is skipped, and
///   reads as zeros, so that the rest of the reply keeps its layout;
/// - a reply that does not fit into a packet is not sent;
/// - low address bits within an element are ignored;
/// - error counters stop at 65535, packet counters wrap.
#[derive(Debug)]
pub struct SimBoard<G> {
    config: BoardConfig,
    gateware: G,
    pointers: AddressPointers,
    chip: EthernetChip,
    eeprom: Eeprom,
    flash: Flash,
    timers: Words,
    status: Words,
    card: Words,
    icap: Icap,
    spi: Spi,
    time: Nanos,
    silent_until: Nanos,
    reload: Option<u32>,
    reloads: u32,
    resets: u32,
}

impl<G: Gateware> SimBoard<G> {
    /// A board after power-up.
    pub fn new(config: BoardConfig, gateware: G) -> Self {
        let eeprom = Eeprom::new(&config);
        Self {
            pointers: AddressPointers::default(),
            chip: EthernetChip::new(&config),
            flash: Flash::new(),
            timers: Words::default(),
            status: status_after_reset(eeprom.led_mode()),
            card: control::card(&config),
            icap: Icap::default(),
            spi: Spi::default(),
            eeprom,
            config,
            gateware,
            time: 0,
            silent_until: 0,
            reload: None,
            reloads: 0,
            resets: 0,
        }
    }

    /// The configuration of the board.
    pub fn config(&self) -> &BoardConfig {
        &self.config
    }

    /// The FPGA.
    pub fn gateware(&self) -> &G {
        &self.gateware
    }

    /// Mutable access to the FPGA, to act on the world around it.
    pub fn gateware_mut(&mut self) -> &mut G {
        &mut self.gateware
    }

    /// Advances to `now`.
    pub fn advance_to(&mut self, now: Nanos) {
        self.time = self.time.max(now);
        self.gateware.advance_to(self.time);
    }

    /// The time that the board has reached. While the board waits inside a packet, this is ahead of
    /// the time of the packet.
    pub fn time(&self) -> Nanos {
        self.time
    }

    /// A register of the board itself: space 6 as a host would read it, without any side effect.
    pub fn status(&self, address: u16) -> u16 {
        self.status.get(address)
    }

    /// The register of space 6 whose low bits the LEDs show, LED 0 the lowest; `None` while the
    /// LEDs belong to the FPGA.
    pub fn debug_leds(&self) -> Option<u16> {
        let is_debug = self.status.get(control_registers::LED_MODE) & 1 != 0;
        let shown = self.status.get(control_registers::DEBUG_LED_POINTER);
        is_debug.then(|| self.status.get(shown))
    }

    /// Gives the user LEDs to the network side (`debug`) or to the FPGA until the next restart,
    /// like a host's write of LEDMode.
    pub fn give_leds(&mut self, debug: bool) {
        self.status.set(control_registers::LED_MODE, debug.into());
    }

    /// Number of reloads of the FPGA, and of resets of the firmware.
    pub fn restarts(&self) -> (u32, u32) {
        (self.reloads, self.resets)
    }

    /// Writes bytes to the flash memory, as a JTAG programmer does, in no time. Bytes past its end
    /// are left out.
    pub fn load_flash(&mut self, start: u32, bytes: &[u8]) {
        let cells = self.flash.memory_mut().iter_mut().skip(start as usize);
        for (cell, byte) in cells.zip(bytes) {
            *cell = *byte;
        }
    }

    /// Number of changes of EEPROM and flash; save the state when it has increased.
    pub fn changes(&self) -> u64 {
        self.eeprom.changes() + self.flash.changes()
    }

    /// Executes the request that arrived at `now`. `reply` is overwritten.
    ///
    /// Returns the time at which the reply leaves the board, or `None` without a reply. The board
    /// executes one packet after the other: a request that arrives while it still waits is executed
    /// later.
    pub fn handle_packet(
        &mut self,
        now: Nanos,
        request: &[u8],
        reply: &mut Vec<u8>,
    ) -> Option<Nanos> {
        reply.clear();
        if now < self.silent_until {
            return None;
        }
        self.advance_to(now);
        if self.gateware.is_in_reset() {
            return None;
        }
        self.status.count(control_registers::RX_PACKETS);
        if request.len() > MAX_PACKET {
            count_error(&mut self.status, ErrorRegister::RECEIVE);
            return None;
        }
        self.status.count(control_registers::RX_UDP);
        self.stamp(
            card_registers::RECEIVE_START,
            now.saturating_sub(on_wire(request)),
        );
        self.stamp(card_registers::RECEIVE_DONE, now);
        self.time += self.config.packet_time;
        for operation in Operations::new(request) {
            match operation {
                Ok(operation) => self.execute(&operation, reply),
                Err(_) => count_error(&mut self.status, ErrorRegister::PARSE),
            }
            if self.gateware.is_in_reset() {
                reply.clear();
                return None;
            }
            if reply.len() > MAX_PACKET || self.reload.is_some() {
                break;
            }
        }
        self.status.set(control_registers::WRITE_ENABLE, 0);
        let sent = self.send(reply);
        self.restart();
        sent
    }

    fn send(&mut self, reply: &mut Vec<u8>) -> Option<Nanos> {
        if reply.is_empty() || self.reload.is_some() {
            reply.clear();
            return None;
        }
        if reply.len() > MAX_PACKET {
            count_error(&mut self.status, ErrorRegister::TRANSMIT);
            reply.clear();
            return None;
        }
        self.status.count(control_registers::TX_PACKETS);
        self.status.count(control_registers::TX_UDP);
        self.stamp(card_registers::SEND_START, self.time);
        self.stamp(card_registers::SEND_DONE, self.time + on_wire(reply));
        Some(self.time)
    }

    fn stamp(&mut self, address: u16, at: Nanos) {
        self.card.set(address, microseconds(at));
    }

    /// Executes a reset or a reload that the packet requested.
    fn restart(&mut self) {
        let reset = self.status.get(control_registers::RESET) != 0;
        let reload = self.reload.take();
        if reload.is_some() {
            self.reloads += 1;
            self.reset_for(self.config.reload_time);
        } else if reset {
            self.resets += 1;
            self.silent_until = self.time + self.config.reset_time;
            self.power_up();
        }
    }

    /// Makes the board lose its configuration, as in a dip of its supply: the FPGA is configured
    /// again, and the board is silent for `time`. Remotes stay plugged in.
    pub fn reset_for(&mut self, time: Nanos) {
        self.gateware.reconfigure();
        self.chip = EthernetChip::new(&self.config);
        self.silent_until = self.time + time;
        self.power_up();
    }

    fn power_up(&mut self) {
        self.pointers = AddressPointers::default();
        self.timers = Words::default();
        self.status = status_after_reset(self.eeprom.led_mode());
        self.card = control::card(&self.config);
        self.icap = Icap::default();
    }

    fn execute(&mut self, operation: &Operation<'_>, reply: &mut Vec<u8>) {
        let command = &operation.command;
        let addresses = self.pointers.addresses(operation);
        let area = info_area(command.space);
        let allowed = area.map_or(Err(ErrorRegister::MEMORY), |area| {
            areas::check(area.sizes, *command)
        });
        if let Err(error) = allowed {
            count_error(&mut self.status, error);
            if !command.write {
                reply.resize(reply.len() + command.data_len(), 0);
            }
            return;
        }
        let mut failed = None;
        let mut elements = operation.elements();
        for address in addresses {
            self.time += self.config.access_time;
            let done = if command.write {
                let value = elements.next().unwrap_or(0);
                self.write(command.space, address, value as u32)
            } else {
                let read = match area {
                    Some(area) if command.info => self.read_info(area, address),
                    _ => self.read(command.space, address),
                };
                let bytes = read.unwrap_or(0).to_le_bytes();
                reply.extend(bytes.iter().take(command.size.bytes()));
                read.map(|_| ())
            };
            failed = failed.or(done.err());
        }
        if let Some(error) = failed {
            count_error(&mut self.status, error);
        }
    }

    fn read_info(&self, area: InfoArea, address: u16) -> Result<u32, ErrorRegister> {
        let pointer = self.pointers.get(area.space);
        let words = InfoArea { pointer, ..area }.words();
        let word = words.get(usize::from(address / 2)).copied();
        word.map(u32::from).ok_or(ErrorRegister::MEMORY)
    }

    fn read(&mut self, space: Space, address: u16) -> Result<u32, ErrorRegister> {
        if u32::from(address) >= end(space) {
            return Err(ErrorRegister::MEMORY);
        }
        let word = match space {
            Space::HostMot2 => {
                self.gateware.advance_to(self.time);
                return Ok(self.gateware.read_register(address & !3));
            }
            Space::Flash => {
                let (value, time) = self.flash.read(address & !3).map_err(flash_error)?;
                self.time += time;
                return Ok(value);
            }
            Space::EthernetChip => self.chip.read(address).ok_or(ErrorRegister::MEMORY)?,
            Space::Eeprom => self.eeprom.read(address),
            Space::Timer => self.read_timer(address),
            Space::Control => self.status.get(address),
            Space::ReadOnly => self.card.get(address),
            Space::Unused => return Err(ErrorRegister::MEMORY),
        };
        Ok(u32::from(word))
    }

    fn write(&mut self, space: Space, address: u16, value: u32) -> Result<(), ErrorRegister> {
        if u32::from(address) >= end(space) {
            return Err(ErrorRegister::MEMORY);
        }
        let enable = self.status.get(control_registers::WRITE_ENABLE);
        let word = value as u16;
        match space {
            Space::HostMot2 => {
                self.gateware.advance_to(self.time);
                self.gateware.write_register(address & !3, value);
            }
            Space::EthernetChip => self
                .chip
                .write(address, word)
                .ok_or(ErrorRegister::MEMORY)?,
            Space::Eeprom => {
                let enabled = enable == control_registers::ENABLE_EEPROM;
                let time = self.eeprom.write(address & !1, word, enabled);
                self.time += time.map_err(|_| ErrorRegister::WRITE)?;
            }
            Space::Flash => {
                let enabled = enable == control_registers::ENABLE_FLASH;
                let time = self.flash.write(address & !3, value, enabled);
                self.time += time.map_err(flash_error)?;
            }
            Space::Timer => self.write_timer(address & !1, word),
            Space::Control => self.write_control(address & !1, word),
            Space::ReadOnly => return Err(ErrorRegister::WRITE),
            Space::Unused => return Err(ErrorRegister::MEMORY),
        }
        Ok(())
    }

    fn write_control(&mut self, address: u16, word: u16) {
        if address == control_registers::ICAP {
            self.reload = self.icap.write(word).or(self.reload);
        } else {
            self.status.set(address, word);
        }
    }

    fn read_timer(&mut self, address: u16) -> u16 {
        if let Some(timer) = waits_for(address) {
            return self.wait_for_hm2(timer);
        }
        if address & !1 == timer_registers::TIME_STAMP {
            return microseconds(self.time);
        }
        self.timers.get(address)
    }

    fn write_timer(&mut self, address: u16, word: u16) {
        if let Some(timer) = waits_for(address) {
            self.wait_for_hm2(timer);
            return;
        }
        match address {
            timer_registers::TIME_STAMP => {}
            timer_registers::WAIT_US => {
                self.timers.set(address, word);
                self.time += Nanos::from(word) * 1000;
            }
            _ => self.timers.set(address, word),
        }
    }

    /// Waits for an edge; returns the time waited, in microseconds.
    fn wait_for_hm2(&mut self, timer: u8) -> u16 {
        let start = self.time;
        let timeout = self.timers.get(timer_registers::HM2_TIMEOUT);
        let limit = start + Nanos::from(timeout) * 1000;
        self.gateware.advance_to(start);
        if let Some(edge) = self.gateware.wait_for_timer(timer, limit) {
            self.time = edge.clamp(start, limit);
        } else {
            self.time = limit;
            count_error(&mut self.status, ErrorRegister::HM2_TIMEOUT);
        }
        ((self.time - start) / 1000) as u16
    }
}

fn flash_error(error: FlashError) -> ErrorRegister {
    match error {
        FlashError::NoRegister => ErrorRegister::MEMORY,
        FlashError::NotEnabled => ErrorRegister::WRITE,
    }
}

/// Duration of a packet on the wire: 100 Mbit/s, with preamble, headers, checksum and gap.
fn on_wire(packet: &[u8]) -> Nanos {
    let frame = (packet.len() + 28).max(46) + 38;
    frame as Nanos * 80
}
