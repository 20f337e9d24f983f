//! The port's own memory: parameters and channel variables.

use super::{Port, PortResult};
use crate::{
    bus::{BusError, Clock, RegisterBus},
    sslbp::{
        Channel, ChannelVariable, MAX_CHANNELS, Observed, Operation, PortError, PortParameters,
        ProcessDataSizes, operation::LAST_LOCAL,
    },
};
use alloc::format;

/// The oldest firmware 1.x whose CS has the remote's faults.
///
/// Manual: 7I77, "CS REGISTER AFTER DOIT".
const OLDEST_MINOR: u8 = 29;

/// The last of the variables of a channel: the duration of an exchange. FACTS 2.4.
const LAST_VARIABLE: u16 = 0x30;

const NOT_KNOWN: &str = "this firmware is not known";

impl Port {
    /// Reads a byte of the port's memory. Manual: 7I77, "LOCAL READ OPERATIONS".
    ///
    /// # Errors
    /// There is no such address; the bus fails, or the port does not answer.
    pub fn local_read<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        address: u16,
    ) -> PortResult<u8, B> {
        self.require_local(address)?;
        let (_, snapshot) = self.run(bus, Operation::ReadLocal(address), &[])?;
        Ok(snapshot.data() as u8)
    }

    const fn require_local<E: BusError>(&self, address: u16) -> Result<(), PortError<E>> {
        if address <= LAST_LOCAL {
            return Ok(());
        }
        Err(PortError::NoSuchAddress {
            port: self.layout.instance,
            address,
            last: LAST_LOCAL,
        })
    }

    /// Reads neighbouring bytes of the port's memory.
    fn local_bytes<B: RegisterBus + Clock, const N: usize>(
        &mut self,
        bus: &mut B,
        first: u16,
    ) -> PortResult<[u8; N], B> {
        let mut bytes = [0; N];
        for (address, byte) in (first..).zip(&mut bytes) {
            *byte = self.local_read(bus, address)?;
        }
        Ok(bytes)
    }

    /// Writes a byte of the port's memory, and reads it back. Manual: 7I77, "LOCAL WRITE
    /// OPERATIONS".
    ///
    /// # Errors
    /// [`PortError::NotKept`]; there is no such address; the bus fails, or the port does not answer.
    pub fn local_write<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        address: u16,
        value: u8,
    ) -> PortResult<(), B> {
        self.require_local(address)?;
        let data = [(self.layout.data(), u32::from(value))];
        self.run(bus, Operation::WriteLocal(address), &data)?;
        let read = self.local_read(bus, address)?;
        if read == value {
            return Ok(());
        }
        Err(PortError::NotKept {
            port: self.layout.instance,
            place: format!("local address {address:#05X}"),
            written: value.into(),
            read: read.into(),
            hint: "reset the port",
        })
    }

    /// Reads the local parameters and checks that this crate can work with the firmware.
    ///
    /// FACTS 2.3.
    ///
    /// # Errors
    /// [`PortError::Firmware`]; the bus fails, or the port does not answer.
    pub fn identify<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
    ) -> PortResult<PortParameters, B> {
        let parameters = self.local_bytes(bus, 0)?;
        let clock = self.local_bytes(bus, PortParameters::CLOCK)?;
        let [
            kind,
            width,
            major,
            minor,
            start,
            stride,
            processor,
            channels,
        ] = parameters;
        let last = u16::from(start) + u16::from(stride) * u16::from(MAX_CHANNELS - 1);
        let is_room =
            u16::from(stride) > LAST_VARIABLE && last + LAST_VARIABLE < PortParameters::CLOCK;
        let is_known = major == 1 && minor >= OLDEST_MINOR;
        let all = self.layout.channels;
        let checks = [
            (
                kind == 0x12,
                "the interface type",
                format!("{kind:#04X}"),
                "0x12 (SSLBP)".into(),
                "this firmware has another serial protocol on that port",
            ),
            (
                width == 8,
                "the width of DATA",
                format!("{width} bits"),
                "8 bits".into(),
                NOT_KNOWN,
            ),
            (
                processor == 0xD8,
                "the interface processor",
                format!("{processor:#04X}"),
                "0xD8 (Dumb8)".into(),
                NOT_KNOWN,
            ),
            (
                is_known,
                "the SSLBP version",
                format!("{major}.{minor}"),
                format!("1.{OLDEST_MINOR} or a newer 1.x"),
                "flash a newer firmware",
            ),
            (
                is_room,
                "the place of the channel variables",
                format!("{start:#04X} with stride {stride:#04X}"),
                "room for those of version 1.43".into(),
                NOT_KNOWN,
            ),
            (
                channels == all,
                "the number of channels",
                format!("{channels}"),
                format!("{all} as in the pin descriptors"),
                "the firmware image is inconsistent, use another",
            ),
        ];
        for (is_right, what, found, expected, hint) in checks {
            if !is_right {
                let port = self.layout.instance;
                return Err(PortError::Firmware {
                    port,
                    what,
                    found,
                    expected,
                    hint,
                });
            }
        }
        let parameters = PortParameters {
            major,
            minor,
            variables_start: start,
            variables_stride: stride,
            clock_hz: u32::from_le_bytes(clock),
        };
        self.parameters = Some(parameters);
        Ok(parameters)
    }

    /// Reads the first bytes of a variable of `channel`.
    ///
    /// # Errors
    /// There is no such channel, or the parameters are not known; the bus fails, or the port does not
    /// answer.
    pub fn read_variable<B: RegisterBus + Clock, const N: usize>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        variable: ChannelVariable,
    ) -> PortResult<[u8; N], B> {
        self.require_existing(channel.mask())?;
        let first = self.known_parameters()?.variable(channel, variable);
        self.local_bytes(bus, first)
    }

    /// RXSize and TXSize of the remote on `channel`, as START has asked for them.
    pub(super) fn process_data_sizes<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
    ) -> PortResult<ProcessDataSizes, B> {
        let [rx, tx] = self.read_variable(bus, channel, ChannelVariable::RxSize)?;
        Ok(ProcessDataSizes { rx, tx })
    }

    /// Sets the baud rate of `channel`; [`stop_all`](Self::stop_all) makes it effective, and
    /// [`ChannelVariable::BaudRate`] reads it even before.
    ///
    /// FACTS 2.4.
    ///
    /// # Errors
    /// As [`read_variable`](Self::read_variable) and [`local_write`](Self::local_write).
    pub fn set_baud_rate<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        channel: Channel,
        baud_rate: u32,
    ) -> PortResult<(), B> {
        self.require_existing(channel.mask())?;
        let parameters = self.known_parameters()?;
        let first = parameters.variable(channel, ChannelVariable::BaudRate);
        for (address, byte) in (first..).zip(baud_rate.to_le_bytes()) {
            self.local_write(bus, address, byte)?;
        }
        Ok(())
    }
}
