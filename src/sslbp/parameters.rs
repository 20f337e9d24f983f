//! What a port keeps in its own memory: parameters and channel variables.

use super::{Channel, LocalAddress, MAX_CHANNELS, PortError};
use crate::bus::BusError;

/// The oldest firmware 1.x whose CS has the remote's faults.
///
/// Manual: 7I77, "CS REGISTER AFTER DOIT".
const OLDEST_MINOR: u8 = 29;

/// The last of the variables of a channel: the duration of an exchange. FACTS 2.4.
const LAST: u16 = 0x30;

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

    /// Whether this crate can work with that firmware of `port`.
    ///
    /// # Errors
    /// [`PortError`] says what is not as expected.
    pub fn check<E: BusError>(&self, port: u8) -> Result<(), PortError<E>> {
        if self.interface_type != 0x12 {
            let found = self.interface_type;
            return Err(PortError::InterfaceType { port, found });
        }
        if self.interface_width != 8 {
            let found = self.interface_width;
            return Err(PortError::InterfaceWidth { port, found });
        }
        if self.processor != 0xD8 {
            let found = self.processor;
            return Err(PortError::Processor { port, found });
        }
        if self.major != 1 || self.minor < OLDEST_MINOR {
            return Err(PortError::Version {
                port,
                major: self.major,
                minor: self.minor,
                oldest: OLDEST_MINOR,
            });
        }
        let (start, stride) = (self.variables_start, self.variables_stride);
        let last = u16::from(start) + u16::from(stride) * u16::from(MAX_CHANNELS - 1) + LAST;
        if u16::from(stride) <= LAST || last >= Self::CLOCK {
            return Err(PortError::ChannelVariables {
                port,
                start,
                stride,
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
    /// Errors since the last stop, one byte each: CRC, cookie, overrun, timeout, extra character,
    /// break, remote fault. Each counter stops at its limit.
    ErrorCounters,
    /// Baud rate; a new one takes effect at the next STOPALL.
    BaudRate,
    /// RXSize of the remote.
    RxSize,
    /// TXSize of the remote.
    TxSize,
}

impl ChannelVariable {
    /// Its place among the variables of its channel.
    pub const fn offset(self) -> u16 {
        match self {
            Self::ErrorCounters => 0x14,
            Self::BaudRate => 0x2A,
            Self::RxSize => 0x2E,
            Self::TxSize => 0x2F,
        }
    }

    /// Its size.
    pub const fn bytes(self) -> u8 {
        match self {
            Self::ErrorCounters => 7,
            Self::BaudRate => 4,
            Self::RxSize | Self::TxSize => 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::BusErrorKind;

    /// The parameters do not need one.
    #[derive(Debug, PartialEq, Eq, thiserror::Error)]
    #[error("no bus")]
    struct NoBus;

    impl BusError for NoBus {
        fn kind(&self) -> BusErrorKind {
            BusErrorKind::Other
        }
    }

    /// FACTS 2.3; gateware transcript t01.
    const RECORDED: [u8; 8] = [0x12, 0x08, 0x01, 0x2B, 0x70, 0x32, 0xD8, 0x08];
    const CLOCK: [u8; 4] = 100_000_000u32.to_le_bytes();

    fn recorded() -> PortParameters {
        PortParameters::from_bytes(RECORDED, CLOCK)
    }

    fn with(index: usize, value: u8) -> Result<(), PortError<NoBus>> {
        let mut bytes = RECORDED;
        bytes[index] = value;
        PortParameters::from_bytes(bytes, CLOCK).check(1)
    }

    #[test]
    fn the_recorded_firmware_is_accepted() {
        assert_eq!(recorded().check::<NoBus>(1), Ok(()));
        assert_eq!((recorded().major, recorded().minor), (1, 43));
        assert_eq!(recorded().clock_hz, 100_000_000);
    }

    #[test]
    fn firmware_that_is_not_known_is_refused_by_name() {
        use PortError as E;
        let refused = [
            (
                with(0, 0x13),
                E::InterfaceType {
                    port: 1,
                    found: 0x13,
                },
            ),
            (with(1, 16), E::InterfaceWidth { port: 1, found: 16 }),
            (
                with(6, 0xD9),
                E::Processor {
                    port: 1,
                    found: 0xD9,
                },
            ),
            (
                with(2, 2),
                E::Version {
                    port: 1,
                    major: 2,
                    minor: 43,
                    oldest: 29,
                },
            ),
            (
                with(3, 28),
                E::Version {
                    port: 1,
                    major: 1,
                    minor: 28,
                    oldest: 29,
                },
            ),
            (
                with(5, 0x20),
                E::ChannelVariables {
                    port: 1,
                    start: 0x70,
                    stride: 0x20,
                },
            ),
        ];
        for (result, expected) in refused {
            assert_eq!(result, Err(expected));
        }
        assert_eq!(with(3, 44), Ok(()));
    }

    /// Gateware transcripts t01 and t18: baud rate of channel 0 at 9A..9D, of channel 1 at CC..CF;
    /// t04: error counters of channel 1 at B6..BC.
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
        assert_eq!(at(1, ChannelVariable::ErrorCounters, 6), Some(0xBC));
    }
}
