//! The modules of a board: each is one file or folder with its registers, its pins and its cycle.
//!
//! A [`Module`] registers once what it reads, writes and is set up with, at a [`Registrar`], and then
//! does one step after each read and one before each write. The board's watchdog and its serial
//! ports are modules like the others, and an application can add modules that this crate does not
//! know.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

pub mod dpll;
pub mod encoder;
mod error;
pub(crate) mod events;
pub mod gpio;
pub mod in_mux;
pub mod led;
pub mod outputs;
pub mod pwm;
mod registrar;
mod report;
pub mod serial;
mod settings;
mod undriven;
pub mod watchdog;

pub use error::RegisterError;
pub use events::{Event, EventKind, EventMask, Events, Repeating};
pub use registrar::Registrar;
pub use report::{BoardState, CycleReport};
pub use settings::{
    Pace, ParseError, Presence, PwmConfig, RemoteConfig, SerialConfig, Settings, TraceSettings,
};

pub use undriven::{Undriven, UndrivenReason, undriven};

use core::any::Any;
use core::fmt;

use crate::bus::{Instant, Words};
use crate::hal::{Output, PinStore};

/// A part of the board in the cycle.
///
/// # Real time
/// Every function is called at most once in a cycle, and must not allocate, wait or panic: a module
/// is a state machine that does one step for each call.
pub trait Module: Any + fmt::Debug + Send {
    /// Takes its inputs from a read that is sound.
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        let _ = cycle;
    }

    /// A read failed: nothing new is known.
    fn not_read(&mut self, pins: &mut PinStore) {
        let _ = pins;
    }

    /// Puts its outputs.
    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        let _ = cycle;
    }

    /// The write was sent at `now`; whether it `arrived`, or that is not known.
    fn written(&mut self, now: Instant, arrived: bool) {
        let _ = (now, arrived);
    }

    /// Something made everything safe. The outputs of the board's own group are safe already.
    fn make_safe(&mut self, pins: &mut PinStore) {
        let _ = pins;
    }

    /// The board has lost its set-up and got it back: counts may stand anywhere.
    fn restored(&mut self, pins: &mut PinStore, now: Instant) {
        let _ = (pins, now);
    }
}

/// What a module has after a read.
#[derive(Debug)]
pub struct ReadCycle<'a> {
    /// What was read.
    pub words: &'a Words,
    /// Where its inputs go.
    pub pins: &'a mut PinStore,
    /// When the registers were read.
    pub now: Instant,
    /// All writes have arrived, the newest last. Otherwise others than the newest may have been
    /// executed, or the newest not: the network lost, delayed or duplicated packets.
    pub certain: bool,
    /// The board is set up, so that its lines are lines.
    pub is_running: bool,
    /// The report to the application.
    pub report: &'a mut CycleReport,
}

/// What a module has before a write.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Debug)]
pub struct WriteCycle<'a> {
    /// What is written: outputs, triggers and settings.
    pub words: &'a mut Words,
    /// Where its outputs come from.
    pub pins: &'a mut PinStore,
    /// When the write began.
    pub now: Instant,
    /// Nothing is to be started anew: the board is not set up, or safe values are sent for the last
    /// time.
    pub hold: bool,
    /// A pin or parameter of this module was set since its last write, or this is its first, or its
    /// outputs have become safe or follow the application again. Otherwise everything that was put
    /// stays as it is.
    pub changed: bool,
    /// The board is set up, so that its watchdog may be fed.
    pub(crate) is_running: bool,
    pub(crate) wants_extra: bool,
}

impl WriteCycle<'_> {
    /// The next read holds the [extra registers](crate::bus::ImagePlan::read_extra) as well.
    pub fn ask_extra(&mut self) {
        self.wants_extra = true;
    }
}

/// What the names of pins begin with that all instances of a module have in common: `encoder.`, and
/// `encoder.bank-1.` of the second module whose instances are numbered with those of the first.
pub(crate) fn bank_stem(name: &str, bank: usize) -> alloc::string::String {
    match bank {
        0 => alloc::format!("{name}."),
        _ => alloc::format!("{name}.bank-{bank}."),
    }
}

/// The word in which the bit of each output is its number, modulo 32.
pub(crate) fn bits_of(
    pins: &mut PinStore,
    outputs: impl IntoIterator<Item = (u8, Output<bool>)>,
) -> u32 {
    outputs.into_iter().fold(0, |word, (bit, output)| {
        word | u32::from(pins.fetch(output)) << (bit & 31)
    })
}

#[cfg(all(test, feature = "std"))]
mod tests;
