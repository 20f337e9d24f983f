//! All faults that the simulator can produce.
//!
//! The reaction of the driver to each of them is in `guides::faults` of `mesa-hal`; a test of that
//! package compares that table with this list.

use crate::remote::WireFault;
use mesa_wire::bus::Fault;
use mesa_wire::lbp::RemoteFaults;

/// Place of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FaultPlace {
    /// Between the FPGA and a remote.
    Wire,
    /// In a remote.
    Remote,
    /// In the FPGA.
    Fpga,
    /// Between host and board, on Ethernet.
    Network,
    /// Between host and FPGA, on an embedded bus.
    Bus,
    /// In the host.
    Host,
}

macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident $name:literal $place:ident,)*) => {
        /// A kind of fault.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum FaultKind {
            $($(#[$doc])* $kind,)*
        }

        impl FaultKind {
            /// All kinds of faults.
            pub const ALL: &'static [Self] = &[$(Self::$kind,)*];

            /// Name in the fault contract.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$kind => $name,)*
                }
            }

            /// Place of the fault.
            pub const fn place(self) -> FaultPlace {
                match self {
                    $(Self::$kind => FaultPlace::$place,)*
                }
            }
        }
    };
}

kinds! {
    /// A request or a reply does not arrive: [`WireFault::Lost`].
    WireLost "wire-lost" Wire,
    /// A bit is inverted: [`WireFault::Corrupted`].
    WireCorrupted "wire-corrupted" Wire,
    /// Characters are missing: [`WireFault::Short`].
    WireShort "wire-short" Wire,
    /// There are more characters: [`WireFault::Long`].
    WireLong "wire-long" Wire,
    /// A reply arrives late: [`WireFault::Late`].
    WireLate "wire-late" Wire,
    /// The line is low for the length of a burst: [`WireFault::Break`].
    WireBreak "wire-break" Wire,
    /// A cable is unplugged: [`Cable::unplug`](crate::remote::Cable::unplug).
    WireUnplugged "wire-unplugged" Wire,
    /// A cable is unplugged and the receiver sees a low line:
    /// [`Cable::set_low_when_unplugged`](crate::remote::Cable::set_low_when_unplugged).
    WireLow "wire-low" Wire,
    /// Another card is plugged in: [`SimFpga::plug`](crate::SimFpga::plug).
    WireSwapped "wire-swapped" Wire,
    /// Fault bit 01.
    RemoteWatchdog "remote-watchdog" Remote,
    /// Fault bit 02.
    RemoteNoEnable "remote-no-enable" Remote,
    /// Fault bit 04, from a driver chip that is too hot.
    RemoteOverTemperature "remote-over-temperature" Remote,
    /// Fault bit 08, from a shorted output.
    RemoteOverCurrent "remote-over-current" Remote,
    /// Fault bit 10, from field power above 32 V.
    RemoteHighVoltage "remote-high-voltage" Remote,
    /// Fault bit 20, from field power below 5 V.
    RemoteLowVoltage "remote-low-voltage" Remote,
    /// Fault bit 40.
    RemoteIllegalMode "remote-illegal-mode" Remote,
    /// Fault bit 80.
    RemoteCommunication "remote-communication" Remote,
    /// A remote has no power.
    RemotePowerOff "remote-power-off" Remote,
    /// A remote's power fails briefly, which resets its software mode.
    RemotePowerGlitch "remote-power-glitch" Remote,
    /// The FPGA is configured again in no time: [`SimFpga::reload`](crate::SimFpga::reload).
    FpgaReset "fpga-reset" Fpga,
    /// The FPGA is configured again after some time:
    /// [`SimFpga::reset_for`](crate::SimFpga::reset_for).
    FpgaResetLong "fpga-reset-long" Fpga,
    /// The watchdog bites.
    FpgaWatchdog "fpga-watchdog" Fpga,
    /// A serial port's command never completes (FACTS 3: DOIT with other high bits).
    FpgaPortStuck "fpga-port-stuck" Fpga,
    /// A packet to the board is lost.
    NetworkLostRequest "network-lost-request" Network,
    /// A packet to the host is lost.
    NetworkLostReply "network-lost-reply" Network,
    /// A packet arrives twice.
    NetworkDuplicate "network-duplicate" Network,
    /// A packet arrives late, after packets that were sent later.
    NetworkLate "network-late" Network,
    /// No packet arrives.
    NetworkDown "network-down" Network,
    /// [`Fault::NotExecuted`]: nothing is executed, and an error is returned.
    BusNotExecuted "bus-not-executed" Bus,
    /// [`Fault::Executed`]: everything is executed, and the error reports an unusable reply.
    BusNoReply "bus-no-reply" Bus,
    /// [`Fault::AckedButLost`]: a write is lost, which only a later exchange reports.
    BusAckedButLost "bus-acked-but-lost" Bus,
    /// The application is late, within the time of the watchdog.
    HostLate "host-late" Host,
    /// The application stalls for longer.
    HostStall "host-stall" Host,
    /// The process ends without a shutdown.
    HostKilled "host-killed" Host,
}

impl FaultKind {
    /// The fault bit by which a remote reports the fault, if it has one.
    pub const fn fault_bit(self) -> Option<RemoteFaults> {
        Some(match self {
            Self::RemoteWatchdog => RemoteFaults::WATCHDOG,
            Self::RemoteNoEnable => RemoteFaults::NO_ENABLE,
            Self::RemoteOverTemperature => RemoteFaults::OVER_TEMPERATURE,
            Self::RemoteOverCurrent => RemoteFaults::OVER_CURRENT,
            Self::RemoteHighVoltage => RemoteFaults::HIGH_VOLTAGE,
            Self::RemoteLowVoltage => RemoteFaults::LOW_VOLTAGE,
            Self::RemoteIllegalMode => RemoteFaults::ILLEGAL_MODE,
            Self::RemoteCommunication => RemoteFaults::COMMUNICATION,
            _ => return None,
        })
    }
}

impl From<WireFault> for FaultKind {
    fn from(fault: WireFault) -> Self {
        match fault {
            WireFault::Lost => Self::WireLost,
            WireFault::Corrupted => Self::WireCorrupted,
            WireFault::Short(_) => Self::WireShort,
            WireFault::Long(_) => Self::WireLong,
            WireFault::Late(_) => Self::WireLate,
            WireFault::Break => Self::WireBreak,
        }
    }
}

impl From<Fault> for FaultKind {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::NotExecuted(_) => Self::BusNotExecuted,
            Fault::Executed(_) => Self::BusNoReply,
            Fault::AckedButLost => Self::BusAckedButLost,
        }
    }
}

impl core::fmt::Display for FaultKind {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_bit_of_a_remote_is_in_the_list() {
        let bits = FaultKind::ALL.iter().filter_map(|kind| kind.fault_bit());
        let all = bits.fold(RemoteFaults::empty(), |all, bit| all | bit);
        assert_eq!(all.bits(), 0xFF);
    }
}
