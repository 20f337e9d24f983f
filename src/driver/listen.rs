//! A board that another program drives: its registers, read beside that program.

use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;

use super::configure::{Assembly, Board};
use super::parts::Parts;
use super::{CycleError, DriverError};
use crate::bus::{Clock, Instant, ReadSlot, ReadsBeside, RegisterBus, Words};
use crate::hal::{AnyValue, PinId, PinInfo, PinStore, Pins};
use crate::hostmot2::{COOKIE, COOKIE_ADDRESS, HostMot2};
use crate::modules::gpio::Gpio;
use crate::modules::{ListenCycle, Module};

/// The pins of a board that another program drives, as far as its registers show them.
///
/// Nothing is written, and no register is read that a read changes. Levels and states have values:
/// inputs, the lines of encoders, directions, isolated outputs, enables, a bite of the watchdog.
/// All other pins have none: a position depends on counts and parameters that only the driving
/// program has, and the pins of remotes on what they report to a command, which would stop the
/// transfers of that program.
///
/// ```
/// use mesa_hal::{Board, Settings};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let board = Board::identify(machines::i7i97(1), Settings::default())?;
/// let mut listener = board.listen()?;
/// listener.read()?;
/// let line = listener.pins().id("hm2_7i97.0.encoder.00.input-a")?;
/// assert_eq!(listener.value(line), Some(false.into()));
/// let position = listener.pins().id("hm2_7i97.0.encoder.00.position")?;
/// assert_eq!(listener.value(position), None);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Listener<B> {
    bus: B,
    firmware: HostMot2,
    name: String,
    pins: PinStore,
    parts: Parts,
    reads: ReadsBeside,
    words: Words,
    /// The cookie once more, after all data.
    last_cookie: ReadSlot,
    /// By the index of the pin.
    shown: Vec<Option<AnyValue>>,
    /// Number of consecutive failed reads.
    failed: u32,
}

impl<B: RegisterBus + Clock> Board<B> {
    /// Reads the board from now on, and leaves it to the program that drives it. Beside a running
    /// program identify the board over a bus that refuses writes: a board that is dropped before
    /// this call is made to drive nothing.
    ///
    /// # Errors
    /// [`DriverError::Register`]: the I/O pins of the firmware cannot be used.
    ///
    /// # Real time
    /// Not for the cycle: allocates.
    pub fn listen(self) -> Result<Listener<B>, DriverError> {
        let mut assembly = self.0;
        assembly.bus.keep_off();
        assembly.add(Gpio::register)?;
        let Assembly {
            mut bus,
            mut plan,
            parts,
            ..
        } = assembly;
        let last_cookie = plan.image.read_again(COOKIE_ADDRESS);
        let (reads, words) = plan.image.freeze_beside();
        Ok(Listener {
            bus: bus.take(),
            firmware: plan.firmware,
            name: plan.name,
            shown: vec![None; plan.pins.infos().len()],
            pins: plan.pins,
            parts,
            reads,
            words,
            last_cookie,
            failed: 0,
        })
    }
}

impl<B: RegisterBus + Clock> Listener<B> {
    /// Reads all registers, and takes the values that they show. Returns the time of the read.
    ///
    /// # Errors
    /// [`CycleError::Read`] and [`CycleError::NotThere`]: no pin has a value any more.
    ///
    /// # Real time
    /// As many exchanges as the registers need on this bus. No allocation by the listener.
    pub fn read(&mut self) -> Result<Instant, CycleError> {
        self.shown.fill(None);
        self.failed = self.failed.saturating_add(1);
        let consecutive = self.failed;
        let read = self.reads.read(&mut self.bus, &mut self.words);
        read.map_err(|source| CycleError::Read {
            source,
            consecutive,
        })?;
        let absent = |found| CycleError::NotThere { found, consecutive };
        self.parts.connection.check(&self.words).map_err(absent)?;
        // The reads may be far apart: a board that was reloaded between them has no values.
        let last = self.words.word(self.last_cookie);
        if last != COOKIE {
            return Err(absent(last));
        }
        self.failed = 0;
        let now = self.bus.now();
        let mut cycle = ListenCycle {
            words: &self.words,
            now,
            pins: &self.pins,
            shown: &mut self.shown,
        };
        for part in self.parts.each() {
            part.listen(&mut cycle);
        }
        Ok(now)
    }

    /// The value of a pin at the last read; `None` if no register shows it, or the read failed.
    pub fn value(&self, pin: impl Into<PinId>) -> Option<AnyValue> {
        let pin = pin.into();
        self.pins.info_of(pin)?;
        self.shown.get(pin.index()).copied().flatten()
    }

    /// The pins with a value at the last read, in the order of [`Pins::infos`].
    pub fn shown(&self) -> impl Iterator<Item = (&PinInfo, AnyValue)> {
        let pins = self.pins.infos().iter().zip(&self.shown);
        pins.filter_map(|(info, value)| Some((info, (*value)?)))
    }

    /// All pins and parameters, for their names; none of them is valid.
    pub fn pins(&self) -> &Pins {
        &self.pins
    }

    /// The modules of a kind, as [`Driver::modules`](super::Driver::modules).
    pub fn modules<M: Module>(&self) -> impl Iterator<Item = &M> {
        self.parts.of()
    }

    /// The description of the board's firmware.
    pub fn firmware(&self) -> &HostMot2 {
        &self.firmware
    }

    /// Prefix of the names of the board's pins, for example `hm2_7i92.0`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The bus, for example to let its time pass.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }
}
