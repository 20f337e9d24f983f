//! The port's own memory: parameters and channel variables.

use super::{Port, PortResult, run::Wanted};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{
        Channel, ChannelVariable, LocalAddress, PortError, PortParameters, ProcessDataSizes,
        machine::Operation,
    },
};

impl Port {
    /// Reads a byte of the port's memory. Manual: 7I77, "LOCAL READ OPERATIONS".
    pub fn local_read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        address: LocalAddress,
    ) -> PortResult<u8, B> {
        let operation = Operation::ReadLocal(address);
        let (_, snapshot) = self.run(bus, operation, &[], Wanted::Nothing)?;
        Ok(snapshot.status().byte())
    }

    /// Writes a byte of the port's memory, and reads it back. Manual: 7I77, "LOCAL WRITE
    /// OPERATIONS".
    pub fn local_write<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        address: LocalAddress,
        value: u8,
    ) -> PortResult<(), B> {
        let data = [(self.layout.data(), u32::from(value))];
        let operation = Operation::WriteLocal(address, value);
        self.run(bus, operation, &data, Wanted::Nothing)?;
        let read = self.local_read(bus, address)?;
        if read == value {
            return Ok(());
        }
        Err(PortError::LocalWrite {
            port: self.layout.instance(),
            address,
            written: value,
            read,
        })
    }

    /// Reads the local parameters and checks that this crate can work with the firmware.
    pub fn identify<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
    ) -> PortResult<PortParameters, B> {
        let parameters = self.read_parameters(bus)?;
        parameters.check(self.layout.instance())?;
        if parameters.channels != self.layout.channels() {
            return Err(PortError::ChannelCount {
                port: self.layout.instance(),
                pins: self.layout.channels(),
                gateware: parameters.channels,
            });
        }
        self.parameters = Some(parameters);
        Ok(parameters)
    }

    fn read_parameters<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
    ) -> PortResult<PortParameters, B> {
        let mut parameters = [0; PortParameters::COUNT as usize];
        self.read_run(bus, 0, &mut parameters)?;
        let mut clock = [0; 4];
        self.read_run(bus, PortParameters::CLOCK, &mut clock)?;
        Ok(PortParameters::from_bytes(parameters, clock))
    }

    fn read_run<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        first: u16,
        bytes: &mut [u8],
    ) -> PortResult<(), B> {
        let addresses = (first..).map_while(LocalAddress::new);
        for (byte, address) in bytes.iter_mut().zip(addresses) {
            *byte = self.local_read(bus, address)?;
        }
        Ok(())
    }

    /// Reads the first bytes of a variable of `channel`.
    pub fn read_variable<B: RegisterBus + Clock, const N: usize>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        variable: ChannelVariable,
    ) -> PortResult<[u8; N], B> {
        self.require_existing(channel.mask())?;
        let parameters = *self.known_parameters()?;
        let mut bytes = [0; N];
        for (index, byte) in (0u8..).zip(&mut bytes) {
            if let Some(address) = parameters.variable(channel, variable, index) {
                *byte = self.local_read(bus, address)?;
            }
        }
        Ok(bytes)
    }

    /// RXSize and TXSize of the remote on `channel`, as START has asked for them.
    pub fn process_data_sizes<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
    ) -> PortResult<ProcessDataSizes, B> {
        let [rx] = self.read_variable(bus, channel, ChannelVariable::RxSize)?;
        let [tx] = self.read_variable(bus, channel, ChannelVariable::TxSize)?;
        Ok(ProcessDataSizes { rx, tx })
    }

    /// The baud rate of `channel`. One that was set but not yet taken over by a STOPALL is read
    /// here too.
    pub fn baud_rate<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
    ) -> PortResult<u32, B> {
        let bytes = self.read_variable(bus, channel, ChannelVariable::BaudRate)?;
        Ok(u32::from_le_bytes(bytes))
    }

    /// Sets the baud rate of `channel`; [`stop_all`](Self::stop_all) makes it effective.
    ///
    /// FACTS 2.4.
    pub fn set_baud_rate<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        baud_rate: u32,
    ) -> PortResult<(), B> {
        self.require_existing(channel.mask())?;
        let parameters = *self.known_parameters()?;
        for (index, byte) in (0u8..).zip(baud_rate.to_le_bytes()) {
            let address = parameters.variable(channel, ChannelVariable::BaudRate, index);
            if let Some(address) = address {
                self.local_write(bus, address, byte)?;
            }
        }
        Ok(())
    }
}
