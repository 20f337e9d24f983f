//! The next step after an error or a remark, apart from its facts.

use core::fmt;

use mesa_wire::bus::BusAdvice;

macro_rules! kinds {
    ($($name:ident: $text:literal,)*) => {
        /// The next step after an error or a remark.
        ///
        /// The `Display` of an error contains facts: the operation, the place, the expected and
        /// the found value. Its method `advice` returns the next step as a value, if there is one.
        /// `Display` of the value writes it as part of a sentence for a programmer; a program with
        /// other words for its users matches the value. [`WithAdvice`] joins both.
        ///
        /// ```
        /// use mesa_hal::hal::PinStore;
        /// use mesa_hal::{Advice, WithAdvice};
        ///
        /// let error = PinStore::default().input::<bool>("spindle").expect_err("no such pin");
        /// assert_eq!(error.advice(), Some(Advice::ListPins));
        /// assert_eq!(
        ///     WithAdvice::new(&error, error.advice()).to_string(),
        ///     "no pin or parameter `spindle`; list the names with `Pins::infos`"
        /// );
        /// ```
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum Advice {
            /// The advice of the bus.
            Bus(BusAdvice),
            $(
                #[doc = concat!("\"", $text, "\".")]
                $name,
            )*
        }

        impl Advice {
            const OWN: &[Self] = &[$(Self::$name),*];
        }

        impl fmt::Display for Advice {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    Self::Bus(advice) => advice.fmt(f),
                    $(Self::$name => f.pad($text),)*
                }
            }
        }
    };
}

// In groups: pins, parameters of remotes, settings, modules, firmware, start and cycle, cards, the
// serial line of a remote, its tables, the board's memory, threads.
kinds! {
    ListPins: "list the names with `Pins::infos`",
    ShortenName: "give the remote a shorter name, of characters that HAL takes",
    ChooseOtherName: "choose another name; two boards in one program need two numbers (`Settings::board_number`)",
    LeaveBoardsOut: "leave boards or modules out",
    UseMatchingHandle: "take the handle of that kind",
    SetOpposite: "set the opposite instead",
    AskThisDriver: "ask this driver for the handle, by name",
    RearmLater: "arm the group when its inputs are valid again",
    SwitchPortOn: "switch the port on by its pin run, then arm the group",
    WriteRemoteParameter: "write it before with `Configured::write_remote_parameter` while the board is configured, or at run time with `Driver::write_remote_parameter`, which stops its port",
    CheckCycle: "check that the cycle runs",

    ListParameters: "look the name up in the remote's descriptor, which lists its parameters",
    LeaveParameterOut: "leave the parameter out",
    ChooseValue: "give a value within the range",

    SetWatchdog: "change `Settings::watchdog`",
    SetBusErrorLimit: "change `Settings::bus_error_limit`",
    SetFaultPolicy: "change `Settings::fault_policy`",
    SetStaleAfter: "change `FaultPolicy::stale_after`",
    SetPwm: "change `Settings::pwm`",
    SetPwmFrequency: "change `Settings::pwm_hz`",
    SetInstances: "change `Settings::instances`, or load a firmware that has more",
    SetEncoderRate: "change `Settings::encoder_rate`",
    LeaveDpll: "choose another thread period, or go on without the DPLL (0 of `Gtag::HM2DPLL` in `Settings::instances`)",
    ChooseHostPace: "let the host pace it (`Pace::Host`)",
    ChoosePeriod: "choose a period of 1 us to 800 ms",
    SetPeriodFirst: "start the driver with `Settings::period`, or call `Driver::set_period` before the first write",
    LengthenWatchdog: "choose a longer time for the watchdog (`Settings::watchdog` for that of the board), or a shorter period",
    LengthenPeriod: "choose a longer period, or spread the remotes over several ports",
    LeavePortOut: "leave the configuration of the port out",
    LeaveChannelOut: "leave the channel out",

    CheckDescriptor: "check the module's descriptor",
    ChoosePhase: "choose `Phase::Data`",
    LeaveModuleOut: "leave one of the modules out",
    ChooseOtherPin: "choose another pin",
    ChooseOtherInstance: "choose another instance or firmware",
    ChooseExisting: "ask for one that exists",

    CheckBoardAddress: "check that the address is right, and that it is the right board",
    CheckBoardFirmware: "check that the address is right, and that the FPGA has loaded a HostMot2 firmware",
    CheckByteOrder: "write the firmware of the board again; on a bus of your own, check whether it swaps bytes",
    LoadMatchingFirmware: "load a firmware for the boards that are connected",
    UseKnownFirmware: "use a firmware with a module that is known",
    UseOtherFirmware: "use another firmware image",
    FlashNewerFirmware: "flash a newer firmware",
    LoadNewerFirmware: "load a newer firmware if a remote is missing or fails",

    CheckSupply: "check the board's supply, and that no other program drives it; then start again",
    CheckLink: "look at the board's link, then try again",
    RearmFirst: "call `Driver::rearm` first",
    Rearm: "re-arm",
    StartAnew: "stop the driver and start it anew",
    SwitchOffPower: "switch off the power of the remote",

    LookAtMissing: "look at `Driver::missing` for the reason, if the remote was configured",
    NameFirstChannel: "name the card's first channel, or load a firmware that is made for the card",
    CompleteTable: "plug the remote in, or complete the table",
    CheckMode: "check whether the software mode, the firmware or the number of instances in use differ",
    CheckSwappedCables: "check whether the cables are swapped",
    ExchangeChannels: "exchange the channels in the configuration, or the card's cables",
    ExchangeOnConnector: "exchange the channels if the card is plugged to a card connector",
    SeeLabel: "see the label on the card",
    PlugInRightRemote: "plug the right remote in, and check that no plug is loose",
    CheckManual: "check terminals and ranges in the manual of the remote's firmware",
    SetRemoteWatchdog: "set NVWatchDogTimeout (50 ms as delivered) and switch the card off and on",
    PlugIn: "plug the remote in, and check its power (field power too, where it is powered from there)",
    PlugInOrRebuild: "plug the right remote in, or build the driver anew",
    RebuildWithRemote: "build the driver anew with the remote plugged in",
    CheckFieldPower: "check the field power of the remote",
    CheckLoads: "check the loads and the supply of the remote, then re-arm it",

    CheckRemotePower: "check that a remote is connected to this channel and has power (field power too, where it is powered from there), and that its jumper is in the operate position",
    CheckCardPower: "check the card's cable and its power (field power too, where it is powered from there)",
    CheckCableAndPower: "check the cable and the power of the remote",
    CheckBaudRate: "check the baud rate and the connected device",
    CheckRxWires: "check for swapped or shorted RX wires, or a remote without power",
    CheckShield: "check cable, shield and ground",
    CheckNoise: "check for noise, and for two remotes on one line",
    CheckCableOrAddress: "check the cable; if only this address fails, the remote does not have it",
    CheckSwitches: "look at the switches and cables of the network, or connect directly",
    CheckWriteProtection: "check the card's jumpers for write protection; else the memory may be worn out",
    PowerCycleThenCable: "switch the remote off and on, then check the cable",
    PowerCycle: "switch the remote off and on",
    PowerCycleBeforeWriting: "switch the remote off and on before anything else is written to it",
    PowerCycleOrUpdate: "switch the remote off and on, and update its firmware if that does not help",
    UpdateRemote: "update the firmware of the remote",
    RestartOrUpdateRemote: "check its cable and start it again; if it stays so, update its firmware",
    ChooseMode: "choose another software mode",
    ChooseListedMode: "start the remote in one of its modes",
    ChooseModeOrWideFirmware: "choose another software mode, or a firmware with wide SSLBP",
    RestartChannel: "stop and start the channel again",
    StopAll: "call `SetupPort::stop_all`, which knows the way out; if that fails, reset the port",
    StopAllFirst: "call `SetupPort::stop_all` first",
    ResetPort: "reset the port",
    ReloadFpga: "reset the port, or reload the FPGA",
    IdentifyPort: "call `SetupPort::reset` or `SetupPort::identify` first",

    CheckCableAndRestart: "check the cable, then start again",
    AddTable: "leave the channel out (x), or add the remote's table with `has_discovery` false (`Settings::remotes`)",
    FinishUpdate: "give `mesa update` again, with the jumper of the remote in the setup position",
    CheckScale: "check the scale of the pins",

    UpdateBoard: "update the firmware of the board",
    TryAgain: "try again",
    TryAgainThenUpdate: "try again; if it stays so, update the firmware of the board",
    SeeBoardManual: "look the registers of each space up in the manual of the board",
    UseLayoutOfBoard: "use the layout of the board that answers (`FlashLayout::for_card`)",
    WriteBootBlock: "write the boot block first (`Flash::write_boot_block`)",
    WriteFallback: "write the fallback first, or, if there is no user configuration either, allow the update without one (`Flash::without_fallback`)",
    WriteUserConfiguration: "write the user configuration first, reload the FPGA from it, then write the fallback",
    ChooseConfigurationArea: "write the user configuration, or the fallback",
    CheckArea: "check the address and the area, and that they are for this board",
    WriteAgain: "if the memory should hold this, write it again, and do not restart the board before it verifies",
    GiveBitFile: "give the .bit file itself",
    GiveStandardBitfile: "give a standard bitfile, built without multiboot features; an image of the whole memory is restored as a backup",
    GetFileAgain: "copy the file again, or get it again",
    GetFileForBoard: "get the file for this board",

    AllowPriority: "give the user `rtprio` up to that priority in /etc/security/limits.d and log in again, or give the program CAP_SYS_NICE",
    AllowLockedMemory: "give the user `memlock unlimited` in /etc/security/limits.d and log in again, or give the program CAP_IPC_LOCK",
    AllowRealtime: "give the user `rtprio` up to that priority and `memlock unlimited` in /etc/security/limits.d and log in again, or give the program CAP_SYS_NICE and CAP_IPC_LOCK; choose among the CPUs that `nproc --all` counts",
    CountCpus: "choose among the CPUs that `nproc --all` counts",
    TryNextPeriod: "try again in a period",
    TryLater: "try again later",
}

impl Advice {
    /// All values: those of the driver in the order of their declaration, then those of the bus.
    pub fn all() -> impl Iterator<Item = Self> {
        let of_buses = BusAdvice::ALL.iter().copied().map(Self::Bus);
        Self::OWN.iter().copied().chain(of_buses)
    }
}

/// The facts of an error or a remark and the [`Advice`] that belongs to it: `facts; advice`.
#[derive(Clone, Copy)]
pub struct WithAdvice<'a> {
    facts: &'a dyn fmt::Display,
    advice: Option<Advice>,
}

impl<'a> WithAdvice<'a> {
    /// Joins facts and advice; without advice the text is that of the facts.
    pub fn new(facts: &'a dyn fmt::Display, advice: Option<Advice>) -> Self {
        Self { facts, advice }
    }
}

impl fmt::Display for WithAdvice<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.facts.fmt(f)?;
        match self.advice {
            Some(advice) => write!(f, "; {advice}"),
            None => Ok(()),
        }
    }
}

impl fmt::Debug for WithAdvice<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&format_args!("{self}"), f)
    }
}

#[cfg(test)]
mod tests {
    use alloc::collections::BTreeSet;
    use alloc::string::ToString;
    use alloc::vec::Vec;

    use super::*;

    #[test]
    fn each_advice_is_a_phrase_of_its_own() {
        let texts: Vec<_> = Advice::all().map(|advice| advice.to_string()).collect();
        for text in &texts {
            assert!(text.split(' ').count() > 1 || text == "re-arm", "{text}");
            let begins_well = text.starts_with(char::is_lowercase) || text.starts_with("LinuxCNC");
            assert!(begins_well && !text.ends_with('.'), "{text}");
            for bad in ["can not", "nobody", "somebody"] {
                assert!(!text.contains(bad), "{text}");
            }
        }
        let different: BTreeSet<_> = texts.iter().collect();
        assert_eq!(different.len(), texts.len());
    }
}
