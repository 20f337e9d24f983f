//! The next steps after the errors, remarks and events of this crate.
//!
//! Each is a constant, with which a program can compare; a program with other words for its users
//! has them by the [topic](AdviceTopic).
//!
//! ```
//! use mesa_hal::hal::PinStore;
//! use mesa_hal::{MesaError, advice};
//!
//! let error = PinStore::default().input::<bool>("spindle").expect_err("no such pin");
//! assert_eq!(error.advice(), Some(advice::LIST_PINS));
//! assert_eq!(
//!     error.with_advice().to_string(),
//!     "no pin or parameter `spindle`; list the names with `Pins::infos`"
//! );
//! ```

pub use mesa_wire::bus::advice::*;
pub use mesa_wire::lbp::advice::*;
pub use mesa_wire::lbp16::advice::*;
pub use mesa_wire::{Advice, AdviceTopic, MesaError, WithAdvice, advice_texts};

// In groups: pins, parameters of remotes, settings, modules, firmware, start and cycle, cards, the
// serial line of a remote, its tables, the board's memory, threads.
mesa_wire::advice_texts! {
    /// All constants of this module that are not those of `mesa-wire`.
    ALL;
    LIST_PINS: PinNames, "list the names with `Pins::infos`";
    SHORTEN_NAME: Choice, "give the remote a shorter name, of characters that HAL takes";
    CHOOSE_OTHER_NAME: Settings, "choose another name; two boards in one program need two numbers (`Settings::board_number`)";
    LEAVE_BOARDS_OUT: Choice, "leave boards or modules out";
    USE_MATCHING_HANDLE: Choice, "take the handle of that kind";
    SET_OPPOSITE: Choice, "set the opposite instead";
    ASK_THIS_DRIVER: Choice, "ask this driver for the handle, by name";
    REARM_LATER: Retry, "arm the group when its inputs are valid again";
    SWITCH_PORT_ON: Retry, "switch the port on by its pin run, then arm the group";
    WRITE_REMOTE_PARAMETER: RemoteParameter, "write it before with `Configured::write_remote_parameter` while the board is configured, or at run time with `Driver::write_remote_parameter`, which stops its port";
    RESTART_PORT: PortSwitch, "check the cable, then switch the port off and on by its pin run";
    CHECK_CYCLE: Host, "check that the cycle runs";

    LIST_PARAMETERS: ParameterNames, "look the name up in the remote's descriptor, which lists its parameters";
    LEAVE_PARAMETER_OUT: Choice, "leave the parameter out";
    CHOOSE_VALUE: Choice, "give a value within the range";

    SET_WATCHDOG: Settings, "change `Settings::watchdog`";
    SET_BUS_ERROR_LIMIT: Settings, "change `Settings::bus_error_limit`";
    SET_FAULT_POLICY: Settings, "change `Settings::fault_policy`";
    SET_STALE_AFTER: Settings, "change `FaultPolicy::stale_after`";
    SET_PWM: Settings, "change `Settings::pwm`";
    SET_PWM_FREQUENCY: PwmFrequency, "change `Settings::pwm_hz`";
    SET_INSTANCES: Instances, "change `Settings::instances`, or load a firmware that has more";
    SET_ENCODER_RATE: Settings, "change `Settings::encoder_rate`";
    LEAVE_DPLL: Dpll, "choose another thread period, or go on without the DPLL (0 of `Gtag::HM2DPLL` in `Settings::instances`)";
    CHOOSE_HOST_PACE: HostPace, "let the host pace it (`Pace::Host`)";
    CHOOSE_PERIOD: Host, "choose a period of 1 us to 800 ms";
    SET_PERIOD_FIRST: StartPeriod, "start the driver with `Settings::period`, or call `Driver::set_period` before the first write";
    LENGTHEN_WATCHDOG: WatchdogTime, "choose a longer time for the watchdog (`Settings::watchdog` for that of the board), or a shorter period";
    LENGTHEN_PERIOD: Host, "choose a longer period, or spread the remotes over several ports";
    LEAVE_PORT_OUT: SerialPort, "leave the configuration of the port out";
    LEAVE_CHANNEL_OUT: Channel, "leave the channel out";

    CHECK_STEP_RATE: Choice, "check maxvel, position-scale, steplen and stepspace";
    CHECK_STEP_TIMES: Choice, "check steplen, stepspace, dirsetup and dirhold";
    CHECK_STEP_HOLD: Choice, "check steplen and dirhold, which share a register";
    CHECK_STEP_TIMER: Choice, "check stepgen.timer-number and the timers of the DPLL";
    HOME_AGAIN: Homing, "home again";

    CHECK_DESCRIPTOR: Module, "check the module's descriptor";
    CHOOSE_PHASE: Module, "choose `Phase::Data`";
    LEAVE_MODULE_OUT: Choice, "leave one of the modules out";
    CHOOSE_OTHER_PIN: Choice, "choose another pin";
    CHOOSE_OTHER_INSTANCE: Choice, "choose another instance or firmware";
    CHOOSE_EXISTING: Choice, "ask for one that exists";

    CHECK_BOARD_ADDRESS: Board, "check that the address is right, and that it is the right board";
    CHECK_BOARD_FIRMWARE: Board, "check that the address is right, and that the FPGA has loaded a HostMot2 firmware";
    CHECK_BYTE_ORDER: Firmware, "write the firmware of the board again; on a bus of your own, check whether it swaps bytes";
    LOAD_MATCHING_FIRMWARE: Firmware, "load a firmware for the boards that are connected";
    USE_KNOWN_FIRMWARE: Firmware, "use a firmware with a module that is known";
    USE_OTHER_FIRMWARE: Firmware, "use another firmware image";
    FLASH_NEWER_FIRMWARE: Firmware, "flash a newer firmware";
    LOAD_NEWER_FIRMWARE: Firmware, "load a newer firmware if a remote is missing or fails";

    CHECK_SUPPLY: Board, "check the board's supply, and that no other program drives it; then start again";
    CHECK_BOARD_POWER: Board, "check the power of the board, and that its FPGA has its firmware";
    CHECK_LINK: Board, "look at the board's link, then try again";
    REARM_FIRST: Rearm, "call `Driver::rearm` first";
    REARM: Rearm, "call `Driver::rearm`";
    FIND_LATE_HOST: WatchdogBite, "find out why the host was late, or which other program lets the watchdog bite, then call `Driver::rearm`";
    CHECK_RESET: BoardReset, "check the board's supply, end other programs that write to it, then call `Driver::rearm`";
    CHECK_CONNECTION: ConnectionLost, "check cable and power of the board, then call `Driver::rearm`";
    READ_FIRST: Calls, "call `Driver::read` before each `Driver::write`, then `Driver::rearm`";
    START_ANEW: Restart, "stop the driver and start it anew";
    SWITCH_OFF_POWER: RemotePower, "switch off the power of the remote";

    LOOK_AT_MISSING: Missing, "look at `Driver::missing` for the reason, if the remote was configured";
    NAME_FIRST_CHANNEL: Remote, "name the card's first channel, or load a firmware that is made for the card";
    COMPLETE_TABLE: Remote, "plug the remote in, or complete the table";
    CHECK_MODE: Remote, "check whether the software mode, the firmware or the number of instances in use differ";
    CHECK_SWAPPED_CABLES: Remote, "check whether the cables are swapped";
    EXCHANGE_CHANNELS: Remote, "exchange the channels in the configuration, or the card's cables";
    EXCHANGE_ON_CONNECTOR: Remote, "exchange the channels if the card is plugged to a card connector";
    SEE_LABEL: Remote, "see the label on the card";
    PLUG_IN_RIGHT_REMOTE: Remote, "plug the right remote in, and check that no plug is loose";
    CHECK_MANUAL: Remote, "check terminals and ranges in the manual of the remote's firmware";
    SET_REMOTE_WATCHDOG: Remote, "set NVWatchDogTimeout (50 ms as delivered) and switch the card off and on";
    PLUG_IN: RemotePower, "plug the remote in, and check its power (field power too, where it is powered from there)";
    PLUG_IN_OR_REBUILD: Remote, "plug the right remote in, or build the driver anew";
    REBUILD_WITH_REMOTE: Restart, "build the driver anew with the remote plugged in";
    CHECK_FIELD_POWER: Remote, "check the field power of the remote";
    CHECK_LOADS: Remote, "check the loads and the supply of the remote, then re-arm it";

    CHECK_REMOTE_POWER: RemotePower, "check that a remote is connected to this channel and has power (field power too, where it is powered from there), and that its jumper is in the operate position";
    CHECK_CARD_POWER: RemotePower, "check the card's cable and its power (field power too, where it is powered from there)";
    CHECK_CABLE_AND_POWER: RemotePower, "check the cable and the power of the remote";
    CHECK_BAUD_RATE: Remote, "check the baud rate and the connected device";
    CHECK_RX_WIRES: Remote, "check for swapped or shorted RX wires, or a remote without power";
    CHECK_SHIELD: Remote, "check cable, shield and ground";
    CHECK_NOISE: Remote, "check for noise, and for two remotes on one line";
    CHECK_CABLE_OR_ADDRESS: RemotePower, "check the cable; if only this address fails, the remote does not have it";
    CHECK_SWITCHES: Network, "look at the switches and cables of the network, or connect directly";
    POWER_CYCLE_THEN_CABLE: RemotePower, "switch the remote off and on, then check the cable";
    POWER_CYCLE: RemotePower, "switch the remote off and on";
    POWER_CYCLE_OR_UPDATE: Remote, "switch the remote off and on, and update its firmware if that does not help";
    UPDATE_REMOTE: Remote, "update the firmware of the remote";
    RESTART_OR_UPDATE_REMOTE: Remote, "check its cable and start it again; if it stays so, update its firmware";
    CHOOSE_MODE: Remote, "choose another software mode";
    CHOOSE_LISTED_MODE: Remote, "start the remote in one of its modes";
    CHOOSE_MODE_OR_WIDE_FIRMWARE: Remote, "choose another software mode, or a firmware with wide SSLBP";
    RESTART_CHANNEL: PortState, "stop and start the channel again";
    STOP_ALL: PortState, "call `SetupPort::stop_all`, which knows the way out; if that fails, reset the port";
    STOP_ALL_FIRST: PortState, "call `SetupPort::stop_all` first";
    RESET_PORT: PortState, "reset the port";
    RELOAD_FPGA: PortState, "reset the port, or reload the FPGA";
    IDENTIFY_PORT: PortState, "call `SetupPort::reset` or `SetupPort::identify` first";

    CHECK_CABLE_AND_RESTART: RemotePower, "check the cable, then start again";
    ADD_TABLE: NoTable, "leave the channel out (x), or add the remote's table with `has_discovery` false (`Settings::remotes`)";
    FINISH_UPDATE: Remote, "give `mesa update` again, with the jumper of the remote in the setup position";
    CHECK_SCALE: Choice, "check the scale of the pins";

    UPDATE_BOARD: Firmware, "update the firmware of the board";
    TRY_AGAIN: Retry, "try again";
    TRY_AGAIN_THEN_UPDATE: Firmware, "try again; if it stays so, update the firmware of the board";
    SEE_BOARD_MANUAL: Firmware, "look the registers of each space up in the manual of the board";
    USE_LAYOUT_OF_BOARD: FlashLayout, "use the layout of the board that answers (`FlashLayout::for_card`)";
    WRITE_BOOT_BLOCK: BootBlock, "write the boot block first (`Flash::write_boot_block`)";
    WRITE_FALLBACK: Fallback, "write the fallback first, or, if there is no user configuration either, allow the update without one (`Flash::without_fallback`)";
    WRITE_USER_CONFIGURATION: Firmware, "write the user configuration first, reload the FPGA from it, then write the fallback";
    CHOOSE_CONFIGURATION_AREA: Firmware, "write the user configuration, or the fallback";
    CHECK_AREA: Firmware, "check the address and the area, and that they are for this board";
    WRITE_AGAIN: Firmware, "if the memory should hold this, write it again, and do not restart the board before it verifies";
    GIVE_BIT_FILE: Firmware, "give the .bit file itself";
    GIVE_STANDARD_BITFILE: StandardBitfile, "give a standard bitfile, built without multiboot features; an image of the whole memory is restored as a backup";
    GET_FILE_AGAIN: Firmware, "copy the file again, or get it again";
    GET_FILE_FOR_BOARD: Firmware, "get the file for this board";

    ALLOW_PRIORITY: Realtime, "give the user `rtprio` up to that priority in /etc/security/limits.d and log in again, or give the program CAP_SYS_NICE";
    ALLOW_LOCKED_MEMORY: Realtime, "give the user `memlock unlimited` in /etc/security/limits.d and log in again, or give the program CAP_IPC_LOCK";
    ALLOW_REALTIME: Realtime, "give the user `rtprio` up to that priority and `memlock unlimited` in /etc/security/limits.d and log in again, or give the program CAP_SYS_NICE and CAP_IPC_LOCK; choose among the CPUs that `nproc --all` counts";
    COUNT_CPUS: Realtime, "choose among the CPUs that `nproc --all` counts";
    TRY_NEXT_PERIOD: Retry, "try again in a period";
    TRY_LATER: Retry, "try again later";
}

/// All advice: that of the driver in the order of the declaration, then that of buses and remotes.
pub fn all() -> impl Iterator<Item = Advice> {
    let of_wire = mesa_wire::lbp::advice::ALL
        .iter()
        .chain(mesa_wire::lbp16::advice::ALL);
    let of_wire = mesa_wire::bus::advice::ALL.iter().chain(of_wire);
    ALL.iter().chain(of_wire).copied()
}

#[cfg(test)]
mod tests {
    use alloc::collections::BTreeSet;
    use alloc::string::ToString;
    use alloc::vec::Vec;

    use super::*;

    #[test]
    fn each_advice_is_a_phrase_of_its_own() {
        let texts: Vec<_> = all().map(|advice| advice.to_string()).collect();
        for text in &texts {
            assert!(text.split(' ').count() > 1, "{text}");
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
