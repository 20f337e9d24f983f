//! What a port keeps in its own memory: parameters and channel variables.

use super::{Channel, LocalAddress, MAX_CHANNELS, ProcessDataSizes, Unsupported};
use core::time::Duration;

/// The oldest firmware 1.x whose CS has the remote's faults.
///
/// Manual: 7I77, "CS REGISTER AFTER DOIT".
const OLDEST_MINOR: u8 = 29;

/// The local parameters of a port.
///
/// The manual calls parameters 4 and 5 GP counts; they are the place of the channel variables.
///
/// Manual: 7I77, "LOCAL PARAMETERS"; FACTS 2.3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PortParameters {
    /// 0: 0x12 for SSLBP.
    pub interface_type: u8,
    /// 1: width of DATA in bits.
    pub interface_width: u8,
    /// 2: major revision of the firmware.
    pub major: u8,
    /// 3: minor revision of the firmware.
    pub minor: u8,
    /// 4: address of the variables of channel 0.
    pub variables_start: u8,
    /// 5: distance of the variables of neighbouring channels.
    pub variables_stride: u8,
    /// 6: 0xD8 for Dumb8.
    pub processor: u8,
    /// 7: number of channels.
    pub channels: u8,
    /// Clock of the processor and the UARTs in hertz.
    pub clock_hz: u32,
}

impl PortParameters {
    /// Number of the parameters at the beginning of the local memory.
    pub const COUNT: u16 = 8;

    /// Address of the clock, four bytes, least significant first. FACTS 2.3.
    pub const CLOCK: u16 = 0x230;

    /// From the eight parameters and the clock.
    pub const fn from_bytes(parameters: [u8; 8], clock: [u8; 4]) -> Self {
        let [
            interface_type,
            interface_width,
            major,
            minor,
            variables_start,
            variables_stride,
            processor,
            channels,
        ] = parameters;
        Self {
            interface_type,
            interface_width,
            major,
            minor,
            variables_start,
            variables_stride,
            processor,
            channels,
            clock_hz: u32::from_le_bytes(clock),
        }
    }

    /// Whether this crate can work with that firmware.
    pub const fn check(&self) -> Result<(), Unsupported> {
        if self.interface_type != 0x12 {
            let found = self.interface_type;
            return Err(Unsupported::InterfaceType { found });
        }
        if self.interface_width != 8 {
            let found = self.interface_width;
            return Err(Unsupported::InterfaceWidth { found });
        }
        if self.processor != 0xD8 {
            let found = self.processor;
            return Err(Unsupported::Processor { found });
        }
        if self.major != 1 || self.minor < OLDEST_MINOR {
            return Err(Unsupported::Version {
                major: self.major,
                minor: self.minor,
                oldest: OLDEST_MINOR,
            });
        }
        let end = ChannelVariable::RpcTime.offset();
        let last = self.variables_start as u16
            + self.variables_stride as u16 * (MAX_CHANNELS as u16 - 1)
            + end;
        if self.variables_stride as u16 <= end || last >= Self::CLOCK {
            return Err(Unsupported::ChannelVariables {
                start: self.variables_start,
                stride: self.variables_stride,
            });
        }
        Ok(())
    }

    /// Address of byte `index` of a variable of `channel`.
    pub const fn variable(
        &self,
        channel: Channel,
        variable: ChannelVariable,
        index: u8,
    ) -> Option<LocalAddress> {
        if index >= variable.bytes() {
            return None;
        }
        LocalAddress::new(
            self.variables_start as u16
                + self.variables_stride as u16 * channel.index() as u16
                + variable.offset()
                + index as u16,
        )
    }
}

/// A variable that the firmware keeps for each channel.
///
/// FACTS 2.4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChannelVariable {
    /// COM_STATE: CS byte 2.
    State,
    /// The error of the last exchange.
    Error,
    /// All errors since the last stop: CS byte 0.
    ErrorLog,
    /// CS byte 1.
    Status,
    /// The seven error counters, in the order of [`ErrorCounters`].
    ErrorCounters,
    /// Errors of one kind that are tolerated.
    ErrorLimit,
    /// Not 0: replies are not checked.
    DisableCrc,
    /// CS byte 3.
    RemoteFault,
    /// The remote's name.
    Name,
    /// Baud rate; a new one takes effect at the next STOPALL.
    BaudRate,
    /// RXSize of the remote.
    RxSize,
    /// TXSize of the remote.
    TxSize,
    /// Duration of the last process-data exchange, in steps of 2 us.
    RpcTime,
}

impl ChannelVariable {
    /// Its place among the variables of its channel.
    pub const fn offset(self) -> u16 {
        match self {
            Self::State => 0x10,
            Self::Error => 0x11,
            Self::ErrorLog => 0x12,
            Self::Status => 0x13,
            Self::ErrorCounters => 0x14,
            Self::ErrorLimit => 0x1B,
            Self::DisableCrc => 0x1E,
            Self::RemoteFault => 0x25,
            Self::Name => 0x26,
            Self::BaudRate => 0x2A,
            Self::RxSize => 0x2E,
            Self::TxSize => 0x2F,
            Self::RpcTime => 0x30,
        }
    }

    /// Its size.
    pub const fn bytes(self) -> u8 {
        match self {
            Self::Name | Self::BaudRate => 4,
            Self::ErrorCounters => 7,
            _ => 1,
        }
    }
}

/// Errors of one channel since its last stop. Each counter stops at its limit.
///
/// FACTS 2.4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ErrorCounters {
    /// Replies with a wrong CRC.
    pub crc: u8,
    /// Answers of something that is not a remote.
    pub cookie: u8,
    /// Characters that came faster than they were read.
    pub overrun: u8,
    /// Replies that did not come in time.
    pub timeout: u8,
    /// Replies with more characters than they should have.
    pub extra_character: u8,
    /// Breaks on the receive line.
    pub serial_break: u8,
    /// Faults that the remote reported.
    pub remote_fault: u8,
}

impl ErrorCounters {
    /// From the seven bytes.
    pub const fn from_bytes(bytes: [u8; 7]) -> Self {
        let [
            crc,
            cookie,
            overrun,
            timeout,
            extra_character,
            serial_break,
            remote_fault,
        ] = bytes;
        Self {
            crc,
            cookie,
            overrun,
            timeout,
            extra_character,
            serial_break,
            remote_fault,
        }
    }

    /// All of them together.
    pub fn total(&self) -> u32 {
        [
            self.crc,
            self.cookie,
            self.overrun,
            self.timeout,
            self.extra_character,
            self.serial_break,
            self.remote_fault,
        ]
        .map(u32::from)
        .iter()
        .sum()
    }
}

/// The variables of one channel that tell how it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ChannelVariables {
    /// Error counters.
    pub counters: ErrorCounters,
    /// Errors of one kind that are tolerated; the next one is too many.
    pub error_limit: u8,
    /// Whether the CRC of replies is not checked.
    pub crc_disabled: bool,
    /// Baud rate.
    pub baud_rate: u32,
    /// Process data sizes.
    pub sizes: ProcessDataSizes,
    /// Duration of the last process-data exchange.
    pub rpc_time: Duration,
}

impl ChannelVariables {
    /// One step of the RPC time.
    pub const RPC_TIME_STEP: Duration = Duration::from_micros(2);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FACTS 2.3; gateware transcript t01.
    const RECORDED: [u8; 8] = [0x12, 0x08, 0x01, 0x2B, 0x70, 0x32, 0xD8, 0x08];
    const CLOCK: [u8; 4] = 100_000_000u32.to_le_bytes();

    fn recorded() -> PortParameters {
        PortParameters::from_bytes(RECORDED, CLOCK)
    }

    fn with(index: usize, value: u8) -> Result<(), Unsupported> {
        let mut bytes = RECORDED;
        bytes[index] = value;
        PortParameters::from_bytes(bytes, CLOCK).check()
    }

    #[test]
    fn the_recorded_firmware_is_accepted() {
        assert_eq!(recorded().check(), Ok(()));
        assert_eq!((recorded().major, recorded().minor), (1, 43));
        assert_eq!(recorded().clock_hz, 100_000_000);
    }

    #[test]
    fn firmware_that_is_not_known_is_refused_by_name() {
        assert_eq!(
            with(0, 0x13),
            Err(Unsupported::InterfaceType { found: 0x13 })
        );
        assert_eq!(with(1, 16), Err(Unsupported::InterfaceWidth { found: 16 }));
        assert!(matches!(
            with(2, 2),
            Err(Unsupported::Version { major: 2, .. })
        ));
        assert!(matches!(
            with(3, 28),
            Err(Unsupported::Version { minor: 28, .. })
        ));
        assert_eq!(with(3, 44), Ok(()));
        assert!(matches!(
            with(5, 0x20),
            Err(Unsupported::ChannelVariables { .. })
        ));
        assert_eq!(with(6, 0xD9), Err(Unsupported::Processor { found: 0xD9 }));
    }

    /// Gateware transcripts t01 and t18: baud rate of channel 0 at 9A..9D, of channel 1 at CC..CF;
    /// t04: error counters of channel 1 at B6..BC, limit at BD.
    #[test]
    fn variables_are_where_the_transcripts_have_them() {
        let at = |channel: usize, variable, index| {
            recorded()
                .variable(Channel::ALL[channel], variable, index)
                .map(LocalAddress::get)
        };
        assert_eq!(at(0, ChannelVariable::BaudRate, 0), Some(0x9A));
        assert_eq!(at(0, ChannelVariable::BaudRate, 3), Some(0x9D));
        assert_eq!(at(0, ChannelVariable::BaudRate, 4), None);
        assert_eq!(at(1, ChannelVariable::BaudRate, 0), Some(0xCC));
        assert_eq!(at(1, ChannelVariable::ErrorCounters, 0), Some(0xB6));
        assert_eq!(at(1, ChannelVariable::ErrorLimit, 0), Some(0xBD));
    }

    #[test]
    fn counters_are_in_the_order_of_the_facts() {
        let counters = ErrorCounters::from_bytes([1, 2, 3, 4, 5, 6, 7]);
        assert_eq!((counters.crc, counters.timeout), (1, 4));
        assert_eq!((counters.serial_break, counters.remote_fault), (6, 7));
        assert_eq!(counters.total(), 28);
    }
}
