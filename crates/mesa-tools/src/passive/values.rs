//! Live values of a board that another program drives, as its registers hold them.

use std::collections::BTreeMap;

use mesa_hal::boards::BoardTable;
use mesa_hal::bus::Instant;
use mesa_hal::hal::{Place, Terminals};
use mesa_hal::hostmot2::{Gtag, HostMot2};
use mesa_hal::modules::watchdog::WatchdogRegisters;
use mesa_hal::sslbp::CsStatus;
use mesa_hal::transport::udp::PacketLink;

use super::inventory::Received;
use super::{PassiveBus, PassiveError, PassiveStatistics, Read, RegisterMap};
use crate::inventory::terminals;

/// Bits of an encoder's control register (FACTS 12.5).
const QUADRATURE_ERROR: u32 = 1 << 15;
const LATCH_ON_INDEX: u32 = 1 << 4;
const INDEX: u32 = 1 << 2;
const B: u32 = 1 << 1;
const A: u32 = 1;

/// Reads the same registers again and again, and shows what they mean.
#[derive(Debug)]
pub struct Sampler {
    items: Vec<Item>,
    reads: Vec<Read>,
    begun: Option<Instant>,
    before: Option<Received>,
}

/// Something to show: its name, its terminals, and the registers of its value.
#[derive(Clone, Debug)]
struct Item {
    name: String,
    place: String,
    kind: Kind,
    address: u16,
}

/// Meaning of a register's word.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Rest of the watchdog's time, and the address of its status.
    Watchdog {
        clock_hz: u32,
        status: u16,
    },
    /// A bit.
    Bit(u8),
    /// Level of a pin, and the address of the port's direction register.
    Pin {
        bit: u8,
        direction: u16,
    },
    /// Count, and the address of the control register.
    Encoder {
        control: u16,
    },
    /// Steps and 65536ths of steps.
    Steps,
    /// State of a channel of a serial port.
    Channel,
    /// Command of a serial port.
    Command,
    /// A counter of eight bits, of four.
    Mpg(u8),
    Word,
}

/// A value, at the time of its [`Sample`].
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Value {
    /// Name in the style of LinuxCNC's pins: `encoder.00`, `inmux.00.input-05`.
    pub name: String,
    /// Function and terminals; empty if not known.
    pub place: String,
    /// Content of the register.
    pub raw: u32,
    /// Content in words.
    pub text: String,
    /// State of a bit; `None` for other values.
    pub is_on: Option<bool>,
}

/// All values of a board at a time.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Sample {
    /// Seconds since the first sample.
    pub time_s: f64,
    /// Packets from other programs since the sample before, per second.
    pub others_per_second: Option<f64>,
    /// Packets of this look so far.
    pub look: PassiveStatistics,
    /// The values.
    pub values: Vec<Value>,
}

impl Sampler {
    /// The values of an identified board.
    pub fn new(firmware: &HostMot2, map: &RegisterMap) -> Self {
        let items = Items::of(firmware, map);
        let addresses = items.iter().flat_map(Item::addresses);
        let mut addresses: Vec<u16> = addresses.collect();
        addresses.sort_unstable();
        addresses.dedup();
        let mut reads = vec![Received::REGISTER];
        for run in addresses.chunk_by(|a, b| *b == a.saturating_add(4)) {
            let first = run.first().copied().unwrap_or_default();
            reads.push(Read::hostmot2(first, run.len() as u16));
        }
        Self {
            items,
            reads,
            begun: None,
            before: None,
        }
    }

    /// Reads all values.
    ///
    /// # Errors
    /// Those of the bus.
    pub fn sample<L: PacketLink>(
        &mut self,
        bus: &mut PassiveBus<L>,
    ) -> Result<Sample, PassiveError> {
        let all = bus.read_all(&self.reads)?;
        let (received, words) = all.split_first().unwrap_or((&0, &[]));
        // Read in the first packet, and counted with it.
        let received = Received::of(bus, *received);
        let addresses = self.reads.iter().skip(1).flat_map(|read| {
            let addresses = (read.address..).step_by(4);
            addresses.take(read.count.into())
        });
        let words: BTreeMap<u16, u32> = addresses.zip(words.iter().copied()).collect();
        let word = |address: u16| words.get(&address).copied().unwrap_or_default();
        let values = self.items.iter().map(|item| item.value(word));
        let values = values.collect();
        let before = self.before.replace(received);
        let begun = *self.begun.get_or_insert(received.at);
        Ok(Sample {
            time_s: received.at.since(begun).as_secs_f64(),
            others_per_second: before.map(|before| received.others_since(before)),
            look: bus.packets(),
            values,
        })
    }
}

impl Item {
    fn addresses(&self) -> impl Iterator<Item = u16> + use<> {
        let more = match self.kind {
            Kind::Watchdog { status, .. } => Some(status),
            Kind::Pin { direction, .. } => Some(direction),
            Kind::Encoder { control } => Some(control),
            _ => None,
        };
        [self.address].into_iter().chain(more)
    }

    fn value(&self, word: impl Fn(u16) -> u32) -> Value {
        let raw = word(self.address);
        let bit = |word: u32, bit: u8| word >> bit & 1 == 1;
        let is_on = match self.kind {
            Kind::Bit(n) | Kind::Pin { bit: n, .. } => Some(bit(raw, n)),
            _ => None,
        };
        let text = match self.kind {
            Kind::Watchdog { clock_hz, status } => watchdog(raw, word(status), clock_hz),
            Kind::Bit(n) => if bit(raw, n) { "ON" } else { "off" }.to_owned(),
            Kind::Pin { bit: n, direction } => {
                let level = if bit(raw, n) { "high" } else { "low" };
                let is_out = bit(word(direction), n);
                format!("{level}, {}", if is_out { "out" } else { "in" })
            }
            Kind::Encoder { control } => encoder(raw, word(control)),
            Kind::Steps => format!("{:.3} steps", f64::from(raw.cast_signed()) / 65536.0),
            Kind::Channel => CsStatus(raw).to_string(),
            Kind::Command if raw == 0 => "idle".to_owned(),
            Kind::Command => format!("busy with 0x{raw:04X}"),
            Kind::Mpg(n) => (raw >> (8 * n) & 0xFF).to_string(),
            Kind::Word => format!("0x{raw:08X}"),
        };
        Value {
            name: self.name.clone(),
            place: self.place.clone(),
            raw,
            text,
            is_on,
        }
    }
}

/// The count of 16 bits, and the lines. Between two looks an axis may move further than 16 bits
/// count, so that a sum of changes would not be its movement.
fn encoder(raw: u32, control: u32) -> String {
    let mut text = format!("count {}", raw as u16);
    for (bit, name) in [
        (A, ", A"),
        (B, ", B"),
        (INDEX, ", index"),
        (LATCH_ON_INDEX, ", waits for the index"),
        (QUADRATURE_ERROR, ", QUADRATURE ERROR"),
    ] {
        if control & bit != 0 {
            text += name;
        }
    }
    text
}

fn watchdog(time: u32, status: u32, clock_hz: u32) -> String {
    if status & WatchdogRegisters::HAS_BIT != 0 {
        return "HAS BITTEN: outputs are off".to_owned();
    }
    if !WatchdogRegisters::runs(time) {
        return "off".to_owned();
    }
    let left = f64::from(time) / f64::from(clock_hz.max(1)) * 1e3;
    format!("runs, {left:.1} ms left")
}

/// All items of a firmware, built from the names of its registers.
struct Items<'a> {
    firmware: &'a HostMot2,
    map: &'a RegisterMap,
    board: &'static BoardTable,
    all: Vec<Item>,
}

impl<'a> Items<'a> {
    fn of(firmware: &'a HostMot2, map: &'a RegisterMap) -> Vec<Item> {
        let mut items = Self {
            firmware,
            map,
            board: BoardTable::for_firmware(firmware, &[]),
            all: Vec::new(),
        };
        for register in map.registers() {
            let parts: Vec<&str> = register.name.split('.').collect();
            items.add_register(&parts, register.address);
        }
        items.all
    }

    fn add_register(&mut self, parts: &[&str], address: u16) {
        match *parts {
            ["watchdog", "time"] => self.add_watchdog(address),
            ["ioport", port, "data"] => self.add_pins(port, address),
            ["encoder", n, "count"] => self.add_encoder(n, address),
            [module @ ("inmux" | "inm"), n, "input"] => {
                let gtag = if module == "inm" {
                    Gtag::IN_M
                } else {
                    Gtag::IN_MUX
                };
                self.add_bits(&format!("{module}.{n}.input"), gtag, address);
            }
            [module @ ("inmux" | "inm"), n, "mpg"] => {
                for counter in 0..4 {
                    let name = format!("{module}.{n}.enc{counter}");
                    self.add(name, String::new(), Kind::Mpg(counter), address);
                }
            }
            ["ssr", n, "data"] => self.add_bits(&format!("ssr.{n}.out"), Gtag::SSR, address),
            ["stepgen", n, "accumulator"] => {
                self.add(format!("stepgen.{n}"), String::new(), Kind::Steps, address);
            }
            ["pwmgen", "enables"] => self.add_enables(address),
            ["sserial", port, "command"] => {
                let name = format!("sserial.{port}");
                self.add(name, String::new(), Kind::Command, address);
            }
            ["sserial", port, channel, "cs"] => {
                let name = format!("sserial.{port}.{channel}");
                self.add(name, String::new(), Kind::Channel, address);
            }
            ["sserial", .., last] if last == "data" || last.starts_with("interface") => {
                self.add(parts.join("."), String::new(), Kind::Word, address);
            }
            _ => {}
        }
    }

    fn add(&mut self, name: String, place: String, kind: Kind, address: u16) {
        self.all.push(Item {
            name,
            place,
            kind,
            address,
        });
    }

    /// Address of another register of the same module.
    fn address(&self, name: &str) -> Option<u16> {
        self.map.named(name).next().map(|register| register.address)
    }

    fn add_watchdog(&mut self, address: u16) {
        let clock_hz = self.firmware.find(Gtag::WATCHDOG).map(|m| m.clock_hz);
        if let (Some(clock_hz), Some(status)) = (clock_hz, self.address("watchdog.status")) {
            let kind = Kind::Watchdog { clock_hz, status };
            self.add("watchdog".to_owned(), String::new(), kind, address);
        }
    }

    fn add_pins(&mut self, port: &str, address: u16) {
        let direction = self.address(&format!("ioport.{port}.direction"));
        let (Some(direction), Ok(port)) = (direction, port.parse::<usize>()) else {
            return;
        };
        let width = self.firmware.idrom.port_width as usize;
        let first = port.saturating_mul(width);
        let pins = self.firmware.pins.iter().copied().enumerate();
        let pins: Vec<_> = pins.skip(first).take(width).collect();
        for (bit, (number, pin)) in (0..).zip(pins) {
            let place = format!("{pin} {}", terminals::of(self.firmware, number, pin));
            let kind = Kind::Pin { bit, direction };
            let name = format!("gpio.{number:03}");
            self.add(name, place.trim_end().to_owned(), kind, address);
        }
    }

    fn add_encoder(&mut self, n: &str, address: u16) {
        let control = self.address(&format!("encoder.{n}.control"));
        let (Some(control), Ok(number)) = (control, n.parse()) else {
            return;
        };
        let gtag = match self.firmware.find(Gtag::MUXED_ENCODER) {
            Some(_) => Gtag::MUXED_ENCODER,
            None => Gtag::ENCODER,
        };
        let places = self.board.encoder_places(self.firmware, gtag, number);
        let place = places.into_iter().collect::<Place>();
        let kind = Kind::Encoder { control };
        self.add(format!("encoder.{n}"), text(&place), kind, address);
    }

    /// The bits of a register that are at terminals.
    fn add_bits(&mut self, name: &str, gtag: Gtag, address: u16) {
        let ranges = self.board.ranges(self.firmware, gtag);
        let places = Terminals::each(ranges).map(|(number, place)| (number, text(&place)));
        let mut places: Vec<_> = places.collect();
        places.dedup_by_key(|(number, _)| *number);
        if places.is_empty() {
            self.add(name.to_owned(), String::new(), Kind::Word, address);
        }
        for (number, place) in places {
            let name = format!("{name}-{number:02}");
            self.add(name, place, Kind::Bit(number as u8), address);
        }
    }

    fn add_enables(&mut self, address: u16) {
        let generators = self.firmware.find(Gtag::PWM).map_or(0, |m| m.instances);
        for n in 0..generators.min(32) {
            let places = Terminals::each_of(self.board.pwm.enables, n.into());
            let place: Place = places.collect();
            let name = format!("pwmgen.{n:02}.enable");
            self.add(name, text(&place), Kind::Bit(n), address);
        }
    }
}

fn text(place: &Place) -> String {
    let Place { terminal, signal } = place;
    format!("{terminal} {signal}").trim().to_owned()
}
