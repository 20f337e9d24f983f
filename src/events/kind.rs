//! The kinds of events.

use crate::advice::{self, Advice, MesaError, WithAdvice};
use core::fmt;
use core::time::Duration;

use bitflags::bitflags;

use super::OfflineReason;
use crate::bus::BusErrorKind;
use crate::packed::packed_enum;
use crate::sslbp::{Failure, RemoteLabel};

/// Defines [`EventKind`] and all that follows from a kind, so that a new kind is one entry: its bit
/// in [`EventMask`], whether it is a `fault` or a `recovery`, its remote if there is one, its text,
/// and its advice if there is one.
macro_rules! event_kinds {
    (@is_fault fault) => { true };
    (@is_fault recovery) => { false };
    (@or_none) => { None };
    (@or_none $value:expr) => { $value };
    (
        $(#[$($enum_attribute:tt)*])*
        pub enum $name:ident {
            $(
                $(#[$($attribute:tt)*])*
                [
                    $mask:ident = $bit:literal, $class:ident;
                    $(of $remote:expr;)? $text:literal $(, $value:expr)*
                    $(; then $advice:expr)?
                ]
                $variant:ident
                $({ $( $(#[$($field_attribute:tt)*])* $field:ident: $type:ty ),* $(,)? })?
            ),* $(,)?
        }
    ) => {
        packed_enum! {
            $(#[$($enum_attribute)*])*
            pub enum $name {
                $(
                    $(#[$($attribute)*])*
                    $variant $({ $( $(#[$($field_attribute)*])* $field: $type ),* })?
                ),*
            }
        }

        bitflags! {
            /// Kinds of events, each with a bit: [`EventKind::mask`].
            #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
            pub struct EventMask: u32 {
                $(
                    #[doc = concat!("[`EventKind::", stringify!($variant), "`].")]
                    const $mask = 1 << $bit;
                )*
                /// Events after which outputs are safe until they are re-armed.
                const OUTPUTS_SAFE = Self::REMOTE_OFFLINE.bits()
                    | Self::WATCHDOG_BITTEN.bits()
                    | Self::BOARD_RESET.bits()
                    | Self::BUS_DOWN.bits()
                    | Self::NOT_READ.bits();
            }
        }

        impl $name {
            /// The bit of this kind.
            pub const fn mask(&self) -> EventMask {
                match self {
                    $(Self::$variant { .. } => EventMask::$mask,)*
                }
            }

            /// True if the event is a fault or a loss. All others report a recovery, or the end of
            /// a row.
            pub const fn is_fault(&self) -> bool {
                match self {
                    $(Self::$variant { .. } => event_kinds!(@is_fault $class),)*
                }
            }

            /// True if outputs became safe with the event, until they are re-armed: what an
            /// operator has to know at once. Other [faults](Self::is_fault) are warnings.
            pub const fn makes_safe(&self) -> bool {
                EventMask::OUTPUTS_SAFE.intersects(self.mask())
            }

            /// The remote of an event about one; `None` for other events.
            #[expect(unused_variables, reason = "an entry names the fields that it needs")]
            pub const fn remote(&self) -> Option<RemoteLabel> {
                match self {
                    $(Self::$variant $({ $($field),* })? => event_kinds!(@or_none $($remote)?),)*
                }
            }
        }

        impl $name {
            /// The next step, if there is one.
            #[expect(unused_variables, reason = "an entry names the fields that it needs")]
            pub fn advice(&self) -> Option<Advice> {
                match self {
                    $(Self::$variant $({ $($field),* })? => event_kinds!(@or_none $($advice)?),)*
                }
            }

            /// Joins the event and the advice: `event; advice`.
            pub fn with_advice(&self) -> WithAdvice<'_> {
                WithAdvice::new(self, self.advice())
            }
        }

        /// The event without its remote.
        #[expect(unused_variables, reason = "an entry names the fields that it needs")]
        fn write_text(kind: &$name, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            match kind {
                $($name::$variant $({ $($field),* })? => write!(f, $text $(, $value)*),)*
            }
        }
    };
}

event_kinds! {
/// The kind of an event.
///
/// Events that may happen in every cycle, [`Repeating`], are reported once for a row of them, and
/// once more for each other reason; their number is reported when the row is over:
/// [`Repeated`](Self::Repeated).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "event", rename_all = "kebab-case"))]
pub enum EventKind {
    /// A transfer of a remote failed; the first of a row with this reason.
    [TRANSFER_FAILED = 0, fault; of Some(*remote); "transfer failed: {failure}"]
    TransferFailed {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
        /// The reason.
        failure: Failure,
    },
    /// A remote went offline: its outputs are safe until it is re-armed.
    [REMOTE_OFFLINE = 1, fault; of Some(*remote); "card offline, outputs off until re-armed: {reason}"; then reason.advice()]
    RemoteOffline {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
        /// The reason this time. The first reason since the remote was re-armed last stays in
        /// [`RemoteStatus::first_fault`](crate::driver::RemoteStatus::first_fault).
        reason: OfflineReason,
    },
    /// A remote that is offline was tried again, and stays offline for another reason than before.
    [REMOTE_STAYS_OFFLINE = 2, fault; of Some(*remote); "card still offline: {reason}"; then reason.advice()]
    RemoteStaysOffline {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
        /// The reason.
        reason: OfflineReason,
    },
    /// A remote that was offline transfers again, with safe outputs until it is re-armed.
    [REMOTE_BACK = 3, recovery; of Some(*remote); "card back, outputs off until re-armed"; then Some(advice::REARM)]
    RemoteBack {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
    },
    /// An optional remote that was absent at the start came up. It waits to be armed.
    [REMOTE_UP = 4, recovery; of Some(*remote); "card plugged in and running, outputs off until re-armed"; then Some(advice::REARM)]
    RemoteUp {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
    },
    /// A remote that had been offline follows the application again; its first fault is cleared.
    [REMOTE_REARMED = 5, recovery; of Some(*remote); "re-armed: outputs follow again"]
    RemoteRearmed {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
    },
    /// The board's watchdog was found to have bitten: the host was late, or another program let it
    /// bite. Everything is safe.
    [WATCHDOG_BITTEN = 6, fault; "the board's watchdog has bitten: all outputs off until re-armed"; then Some(advice::FIND_LATE_HOST)]
    WatchdogBitten,
    /// The board was found to have been reset, or to have lost power, or another program wrote the
    /// time of its watchdog. Everything is safe.
    [BOARD_RESET = 7, fault; "the board was reset or lost power, or another program wrote its watchdog's time: \
         all outputs off until re-armed"; then Some(advice::CHECK_RESET)]
    BoardReset,
    /// The bus failed too often in too short a time. Everything is safe.
    [BUS_DOWN = 8, fault; "connection lost, too many exchanges with the board failed: all outputs off until re-armed"; then Some(advice::CHECK_CONNECTION)]
    BusDown,
    /// The board got back the set-up that it had lost.
    [BOARD_SET_UP = 9, recovery; "the board is set up again"]
    BoardSetUp,
    /// Another board, or another firmware, answers than at the driver's start. It gets no part of
    /// the driver's set-up, and everything stays safe.
    [OTHER_FIRMWARE = 19, fault; "another board or another firmware answers than at the start: it is not set up, and \
         all outputs stay off"; then Some(advice::START_ANEW)]
    OtherFirmware,
    /// [`Driver::rearm`](crate::driver::Driver::rearm) let outputs follow the application again.
    [REARMED = 10, recovery; "re-armed: groups that follow again: {armed}{}", Waiting(*waiting)]
    Rearmed {
        /// Groups that were armed.
        armed: u32,
        /// Groups that do not run yet.
        waiting: u32,
    },
    /// Groups that were to be armed as soon as they run
    /// ([`Driver::rearm_when_running`](crate::Driver::rearm_when_running),
    /// [`Rearmed::rearm_pending`](crate::driver::Rearmed::rearm_pending)) will not be, because of a
    /// fault of the board. Re-arm them again.
    [REARM_CANCELLED = 21, fault; "re-arming of {groups} groups cancelled by a new fault of the board"; then Some(advice::REARM)]
    RearmCancelled {
        /// Number of these groups.
        groups: u32,
    },
    /// A remote that was to be armed as soon as it runs will not be, because of a new fault of it,
    /// or because its port was switched off. Re-arm it again.
    [REMOTE_REARM_CANCELLED = 22, fault; of Some(*remote); "re-arming cancelled by a new fault"; then Some(advice::REARM)]
    RemoteRearmCancelled {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
    },
    /// A read failed; the first of a row with this reason.
    [READ_FAILED = 11, fault; "read failed: {why}"]
    ReadFailed {
        /// The error of the bus.
        why: BusErrorKind,
    },
    /// A read found no HostMot2 board; the first of a row of failed reads.
    [NOT_THERE = 12, fault; "no HostMot2 board: address 0x0100 reads {found:#010X}, expected 0x55AACAFE"]
    NotThere {
        /// Content of the cookie's address.
        found: u32,
    },
    /// A row is over: 10 s have passed without a further event, the remote went offline, or the
    /// driver stops. Not reported if all events of the row were reported one by one.
    [REPEATED = 13, recovery; of what.remote(); "{count} {what} within {:.3} s", lasted.as_secs_f64()]
    Repeated {
        /// The kind of the row.
        #[cfg_attr(feature = "serde", serde(flatten))]
        what: Repeating,
        /// Number of events, including those that were reported.
        count: u32,
        /// Time from the first to the last, in whole milliseconds.
        #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
        lasted: Duration,
    },
    /// A write failed; the first of a row with this reason.
    [WRITE_FAILED = 14, fault; "write failed: {why}"]
    WriteFailed {
        /// The error of the bus.
        why: BusErrorKind,
    },
    /// Writes are known to be lost; the first of a row.
    [LOST_WRITES = 15, fault; "lost writes: {count}"]
    LostWrites {
        /// Number in this cycle.
        count: u32,
    },
    /// Periods passed without a good read, where the [board paces](crate::driver::Pace::Board); the
    /// first of a row.
    [MISSED_PERIODS = 16, fault; "periods without a good read: {count}"]
    MissedPeriods {
        /// Number in this cycle.
        count: u32,
    },
    /// The queue was full: from this event on, until it was empty again, events were dropped.
    [DROPPED = 17, fault; "the queue of events was full: {count} events dropped from here on"]
    Dropped {
        /// Number of dropped events.
        count: u32,
    },
    /// A second master drives the board as well; the first of a row.
    [OTHER_MASTER = 18, fault; "another program or host drives this board: {packets} foreign packets within 1 s"; then Some(advice::END_OTHER_PROGRAM)]
    OtherMaster {
        /// Number of its packets when it was detected.
        packets: u32,
    },
    /// The application writes and does not read: all inputs are invalid, and everything is safe.
    [NOT_READ = 20, fault; "{writes} writes without a read: no input is valid, all outputs off until re-armed"; then Some(advice::READ_FIRST)]
    NotRead {
        /// Number of writes since the last read.
        writes: u32,
    },
    /// A parameter of a remote that was
    /// [requested](crate::Driver::request_remote_parameter) was not written, or the reply to its
    /// write was lost. Unless the remote refused the value, it is tried again when the port is
    /// switched on the next time.
    [PARAMETER_NOT_WRITTEN = 24, fault; of Some(*remote); "parameter number {parameter} was not written: no good reply, or the card does not keep the \
         value"; then Some(advice::RESTART_PORT)]
    ParameterNotWritten {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
        /// Index in [`RemotePins::parameters`](crate::remote::RemotePins::parameters).
        parameter: u32,
    },
    /// A step generator is asked for a higher rate than it may have, by its parameters or because
    /// of the times of its pulses. Reported once for each change of its parameters.
    [STEP_RATE_LIMITED = 25, fault; "step generator {generator}: {asked} steps/s commanded, its limit is {limit} steps/s"; then Some(advice::CHECK_STEP_RATE)]
    StepRateLimited {
        /// The number of the generator.
        generator: u32,
        /// The rate that is asked for, in steps per second.
        asked: u32,
        /// The highest rate.
        limit: u32,
    },
    /// A time of the pulses of a step generator is longer than its register holds, and became the
    /// longest one.
    [STEP_TIME_CLIPPED = 26, fault; "step generator {generator}: pulse time set to {asked} ns, {longest} ns is used, the longest one"; then Some(advice::CHECK_STEP_TIMES)]
    StepTimeClipped {
        /// The number of the generator.
        generator: u32,
        /// The time that is asked for, in ns.
        asked: u32,
        /// The longest time, in ns.
        longest: u32,
    },
    /// The pulses of a step generator are so long that its register of the hold time, which
    /// includes the pulse, has no room for `dirhold`. Reported once for each change of the times,
    /// when the generator is enabled.
    [STEP_HOLD_SHORT = 27, fault; "step generator {generator}: the direction can change {left} ns after a pulse, dirhold is {asked} ns"; then Some(advice::CHECK_STEP_HOLD)]
    StepHoldShort {
        /// The number of the generator.
        generator: u32,
        /// The hold time that is asked for, in ns.
        asked: u32,
        /// The time from the end of a pulse to a change of the direction, in ns.
        left: u32,
    },
    /// The accumulator of a step generator stands still although it has a rate, so that its
    /// position is not known: it is stopped until it has been disabled and enabled again.
    [STEPGEN_STANDS = 28, fault; "step generator {generator}: stopped, because its accumulator does not move at {rate} steps/s"; then Some(advice::CHECK_STEP_TIMER)]
    StepgenStalled {
        /// The number of the generator.
        generator: u32,
        /// Its rate in steps per second.
        rate: u32,
    },
    /// A parameter or pin was set to a value that the hardware cannot have, and another one is in
    /// use: the parameter has that one. A pin keeps its value, and is reported once for each.
    [VALUE_CORRECTED = 30, fault; "{}: {asked} is out of range {lowest} to {highest}, {used} is used", setting.of(*number)]
    ValueCorrected {
        /// The parameter or pin.
        setting: CorrectedValue,
        /// The number of its instance, or of its module of the same kind; 0 without one.
        number: u32,
        /// The value that it was set to.
        asked: i64,
        /// The value that is used.
        used: i64,
        /// The smallest allowed value.
        lowest: i64,
        /// The largest allowed value.
        highest: i64,
    },
    /// Positions are not known any more, and stay so until the axes are homed again: by an index,
    /// or by `reset`, `position-reset` or `homed`. Not in the first 100 reads after the start:
    /// unless an axis was homed before, or its generator enabled, there was no position yet that
    /// could be lost.
    [POSITION_UNSURE = 29, fault; "position unsure of {of} {}", Numbers { first: *first, mask: *mask }; then Some(advice::HOME_AGAIN)]
    PositionUnsure {
        /// The kind of counter.
        of: Positions,
        /// The number of bit 0 of the mask.
        first: u32,
        /// The bit of each counter whose position has become unsure.
        mask: u32,
    },
    /// An event of a module outside of this crate, by
    /// [`ReadCycle::report`](crate::modules::ReadCycle::report).
    [OF_MODULE = 23, fault; "module {module:02X}: event {code}, value {value}"]
    OfModule {
        /// The GTAG of the module.
        module: u32,
        /// The kind of the event, by the module's own numbers.
        code: u32,
        /// A value of the module.
        value: u32,
    },
}
}

packed_enum! {
/// Parameters and pins whose values are [corrected](EventKind::ValueCorrected).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum CorrectedValue {
    /// `pwmgen.pwm_frequency`.
    PwmFrequency,
    /// `pwmgen.pdm_frequency`.
    PdmFrequency,
    /// `pwmgen.NN.output-type`.
    OutputType,
    /// `inmux.NN.scan_rate`.
    InMuxScanRate,
    /// `inmux.NN.fast_scans`.
    InMuxFastScans,
    /// `inmux.NN.slow_scans`.
    InMuxSlowScans,
    /// `inm.NN.scan_rate`.
    InMScanRate,
    /// `inm.NN.fast_scans`.
    InMFastScans,
    /// `inm.NN.slow_scans`.
    InMSlowScans,
    /// `watchdog.timeout_ns`.
    WatchdogTimeout,
    /// `encoder.sample-frequency`.
    SampleFrequency,
    /// `encoder.muxed-sample-frequency`.
    MuxedSampleFrequency,
    /// `encoder.muxed-skew`.
    MuxedSkew,
    /// `encoder.timer-number`.
    EncoderTimer,
    /// `stepgen.timer-number`.
    StepgenTimer,
    /// `ssr.NN.rate`.
    SsrRate,
    /// `dpll.base-freq-khz`, in Hz.
    DpllFrequency,
    /// `dpll.time-const`.
    DpllTimeConst,
    /// `dpll.plimit`.
    DpllPhaseLimit,
}
}

impl CorrectedValue {
    /// The name with the number of an instance, or of a module of the same kind.
    fn of(self, number: u32) -> impl fmt::Display {
        let (kind, name) = match self {
            Self::PwmFrequency => ("pwmgen.", "pwm_frequency"),
            Self::PdmFrequency => ("pwmgen.", "pdm_frequency"),
            Self::OutputType => ("pwmgen", "output-type"),
            Self::InMuxScanRate => ("inmux", "scan_rate"),
            Self::InMuxFastScans => ("inmux", "fast_scans"),
            Self::InMuxSlowScans => ("inmux", "slow_scans"),
            Self::InMScanRate => ("inm", "scan_rate"),
            Self::InMFastScans => ("inm", "fast_scans"),
            Self::InMSlowScans => ("inm", "slow_scans"),
            Self::WatchdogTimeout => ("watchdog.", "timeout_ns"),
            Self::SampleFrequency => ("encoder.", "sample-frequency"),
            Self::MuxedSampleFrequency => ("encoder.", "muxed-sample-frequency"),
            Self::MuxedSkew => ("encoder.", "muxed-skew"),
            Self::EncoderTimer => ("encoder.", "timer-number"),
            Self::StepgenTimer => ("stepgen.", "timer-number"),
            Self::SsrRate => ("ssr", "rate"),
            Self::DpllFrequency => ("dpll.", "base-freq-khz (in Hz)"),
            Self::DpllTimeConst => ("dpll.", "time-const"),
            Self::DpllPhaseLimit => ("dpll.", "plimit"),
        };
        Numbered { kind, number, name }
    }
}

/// A name whose kind ends with a point if its number is that of a module, as in `pwmgen.bank-1.`;
/// otherwise it is that of an instance.
struct Numbered {
    kind: &'static str,
    number: u32,
    name: &'static str,
}

impl fmt::Display for Numbered {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, number, name } = self;
        match (kind.ends_with('.'), number) {
            (true, 0) => write!(f, "{kind}{name}"),
            (true, bank) => write!(f, "{kind}bank-{bank}.{name}"),
            (false, number) => write!(f, "{kind}.{number:02}.{name}"),
        }
    }
}

packed_enum! {
/// Events that may happen in every cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "what", rename_all = "kebab-case"))]
pub enum Repeating {
    /// [`EventKind::TransferFailed`] of a remote.
    FailedTransfers {
        /// The remote.
        #[cfg_attr(feature = "serde", serde(flatten))]
        remote: RemoteLabel,
    },
    /// [`EventKind::ReadFailed`] and [`EventKind::NotThere`].
    FailedReads,
    /// [`EventKind::WriteFailed`].
    FailedWrites,
    /// [`EventKind::LostWrites`].
    LostWrites,
    /// [`EventKind::MissedPeriods`].
    MissedPeriods,
    /// [`EventKind::OtherMaster`], which reports its packets every second.
    OtherMaster,
}
}

packed_enum! {
/// What counts a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Positions {
    /// The encoders of the board: pin `count-unsure`.
    Encoders,
    /// The step generators of the board: pin `position-unsure`.
    StepGenerators,
}
}

impl fmt::Display for Positions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Encoders => "encoders",
            Self::StepGenerators => "step generators",
        })
    }
}

impl Repeating {
    const fn remote(self) -> Option<RemoteLabel> {
        match self {
            Self::FailedTransfers { remote } => Some(remote),
            _ => None,
        }
    }
}

impl fmt::Display for Repeating {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FailedTransfers { .. } => "failed transfers",
            Self::FailedReads => "failed reads",
            Self::FailedWrites => "failed writes",
            Self::LostWrites => "lost writes",
            Self::MissedPeriods => "periods without a good read",
            Self::OtherMaster => "packets of another master",
        })
    }
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(remote) = self.remote() {
            write!(f, "{remote}: ")?;
        }
        write_text(self, f)
    }
}

/// The numbers of a mask: `00, 01, 02`.
struct Numbers {
    first: u32,
    mask: u32,
}

impl fmt::Display for Numbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for bit in (0..u32::BITS).filter(|bit| self.mask >> bit & 1 != 0) {
            write!(f, "{separator}{:02}", self.first.saturating_add(bit))?;
            separator = ", ";
        }
        Ok(())
    }
}

/// Number of groups that wait after a re-arm, if there are any.
struct Waiting(u32);

impl fmt::Display for Waiting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => Ok(()),
            waiting => write!(f, ", that wait until they run: {waiting}"),
        }
    }
}
