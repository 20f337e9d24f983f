//! Properties that were added after [`Steppers`](super::Steppers), again from a random stream of
//! their own.

use super::{
    Board, FaultKind, FaultPlace, MILLI, More, Plan, Planned, Stranger, WRITTEN_WATCHDOG, scrambled,
};
use crate::common::chance::Chance;

/// Cycles for which a board that has bitten is left alone.
const LEFT_ALONE: u64 = 250;
/// Time in which a remote gets a parameter, from a few milliseconds after the start of its port on.
const WRITES_IN: u64 = 25 * MILLI;

/// Further habits of an application.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
pub struct Later {
    /// Leaves a board that has bitten alone.
    pub leaves_bitten: bool,
    /// Re-arms what runs, and the rest as soon as it does.
    pub when_running: bool,
    /// Requests a parameter again, with another value, while the first one is written. The faults
    /// of wires come then.
    pub asks_twice: bool,
    /// Neither reads nor writes for a while before it stops the driver.
    pub idles_before_stop: bool,
    /// Gives one act for each fault, while it may still be present: re-arms what runs, and the rest
    /// as soon as it does.
    pub acts_early: bool,
    /// Looks at a board that waits to be re-armed before each read as well.
    pub follows: bool,
}

impl Later {
    pub const NOTHING: Self = Self {
        leaves_bitten: false,
        when_running: false,
        asks_twice: false,
        idles_before_stop: false,
        acts_early: false,
        follows: false,
    };
}

impl Plan {
    /// Applies these properties to the plan.
    pub(super) fn with_later(mut self) -> Self {
        let mut chance = Chance(scrambled(self.seed ^ 0x1A7E));
        let later = Later {
            leaves_bitten: chance.one_in(3),
            when_running: chance.one_in(3),
            asks_twice: chance.one_in(20),
            idles_before_stop: Chance(scrambled(self.seed ^ 0x1D_1E)).one_in(2),
            acts_early: Chance(scrambled(self.seed ^ 0xAC75)).one_in(10),
            follows: Chance(scrambled(self.seed ^ 0xF0_1105)).one_in(4),
        };
        if self.is_minute || self.is_homing {
            return self;
        }
        self.later = later;
        self.later.asks_twice &= self.extras.deeds_one_in == 0 && !self.more.runs;
        self.later.asks_twice &= self.extras.stranger == Stranger::None;
        if self.later.asks_twice {
            self.asks_for_parameters(&mut chance);
        }
        self.later.acts_early &= !self.later.asks_twice && self.extras.stranger == Stranger::None;
        if self.later.acts_early {
            self.acts_for_each_fault(&mut Chance(scrambled(self.seed ^ 0xAC7)));
        }
        let is_plain = self.board == Board::I7i92 && self.steppers.is_7i76;
        let is_other = self.later.asks_twice || self.later.acts_early;
        if is_plain && !is_other && Chance(scrambled(self.seed ^ 0xB17E)).one_in(2) {
            self.only_bites(&mut Chance(scrambled(self.seed ^ 0xB17)));
        }
        self.later.leaves_bitten &= self.bites_alone() && !self.later.acts_early;
        if self.later.leaves_bitten {
            self.habits.rearm_every = 0;
            self.habits.rearm_when_safe = 0;
            self.more.clears = false;
            self.run += LEFT_ALONE * self.period;
        }
        self
    }

    /// Switches its ports off and on again and again, with parameters to write, while the board is
    /// reset, or while the wires fail.
    fn asks_for_parameters(&mut self, chance: &mut Chance) {
        // A value that changes nothing else.
        self.extras.remote_watchdog = WRITTEN_WATCHDOG.into();
        self.extras.second_master = false;
        self.more.switches_one_in = 40;
        self.more.proves_one_in = 0;
        self.habits.rearm_when_safe = 2;
        self.run += 1_000 * self.period;
        let run = self.run;
        self.faults = Vec::new();
        let resets = chance.of(&[0, 1, 3]);
        for _ in 0..resets {
            self.faults.push(Planned {
                kind: FaultKind::FpgaReset,
                in_build: false,
                after: chance.below(run),
                lasts: MILLI,
                target: 0,
                dice: 0,
            });
        }
        // One in each round.
        for _ in 0..6 {
            self.faults.push(Planned {
                kind: chance.of(&[FaultKind::WireUnplugged, FaultKind::WireBreak]),
                in_build: false,
                after: 4 * MILLI + chance.below(WRITES_IN),
                // An access is given up after three attempts, 60 ms apart.
                lasts: MILLI * (180 + chance.below(220)),
                target: chance.below(self.remotes() as u64) as usize,
                dice: chance.below(1 << 31),
            });
        }
    }

    /// One fault after the other, each with an act while something waits, and no other act.
    fn acts_for_each_fault(&mut self, chance: &mut Chance) {
        self.extras.second_master = false;
        self.extras.deeds_one_in = 0;
        self.more = More {
            runs: false,
            clears: false,
            switches_one_in: 0,
            proves_one_in: 0,
            jitter: 0,
            master_stays: false,
            ..self.more
        };
        self.steppers.is_refused = false;
        self.habits.rearm_every = 0;
        self.habits.rearm_when_safe = 0;
        self.habits.restarts = false;
        self.later.when_running = true;
        let mut after = 10 * MILLI;
        self.faults = Vec::new();
        for _ in 0..3 {
            after += chance.below(20 * MILLI);
            let lasts = MILLI * (1 + chance.below(150));
            self.faults.push(Planned {
                kind: chance.of(&[
                    FaultKind::WireUnplugged,
                    FaultKind::WireLow,
                    FaultKind::RemotePowerOff,
                    FaultKind::RemotePowerGlitch,
                    FaultKind::RemoteLowVoltage,
                    FaultKind::RemoteOverTemperature,
                    FaultKind::FpgaWatchdog,
                    FaultKind::FpgaReset,
                    FaultKind::FpgaResetLong,
                    FaultKind::HostStall,
                ]),
                in_build: false,
                after,
                lasts,
                target: chance.below(self.remotes() as u64) as usize,
                dice: chance.below(1 << 31),
            });
            after += lasts + 600 * MILLI;
        }
        self.run = after;
    }

    /// Nothing but bites of a board whose encoder keeps its long filter, and with that a mode: it
    /// is sure.
    fn only_bites(&mut self, chance: &mut Chance) {
        self.extras.second_master = false;
        self.extras.stranger = Stranger::None;
        self.extras.deeds_one_in = 0;
        (self.more.switches_one_in, self.more.proves_one_in) = (0, 0);
        self.habits.settings_one_in = 0;
        // A request is written with the mode, which proves nothing then.
        self.habits.index_one_in = u64::MAX;
        self.run += 200 * MILLI;
        let run = self.run;
        let bite = |chance: &mut Chance| Planned {
            kind: FaultKind::FpgaWatchdog,
            in_build: false,
            after: 50 * MILLI + chance.below(run - 100 * MILLI),
            lasts: MILLI * (1 + chance.below(50)),
            target: 0,
            dice: chance.below(1 << 31),
        };
        self.faults = (0..2).map(|_| bite(chance)).collect();
    }

    /// True if a fault is a bite of the board's watchdog, and no packet is lost or doubtful.
    fn bites_alone(&self) -> bool {
        let mut faults = self.faults.iter();
        let bites = faults.any(|fault| {
            matches!(fault.kind, FaultKind::FpgaWatchdog | FaultKind::HostStall) && !fault.in_build
        });
        let is_bus = |place| matches!(place, FaultPlace::Network | FaultPlace::Bus);
        let is_sound = self.faults.iter().all(|fault| !is_bus(fault.kind.place()));
        let extras = &self.extras;
        bites
            && is_sound
            && !extras.second_master
            && extras.stranger == Stranger::None
            && !self.has_deeds()
    }
}
