//! Properties that were added after [`Extras`](super::Extras), again from a random stream of their
//! own, so that all earlier plans stay unchanged.

use super::extras::FASTEST;
use super::{Board, FaultKind, MILLI, Pace, Plan, Stranger, scrambled};
use crate::common::chance::Chance;

/// Further actions of an application, and further properties of its machine.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
pub struct More {
    /// The second half of its cycles is run by a `Runner`.
    pub runs: bool,
    /// Clears the safe state by pin before it re-arms.
    pub clears: bool,
    /// Changes limits, scales and the drive of the isolated outputs, and enables drives one by one,
    /// in one of this number of cycles; 0: never.
    pub tunes_one_in: u64,
    /// Switches a port off or on in one of this number of cycles; 0: never.
    pub switches_one_in: u64,
    /// Proves the watchdogs of its remotes in one of this number of cycles; 0: never.
    pub proves_one_in: u64,
    /// Place of a host's stop within an exchange: true before the board receives it, false before
    /// the host has the reply.
    pub stalls_before: bool,
    /// The host stops in a write as well, and not between two exchanges.
    pub stalls_in_write: bool,
    /// A single late reply is followed by another one some cycles later.
    pub is_late_again: bool,
    /// From the middle on each read is late by up to this number of hundredths of a period: the
    /// DPLL, which follows the reads, loses its lock.
    pub jitter: u64,
    /// A timer of the DPLL latches the encoders.
    pub is_latched: bool,
    /// The other program writes in every cycle, for longer than its detection takes.
    pub master_stays: bool,
}

/// Number of undisturbed periods after which the DPLL is locked.
pub const LOCKED_AFTER: u64 = 260;

impl More {
    pub const NOTHING: Self = Self {
        runs: false,
        clears: false,
        tunes_one_in: 0,
        switches_one_in: 0,
        proves_one_in: 0,
        stalls_before: false,
        stalls_in_write: false,
        is_late_again: false,
        jitter: 0,
        is_latched: false,
        master_stays: false,
    };

    fn new(chance: &mut Chance) -> Self {
        Self {
            runs: chance.one_in(6),
            clears: chance.one_in(3),
            tunes_one_in: chance.of(&[0, 3, 15]),
            switches_one_in: chance.of(&[0, 0, 0, 0, 25]),
            proves_one_in: chance.of(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 60]),
            stalls_before: chance.one_in(2),
            stalls_in_write: chance.one_in(2),
            is_late_again: chance.one_in(2),
            jitter: chance.of(&[0, 0, 0, 0, 0, 0, 0, 30]),
            is_latched: chance.one_in(4),
            master_stays: chance.one_in(3),
        }
    }
}

impl Plan {
    /// Applies the further properties to the plan.
    pub(super) fn with_more(mut self) -> Self {
        let mut chance = Chance(scrambled(self.seed ^ 0x30_4E));
        let more = More::new(&mut chance);
        let without_watchdog = chance.one_in(16);
        if self.is_minute || self.is_homing {
            return self;
        }
        self.more = more;
        // Between the last look at a card and its start, it cannot be distinguished from another
        // one of its kind.
        for fault in &mut self.faults {
            if fault.in_build && fault.kind == FaultKind::WireSwapped {
                fault.kind = FaultKind::WireUnplugged;
            }
        }
        if without_watchdog {
            self.extras.remote_watchdog = 0;
        }
        if self.extras.is_fast && self.board == Board::I7i92 && chance.one_in(2) {
            self.speed *= self.fastest() / FASTEST;
        }
        // At the board's pace, the DPLL follows no reads.
        let can_lock = self.pace == Pace::Host && self.has_dpll() && !self.extras.is_fast;
        if !can_lock {
            self.more.jitter = 0;
        }
        self.more.is_latched &= self.has_dpll() && !self.extras.is_fast;
        // The sampling time of data delayed by a disturbed network is unknown.
        self.more.is_latched &= self.spares_the_board();
        // A runner reads by itself.
        self.more.runs &= self.spares_the_board();
        self.more.runs &= self.more.jitter == 0 && self.extras.stranger == Stranger::None;
        if self.more.jitter > 0 {
            // Locked once, and then long enough to be seen without the lock.
            self.run = self.run.max(2 * (LOCKED_AFTER + 60) * self.period);
        }
        self.more.master_stays &= self.extras.second_master;
        if self.more.master_stays {
            self.run = self.run.max(1_300 * MILLI);
        }
        self
    }

    /// The greatest count rate of its encoders, with the short filter: that of a 7I92 samples twice
    /// as often, and the one beside a 7I76 is not multiplexed.
    pub fn fastest(&self) -> f64 {
        match self.board {
            Board::I7i92 if self.steppers.is_7i76 => 4.0 * FASTEST,
            Board::I7i92 => 2.0 * FASTEST,
            Board::I7i97 => FASTEST,
        }
    }

    /// True if the host is late or stops.
    pub fn host_stands_still(&self) -> bool {
        let mut faults = self.faults.iter();
        faults.any(|fault| matches!(fault.kind, FaultKind::HostLate | FaultKind::HostStall))
    }

    /// True if requests or replies are lost, or replies come too late.
    pub fn loses_replies(&self) -> bool {
        use FaultKind as Kind;
        let mut faults = self.faults.iter();
        faults.any(|fault| {
            matches!(
                fault.kind,
                Kind::NetworkLostRequest
                    | Kind::NetworkLostReply
                    | Kind::NetworkLate
                    | Kind::NetworkDown
                    | Kind::BusNotExecuted
                    | Kind::BusNoReply
            )
        })
    }

    /// True if the firmware has a DPLL.
    pub fn has_dpll(&self) -> bool {
        let is_small = matches!(&self.ports[..], [only] if only.len() <= 3);
        self.board == Board::I7i97 || is_small
    }

    /// True if the application makes calls other than reading and writing during operation.
    pub fn has_deeds(&self) -> bool {
        let More {
            switches_one_in,
            proves_one_in,
            ..
        } = self.more;
        self.extras.deeds_one_in + switches_one_in + proves_one_in > 0
    }

    /// True if the host reads in each period, as far as the application can.
    pub fn spares_its_host(&self) -> bool {
        !self.has_deeds() && !self.extras.second_master && self.more.jitter == 0
    }

    /// True if its encoders share their pins.
    pub fn has_muxed(&self) -> bool {
        self.board == Board::I7i97 || !self.steppers.is_7i76
    }

    /// True if the board is reset or exchanged, or seems to be.
    pub fn may_be_reset(&self) -> bool {
        use FaultKind as Kind;
        let mut faults = self.faults.iter();
        let resets = |kind| {
            matches!(
                kind,
                Kind::FpgaReset | Kind::FpgaResetLong | Kind::HostStall
            )
        };
        faults.any(|fault| resets(fault.kind))
            || self.extras.stranger != Stranger::None
            || self.extras.second_master
            || self.has_deeds()
    }

    /// True if nothing happens to the board, to its host, or between the two.
    pub fn spares_the_board(&self) -> bool {
        use mesa_hal_sim::FaultPlace;
        let spares =
            |kind: FaultKind| matches!(kind.place(), FaultPlace::Wire | FaultPlace::Remote);
        self.faults.iter().all(|fault| spares(fault.kind))
            && !self.has_deeds()
            && !self.extras.second_master
    }

    /// True if the remotes' own watchdogs never bite: nothing switches their outputs off when they
    /// cannot be reached.
    pub fn is_without_watchdog(&self) -> bool {
        self.extras.remote_watchdog == 0
    }
}
