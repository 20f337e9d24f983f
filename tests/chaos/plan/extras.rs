//! Further properties of a machine and its application, from a random stream of their own:
//! additions here leave the rest of every plan unchanged.

use super::{Board, FaultKind, MILLI, Plan, Planned, scrambled};
use crate::common::chance::Chance;

/// Settings other than the defaults, and more.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
pub struct Extras {
    /// Number of consecutive failures that make everything safe.
    pub bus_error_limit: u32,
    /// Number of cycles without new data after which inputs are not valid.
    pub stale_after: u32,
    /// Motors, each with an encoder of its own.
    pub axes: usize,
    /// Counts from index to index.
    pub turn: u32,
    /// The motors go from mark to mark near the greatest count rate; the filter of an encoder is
    /// never changed, since that would change the rate.
    pub is_fast: bool,
    /// Outputs are commanded through a queue, with more commands than a cycle takes.
    pub is_queued: bool,
    /// Makes calls other than reading and writing in one of this number of cycles; 0: never.
    pub deeds_one_in: u64,
    /// Requests each read ahead.
    pub reads_ahead: bool,
    /// Expected presence of remotes: 0 anything, 1 may be absent, 2 present.
    pub presence: u8,
    /// Milliseconds of the remotes' own watchdogs.
    pub remote_watchdog: u64,
    /// PWM generators of a 7I97 dither.
    pub dithers: bool,
    /// Parts per million by which the board's clock is faster than its firmware reports.
    pub ppm: i64,
    /// Another program occasionally writes to the board.
    pub second_master: bool,
    /// Values that are not numbers are occasionally set.
    pub sets_nan: bool,
    /// Another board or firmware answers after the first fault, until all faults end.
    pub stranger: Stranger,
}

/// Replacement for the original board after a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stranger {
    None,
    /// Another firmware on the same board.
    Firmware,
    /// Another board with the same firmware.
    Board,
}

/// Milliseconds that the application writes to a remote's watchdog during operation.
pub const WRITTEN_WATCHDOG: u32 = 50;

/// The greatest count rate of multiplexed encoders with the short filter, at 100 MHz and 14 clocks
/// for each sample: clock / (3 (14 + 2)).
pub const FASTEST: f64 = 100e6 / 48.0;

impl Extras {
    pub fn new(chance: &mut Chance) -> Self {
        Self {
            bus_error_limit: chance.of(&[5, 5, 5, 1, 50]),
            stale_after: chance.of(&[5, 5, 5, 2, 20]),
            axes: chance.of(&[1, 1, 2, 6]),
            turn: chance.of(&[400, 400, 4_000, 65_536, 100_000]),
            is_fast: false,
            is_queued: chance.one_in(4),
            deeds_one_in: chance.of(&[0, 0, 0, 0, 0, 40]),
            reads_ahead: chance.one_in(8),
            presence: chance.of(&[0, 0, 1, 2]),
            remote_watchdog: chance.of(&[50, 50, 50, 20, 100]),
            dithers: chance.one_in(3),
            ppm: chance.of(&[0, 0, 200, -200]),
            second_master: chance.one_in(10),
            sets_nan: chance.one_in(4),
            stranger: Stranger::None,
        }
    }
}

impl Plan {
    /// Applies the extras to the plan.
    pub(super) fn with_extras(mut self) -> Self {
        let mut chance = Chance(scrambled(self.seed ^ 0xE87A5));
        self.extras = Extras::new(&mut chance);
        if self.extras.remote_watchdog < 50 && (self.period > MILLI || self.has_bad_wire()) {
            // In a slow cycle, and on a bad wire, that is shorter than the trial start of a
            // neighbour (docs/neighbours.md).
            self.extras.remote_watchdog = 50;
        }
        self.extras.second_master &= self.is_network && !self.is_homing && !self.is_minute;
        if chance.one_in(3) {
            self.field_mode = chance.of(&[1, 3]);
        }
        if self.is_minute || self.is_homing {
            self.extras = Extras {
                turn: 400,
                is_queued: false,
                deeds_one_in: 0,
                ..self.extras
            };
            return self;
        }
        let is_one_exchange = !self.is_network && self.board == Board::I7i97;
        match chance.below(25) {
            0 => self.goes_far(&mut chance),
            1 => self.becomes_another(&mut chance),
            2..6 if is_one_exchange => self.starts_with_a_reset(&mut chance),
            _ => {}
        }
        self
    }

    /// From mark to mark, which are so far apart that the counter of the board wraps around between
    /// them, while settings are written and indexes of other axes are requested.
    fn goes_far(&mut self, chance: &mut Chance) {
        let speed = FASTEST * chance.of(&[0.6, 0.8, 0.88]);
        let turn = chance.of(&[131_072, 200_000, 300_000, 1_000_000]);
        self.speed = if chance.one_in(2) { speed } else { -speed };
        self.extras = Extras {
            turn,
            is_fast: true,
            axes: if turn == 1_000_000 {
                1
            } else {
                chance.of(&[1, 3, 6])
            },
            ..self.extras
        };
        self.habits.index_one_in = 2;
        self.habits.settings_one_in = chance.of(&[0, 2, 2]);
        // The slowest axis reaches its second mark.
        let second = f64::from(turn) / (speed * self.extras.slowest()) * 1e9;
        self.run = self.run.max(second as u64 + 80 * MILLI);
    }

    /// The FPGA is reset in the middle of the first set-up.
    fn starts_with_a_reset(&mut self, chance: &mut Chance) {
        self.faults = vec![Planned {
            kind: chance.of(&[
                FaultKind::FpgaReset,
                FaultKind::FpgaReset,
                FaultKind::FpgaResetLong,
            ]),
            in_build: true,
            after: chance.below(400_000),
            lasts: chance.below(100_000),
            target: 0,
            dice: 0,
        }];
    }

    /// Another firmware, or another board, is present after a while without power.
    fn becomes_another(&mut self, chance: &mut Chance) {
        self.extras.stranger = if self.is_network {
            chance.of(&[Stranger::Firmware, Stranger::Board])
        } else {
            Stranger::Firmware
        };
        self.faults = vec![Planned {
            kind: if self.is_network {
                FaultKind::NetworkDown
            } else {
                FaultKind::FpgaResetLong
            },
            in_build: false,
            after: 10 * MILLI + chance.below(self.run / 2),
            lasts: chance.of(&[1, 10, 40]) * MILLI,
            target: 0,
            dice: 0,
        }];
    }

    /// The speed of a motor in counts per second.
    pub fn speed(&self, axis: usize) -> f64 {
        let part = if self.extras.is_fast {
            PARTS_FAST
        } else {
            PARTS
        };
        self.speed * part[axis % part.len()]
    }

    /// Position of a motor at power-up. The mark at 0 is a few tens of milliseconds away when all
    /// motors are fast.
    pub fn begins_at(&self, axis: usize) -> f64 {
        if self.extras.is_fast {
            -0.04 * self.speed(axis) - (17 * axis) as f64
        } else {
            (17 * axis) as f64
        }
    }
}

/// The speeds of the axes, as parts of that of the first.
const PARTS: [f64; 6] = [1.0, -0.7, 0.4, 0.0, -1.0, 0.1];
const PARTS_FAST: [f64; 6] = [1.0, -1.0, 0.8, -0.9, 0.7, 1.0];

impl Extras {
    /// The speed of the slowest axis, as a part of that of the first.
    fn slowest(&self) -> f64 {
        let parts = PARTS_FAST.iter().take(self.axes);
        parts.map(|part| part.abs()).fold(1.0, f64::min)
    }
}
