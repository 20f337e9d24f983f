//! CS and DATA as read by the host.

use super::StartMode;
use crate::lbp::{RemoteFaults, write_flags};
use bitflags::bitflags;
use core::fmt;

bitflags! {
    /// Local communication faults: CS byte 0. Sticky: only a stop of the channel clears them.
    ///
    /// Manual: 7I77, "CS REGISTER AFTER START".
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct LocalFaults: u8 {
        /// The 21st error of one kind.
        const TOO_MANY_ERRORS = 0x80;
        /// The remote reported a fault.
        const REMOTE_FAULT = 0x40;
        /// The line from the remote was low for longer than a character.
        const SERIAL_BREAK = 0x20;
        /// More characters than expected in the reply.
        const EXTRA_CHARACTER = 0x10;
        /// No reply, or too short a one, in time.
        const TIMEOUT = 0x08;
        /// A character completed within 20 to 50 ns before a request was sent. Indicates neither a
        /// full FIFO nor damaged data: on a line held low about one DOIT in 200 sets it (FACTS
        /// 11.8).
        const OVERRUN = 0x04;
        /// The device that answers is not a remote.
        const INVALID_COOKIE = 0x02;
        /// A reply with a wrong CRC.
        const CRC = 0x01;
        const _ = !0;
    }
}

bitflags! {
    /// Communication status: CS byte 1. All bits clear is the good state.
    ///
    /// Manual: 7I77, "CS REGISTER AFTER START".
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub(super) struct LinkStatus: u8 {
        /// START is not complete.
        const NOT_READY = 0x80;
        /// The remote has not been identified.
        const NO_REMOTE_ID = 0x40;
        /// A communication error or a remote fault has occurred since the last stop.
        const COMMUNICATION_ERROR = 0x20;
        /// A remote fault has occurred since the last stop, or the channel is stopped.
        const REMOTE_FAULT = 0x01;
        const _ = !0;
    }
}

const LOCAL_FAULT_WORDS: [&str; 8] = [
    "CRC error",
    "not a remote (wrong cookie)",
    "overrun",
    "no reply in time",
    "extra characters",
    "line held low",
    "remote fault",
    "too many errors",
];

const LINK_STATUS_WORDS: [&str; 8] = [
    "remote fault",
    "bit 1",
    "bit 2",
    "bit 3",
    "bit 4",
    "communication error",
    "remote not identified",
    "not ready",
];

impl fmt::Display for LocalFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_flags(f, self.bits(), &LOCAL_FAULT_WORDS, "no local fault")
    }
}

impl fmt::Display for LinkStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_flags(f, self.bits(), &LINK_STATUS_WORDS, "ok")
    }
}

/// State of a channel in its communication with the remote: CS byte 2.
///
/// The code itself is at [`CsStatus::state_code`]. The manual calls it "debug only", yet it
/// indicates how far a START has come.
///
/// Source: FACTS 4.6.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ComState {
    /// Stopped.
    Stopped,
    /// START identifies and prepares the remote, in steps that have no names here.
    Starting,
    /// Requests the unit number.
    UnitNumber,
    /// Requests sizes and tables.
    Sizes,
    /// Sends the first process data, all zeros.
    ClearOutputs,
    /// Waits until the remote has tried to clear its faults, and checks that none remains.
    CheckFaults,
    /// Sends zeros until the first DOIT.
    Chatter,
    /// Setup mode, with one access in each DOIT.
    PassThrough,
    /// Process data in each DOIT.
    ProcessData,
    /// An unknown code.
    Unknown,
}

use ComState as S;

/// First and last code of each step, one to prepare it and one or more to wait, and the activity of
/// the channel there.
const STEPS: [(u8, u8, ComState, &str); 20] = [
    (0x00, 0x00, S::Stopped, "stopped"),
    (0x01, 0x02, S::Starting, "waits before the first request"),
    (0x03, 0x04, S::Starting, "asks whether a remote is there"),
    (0x05, 0x06, S::Starting, "sets the frame timeout"),
    (0x07, 0x08, S::Starting, "clears the LBP status"),
    (0x09, 0x0B, S::Starting, "checks the LBP status"),
    (0x0C, 0x0D, S::UnitNumber, "asks for the unit number"),
    (0x0E, 0x15, S::Starting, "asks for the name"),
    (0x16, 0x17, S::Starting, "recognises the name"),
    (0x18, 0x19, S::Starting, "clears the faults of a 7I64"),
    (0x1A, 0x1B, S::Starting, "sets the software mode"),
    (0x1C, 0x1D, S::Sizes, "asks for sizes and tables"),
    (0x1E, 0x1F, S::ClearOutputs, "sets the outputs off"),
    (0x20, 0x21, S::Starting, "clears the faults"),
    (0x22, 0x23, S::CheckFaults, "waits for the faults to clear"),
    (0x24, 0x26, S::CheckFaults, "checks that no fault is left"),
    (0x3A, 0x3B, S::Chatter, "running, no DOIT yet"),
    (0x3E, 0x3F, S::ProcessData, "running (7I64)"),
    (0x40, 0x41, S::PassThrough, "setup mode"),
    (0x42, 0x43, S::ProcessData, "running"),
];

/// Content of a channel's CS register.
///
/// Manual: 7I77, "CS REGISTER AFTER START", "CS REGISTER AFTER DOIT".
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(transparent))]
pub struct CsStatus(pub u32);

impl CsStatus {
    /// Local communication faults, sticky.
    pub const fn local_faults(self) -> LocalFaults {
        LocalFaults::from_bits_retain(self.0 as u8)
    }

    /// Communication status.
    pub(super) const fn link(self) -> LinkStatus {
        LinkStatus::from_bits_retain((self.0 >> 8) as u8)
    }

    /// State of the channel.
    pub fn state(self) -> ComState {
        self.step().0
    }

    fn step(self) -> (ComState, &'static str) {
        let code = self.state_code();
        let mut steps = STEPS.iter();
        let step = steps.find(|step| (step.0..=step.1).contains(&code));
        step.map_or((S::Unknown, "in a state that is not known"), |step| {
            (step.2, step.3)
        })
    }

    /// The code of [`state`](Self::state).
    pub const fn state_code(self) -> u8 {
        (self.0 >> 16) as u8
    }

    /// Faults in the remote's last reply. Faults reported before survive STOPALL and START until
    /// the first DOIT completes (FACTS 3.7).
    pub const fn remote_faults(self) -> RemoteFaults {
        RemoteFaults::from_bits_retain((self.0 >> 24) as u8)
    }

    /// True if START has identified the remote and is complete.
    ///
    /// The communication-error bit is ignored, because it is sticky and does not describe the
    /// present state (FACTS 6.2: the access after a lost reply is fine).
    pub const fn is_ready(self) -> bool {
        let pending = LinkStatus::NOT_READY.union(LinkStatus::NO_REMOTE_ID);
        !self.link().intersects(pending)
    }

    /// True if the channel has the state after power-up or a stop.
    pub const fn is_stopped(self) -> bool {
        self.state_code() == 0 && self.link().bits() == 0xC1
    }

    /// True if a channel that was stopped before has completed this START. DATA is ignored: after a
    /// START that the network delivered twice it reads FF (FACTS 3.3).
    pub(crate) fn has_started(self, mode: StartMode) -> bool {
        let arrived = match mode {
            StartMode::Normal => S::Chatter,
            StartMode::Setup => S::PassThrough,
        };
        self.state() == arrived && self.is_ready()
    }

    /// True if the channel is in one of the states in which DOIT exchanges process data.
    pub(super) fn transfers_data(self) -> bool {
        self.state() == S::ProcessData && self.is_ready()
    }
}

impl fmt::Display for CsStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.step().1)?;
        if !self.is_stopped() {
            if !self.link().is_empty() {
                write!(f, "; {}", self.link())?;
            }
            if !self.local_faults().is_empty() {
                write!(f, "; since the last stop: {}", self.local_faults())?;
            }
        }
        if !self.remote_faults().is_empty() {
            // Until START has read the faults, they are those of an earlier reply (FACTS 3.7).
            let is_old = matches!(
                self.state(),
                S::Stopped | S::Starting | S::UnitNumber | S::Sizes | S::ClearOutputs
            );
            let says = if is_old { "said before" } else { "says" };
            write!(f, "; the remote {says}: {}", self.remote_faults())?;
        }
        write!(f, " (CS {:08X})", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;
    use proptest::prelude::*;

    fn cs(word: u32) -> CsStatus {
        CsStatus(word)
    }

    /// Gateware transcripts t02, t03, t06, t10, t11.
    #[test]
    fn recorded_values_decode() {
        assert!(cs(0x0000_C100).is_stopped());
        assert_eq!(cs(0x0040_0000).state(), ComState::PassThrough);
        assert!(cs(0x0040_0000).is_ready());
        assert_eq!(cs(0x003A_0000).state(), ComState::Chatter);
        let lost = cs(0x0042_2008);
        assert_eq!(lost.state(), ComState::ProcessData);
        assert_eq!(lost.link(), LinkStatus::COMMUNICATION_ERROR);
        assert_eq!(lost.local_faults(), LocalFaults::TIMEOUT);
        let bitten = cs(0x0142_2140);
        assert_eq!(bitten.remote_faults(), RemoteFaults::WATCHDOG);
        assert_eq!(bitten.local_faults(), LocalFaults::REMOTE_FAULT);
        assert!(bitten.is_ready());
    }

    /// FACTS 4.5.
    #[test]
    fn recorded_failures_decode() {
        use LocalFaults as L;
        assert_eq!(
            cs(0x0004_E1B0).local_faults(),
            L::TOO_MANY_ERRORS | L::SERIAL_BREAK | L::EXTRA_CHARACTER
        );
        assert_eq!(cs(0x2024_A1C0).remote_faults(), RemoteFaults::LOW_VOLTAGE);
        assert_eq!(cs(0x2024_A1C0).state(), ComState::CheckFaults);
        assert_eq!(cs(0x000D_E188).state(), ComState::UnitNumber);
        assert_eq!(cs(0x001D_E188).state(), ComState::Sizes);
        assert_eq!(cs(0x001E_A188).state(), ComState::ClearOutputs);
    }

    #[test]
    fn machine_builder_can_read_it() {
        assert_eq!(
            cs(0x2042_2148).to_string(),
            "running; remote fault, communication error; since the last stop: no reply in time, \
             remote fault; the remote says: field voltage too low or missing (CS 20422148)"
        );
        assert_eq!(cs(0x0000_C100).to_string(), "stopped (CS 0000C100)");
    }

    proptest! {
        #[test]
        fn any_value_decodes_and_keeps_its_bits(word: u32) {
            let status = cs(word);
            let bytes = [
                status.local_faults().bits(),
                status.link().bits(),
                status.state_code(),
                status.remote_faults().bits(),
            ];
            prop_assert_eq!(u32::from_le_bytes(bytes), word);
            prop_assert!(!status.to_string().is_empty());
        }
    }
}
