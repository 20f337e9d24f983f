//! The message that the DPLL of a board cannot follow the thread.

use core::fmt;
use core::time::Duration;

use mesa_hal::Rounded;
use mesa_hal::hal::{PinId, Pins, Value};

use crate::ffi::Level;
use crate::table::Memory;

/// The DPLL of a board, and the pins that let it latch positions.
#[derive(Debug, Default)]
pub(crate) struct Dpll {
    /// The pin of its frequency, which follows the period.
    frequency: Option<PinId>,
    /// The pins `timer-number`: their numbers in HAL, and their names without the board's.
    timers: Vec<(usize, String)>,
    /// The period that it cannot follow.
    left_alone: Option<Duration>,
    /// The level of the message so far.
    said: Option<Level>,
}

impl Dpll {
    /// The DPLL of a board with this name. HAL's numbers are the positions of the driver's pins.
    pub fn new(board: &str, pins: &Pins) -> Self {
        let own = |name: &str| {
            name.strip_prefix(board)?
                .strip_prefix('.')
                .map(str::to_owned)
        };
        let timers = pins.infos().iter().enumerate();
        let timers = timers.filter(|(_, info)| info.name.ends_with(".timer-number"));
        Self {
            frequency: pins.find(&format!("{board}.dpll.base-freq-khz")),
            timers: timers
                .filter_map(|(number, info)| Some((number, own(&info.name)?)))
                .collect(),
            ..Self::default()
        }
    }

    /// The pin of its frequency.
    pub const fn frequency(&self) -> Option<PinId> {
        self.frequency
    }

    /// The driver has this period. Its pin still asks for that of the period if the DPLL cannot
    /// follow.
    pub fn begin(&mut self, period: Duration, pins: &Pins) {
        let khz = self.frequency.map(|id| f64::from_bits(pins.bits_of(id)));
        self.left_alone = khz.is_some_and(|khz| khz < 0.0).then_some(period);
    }

    /// A message that has not been said: that the DPLL does not follow, and, as soon as a timer is
    /// set, that this has not the effect that was asked for.
    ///
    /// # Real time
    /// A step for each kind of counter. No allocation.
    pub fn news(&mut self, memory: &impl Memory) -> Option<(Level, Unfollowed<'_>)> {
        let period = self.left_alone?;
        if self.said == Some(Level::Error) {
            return None;
        }
        let mut timers = self.timers.iter();
        let set = timers.find_map(|(number, name)| {
            let timer = i32::from_bits(memory.load(*number));
            (timer >= 0).then_some((&**name, timer))
        });
        let level = if set.is_some() {
            Level::Error
        } else {
            Level::Note
        };
        (self.said.replace(level) != Some(level)).then_some((level, Unfollowed { period, set }))
    }
}

/// A period that the DPLL cannot follow, and a timer that is set.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unfollowed<'a> {
    period: Duration,
    set: Option<(&'a str, i32)>,
}

impl fmt::Display for Unfollowed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let period = Rounded(&self.period);
        write!(
            f,
            "the DPLL cannot follow a thread of {period}, and stays at 1 kHz"
        )?;
        match self.set {
            Some((name, timer)) => write!(
                f,
                ": {name} = {timer} latches positions up to 1 ms before they are read; set it to -1, or choose a \
                 faster thread"
            ),
            None => f.write_str("; no timer-number is set, so nothing depends on it"),
        }
    }
}
