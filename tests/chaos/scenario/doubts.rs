//! Losses of positions, as the driver reports them, against the pins that show doubts.

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{BoardState, Driver, Positions};
use mesa_hal::hal::{InOut, Input, Output, Pins};

use super::super::network::Host;
use super::super::oracle::{Checked, Promise, ensure};
use super::Scenario;

/// Reads after the start, or after a set-up before their end, in which there is no position yet
/// that could be lost; and some more or less, since the driver counts its own.
const YOUNG: u32 = 100;
const ROUGH: u32 = 10;
/// Reads after which a generator that is on and armed since has used its position.
const USED_AFTER: u32 = 3;

/// The acts by which an application makes a position its own.
#[derive(Clone, Copy, Debug)]
enum Acts {
    /// An index of an encoder.
    Index(InOut<bool>),
    /// The `enable` and the `position-reset` of a step generator.
    Moves(Output<bool>, Output<bool>),
}

/// An encoder or a step generator.
#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
struct Counter {
    of: Positions,
    number: u32,
    unsure: Input<bool>,
    acts: Acts,
    was_unsure: bool,
    /// The loss has been reported, and the board was not set up again since.
    is_told: bool,
    /// An index, or a reset of the position, was requested since the last good read.
    was_asked: bool,
    /// Its position may have been used.
    is_used: bool,
    /// Looks for which it has been enabled and armed.
    on_for: u32,
    /// Least and greatest number of reads by the count of the driver.
    reads: [u32; 2],
}

/// The counters of a driver.
#[derive(Clone, Debug, Default)]
pub(super) struct Doubts {
    counters: Vec<Counter>,
    /// The board has lost its set-up since the last look.
    is_set_up: bool,
    /// The driver has read the board by itself since then.
    was_read: bool,
}

impl Counter {
    fn new(pins: &Pins, of: Positions, name: &str) -> Option<Self> {
        let (stem, _) = name.rsplit_once('.')?;
        let (_, number) = stem.rsplit_once('.')?;
        let acts = match of {
            Positions::Encoders => Acts::Index(pins.inout(&format!("{stem}.index-enable")).ok()?),
            _ => Acts::Moves(
                pins.output(&format!("{stem}.enable")).ok()?,
                pins.output(&format!("{stem}.position-reset")).ok()?,
            ),
        };
        Some(Self {
            of,
            number: number.parse().ok()?,
            unsure: pins.input(name).ok()?,
            acts,
            was_unsure: false,
            is_told: false,
            was_asked: false,
            is_used: false,
            on_for: 0,
            reads: [0; 2],
        })
    }

    /// Takes what the application asks for in this cycle.
    fn asks(&mut self, pins: &Pins, is_armed: bool) {
        let is_asked = match self.acts {
            Acts::Index(enable) => pins.read(enable).value,
            Acts::Moves(_, reset) => pins.commanded(reset),
        };
        let is_on = matches!(self.acts, Acts::Moves(enable, _) if pins.commanded(enable));
        // Until the next good read.
        self.was_asked |= is_asked;
        self.is_used |= is_on || is_asked;
        self.on_for = if is_on && is_armed {
            self.on_for + 1
        } else {
            0
        };
    }

    /// True if its position may have become known by what the application asked for.
    fn is_settled(&self, pins: &Pins) -> bool {
        self.was_asked && !matches!(self.acts, Acts::Index(enable) if pins.read(enable).value)
    }

    /// Takes a good read, and whether it has reported a loss.
    fn look(&mut self, pins: &Pins, tells: bool, is_set_up: bool) -> Result<(), &'static str> {
        if is_set_up {
            let [least, most] = &mut self.reads;
            *least = if *least < YOUNG + ROUGH { 0 } else { *least };
            *most = if *most < YOUNG - ROUGH { 0 } else { *most };
        }
        let is_settled = self.is_settled(pins);
        self.was_asked = false;
        let was_told = self.is_told && !is_settled;
        let is_unsure = pins.read(self.unsure).value;
        let [least, most] = self.reads;
        let is_old = least >= YOUNG + ROUGH || self.on_for > USED_AFTER;
        let is_lost = is_unsure && (!self.was_unsure || is_set_up && was_told);
        let may_be_lost = most >= YOUNG - ROUGH || self.is_used;
        self.is_told = is_unsure && (tells || was_told && !is_set_up);
        self.was_unsure = is_unsure;
        self.reads = self.reads.map(|reads| reads.saturating_add(1));
        match tells {
            false if is_lost && is_old => Err("is lost, and nothing reports it"),
            true if !is_unsure => Err("is reported as unsure, and is not"),
            true if was_told && !is_set_up => Err("is reported as unsure again"),
            true if !may_be_lost => Err("is reported as unsure, and there was none yet"),
            _ => Ok(()),
        }
    }

    /// True if one of these reports is about it.
    fn is_among(&self, told: &[(Positions, u32, u32)]) -> bool {
        told.iter().any(|(of, first, mask)| {
            let bit = self.number.checked_sub(*first);
            *of == self.of && bit.is_some_and(|bit| bit < 32 && mask >> bit & 1 != 0)
        })
    }

    /// Takes what it shows after reads that nobody has looked at.
    fn begin_anew(&mut self, pins: &Pins) {
        self.was_unsure = pins.read(self.unsure).value;
        self.is_told = false;
        self.reads[1] = u32::MAX;
    }
}

impl Doubts {
    /// A new driver reports from here on.
    pub(super) fn begin<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) {
        let pins = driver.pins();
        let counter = |name: &str| match name {
            name if name.ends_with(".count-unsure") => {
                Counter::new(pins, Positions::Encoders, name)
            }
            name if name.ends_with(".position-unsure") => {
                Counter::new(pins, Positions::StepGenerators, name)
            }
            _ => None,
        };
        *self = Self {
            counters: pins
                .infos()
                .iter()
                .filter_map(|info| counter(&info.name))
                .collect(),
            ..Self::default()
        };
    }

    /// Takes what the application asks for in this cycle.
    pub(super) fn asks<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) {
        let pins = driver.pins();
        let own = pins.group_state(driver.group());
        let is_armed = own.is_some_and(|own| own.armed);
        let is_armed = is_armed && driver.board_state() == BoardState::Running;
        let counters = self.counters.iter_mut();
        counters.for_each(|counter| counter.asks(pins, is_armed));
    }

    /// The driver has read the board by itself.
    pub(super) fn was_read(&mut self) {
        self.was_read = true;
    }
}

impl Scenario {
    /// After a read: `good` if it succeeded. Each loss of a position is reported with the read that
    /// shows it, once, and again after each set-up.
    pub(super) fn losses_are_told<B: Host>(&mut self, driver: &Driver<B>, good: bool) -> Checked {
        let now = self.sim.now();
        let (pins, doubts) = (driver.pins(), &mut self.doubts);
        self.what_is_told.hear();
        if driver.board_state() != BoardState::Running {
            doubts.is_set_up = true;
            return Ok(());
        }
        if !good {
            return Ok(());
        }
        let told = std::mem::take(&mut self.what_is_told.unsure);
        let mut counters = std::mem::take(&mut doubts.counters);
        let checked = counters.iter_mut().try_for_each(|counter| {
            if doubts.was_read {
                counter.begin_anew(pins);
                return Ok(());
            }
            let tells = counter.is_among(&told);
            let looked = counter.look(pins, tells, doubts.is_set_up);
            ensure(looked.is_ok(), Promise::Told, now, || {
                let what = looked.err().unwrap_or_default();
                format!(
                    "the position of {} {:02} {what}: {told:x?}",
                    counter.of, counter.number
                )
            })
        });
        doubts.counters = counters;
        (doubts.is_set_up, doubts.was_read) = (false, false);
        checked
    }
}
