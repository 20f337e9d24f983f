//! The port's own memory: parameters and channel variables.

use super::{PortResult, SetupPort};
use crate::{
    advice,
    bus::{Clock, RegisterBus},
    sslbp::{
        Channel, ChannelVariable, MAX_CHANNELS, PortImage, PortOperation, PortParameters,
        operation::LAST_LOCAL,
    },
};
use alloc::{format, string::ToString};
use core::{fmt, time::Duration};

/// The oldest firmware 1.x that reports the remote's faults in CS.
///
/// Manual: 7I77, "CS REGISTER AFTER DOIT".
const OLDEST_MINOR: u8 = 29;

/// The last of the variables of a channel: the duration of an exchange. FACTS 2.4.
const LAST_VARIABLE: u16 = 0x30;

/// Largest number of reads of a byte while the bus doubts that the right byte was returned.
const READS: u8 = 10;
/// Longest expected delay of a packet's copy.
const COPIES: Duration = Duration::from_millis(1);

impl<B: RegisterBus + Clock> SetupPort<'_, B> {
    /// Reads a byte of the port's memory. Manual: 7I77, "LOCAL READ OPERATIONS".
    ///
    /// # Errors
    /// The address does not exist; the bus fails, or the port does not answer.
    pub fn local_read(&mut self, address: u16) -> PortResult<u8> {
        self.require_local(address)?;
        let what = format_args!("local address {address:#05X}");
        self.read_without_doubt(what, |port| port.local_read_once(address))
    }

    /// Reads a value again until the bus has no doubts, or two reads in a row agree.
    ///
    /// A network can deliver an earlier command once more, after the one of this read: the
    /// registers then hold the value of the earlier command.
    pub(super) fn read_without_doubt<T: Copy + PartialEq>(
        &mut self,
        what: fmt::Arguments<'_>,
        mut read: impl FnMut(&mut Self) -> PortResult<T>,
    ) -> PortResult<T> {
        let mut before = None;
        for _ in 0..READS {
            let doubts = self.bus.statistics().doubts;
            let value = read(self)?;
            if self.bus.statistics().doubts == doubts || before.replace(value) == Some(value) {
                return Ok(value);
            }
            // Copies that arrive after this time are copies of this command.
            self.bus.wait(COPIES);
        }
        let found =
            "another value with each read, because the network delivers packets twice or late";
        Err(self.unexpected(
            what.to_string(),
            found.into(),
            "the same value twice".into(),
            Some(advice::CHECK_SWITCHES),
        ))
    }

    fn local_read_once(&mut self, address: u16) -> PortResult<u8> {
        let (_, snapshot) = self.run(PortOperation::ReadLocal(address), &[])?;
        Ok(snapshot.data() as u8)
    }

    fn require_local(&self, address: u16) -> PortResult<()> {
        if address <= LAST_LOCAL {
            return Ok(());
        }
        let found = format!("{address:#X}");
        let expected = format!("{LAST_LOCAL:#X} at most, where the port's memory ends");
        Err(self.unexpected("the local address".into(), found, expected, None))
    }

    /// Reads consecutive bytes of the port's memory.
    fn local_bytes<const N: usize>(&mut self, first: u16) -> PortResult<[u8; N]> {
        let mut bytes = [0; N];
        for (address, byte) in (first..).zip(&mut bytes) {
            *byte = self.local_read(address)?;
        }
        Ok(bytes)
    }

    /// Writes a byte of the port's memory, and reads it back. Manual: 7I77, "LOCAL WRITE
    /// OPERATIONS".
    ///
    /// # Errors
    /// [`PortError::Unexpected`](crate::sslbp::PortError::Unexpected) if the byte is not kept, or
    /// the address does not exist; the bus fails, or the port does not answer.
    pub fn local_write(&mut self, address: u16, value: u8) -> PortResult<()> {
        self.require_local(address)?;
        let data = [(self.port.layout.data(), u32::from(value))];
        self.run(PortOperation::WriteLocal(address), &data)?;
        let read = self.local_read(address)?;
        if read == value {
            return Ok(());
        }
        let what = format!("local address {address:#05X}");
        Err(self.not_kept(what, read.into(), value.into(), advice::RESET_PORT))
    }

    /// Reads the local parameters and checks that this crate supports the firmware.
    ///
    /// FACTS 2.3.
    ///
    /// # Errors
    /// [`PortError::Unexpected`](crate::sslbp::PortError::Unexpected); the bus fails, or the port
    /// does not answer.
    pub fn identify(&mut self) -> PortResult<PortParameters> {
        let parameters = self.local_bytes(0)?;
        let clock = self.local_bytes(PortParameters::CLOCK)?;
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
        let require = |(found, expected): (u8, u8), what: &str, why: &str, advice| {
            if found == expected {
                return Ok(());
            }
            let [found, expected] = [found, expected].map(|byte| format!("{byte:#04X}"));
            Err(self.unexpected(what.into(), found, expected + why, Some(advice)))
        };
        let of_sslbp = ", which is that of SSLBP";
        let unknown = advice::USE_KNOWN_FIRMWARE;
        require((kind, 0x12), "the interface type", of_sslbp, unknown)?;
        require((width, 8), "the width of DATA", "", unknown)?;
        require((processor, 0xD8), "the interface processor", "", unknown)?;
        if major != 1 || minor < OLDEST_MINOR {
            let found = format!("{major}.{minor}");
            let expected = format!("1.{OLDEST_MINOR} or a newer 1.x");
            let advice = Some(advice::FLASH_NEWER_FIRMWARE);
            return Err(self.unexpected("the SSLBP version".into(), found, expected, advice));
        }
        if !has_room(start, stride) {
            let what = "the place of the channel variables".into();
            let found = format!("{start:#04X} with stride {stride:#04X}");
            let expected = "room for those of version 1.43".into();
            let advice = Some(advice::USE_KNOWN_FIRMWARE);
            return Err(self.unexpected(what, found, expected, advice));
        }
        let all = self.port.layout.channels;
        let as_pins = ", as the pin descriptors have";
        let other = advice::USE_OTHER_FIRMWARE;
        require((channels, all), "the number of channels", as_pins, other)?;
        let parameters = PortParameters {
            major,
            minor,
            variables_start: start,
            variables_stride: stride,
            clock_hz: u32::from_le_bytes(clock),
        };
        self.port.parameters = Some(parameters);
        Ok(parameters)
    }

    /// Reads the first bytes of a variable of `channel`.
    ///
    /// # Errors
    /// The channel does not exist, or the parameters are not known; the bus fails, or the port does
    /// not answer.
    pub fn read_variable<const N: usize>(
        &mut self,
        channel: Channel,
        variable: ChannelVariable,
    ) -> PortResult<[u8; N]> {
        let first = self.variable(channel, variable)?;
        self.local_bytes(first)
    }

    fn variable(&self, channel: Channel, variable: ChannelVariable) -> PortResult<u16> {
        self.require_existing(channel.mask())?;
        Ok(self.known_parameters()?.variable(channel, variable))
    }

    /// Sets the baud rate of `channel`. The rate takes effect with [`stop_all`](Self::stop_all);
    /// [`ChannelVariable::BaudRate`] contains it even before.
    ///
    /// FACTS 2.4.
    ///
    /// # Errors
    /// As [`read_variable`](Self::read_variable) and [`local_write`](Self::local_write).
    pub fn set_baud_rate(&mut self, channel: Channel, baud_rate: u32) -> PortResult<()> {
        let first = self.variable(channel, ChannelVariable::BaudRate)?;
        for (address, byte) in (first..).zip(baud_rate.to_le_bytes()) {
            self.local_write(address, byte)?;
        }
        Ok(())
    }
}

/// True if the variables of all channels fit before the parameters behind them.
fn has_room(start: u8, stride: u8) -> bool {
    let last = u16::from(start) + u16::from(stride) * u16::from(MAX_CHANNELS - 1);
    u16::from(stride) > LAST_VARIABLE && last + LAST_VARIABLE < PortParameters::CLOCK
}
