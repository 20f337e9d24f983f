//! The report of a cycle to the application.

use core::fmt;
use core::time::Duration;

use crate::packed::packed_enum;

/// The outcome of one read. All counts are of this cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
#[must_use = "a read can fail in part"]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CycleReport {
    /// State of the board itself.
    pub board: BoardState,
    /// Remotes with new, valid data.
    pub good: u32,
    /// Remotes with a failed transfer.
    pub failed: u32,
    /// Remotes that went offline in this cycle.
    pub offline: u32,
    /// Ports with an incomplete transfer: the period is too short.
    pub too_short: u32,
    /// Writes that the bus has lost since the last read.
    pub lost_writes: u64,
    /// Packets of a second master that drives the board as well, in the cycle in which it is
    /// detected: outputs follow the second master and this driver by turns. The driver does not
    /// make anything safe on its own, because the second master would override it at once: stop the
    /// machine by means that do not depend on this board.
    pub foreign_packets: u32,
    /// Periods of the board without a good read since the last good one, where the [board
    /// paces](crate::driver::Pace::Board): packets were lost, or the host was late.
    pub missed_periods: u64,
    /// The board's clock has not begun this cycle, though the [board
    /// paces](crate::driver::Pace::Board): the clock stands still or runs at another frequency than
    /// planned, or the board did not wait for it. Inputs are not taken at equal intervals.
    pub unpaced: bool,
    /// Rest of the period when the host's packets arrived at the board, where the [board
    /// paces](crate::driver::Pace::Board).
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::some_seconds"))]
    pub slack: Option<Duration>,
    /// The cycle and the clock of the board's DPLL run together, and have for the last 120 reads,
    /// so that the DPLL's timers sample as far before the read as they are set to. Before that, the
    /// timers' samples are not reliable.
    ///
    /// Where the [host paces](crate::driver::Pace::Host), the mean of the phase error, early or
    /// late, over about 16 reads is less than a twentieth of a period. That takes 120 to 200
    /// periods from the start: in the first 100 the phase is set, as in LinuxCNC, such that it is 0
    /// at the read. Where the [board paces](crate::driver::Pace::Board), its clock began all these
    /// cycles, and none was missed.
    ///
    /// `false` without a DPLL, and while the board is not running.
    pub locked: bool,
}

impl CycleReport {
    /// True if nothing went wrong in this cycle.
    pub const fn is_good(&self) -> bool {
        matches!(self.board, BoardState::Running)
            && self.failed == 0
            && self.offline == 0
            && self.too_short == 0
            && self.lost_writes == 0
            && self.foreign_packets == 0
            && self.missed_periods == 0
            && !self.unpaced
    }
}

packed_enum! {
/// State of the board itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum BoardState {
    /// The board is set up and runs.
    #[default]
    Running,
    /// The board's watchdog has bitten: all its I/O are inputs. All outputs are safe until
    /// [`Driver::rearm`](crate::driver::Driver::rearm).
    WatchdogBitten,
    /// The board was reset or has lost power, or another program wrote its watchdog's time, so that
    /// the watchdog bit after that time, and not after a silence of this driver. All outputs are
    /// safe until [`Driver::rearm`](crate::driver::Driver::rearm).
    Reset,
    /// The bus failed too often in too short a time, see
    /// [`Settings::bus_error_limit`](crate::driver::Settings::bus_error_limit). All outputs are
    /// safe, and the watchdog is not fed, until [`Driver::rearm`](crate::driver::Driver::rearm).
    BusDown,
    /// Another board, or another firmware, answered when the board was to be set up again. All
    /// outputs are safe, and nothing is written, until
    /// [`Driver::rearm`](crate::driver::Driver::rearm) finds the board that the driver was started
    /// with.
    OtherFirmware,
}
}

impl BoardState {
    /// True if the board with the driver's firmware answers: otherwise nothing is known about the
    /// present states of its remotes and inputs.
    pub const fn is_reached(self) -> bool {
        !matches!(self, Self::BusDown | Self::OtherFirmware)
    }
}

impl fmt::Display for BoardState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Running => "the board runs",
            Self::WatchdogBitten => "the board's watchdog has bitten",
            Self::Reset => {
                "the board was reset or has lost power, or another program wrote its watchdog's time"
            }
            Self::BusDown => "the board does not answer any more",
            Self::OtherFirmware => "another board or another firmware answers than at the start",
        })
    }
}
