//! What a remote does with a request.

use super::{Application, Remote, buffers::Reply};
use crate::{
    lbp::{
        Access, Command, LbpError, LbpStatus, LocalRead, LocalWrite, Nonvolatile, RPC_PITCH,
        RPC_TABLE_SIZE, ReceivedRequest, RemoteFaults, RpcMemory, RpcNumber,
    },
    sim::wire::Nanos,
};

/// What the line can reach: working memory, EEPROM, flash or the RPC table.
struct Reach<'a, A> {
    remote: &'a mut Remote<A>,
    at: Nanos,
}

impl<A: Application> RpcMemory for Reach<'_, A> {
    fn read(&mut self, address: u16) -> Result<u8, LbpError> {
        let remote = &*self.remote;
        match (remote.state.nonvolatile, &remote.flash) {
            (Nonvolatile::Off, _) => Ok(remote.memory.byte(address)),
            (Nonvolatile::Flash, Some(flash)) => flash.read(address),
            _ => Ok(remote.eeprom.cells().byte(address)),
        }
    }

    fn write(&mut self, address: u16, value: u8) -> Result<(), LbpError> {
        let remote = &mut *self.remote;
        let busy = match (remote.state.nonvolatile, &mut remote.flash) {
            (Nonvolatile::Off, _) => return remote.memory.write_from_line(address, value),
            (Nonvolatile::Flash, Some(flash)) => self.at + flash.write(address, value)?,
            _ => remote.eeprom.write(self.at, address, value),
        };
        remote.state.busy_until = remote.state.busy_until.max(busy);
        Ok(())
    }
}

impl<A: Application> Remote<A> {
    /// Carries out a request; `None`: it stays silent.
    pub(super) fn execute(&mut self, at: Nanos, request: &ReceivedRequest) -> Option<Reply> {
        match request.command {
            Command::Access(access) => Some(self.access(at, access, request)),
            Command::Rpc(RpcNumber::DISCOVERY) => (!self.config.no_discovery)
                .then(|| Reply::new(&self.config.sizes(self.state.mode).to_bytes())),
            Command::Rpc(RpcNumber::UNIT_NUMBER) => {
                (!self.config.no_unit_number).then(|| Reply::new(&self.unit_number().to_le_bytes()))
            }
            Command::Rpc(RpcNumber::PROCESS_DATA) => Some(self.process_data(at, request.data())),
            Command::Rpc(number) => Some(self.stored(at, number, request.data())),
            Command::LocalRead(read) => Some(Reply::new(&[self.local_read(read)])),
            Command::LocalWrite(write) => {
                self.local_write(at, write, request.byte());
                Some(Reply::EMPTY)
            }
        }
    }

    fn unit_number(&self) -> u32 {
        match self.config.unit_address {
            Some(address) => self.memory.word(address, 4) as u32,
            None => self.config.unit_number,
        }
    }

    fn process_data(&mut self, at: Nanos, data: &[u8]) -> Reply {
        self.feed_watchdog(at);
        let mode = self.state.mode;
        if self.application.clears_faults(data) {
            self.clear_faults(at);
        }
        if self.state.faults.is_empty() {
            self.application.outputs(mode, &mut self.memory, data);
            // an output may trip at once
            self.state.faults |= self.application.faults();
        }
        self.application.sample(mode, &mut self.memory);
        let rx_size = self.config.sizes(mode).rx_size;
        // With an RX size of 0 the reply is its CRC alone. FACTS 11.5.
        let mut reply = if self.config.no_fault_byte || rx_size == 0 {
            Reply::EMPTY
        } else {
            Reply::new(&[self.state.faults.bits()])
        };
        let mut inputs = [0; 32];
        let fault_bytes = usize::from(!self.config.no_fault_byte);
        let size = usize::from(rx_size).saturating_sub(fault_bytes);
        let inputs = inputs.get_mut(..size.min(31)).unwrap_or_default();
        self.application.inputs(mode, &mut self.memory, inputs);
        reply.extend(inputs);
        reply
    }

    fn access(&mut self, at: Nanos, access: Access, request: &ReceivedRequest) -> Reply {
        let address = request.address.unwrap_or(self.state.current);
        let size = access.size.bytes();
        let step = if access.auto_increment { size } else { 0 };
        self.state.current = address.wrapping_add(step as u16);
        if access.write {
            for (offset, &byte) in request.data().iter().enumerate() {
                let result = self.write(at, address.wrapping_add(offset as u16), byte);
                self.note(result);
            }
            self.written();
            return Reply::EMPTY;
        }
        self.application.sample(self.state.mode, &mut self.memory);
        let mut reply = Reply::EMPTY;
        for offset in 0..size {
            let result = self.read(at, address.wrapping_add(offset as u16));
            reply.extend(&[*result.as_ref().unwrap_or(&0)]);
            self.note(result.map(|_| ()));
        }
        reply
    }

    fn read(&mut self, at: Nanos, address: u16) -> Result<u8, LbpError> {
        if self.state.rpc_access != 0 && address < RPC_TABLE_SIZE {
            self.state.rpc_table.read(address)
        } else {
            Reach { remote: self, at }.read(address)
        }
    }

    fn write(&mut self, at: Nanos, address: u16, value: u8) -> Result<(), LbpError> {
        if self.state.rpc_access != 0 && address < RPC_TABLE_SIZE {
            self.state.rpc_table.write(address, value)
        } else {
            Reach { remote: self, at }.write(address, value)
        }
    }

    fn note(&mut self, result: Result<(), LbpError>) {
        if result.is_err() {
            self.state.status |= LbpStatus::INVALID_ADDRESS;
        }
    }

    fn written(&mut self) {
        let faulty = !self.state.faults.is_empty();
        self.application
            .written(self.state.mode, &mut self.memory, faulty);
    }

    /// An RPC of the table. A list that can not be carried out answers nothing but the CRC.
    fn stored(&mut self, at: Nanos, number: RpcNumber, data: &[u8]) -> Reply {
        self.application.sample(self.state.mode, &mut self.memory);
        let table = self.state.rpc_table.clone();
        let mut current = self.state.current;
        let mut reach = Reach { remote: self, at };
        let result = table.execute(number, data, &mut current, &mut reach);
        self.state.current = current;
        self.written();
        match result {
            Ok(reply) => Reply::new(reply.as_bytes()),
            Err(error) => {
                self.state.status |= match error {
                    LbpError::ReplyTooLong => LbpStatus::BUFFER_OVERFLOW,
                    _ => LbpStatus::INVALID_ADDRESS,
                };
                Reply::EMPTY
            }
        }
    }

    fn local_read(&mut self, read: LocalRead) -> u8 {
        let [address_low, address_high] = self.state.current.to_le_bytes();
        let [size_low, size_high] = RPC_TABLE_SIZE.to_le_bytes();
        match read {
            LocalRead::UnitAddress | LocalRead::UnitId => self.state.unit_id,
            LocalRead::Status => self.state.status.bits(),
            LocalRead::CrcEnable => 1,
            LocalRead::CrcErrorCount => self.state.crc_errors,
            LocalRead::SoftwareMode => self.state.mode,
            LocalRead::ClearFaults => self.clearing(),
            LocalRead::RpcMemoryAccess => self.state.rpc_access,
            LocalRead::FrameTimeout => self.state.frame_timeout,
            LocalRead::Nonvolatile => self.state.nonvolatile.to_byte(),
            LocalRead::Name(index) => {
                let character = self.config.name.get(usize::from(index));
                character.copied().unwrap_or_default()
            }
            LocalRead::Capabilities => self.config.capabilities.bits(),
            LocalRead::SoftwareRevision => self.config.software_revision,
            LocalRead::HardwareMode => self.config.hardware_mode,
            LocalRead::Faults => self.state.faults.bits(),
            LocalRead::AddressLow => address_low,
            LocalRead::AddressHigh => address_high,
            LocalRead::LbpVersion => self.config.lbp_version,
            LocalRead::RpcPitch => RPC_PITCH,
            LocalRead::RpcSizeLow => size_low,
            LocalRead::RpcSizeHigh => size_high,
            LocalRead::Cookie => self.config.cookie,
            LocalRead::Reserved(_) => 0,
        }
    }

    /// C7: not zero while the faults are still being cleared.
    fn clearing(&mut self) -> u8 {
        if self.state.clear_count == 0 {
            return 0;
        }
        self.state.clear_count -= 1;
        0xFF
    }

    fn local_write(&mut self, at: Nanos, write: LocalWrite, value: u8) {
        let [low, high] = self.state.current.to_le_bytes();
        match write {
            LocalWrite::Status => {
                if !self.config.status_stuck {
                    self.state.status = LbpStatus::from_bits_retain(value);
                }
            }
            LocalWrite::CrcErrorCount => self.state.crc_errors = value,
            LocalWrite::SoftwareMode => self.set_mode(value),
            LocalWrite::ClearFaults => {
                if value != 0 {
                    self.state.clear_count = self.config.clear_delay;
                    self.clear_faults(at);
                }
            }
            LocalWrite::RpcMemoryAccess => self.state.rpc_access = value,
            LocalWrite::FrameTimeout => self.state.frame_timeout = value,
            LocalWrite::Nonvolatile => self.state.nonvolatile = Nonvolatile::from_byte(value),
            LocalWrite::Leds => self.state.leds = value,
            LocalWrite::AddressLow => self.state.current = u16::from_le_bytes([value, high]),
            LocalWrite::AddressHigh => self.state.current = u16::from_le_bytes([low, value]),
            LocalWrite::AddressAdd => {
                self.state.current = self.state.current.wrapping_add(u16::from(value));
            }
            LocalWrite::UnitId => self.state.unit_id = value,
            LocalWrite::ResetProcessor => self.state.reset = value == 0x5A,
            // the parser is between two frames anyway; a 7I77 always checks CRCs
            LocalWrite::ResetParser | LocalWrite::CrcEnable | LocalWrite::Reserved(_) => {}
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
