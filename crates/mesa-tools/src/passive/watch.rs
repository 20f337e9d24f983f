//! Live values of a board that another program drives: its pins, and the counters and serial
//! channels that no pin shows.

use core::fmt;

use mesa_hal::bus::{Instant, Phase, ReadSlot};
use mesa_hal::driver::{Defaults, Listener};
use mesa_hal::hal::{AnyValue, Place};
use mesa_hal::modules::{ListenCycle, Module, Registrar};
use mesa_hal::transport::RegisterMap;
use mesa_hal::transport::udp::PacketLink;
use mesa_hal::{Board, CycleError, DriverError, Settings};

use super::received::{COUNTED, Received};
use super::{PassiveBus, PassiveStatistics};

/// A board whose values are read again and again.
#[derive(Debug)]
pub struct Watched<L> {
    listener: Listener<PassiveBus<L>>,
    begun: Option<Instant>,
    /// The last count of the packets that the board received.
    before: Option<Received>,
    /// Packets of other programs between the last two counts, per second.
    others_per_second: Option<f64>,
}

/// A value, at the time of its [`Sample`].
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Value {
    /// Name of the pin in LinuxCNC (`hm2_7i97.0.inmux.00.input-05`), or of the register in
    /// [`RegisterMap`] (`encoder.00.count`).
    pub name: String,
    /// Terminals of the pin; empty if not known.
    pub place: String,
    /// The value.
    pub value: AnyValue,
    /// The value in words; `None` where it speaks for itself.
    pub text: Option<String>,
}

/// The value without its name: a bit as ON or off, as on the screen of a machine of one's own.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.text, self.value.as_bool()) {
            (Some(text), _) => f.pad(text),
            (None, Some(is_on)) => f.pad(if is_on { "ON" } else { "off" }),
            (None, None) => {
                let word = self.value.as_i64().unwrap_or_default();
                f.pad(&format!("{word} 0x{word:08X}"))
            }
        }
    }
}

/// All values of a board at a time.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Sample {
    /// Seconds since the first sample.
    pub time_s: f64,
    /// Packets from other programs per second, counted five times a second; `None` at first.
    pub others_per_second: Option<f64>,
    /// Packets of this look so far.
    pub look: PassiveStatistics,
    /// The values.
    pub values: Vec<Value>,
}

impl<L: PacketLink> Watched<L> {
    /// Identifies a board, with the pins that it has in LinuxCNC. Nothing is written.
    ///
    /// # Errors
    /// [`DriverError`]: no board answers, or its firmware cannot be used.
    pub fn new(mut bus: PassiveBus<L>) -> Result<Self, DriverError> {
        // By which the bus knows the registers that it may read.
        bus.identify()?;
        let settings = Settings {
            defaults: Defaults::LinuxCnc,
            ..Settings::default()
        };
        let mut board = Board::identify(bus, settings)?;
        board.add(|r| {
            let registers = Registers::new(r);
            r.add(registers);
            Ok(())
        })?;
        Ok(Self {
            listener: board.listen()?,
            begun: None,
            before: None,
            others_per_second: None,
        })
    }

    /// Reads all values.
    ///
    /// # Errors
    /// Those of the bus.
    pub fn sample(&mut self) -> Result<Sample, CycleError> {
        let at = self.listener.read()?;
        self.count_others(at)?;
        let pins = self.listener.shown().map(|(info, value)| Value {
            name: info.name.clone(),
            place: text(&info.place),
            value,
            text: None,
        });
        let registers = self.listener.modules::<Registers>();
        let values = pins.chain(registers.flat_map(Registers::values)).collect();
        let begun = *self.begun.get_or_insert(at);
        Ok(Sample {
            time_s: at.since(begun).as_secs_f64(),
            others_per_second: self.others_per_second,
            look: self.bus().packets(),
            values,
        })
    }

    fn count_others(&mut self, now: Instant) -> Result<(), CycleError> {
        let is_due = |before: Received| now.since(before.at) >= COUNTED;
        if self.before.is_some_and(|before| !is_due(before)) {
            return Ok(());
        }
        let received = Received::read(self.bus());
        let received = received.map_err(|error| CycleError::Read {
            source: error.into(),
            consecutive: 1,
        })?;
        let before = self.before.replace(received);
        self.others_per_second = before.map(|before| received.others_since(before));
        Ok(())
    }

    /// The board, as it is listened to.
    pub fn listener(&self) -> &Listener<PassiveBus<L>> {
        &self.listener
    }

    /// The bus.
    pub fn bus(&mut self) -> &mut PassiveBus<L> {
        self.listener.bus_mut()
    }
}

/// The registers whose content no pin shows: counters, accumulators and serial ports.
#[derive(Debug)]
struct Registers {
    map: RegisterMap,
    rows: Vec<Row>,
}

#[derive(Debug)]
struct Row {
    name: String,
    address: u16,
    slot: ReadSlot,
    word: u32,
}

impl Registers {
    fn new(r: &mut Registrar<'_>) -> Self {
        let map = RegisterMap::of(r.firmware);
        let wanted = map.readable().filter(|register| {
            let last = register.name.rsplit('.').next().unwrap_or_default();
            let is_counter = matches!(last, "count" | "accumulator" | "mpg");
            is_counter || register.name.starts_with("sserial.")
        });
        let rows = wanted.map(|register| Row {
            name: register.name.clone(),
            address: register.address,
            slot: r.image.read(Phase::Data, register.address),
            word: 0,
        });
        let rows = rows.collect();
        Self { map, rows }
    }

    fn values(&self) -> impl Iterator<Item = Value> + '_ {
        self.rows.iter().map(|row| Value {
            name: row.name.clone(),
            place: String::new(),
            value: row.word.into(),
            text: self.map.meaning(row.address, row.word),
        })
    }
}

impl Module for Registers {
    fn listen(&mut self, cycle: &mut ListenCycle<'_>) {
        for row in &mut self.rows {
            row.word = cycle.words.word(row.slot);
        }
    }
}

fn text(place: &Place) -> String {
    let Place { terminal, signal } = place;
    format!("{terminal} {signal}").trim().to_owned()
}
