//! The error register of a board.

use bitflags::bitflags;

bitflags! {
    /// The error register, space 6 address 0. Manual: 7I97, "ERROR REGISTER FORMAT".
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct ErrorRegister: u16 {
        /// A request was not a sequence of whole commands.
        const PARSE = 1 << 0;
        /// A space rejected an access.
        const MEMORY = 1 << 1;
        /// A write was refused.
        const WRITE = 1 << 2;
        /// A received packet was damaged.
        const RECEIVE = 1 << 3;
        /// A packet could not be sent.
        const TRANSMIT = 1 << 4;
        /// HostMot2's timer did not fire in time.
        const HM2_TIMEOUT = 1 << 5;
        /// Reserved bits are kept.
        const _ = !0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_bits_are_those_of_the_manual() {
        let all = [
            ErrorRegister::PARSE,
            ErrorRegister::MEMORY,
            ErrorRegister::WRITE,
            ErrorRegister::RECEIVE,
            ErrorRegister::TRANSMIT,
            ErrorRegister::HM2_TIMEOUT,
        ];
        for (bit, flag) in all.into_iter().enumerate() {
            assert_eq!(flag.bits(), 1 << bit);
        }
        assert_eq!(ErrorRegister::from_bits_retain(0x8041).bits(), 0x8041);
    }
}
