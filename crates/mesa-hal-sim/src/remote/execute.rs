//! Execution of requests by a remote.

use super::{
    Application, SimRemote,
    buffers::ReplyBuffer,
    parser::{MemoryAccess, ReceivedRequest},
    rpc::{RPC_PITCH, RPC_TABLE_SIZE, RpcMemory},
};
use crate::wire::Nanos;
use mesa_wire::lbp::{
    DISCOVERY, LbpStatus, LocalLocation, NonvolatileMemory, PROCESS_DATA, RemoteFaults, UNIT_NUMBER,
};

/// The value of EC for access to the flash.
const FLASH: u8 = NonvolatileMemory::Flash as u8;

/// Memory that the line can access: working memory, EEPROM, flash or the RPC table.
struct Reach<'a, A> {
    remote: &'a mut SimRemote<A>,
    at: Nanos,
}

impl<A: Application> RpcMemory for Reach<'_, A> {
    fn read(&mut self, address: u16) -> Result<u8, LbpStatus> {
        let remote = &*self.remote;
        match (remote.state.nonvolatile, &remote.flash) {
            // The tables are part of the program.
            (0, _) if remote.state.in_bootloader => Ok(0),
            (0, _) => Ok(remote.memory.byte(address)),
            (FLASH, Some(flash)) => flash.read(address),
            _ => Ok(remote.eeprom.cells().byte(address)),
        }
    }

    fn write(&mut self, address: u16, value: u8) -> Result<(), LbpStatus> {
        let remote = &mut *self.remote;
        let busy = match (remote.state.nonvolatile, &mut remote.flash) {
            (0, _) => return remote.memory.write_from_line(address, value),
            (FLASH, Some(flash)) => self.at + flash.write(self.at, address, value)?,
            _ => remote.eeprom.write(self.at, address, value),
        };
        remote.state.busy_until = remote.state.busy_until.max(busy);
        Ok(())
    }
}

impl<A: Application> SimRemote<A> {
    /// Executes a request; `None` without a reply.
    pub(super) fn execute(&mut self, at: Nanos, request: &ReceivedRequest) -> Option<ReplyBuffer> {
        let location = LocalLocation::new(request.command & 0x1F);
        match (request.command, location) {
            // A bootloader has no remote procedures.
            (0x80..=0xBF, _) if self.state.in_bootloader => None,
            (DISCOVERY, _) => (!self.config.no_discovery)
                .then(|| ReplyBuffer::new(&self.config.sizes(self.state.mode).to_bytes())),
            (UNIT_NUMBER, _) => (!self.config.no_unit_number)
                .then(|| ReplyBuffer::new(&self.unit_number().to_le_bytes())),
            (PROCESS_DATA, _) => Some(self.process_data(at, request.data())),
            (command @ 0x80..=0xBF, _) => Some(self.stored(at, command, request.data())),
            (0xC0..=0xDF, Some(location)) => Some(ReplyBuffer::new(&[self.local_read(location)])),
            (0xE0..=0xFF, Some(location)) => {
                self.local_write(at, location, request.byte());
                Some(ReplyBuffer::EMPTY)
            }
            (command, _) => Some(self.access(at, MemoryAccess::from_byte(command)?, request)),
        }
    }

    fn unit_number(&self) -> u32 {
        match self.config.unit_address {
            Some(address) => self.memory.word(address, 4) as u32,
            None => self.config.unit_number,
        }
    }

    fn process_data(&mut self, at: Nanos, data: &[u8]) -> ReplyBuffer {
        self.feed_watchdog(at);
        let mode = self.state.mode;
        if self.application.clears_faults(data) {
            self.clear_faults(at);
        }
        if self.state.faults.is_empty() {
            self.application.outputs(mode, &mut self.memory, data);
            // An output may trip immediately.
            self.state.faults |= self.application.faults();
        }
        self.application.sample(mode, &mut self.memory);
        let rx_size = self.config.sizes(mode).rx_size;
        // With an RX size of 0 the reply is only its CRC. FACTS 11.5.
        let mut reply = if self.config.no_fault_byte || rx_size == 0 {
            ReplyBuffer::EMPTY
        } else {
            ReplyBuffer::new(&[self.state.faults.bits()])
        };
        let mut inputs = [0; 32];
        let fault_bytes = usize::from(!self.config.no_fault_byte);
        let size = usize::from(rx_size).saturating_sub(fault_bytes);
        let inputs = inputs.get_mut(..size.min(31)).unwrap_or_default();
        self.application.inputs(mode, &mut self.memory, inputs);
        reply.extend(inputs);
        reply
    }

    fn access(
        &mut self,
        at: Nanos,
        access: MemoryAccess,
        request: &ReceivedRequest,
    ) -> ReplyBuffer {
        let address = request.address.unwrap_or(self.state.current);
        self.state.current = address.wrapping_add(access.step());
        if access.is_write() {
            for (offset, &byte) in request.data().iter().enumerate() {
                let result = self.write(at, address.wrapping_add(offset as u16), byte);
                self.note(result);
            }
            self.written();
            return ReplyBuffer::EMPTY;
        }
        self.application.sample(self.state.mode, &mut self.memory);
        let mut reply = ReplyBuffer::EMPTY;
        for offset in 0..access.bytes() {
            let result = self.read(at, address.wrapping_add(offset as u16));
            reply.extend(&[*result.as_ref().unwrap_or(&0)]);
            self.note(result.map(|_| ()));
        }
        reply
    }

    fn read(&mut self, at: Nanos, address: u16) -> Result<u8, LbpStatus> {
        if self.state.rpc_access != 0 && address < RPC_TABLE_SIZE {
            self.state.rpc_table.read(address)
        } else {
            Reach { remote: self, at }.read(address)
        }
    }

    fn write(&mut self, at: Nanos, address: u16, value: u8) -> Result<(), LbpStatus> {
        if self.state.rpc_access != 0 && address < RPC_TABLE_SIZE {
            self.state.rpc_table.write(address, value)
        } else {
            Reach { remote: self, at }.write(address, value)
        }
    }

    fn note(&mut self, result: Result<(), LbpStatus>) {
        if let Err(status) = result {
            self.state.status |= status;
        }
    }

    fn written(&mut self) {
        let faulty = !self.state.faults.is_empty();
        self.application
            .written(self.state.mode, &mut self.memory, faulty);
    }

    /// Executes an RPC of the table. A list that fails gives a reply of only the CRC.
    fn stored(&mut self, at: Nanos, command: u8, data: &[u8]) -> ReplyBuffer {
        self.application.sample(self.state.mode, &mut self.memory);
        let table = self.state.rpc_table.clone();
        let mut current = self.state.current;
        let mut reach = Reach { remote: self, at };
        let result = table.execute(command, data, &mut current, &mut reach);
        self.state.current = current;
        self.written();
        result.unwrap_or_else(|status| {
            self.state.status |= status;
            ReplyBuffer::EMPTY
        })
    }

    fn local_read(&mut self, location: LocalLocation) -> u8 {
        let [address_low, address_high] = self.state.current.to_le_bytes();
        let [size_low, size_high] = RPC_TABLE_SIZE.to_le_bytes();
        match location {
            LocalLocation::UNIT_ADDRESS | LocalLocation::UNIT_ID => self.state.unit_id,
            LocalLocation::STATUS => self.state.status.bits(),
            LocalLocation::CRC_ENABLE => 1,
            LocalLocation::CRC_ERROR_COUNT => self.state.crc_errors,
            LocalLocation::SOFTWARE_MODE => self.state.mode,
            LocalLocation::CLEAR_FAULTS => self.clearing(),
            LocalLocation::RPC_MEMORY_ACCESS => self.state.rpc_access,
            LocalLocation::FRAME_TIMEOUT => self.state.frame_timeout,
            LocalLocation::NONVOLATILE => self.state.nonvolatile,
            LocalLocation::CAPABILITIES => self.config.capabilities.bits(),
            LocalLocation::SOFTWARE_REVISION => self.state.revision,
            LocalLocation::HARDWARE_MODE => self.config.hardware_mode,
            LocalLocation::FAULTS => self.state.faults.bits(),
            LocalLocation::ADDRESS_LOW => address_low,
            LocalLocation::ADDRESS_HIGH => address_high,
            LocalLocation::LBP_VERSION => self.config.lbp_version,
            LocalLocation::RPC_PITCH => RPC_PITCH,
            LocalLocation::RPC_SIZE_LOW => size_low,
            LocalLocation::RPC_SIZE_HIGH => size_high,
            LocalLocation::COOKIE => self.config.cookie,
            // A character of the name, or reserved.
            _ => {
                let character = location.index().checked_sub(LocalLocation::NAME.index());
                let character = character.and_then(|n| self.config.name.get(usize::from(n)));
                character.copied().unwrap_or_default()
            }
        }
    }

    /// C7: non-zero while the faults are still being cleared.
    fn clearing(&mut self) -> u8 {
        if self.state.clear_count == 0 {
            return 0;
        }
        self.state.clear_count -= 1;
        0xFF
    }

    fn local_write(&mut self, at: Nanos, location: LocalLocation, value: u8) {
        let [low, high] = self.state.current.to_le_bytes();
        match location {
            LocalLocation::STATUS if !self.config.status_stuck => {
                self.state.status = LbpStatus::from_bits_retain(value);
            }
            LocalLocation::CRC_ERROR_COUNT => self.state.crc_errors = value,
            LocalLocation::SOFTWARE_MODE => self.set_mode(value),
            LocalLocation::CLEAR_FAULTS if value != 0 => {
                self.state.clear_count = self.config.clear_delay;
                self.clear_faults(at);
            }
            LocalLocation::RPC_MEMORY_ACCESS => self.state.rpc_access = value,
            LocalLocation::FRAME_TIMEOUT => self.state.frame_timeout = value,
            LocalLocation::NONVOLATILE => self.state.nonvolatile = value,
            LocalLocation::LEDS => self.state.leds = value,
            LocalLocation::ADDRESS_LOW => self.state.current = u16::from_le_bytes([value, high]),
            LocalLocation::ADDRESS_HIGH => self.state.current = u16::from_le_bytes([low, value]),
            LocalLocation::ADDRESS_ADD => {
                self.state.current = self.state.current.wrapping_add(u16::from(value));
            }
            LocalLocation::SET_UNIT_ID => self.state.unit_id = value,
            LocalLocation::RESET_PROCESSOR => self.state.reset = value == 0x5A,
            // No effect: reserved locations, a reset of the parser, which is between two frames
            // here, and CRC_ENABLE: a 7I77 always checks CRCs.
            _ => {}
        }
    }

    fn clear_faults(&mut self, at: Nanos) {
        self.state.faults = self.config.stuck_faults;
        self.arm_watchdog(at);
        self.application.faults_cleared();
        self.state.faults |= self.application.faults();
    }

    fn set_mode(&mut self, mode: u8) {
        if self.config.mode(mode).is_some() {
            self.state.mode = mode;
        } else if !self.config.ignores_modes {
            self.state.faults |= RemoteFaults::ILLEGAL_MODE;
        }
    }
}
