//! Contents of a port's own memory.

use super::Channel;

/// The local parameters of a port that differ from port to port.
///
/// Manual: 7I77, "LOCAL PARAMETERS"; FACTS 2.3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PortParameters {
    /// 2: major revision of the firmware.
    pub major: u8,
    /// 3: minor revision of the firmware.
    pub minor: u8,
    /// 4: address of the variables of channel 0. The manual calls parameters 4 and 5 GP counts.
    pub variables_start: u8,
    /// 5: distance of the variables of neighbouring channels.
    pub variables_stride: u8,
    /// Clock of the processor and the UARTs in hertz.
    pub clock_hz: u32,
}

impl PortParameters {
    /// Address of local parameter 3, the minor revision.
    pub const MINOR: u16 = 3;

    /// Address of the clock, four bytes, least significant first. FACTS 2.3.
    pub const CLOCK: u16 = 0x230;

    /// The version in boards since 2015, with which this crate is tested: 1.43.
    const USUAL: (u8, u8) = (1, 43);

    /// Experience with versions older than the usual one, as a sentence for the user. The advice is
    /// [`advice::LOAD_NEWER_FIRMWARE`](crate::advice::LOAD_NEWER_FIRMWARE).
    pub const OLD_VERSION: &str = "this crate has not been tried with a version before 1.43, \
        which boards have had since 2015; with 1.38 the analog part of a 7I77 was not found";

    /// True if the port has an older version of SSLBP than the one this crate is tested with. FACTS
    /// 2.3.
    pub fn is_old(&self) -> bool {
        (self.major, self.minor) < Self::USUAL
    }

    /// Address of a variable of `channel`.
    pub const fn variable(&self, channel: Channel, variable: ChannelVariable) -> u16 {
        let stride = self.variables_stride as u16;
        self.variables_start as u16 + stride * channel.index() as u16 + variable as u16
    }
}

/// A variable that the firmware keeps for each channel, by its offset.
///
/// FACTS 2.4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ChannelVariable {
    /// Errors since the last stop, one byte each: CRC, cookie, overrun, timeout, extra character,
    /// break, remote fault. Each counter stops at its limit.
    ErrorCounters = 0x14,
    /// Baud rate, four bytes; a new one takes effect at the next STOPALL.
    BaudRate = 0x2A,
    /// RXSize of the remote, one byte.
    RxSize = 0x2E,
    /// TXSize of the remote, one byte.
    TxSize = 0x2F,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gateware transcripts t01 and t18: baud rate of channel 0 at 9A..9D, of channel 1 at CC..CF;
    /// t04: error counters of channel 1 at B6..BC.
    #[test]
    fn variables_are_where_the_transcripts_have_them() {
        let parameters = PortParameters {
            major: 1,
            minor: 43,
            variables_start: 0x70,
            variables_stride: 0x32,
            clock_hz: 100_000_000,
        };
        let at = |channel: usize, variable| parameters.variable(Channel::ALL[channel], variable);
        assert_eq!(at(0, ChannelVariable::BaudRate), 0x9A);
        assert_eq!(at(1, ChannelVariable::BaudRate), 0xCC);
        assert_eq!(at(1, ChannelVariable::ErrorCounters), 0xB6);
    }
}
