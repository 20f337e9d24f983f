//! The contents of a scenario. Everything follows from its seed.

mod extras;
mod later;
mod more;
mod steppers;

pub use extras::{Extras, Stranger, WRITTEN_WATCHDOG};
pub use later::Later;
pub use more::{LOCKED_AFTER, More};
pub use steppers::Steppers;

use mesa_hal::boards::{i7i72, i7i77};
use mesa_hal::discovery::RemoteTable;
use mesa_hal::driver::Pace;
use mesa_hal_sim::{FaultKind, FaultPlace};

use crate::common::chance::Chance;

pub const MICRO: u64 = 1_000;
pub const MILLI: u64 = 1_000_000;
/// The longest time that an application sets for the board's watchdog.
pub const LONGEST_WATCHDOG: u64 = 20 * MILLI;

/// A card on a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Card {
    /// The field I/O of a 7I77.
    Field,
    /// The field I/O of a 7I76.
    Field76,
    /// The analog section of a 7I77.
    Analog,
    /// A 7I72.
    Outputs,
}

impl Card {
    /// The library's table of the card, if it has one.
    pub const fn table(self) -> Option<&'static RemoteTable> {
        match self {
            Self::Field => Some(&i7i77::FIELD),
            Self::Field76 => None,
            Self::Analog => Some(&i7i77::ANALOG),
            Self::Outputs => Some(&i7i72::REMOTE),
        }
    }

    /// Field I/O: 32 inputs and 16 outputs.
    pub const fn is_field(self) -> bool {
        matches!(self, Self::Field | Self::Field76)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    I7i92,
    I7i97,
}

/// Phase in the life of a machine in which an event occurs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Moment {
    /// Before the first packet to a remote.
    Start,
    /// While the remotes are found and started.
    Discovery,
    /// All is well.
    Running,
    /// An earlier event is not fully recovered from.
    Recovery,
}

impl Moment {
    pub const ALL: [Self; 4] = [Self::Start, Self::Discovery, Self::Running, Self::Recovery];
}

/// A fault to come.
#[derive(Clone, Copy, Debug)]
pub struct Planned {
    pub kind: FaultKind,
    /// While the driver is built, and not in the cycle.
    pub in_build: bool,
    /// Time after the beginning of the build or of the cycle.
    pub after: u64,
    pub lasts: u64,
    /// Number of the remote.
    pub target: usize,
    /// Determines the details.
    pub dice: u64,
}

/// Behaviour of the application.
#[derive(Clone, Copy, Debug)]
pub struct Habits {
    /// Re-arms at this interval of cycles, needed or not; 0: only when something is not armed.
    pub rearm_every: u64,
    /// When something is not armed, re-arms in one of this number of cycles; 0: not before the end.
    pub rearm_when_safe: u64,
    /// Leaves its outputs unchanged in one of this number of cycles.
    pub idle_one_in: u64,
    /// Changes a setting in one of this number of cycles; 0: never.
    pub settings_one_in: u64,
    /// Requests an index in one of this number of cycles.
    pub index_one_in: u64,
    /// Restarts offline remotes by itself at the end.
    pub restarts: bool,
    /// End of the process: 0 shutdown, 1 drop, otherwise killed.
    pub leaves: u64,
}

#[derive(Clone, Debug)]
pub struct Plan {
    pub seed: u64,
    pub board: Board,
    pub ports: Vec<Vec<Card>>,
    pub is_network: bool,
    pub pace: Pace,
    pub period: u64,
    pub watchdog: u64,
    pub faults: Vec<Planned>,
    pub habits: Habits,
    /// Time that the machine runs before all faults end.
    pub run: u64,
    /// Homes all the time, on a network that delays and duplicates by several periods.
    pub is_homing: bool,
    /// One remote is absent for a minute, and restart attempts are as rare as by default.
    pub is_minute: bool,
    /// Counts of the motors per second.
    pub speed: f64,
    /// The software mode of field I/O; after a loss of power it is 0.
    pub field_mode: u8,
    pub extras: Extras,
    pub more: More,
    pub steppers: Steppers,
    pub later: Later,
}

impl Plan {
    pub fn new(seed: u64) -> Self {
        let mut chance = Chance(scrambled(seed));
        let board = chance.of(&[Board::I7i92, Board::I7i97]);
        let ports = ports(&mut chance, board);
        let remotes: usize = ports.iter().map(Vec::len).sum();
        let is_network = chance.one_in(2);
        let is_paced = is_network && board == Board::I7i97 && chance.one_in(2);
        let period = if remotes > 8 {
            chance.of(&[1_000, 2_000])
        } else {
            chance.of(&[500, 1_000, 1_000, 2_000])
        } * MICRO;
        let run = MILLI * (60 + chance.below(if remotes > 8 { 60 } else { 140 }));
        let faults = faults(&mut chance, (is_network, is_paced), remotes, run);
        let mut plan = Self {
            seed,
            board,
            ports,
            is_network,
            pace: if is_paced { Pace::Board } else { Pace::Host },
            period,
            watchdog: if period > MILLI {
                chance.of(&[10, 20])
            } else {
                chance.of(&[5, 8, 20])
            } * MILLI,
            faults,
            habits: Habits {
                rearm_every: chance.of(&[0, 0, 0, 15]),
                rearm_when_safe: chance.of(&[0, 2, 10, 40]),
                idle_one_in: chance.of(&[2, 5, 20]),
                settings_one_in: chance.of(&[0, 3, 10, 30]),
                index_one_in: 1 + chance.below(40),
                restarts: chance.one_in(2),
                leaves: chance.below(4),
            },
            run,
            speed: chance.of(&[0.0, 20_000.0, -50_000.0, 120_000.0]),
            field_mode: chance.of(&[0, 2]),
            is_homing: false,
            is_minute: false,
            extras: Extras::new(&mut Chance(0)),
            more: More::NOTHING,
            steppers: Steppers::NONE,
            later: Later::NOTHING,
        };
        if seed % MINUTE_EVERY == MINUTE_SEED {
            plan.absent_for_a_minute();
        }
        if plan.is_network && !plan.is_minute && chance.one_in(10) {
            plan.homes(&mut chance);
        }
        plan.with_extras().with_more().with_steppers().with_later()
    }

    /// Homing on a network that delays and duplicates, while settings are written all the time.
    fn homes(&mut self, chance: &mut Chance) {
        self.is_homing = true;
        self.pace = Pace::Host;
        self.speed = chance.of(&[20_000.0, -20_000.0, 50_000.0]);
        self.habits = Habits {
            settings_one_in: 2,
            index_one_in: 2,
            ..self.habits
        };
        let lasts = self.run;
        // Mostly when no packet of the set-up is in flight any more: counts are uncertain before.
        let later = chance.of(&[0, 110, 110, 110]) * self.period;
        self.run += later;
        self.faults = vec![Planned {
            kind: chance.of(&[FaultKind::NetworkLate, FaultKind::NetworkDuplicate]),
            in_build: false,
            after: 10 * MILLI + later,
            lasts,
            target: 0,
            dice: 2,
        }];
    }

    fn absent_for_a_minute(&mut self) {
        let target = self.faults.first().map_or(0, |fault| fault.target % 3);
        *self = Self {
            ports: vec![vec![Card::Field, Card::Analog, Card::Outputs]],
            period: MILLI,
            faults: vec![Planned {
                kind: FaultKind::WireUnplugged,
                in_build: false,
                after: 100 * MILLI,
                lasts: 60_000 * MILLI,
                target,
                dice: 0,
            }],
            habits: Habits {
                settings_one_in: 0,
                restarts: true,
                ..self.habits
            },
            run: 60_100 * MILLI,
            is_minute: true,
            ..self.clone()
        };
    }

    pub fn remotes(&self) -> usize {
        self.ports.iter().map(Vec::len).sum()
    }

    /// The remote of all faults, if they are faults of one remote or its wire, and neither the
    /// application nor another program disturbs the others.
    pub fn victim(&self) -> Option<usize> {
        let of_remotes =
            |fault: &Planned| matches!(fault.kind.place(), FaultPlace::Wire | FaultPlace::Remote);
        let [first, ..] = &self.faults[..] else {
            return None;
        };
        if self.has_deeds() || self.extras.second_master {
            return None;
        }
        let alike = |fault: &Planned| fault.target == first.target && !fault.in_build;
        let all = self
            .faults
            .iter()
            .all(|fault| of_remotes(fault) && alike(fault));
        all.then_some(first.target)
    }

    /// Some bytes on a wire are lost or wrong, so that a START takes longer.
    pub fn has_bad_wire(&self) -> bool {
        let is_bad = |fault: &Planned| fault.kind.place() == FaultPlace::Wire;
        self.faults.iter().any(is_bad)
    }

    /// Port and channel of a remote by its number.
    pub fn place(&self, remote: usize) -> (usize, usize) {
        let mut left = remote;
        for (port, cards) in self.ports.iter().enumerate() {
            if left < cards.len() {
                return (port, left);
            }
            left -= cards.len();
        }
        (0, 0)
    }

    pub fn card(&self, remote: usize) -> Card {
        let (port, channel) = self.place(remote);
        self.ports[port][channel]
    }

    /// Longest delay between sending and executing a write.
    pub fn lateness(&self) -> u64 {
        let periods = match (self.is_network, self.is_homing) {
            (true, true) => 4,
            (true, false) => 2,
            (false, _) => 0,
        };
        periods * self.period
    }
}

/// A minute is long: one in this number of scenarios.
const MINUTE_EVERY: u64 = 1_000;
const MINUTE_SEED: u64 = 77;

/// Makes unrelated plans of consecutive seeds.
pub fn scrambled(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Mostly a few remotes on one port, as on real machines; sometimes many on several.
fn ports(chance: &mut Chance, board: Board) -> Vec<Vec<Card>> {
    const MACHINE: [Card; 3] = [Card::Field, Card::Analog, Card::Outputs];
    const MIX: [Card; 4] = [Card::Field, Card::Outputs, Card::Analog, Card::Outputs];
    let mixed = |count: u64| (0..count as usize).map(|n| MIX[n % 4]).collect::<Vec<_>>();
    match chance.below(40) {
        0 => vec![mixed(8), mixed(8), mixed(8), mixed(8)],
        1..4 => (0..2 + chance.below(2))
            .map(|_| mixed(1 + chance.below(4)))
            .collect(),
        4 if board == Board::I7i97 => vec![mixed(4 + chance.below(5))],
        _ => vec![MACHINE[..=chance.below(3) as usize].to_vec()],
    }
}

fn faults(
    chance: &mut Chance,
    (is_network, is_paced): (bool, bool),
    remotes: usize,
    run: u64,
) -> Vec<Planned> {
    let possible: Vec<FaultKind> = FaultKind::ALL
        .iter()
        .copied()
        .filter(|kind| match kind.place() {
            FaultPlace::Network => is_network,
            FaultPlace::Bus => !is_network,
            _ => true,
        })
        .collect();
    let count = chance.of(&[1, 1, 1, 2, 2, 3]);
    let target = chance.below(remotes as u64) as usize;
    let mut faults: Vec<Planned> = Vec::new();
    for n in 0..count {
        let kind = chance.of(&possible);
        let in_build = n == 0 && kind.place() != FaultPlace::Host && chance.one_in(4);
        let lasts = match chance.below(4) {
            0 => MICRO * (1 + chance.below(2_000)),
            1 => MILLI * (1 + chance.below(60)),
            2 => MILLI * (1 + chance.below(15)),
            _ => MILLI * 40 + chance.below(run / 2),
        };
        let after = match (in_build, faults.last()) {
            // A start takes no time, and finding all remotes some: more on a network.
            (true, _) => {
                let most = if is_network { 100 } else { 20 };
                chance.of(&[300 * MICRO, 3 * MILLI, most * MILLI])
            }
            // While the previous fault is still present, or has just ended.
            (false, Some(before)) if !before.in_build && chance.one_in(2) => {
                let from = before.after + if chance.one_in(2) { before.lasts } else { 0 };
                return_within(from, run) + MILLI * 30
            }
            _ => 10 * MILLI + chance.below(run / 2),
        };
        faults.push(Planned {
            kind,
            in_build,
            after: if in_build {
                chance.below(after)
            } else {
                after - chance.below(10 * MILLI)
            },
            lasts,
            target: if chance.one_in(2) {
                target
            } else {
                chance.below(remotes as u64) as usize
            },
            dice: chance.below(1 << 31) | u64::from(is_paced) << 32,
        });
    }
    faults
}

fn return_within(from: u64, run: u64) -> u64 {
    from.min(run)
}
