//! The truth: every change of an output, every fault and every restart, at its time.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mesa_hal_sim::SimFpga;
use mesa_hal_sim::devices::find;
use mesa_hal_sim::wire::{Burst, Nanos, RemoteEnd};

use super::plan::Card;

/// State of outputs that are switched together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Level {
    pub bits: u64,
    pub millivolts: [i32; 6],
}

/// Two steps of the coarsest analog output.
const CLOSE: i32 = 40;

impl Level {
    pub const OFF: Self = Self {
        bits: 0,
        millivolts: [0; 6],
    };

    pub fn bits(bits: u64) -> Self {
        Self { bits, ..Self::OFF }
    }

    pub fn is_on(&self) -> bool {
        self.bits != 0 || self.millivolts.iter().any(|volts| volts.abs() > CLOSE)
    }

    pub fn is(&self, other: &Self) -> bool {
        let mut volts = self.millivolts.iter().zip(other.millivolts);
        self.bits == other.bits && volts.all(|(a, b)| (a - b).abs() <= CLOSE)
    }
}

/// The board's own outputs, by the parts that are written one after the other.
pub const PORTS: usize = 6;
pub const ENABLES: usize = PORTS;
pub const SSR: usize = PORTS + 1;
pub const VOLTS: usize = PORTS + 2;
pub const PARTS: usize = VOLTS + 6;

/// The GPIO of each port, the drive enables, the isolated outputs, and each voltage.
pub type Parts = [Level; PARTS];

/// Commands of the application for the board's own outputs.
#[derive(Clone, Copy, Debug, Default)]
pub struct BoardCommand {
    pub gpio: [u32; PORTS],
    /// By analog output. Those of 0 to 3 are switched by the first.
    pub enables: u32,
    pub ssr: u32,
    pub millivolts: [i32; 6],
    /// No other output depends on it.
    pub led: bool,
}

impl BoardCommand {
    pub fn parts(&self) -> Parts {
        let mut parts = [Level::OFF; PARTS];
        for (part, gpio) in parts.iter_mut().zip(self.gpio) {
            part.bits = gpio.into();
        }
        parts[SSR].bits = self.ssr.into();
        let has = |n: usize| u64::from(self.enables) >> n & 1;
        parts[ENABLES].bits = (0xF * has(0)) | (has(4) << 4) | (has(5) << 5);
        for (n, part) in parts[VOLTS..].iter_mut().enumerate() {
            if has(n) & has(if n < 4 { 0 } else { n }) != 0 {
                part.millivolts[0] = self.millivolts[n];
            }
        }
        parts
    }
}

#[derive(Clone, Copy, Debug)]
pub enum What {
    /// The outputs of a remote, by its number.
    Remote(usize, Level),
    /// The fault byte of a remote.
    Faults(usize, u8),
    /// A part of the board's own outputs.
    Part(usize, Level),
    Bite,
    Reset,
    /// A register of a module that drives pins is written.
    Written,
    /// A write drives the first pin, after none was driven.
    Opened,
    /// No pin is driven any more.
    Closed,
}

#[derive(Clone, Copy, Debug)]
pub struct Event {
    pub at: Nanos,
    pub what: What,
}

/// Events almost in the order of their times: each remote advances its time only when it is
/// inspected.
#[derive(Clone, Debug, Default)]
pub struct Journal(Arc<Mutex<Vec<Event>>>);

impl Journal {
    pub fn note(&self, at: Nanos, what: What) {
        self.lock().push(Event { at, what });
    }

    pub fn take(&self) -> Vec<Event> {
        std::mem::take(&mut *self.lock())
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Event>> {
        // The story of a scenario that has panicked while holding the lock is still needed.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The pins of the board that the application drives.
#[derive(Clone, Copy, Debug)]
pub struct Outputs {
    pub port_width: usize,
    /// GPIO by port.
    pub gpio: [u32; PORTS],
}

/// The current outputs of the board.
pub fn parts(fpga: &SimFpga, outputs: &Outputs) -> Parts {
    let mut parts = [Level::OFF; PARTS];
    for (port, mask) in outputs.gpio.iter().enumerate() {
        for bit in (0..outputs.port_width).filter(|bit| mask >> bit & 1 != 0) {
            let pin = port * outputs.port_width + bit;
            let on = fpga.is_driven(pin) && fpga.pin_level(pin);
            parts[port].bits |= u64::from(on) << bit;
        }
    }
    if fpga.pwm().is_some() {
        for n in 0..6 {
            let drive = fpga.analog_output(n);
            parts[ENABLES].bits |= u64::from(drive.enabled) << n;
            parts[VOLTS + n].millivolts[0] = (drive.volts * 1000.0).round() as i32;
        }
    }
    for n in 0..6 {
        parts[SSR].bits |= u64::from(fpga.isolated_output(n)) << n;
    }
    parts
}

/// Wraps a remote and records the changes of its outputs.
#[derive(Debug)]
pub struct Recorder {
    remote: Box<dyn RemoteEnd>,
    number: usize,
    card: Card,
    journal: Journal,
    seen: Level,
    faults: u8,
    /// True once the host has sent it anything.
    pub spoken_to: bool,
}

impl Recorder {
    pub fn new(remote: Box<dyn RemoteEnd>, number: usize, card: Card, journal: &Journal) -> Self {
        Self {
            remote,
            number,
            card,
            journal: journal.clone(),
            seen: Level::OFF,
            faults: 1,
            spoken_to: false,
        }
    }

    /// Records changes.
    pub fn look(&mut self, at: Nanos) {
        let Some(device) = find(&*self.remote) else {
            return;
        };
        let (world, faults) = (device.world(), device.faults().bits());
        let bits = |count: usize| {
            let on = (0..count).map(|n| u64::from(world.output(n) == Some(true)) << n);
            on.sum::<u64>()
        };
        let now = match self.card {
            Card::Field | Card::Field76 => Level::bits(bits(16)),
            Card::Outputs => Level::bits(bits(48)),
            Card::Analog => Level {
                bits: bits(6),
                millivolts: std::array::from_fn(|n| {
                    let volts = world.analog_output(n).unwrap_or(0.0);
                    (volts * 1000.0).round() as i32
                }),
            },
        };
        let told = std::mem::replace(&mut self.faults, faults);
        let notes = [
            (faults != told).then_some(What::Faults(self.number, faults)),
            (now != self.seen).then_some(What::Remote(self.number, now)),
        ];
        self.seen = now;
        // At a START outputs go off first, and then faults are cleared.
        let [first, then] = if faults == 0 {
            let [faults, outputs] = notes;
            [outputs, faults]
        } else {
            notes
        };
        for what in first.into_iter().chain(then) {
            self.journal.note(at, what);
        }
    }
}

impl RemoteEnd for Recorder {
    fn advance(&mut self, now: Nanos) {
        self.remote.advance(now);
        self.look(now);
    }

    fn receive(&mut self, burst: &Burst) {
        self.spoken_to = true;
        self.remote.receive(burst);
        self.look(burst.end());
    }

    fn transmit(&mut self) -> Option<Burst> {
        self.remote.transmit()
    }

    fn holds_line_low(&self) -> bool {
        self.remote.holds_line_low()
    }

    fn inner(&self) -> Option<&dyn RemoteEnd> {
        Some(&*self.remote)
    }

    fn inner_mut(&mut self) -> Option<&mut dyn RemoteEnd> {
        Some(&mut *self.remote)
    }
}

/// The recorder at `end`, or behind the cable there.
pub fn recorder(mut end: &mut dyn RemoteEnd) -> Option<&mut Recorder> {
    while !(end as &dyn core::any::Any).is::<Recorder>() {
        end = end.inner_mut()?;
    }
    (end as &mut dyn core::any::Any).downcast_mut()
}
