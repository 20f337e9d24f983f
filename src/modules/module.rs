//! A module in the cycle, and what it gets in each step.

use core::any::Any;
use core::fmt;
use core::time::Duration;

use super::RegisterError;
use crate::bus::{Instant, Words};
use crate::events::{CycleReport, EventKind, EventSink};
use crate::hal::{AnyValue, Handle, Output, PinId, PinStore, Pins, Value};
use crate::hostmot2::Gtag;

/// A part of the board in the cycle.
///
/// # Real time
/// Every function is called at most once in a cycle, and must not allocate, wait or panic: a module
/// is a state machine that does one step for each call.
pub trait Module: Any + fmt::Debug + Send {
    /// Takes the inputs from a valid read.
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let _ = cycle;
    }

    /// Handles a failed read: there are no new inputs.
    fn not_read(&mut self, pins: &mut PinStore) {
        let _ = pins;
    }

    /// Puts the outputs.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        let _ = cycle;
    }

    /// Called at `now`, after the write; `arrived` is false if the write failed or was omitted.
    fn written(&mut self, now: Instant, arrived: bool) {
        let _ = (now, arrived);
    }

    /// Handles a fault that made everything safe. The outputs of the board's own group are safe
    /// already.
    fn make_safe(&mut self, pins: &mut PinStore) {
        let _ = pins;
    }

    /// Called before the first write when the application has changed the period of the cycle from
    /// that of [`Registrar::settings`](super::Registrar::settings):
    /// [`Driver::set_period`](crate::Driver::set_period).
    ///
    /// # Errors
    /// The module cannot work with this period; it is then called again with the period of before.
    fn set_period(&mut self, period: Duration, pins: &mut PinStore) -> Result<(), RegisterError> {
        let _ = (period, pins);
        Ok(())
    }

    /// Called instead of [`read`](Self::read) with each good read of a board that is not set up any
    /// more: nothing is published, but counters and accumulators that ran on can be followed.
    fn run_on(&mut self, cycle: &RunOnCycle<'_>) {
        let _ = cycle;
    }

    /// Shows what the registers of a board say that another program drives:
    /// [`Board::listen`](crate::Board::listen). Only what is true whatever that program has set:
    /// levels and states, but no count since a start, and nothing that a parameter scales.
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        let _ = cycle;
    }

    /// Called when the board has lost its set-up and got it back: counters may contain any value.
    fn restored(&mut self, pins: &mut PinStore, now: Instant) {
        let _ = (pins, now);
    }

    /// Called when the board has its set-up back, with what had happened to it. A module that does
    /// not tell faults apart implements [`restored`](Self::restored), which this calls.
    fn set_up_again(&mut self, pins: &mut PinStore, now: Instant, outage: &Outage) {
        let _ = outage;
        self.restored(pins, now);
    }
}

/// What has happened to a board from the fault that ended its set-up to the next set-up.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Outage {
    /// The board was reset or lost its power, or seems to have been: its registers may contain any
    /// value.
    pub was_reset: bool,
    /// The watchdog has bitten, the board was reset, or a set-up has failed: for some time its
    /// pins were inputs. A reset before a late packet can look like a bite.
    pub has_released: bool,
    /// Another board, or another firmware, has answered meanwhile.
    pub was_replaced: bool,
    /// The last write before the bite, as far as it is known.
    pub(crate) last_feed: Option<LastFeed>,
    /// The last read has shown a bite: a board that was reset, and then got a late packet of a
    /// set-up, does not show one.
    pub(crate) shows_bite: bool,
}

impl Outage {
    /// True if the board has kept its set-up: only the bus was down. The set-up is then written
    /// again without letting go of a pin.
    pub const fn has_kept_set_up(&self) -> bool {
        !self.was_reset && !self.has_released && !self.was_replaced
    }
}

/// Input of [`Module::run_on`].
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct RunOnCycle<'a> {
    /// The words that were read.
    pub words: &'a Words,
    /// Time of the request: see [`ReadCycle::asked`].
    pub asked: Instant,
    /// Time at which the registers were read.
    pub now: Instant,
    /// What has happened to the board up to now.
    pub outage: &'a Outage,
}

/// Input of [`Module::listen`].
#[derive(Debug)]
pub struct ListenCycle<'a> {
    /// The words that were read.
    pub words: &'a Words,
    /// Time at which the registers were read.
    pub now: Instant,
    pub(crate) pins: &'a Pins,
    /// By the index of the pin.
    pub(crate) shown: &'a mut [Option<AnyValue>],
}

impl ListenCycle<'_> {
    /// Shows the value of a pin. One of another board changes nothing.
    pub fn show<K: Copy, T: Value>(&mut self, pin: Handle<K, T>, value: T)
    where
        AnyValue: From<T>,
    {
        let pin = PinId::from(pin);
        let is_ours = self.pins.info_of(pin).is_some();
        if let Some(shown) = self.shown.get_mut(pin.index()).filter(|_| is_ours) {
            *shown = Some(value.into());
        }
    }
}

/// Input of [`Module::read`].
#[derive(Debug)]
#[non_exhaustive]
pub struct ReadCycle<'a> {
    /// The words that were read.
    pub words: &'a Words,
    /// The store that takes the inputs.
    pub pins: &'a mut PinStore,
    /// Time of the request: the registers were not read before. A host that is suspended between
    /// the read and [`now`](Self::now) has old values.
    pub asked: Instant,
    /// Time at which the registers were read: the arrival of the reply.
    pub now: Instant,
    /// All writes have arrived, the newest last. If false, older writes may have been executed
    /// after the newest, or the newest not at all: the network lost, delayed or duplicated packets.
    pub certain: bool,
    /// The board is set up, so that its serial lines are connected.
    pub is_running: bool,
    /// The report to the application.
    pub report: &'a mut CycleReport,
    pub(crate) events: &'a EventSink,
}

impl ReadCycle<'_> {
    /// Periods without a good read since the last one, where the [board
    /// paces](crate::driver::Pace::Board); 0 at the host's pace, where
    /// [`now`](Self::now) minus that of the previous call is the time that has passed.
    /// The length of a period is that of the [`Registrar::settings`](super::Registrar::settings).
    ///
    /// ```
    /// # use core::time::Duration;
    /// # use mesa_hal::modules::ReadCycle;
    /// # fn rate(cycle: &ReadCycle<'_>, counts: i32, period: Duration) -> f64 {
    /// let periods = 1 + cycle.missed_periods();
    /// f64::from(counts) / (period.as_secs_f64() * periods as f64)
    /// # }
    /// ```
    pub fn missed_periods(&self) -> u64 {
        self.report.missed_periods
    }

    /// Reports an [event](crate::driver::EventKind::OfModule) of the module to the application. Not
    /// in every cycle: the queue holds [`event_room`](crate::Settings::event_room) events.
    ///
    /// ```
    /// # use mesa_hal::hostmot2::Gtag;
    /// # use mesa_hal::modules::ReadCycle;
    /// # const GTAG: Gtag = Gtag(0x99);
    /// # fn overflow(cycle: &ReadCycle<'_>, instance: u8) {
    /// const OVERFLOW: u32 = 1;
    /// cycle.report(GTAG, OVERFLOW, instance.into());
    /// # }
    /// ```
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn report(&self, module: Gtag, code: u32, value: u32) {
        let module = u32::from(module.0);
        let kind = EventKind::OfModule {
            module,
            code,
            value,
        };
        self.events.report(self.now, kind);
    }
}

/// Input of [`Module::write`].
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Debug)]
pub struct WriteCycle<'a> {
    /// The words to write: outputs, triggers and settings.
    pub words: &'a mut Words,
    /// The store with the outputs.
    pub pins: &'a mut PinStore,
    /// Time at which the write began.
    pub now: Instant,
    /// Nothing new may be started: the board is not set up, or safe values are sent for the last
    /// time.
    pub hold: bool,
    /// A pin or parameter of this module was set since its last write, or this is its first write,
    /// or its outputs have become safe or follow the application again. If false, everything that
    /// was put stays unchanged.
    pub changed: bool,
    /// The board is set up, so that its watchdog may be restarted.
    pub(crate) is_running: bool,
    pub(crate) wants_extra: bool,
    pub(crate) events: &'a EventSink,
}

impl WriteCycle<'_> {
    /// Includes the [extra registers](crate::bus::ImagePlan::read_extra) in the next read.
    pub fn request_extra(&mut self) {
        self.wants_extra = true;
    }
}

/// Prefix of the names of pins that all instances of a module share: `encoder.`, and
/// `encoder.bank-1.` for a second module whose instances are numbered with those of the first.
pub(crate) fn bank_stem(name: &str, bank: usize) -> alloc::string::String {
    match bank {
        0 => alloc::format!("{name}."),
        _ => alloc::format!("{name}.bank-{bank}."),
    }
}

/// Returns the word in which each output sets the bit of its number, modulo 32.
pub(crate) fn bits_of(
    pins: &mut PinStore,
    outputs: impl IntoIterator<Item = (u8, Output<bool>)>,
) -> u32 {
    outputs.into_iter().fold(0, |word, (bit, output)| {
        word | u32::from(pins.fetch(output)) << (bit & 31)
    })
}

/// The last write that restarted a watchdog before it has bitten.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LastFeed {
    /// Its start.
    pub at: Instant,
    /// The watchdog's time after that.
    pub bitten_at: Instant,
    /// No further write has arrived since.
    pub is_last: bool,
}
