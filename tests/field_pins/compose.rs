//! The identity memory of a machine's firmware: a public one, changed to what the list of the
//! machine shows. Its words are written here by the layout of HostMot2 (FACTS 9), without the code
//! that reads them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use super::list::List;

/// Addresses of header words, and of the module descriptors.
const NAME: u16 = 0x040C;
const CLOCKS: [u16; 2] = [0x0428, 0x042C];
const OFFSET_TO_MODULES: u16 = 0x0404;
const OFFSET_TO_PINS: u16 = 0x0408;
const IDROM: u16 = 0x0400;
const PORTS: u16 = 0x041C;
const PORT_WIDTH: u16 = 0x0424;
const SLOTS: u16 = 30;

/// Kinds of modules whose instances have names, with beginning and end of those, the pins of an
/// instance, and a descriptor for a firmware that has none.
struct Kind {
    tag: u8,
    begin: &'static str,
    end: &'static str,
    pins: &'static [u8],
    /// Pins with numbers: their beginning in the names, and the first.
    row: Option<(&'static str, u8)>,
    descriptor: [u32; 3],
}

const KIND: Kind = Kind {
    tag: 0,
    begin: "",
    end: "",
    pins: &[],
    row: None,
    descriptor: [0; 3],
};

const KINDS: [Kind; 8] = [
    Kind {
        tag: ENCODER,
        begin: "encoder.",
        end: ".count",
        pins: &[0x01, 0x02, 0x03],
        descriptor: [0x0102_0304, 0x0005_3000, 0x03],
        ..KIND
    },
    Kind {
        tag: MUXED_ENCODER,
        begin: "encoder.",
        end: ".count",
        pins: &[0x01, 0x02, 0x03],
        descriptor: [0x0601_040C, 0x0005_3600, 0x03],
        ..KIND
    },
    Kind {
        tag: STEPGEN,
        begin: "stepgen.",
        end: ".counts",
        pins: &[0x81, 0x82],
        descriptor: [0x0501_C205, 0x000A_2000, 0x1FF],
        ..KIND
    },
    Kind {
        tag: PWM,
        begin: "pwmgen.",
        end: ".value",
        pins: &[0x81, 0x82, 0x83],
        descriptor: [0x0102_0006, 0x0005_4100, 0x03],
        ..KIND
    },
    Kind {
        tag: 0x1E,
        begin: "inmux.",
        end: ".scan_rate",
        pins: &[0x01, 0x81, 0x82, 0x83, 0x84],
        descriptor: [0x0101_001E, 0x0005_8000, 0x1F],
        ..KIND
    },
    Kind {
        tag: 0x23,
        begin: "inm.",
        end: ".scan_rate",
        row: Some(("input-", 0x01)),
        descriptor: [0x0101_0023, 0x0005_8500, 0x1F],
        ..KIND
    },
    Kind {
        tag: 0xC3,
        begin: "ssr.",
        end: ".rate",
        row: Some(("out-", 0x81)),
        descriptor: [0x0101_00C3, 0x0002_7D00, 0x03],
        ..KIND
    },
    Kind {
        tag: 0x2D,
        begin: "outm.",
        end: "",
        row: Some(("out-", 0x81)),
        descriptor: [0x0101_002D, 0x0001_B000, 0x01],
        ..KIND
    },
];

impl Kind {
    /// The secondary pins of an instance in the list.
    fn pins(&self, list: &List, unit: u8) -> Vec<u8> {
        let mut pins = self.pins.to_vec();
        if let Some((name, first)) = self.row {
            let begin = format!("{}{unit:02}.{name}", self.begin);
            let is_there = |number: &u8| list.has(&format!("{begin}{number:02}"));
            pins.extend((0..32).filter(is_there).map(|number| first + number));
        }
        pins
    }
}

/// A pin that no module uses.
const PLAIN: u32 = 0x0300_0000;
const ENCODER: u8 = 0x04;
const STEPGEN: u8 = 0x05;
const PWM: u8 = 0x06;
const MUXED_ENCODER: u8 = 0x0C;
/// In the version of an encoder with a probe.
const WITH_PROBE: u8 = 0x80;
const DPLL: u8 = 0x1A;
const DPLL_DESCRIPTOR: [u32; 3] = [0x0101_001A, 0x0007_7000, 0];
const SERIAL: u8 = 0xC1;
const SERIAL_DESCRIPTOR: [u32; 3] = [0x0101_00C1, 0x1006_5B00, 0x3C];
const MUX_SELECT: u8 = 0x0D;
const MUX_SELECT_DESCRIPTOR: [u32; 3] = [0x0101_000D, 0, 0];

/// The words of an identity memory.
#[derive(Clone, Debug)]
struct Words(BTreeMap<u16, u32>);

/// The text of the firmware that the comment of a list names, changed to what the list has.
pub fn compose(list: &List) -> Result<String, String> {
    let mut failure = String::from("the comment names no firmware");
    let mut best: Option<(usize, Words)> = None;
    for base in named(&list.firmware) {
        match Words::read(&base).or_else(|error| Words::without_dpll(&base).ok_or(error)) {
            Ok(words) => {
                let changes = words.distance(list);
                if best.as_ref().is_none_or(|(least, _)| changes < *least) {
                    best = Some((changes, words));
                }
            }
            Err(error) => failure = error,
        }
    }
    // One that is not public is composed of the nearest that is.
    let nearest = || {
        let all = all().into_iter().filter_map(|name| Words::read(&name).ok());
        let all = all.map(|words| (words.distance(list), words));
        all.min_by_key(|(distance, _)| *distance)
    };
    let (_, mut words) = best.or_else(nearest).ok_or(failure)?;
    words.adapt(list)?;
    Ok(words.text())
}

/// The words of the comment that can be names of firmwares.
fn named(comment: &str) -> Vec<String> {
    let words =
        comment.split(|c: char| c.is_whitespace() || matches!(c, ',' | ';' | '(' | ')' | ':'));
    let is_name =
        |word: &&str| word.contains('-') && word.starts_with(|c: char| c.is_ascii_digit());
    words.filter(is_name).map(str::to_owned).collect()
}

/// The directory of firmwares.
fn firmwares() -> PathBuf {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/transcripts/firmwares");
    std::env::var_os("FIRMWARES").map_or_else(|| own.into(), PathBuf::from)
}

/// The names of all firmwares in the directory.
fn all() -> Vec<String> {
    let files = fs::read_dir(firmwares()).into_iter().flatten().flatten();
    let names = files.filter_map(|file| {
        let name = file.file_name().into_string().ok()?;
        Some(name.strip_suffix(".txt")?.to_owned())
    });
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

impl Words {
    fn read(name: &str) -> Result<Self, String> {
        let path = firmwares().join(format!("{name}.txt"));
        let text = fs::read_to_string(&path);
        let text = text.map_err(|error| format!("{}: {error}", path.display()))?;
        let mut words = BTreeMap::new();
        for line in text.lines().filter(|line| !line.starts_with('#')) {
            let word = line.split_once(' ').and_then(|(address, word)| {
                let address = u16::from_str_radix(address, 16).ok()?;
                Some((address, u32::from_str_radix(word.trim(), 16).ok()?))
            });
            words.extend([word.ok_or_else(|| format!("{name}: {line}"))?]);
        }
        Ok(Self(words))
    }

    /// The firmware of a name with a `D` behind the cards, for a DPLL, is public without it.
    fn without_dpll(name: &str) -> Option<Self> {
        let (cards, width) = name.rsplit_once('_')?;
        let plain = format!("{}_{width}", cards.strip_suffix('D')?);
        Self::read(&plain).ok()
    }

    fn word(&self, address: u16) -> u32 {
        self.0.get(&address).copied().unwrap_or_default()
    }

    fn set(&mut self, address: u16, word: u32) {
        self.0.insert(address, word);
    }

    fn text(&self) -> String {
        self.0
            .iter()
            .fold(String::new(), |mut text, (address, word)| {
                let _ = writeln!(text, "{address:04X} {word:08X}");
                text
            })
    }

    /// Address of the word of a pin.
    fn pin_at(&self, pin: u16) -> u16 {
        IDROM + self.word(OFFSET_TO_PINS) as u16 + 4 * pin
    }

    fn pins(&self) -> u16 {
        (self.word(PORTS) * self.word(PORT_WIDTH)) as u16
    }

    /// Address of the descriptor of a kind, and the number of its instances.
    fn module(&self, tag: u8) -> Option<(u16, u8)> {
        let first = IDROM + self.word(OFFSET_TO_MODULES) as u16;
        let mut slots = (0..SLOTS).map(|slot| first + 12 * slot);
        let slot = slots.find(|&slot| self.word(slot).to_le_bytes()[0] == tag)?;
        Some((slot, self.word(slot).to_le_bytes()[3]))
    }

    fn instances(&self, tag: u8) -> u8 {
        self.module(tag).map_or(0, |(_, instances)| instances)
    }

    /// Number of pins that are used in one and free in the other, and serial channels without pins
    /// on which the list has cards.
    fn distance(&self, list: &List) -> usize {
        let used = |pin: &u16| self.word(self.pin_at(*pin)) & 0xFF00 != 0;
        let differs = |pin: &u16| used(pin) != is_used(list, *pin);
        let pins = (0..self.pins()).filter(differs).count();
        let is_missing = |card: &&super::list::Card| {
            let channel = card.channel as u32 + 1;
            let rx = 0x0300_0000 | (card.port as u32) << 16 | u32::from(SERIAL) << 8 | channel;
            (0..self.pins()).all(|pin| self.word(self.pin_at(pin)) != rx)
        };
        pins + 100 * list.cards.iter().filter(is_missing).count()
    }

    /// Changes the words to those of the list's machine: board, clocks, instances, pins.
    fn adapt(&mut self, list: &List) -> Result<(), String> {
        self.set_board(list.board());
        self.set_dpll(list.begins("dpll."))?;
        let is_muxed = list.has("encoder.muxed-sample-frequency");
        for kind in &KINDS {
            let mut wanted = list.instances(kind.begin, kind.end);
            if kind.begin == "encoder." && (kind.tag == MUXED_ENCODER) != is_muxed {
                wanted = 0;
            }
            self.set_instances(kind, wanted)?;
        }
        if is_muxed && self.module(MUX_SELECT).is_none() {
            self.add_module(MUX_SELECT_DESCRIPTOR)?;
        }
        let ports = list.cards.iter().map(|card| card.port as u8 + 1).max();
        if ports > Some(self.instances(SERIAL)) {
            let slot = self.module(SERIAL).map(|(slot, _)| slot);
            let slot = slot.map_or_else(|| self.add_module(SERIAL_DESCRIPTOR), Ok)?;
            self.set_count(slot, ports.unwrap_or_default());
        }
        // Versions that have further names.
        if list.has("pwmgen.00.dither") {
            self.set_version(PWM, |_| 1);
        }
        if list.has("encoder.00.probe-enable") {
            self.set_version(ENCODER, |version| version | WITH_PROBE);
            self.set_version(MUXED_ENCODER, |version| version | WITH_PROBE);
        }
        if list.has("stepgen.00.index-enable") {
            self.set_version(STEPGEN, |_| 0xC2);
        } else if list.has("stepgen.00.swap_step_dir") {
            self.set_version(STEPGEN, |version| version.max(0x42));
        }
        self.set_pins(list)
    }

    fn set_version(&mut self, tag: u8, version: impl Fn(u8) -> u8) {
        if let Some((slot, _)) = self.module(tag) {
            let [tag, old, clock, instances] = self.word(slot).to_le_bytes();
            let word = u32::from_le_bytes([tag, version(old), clock, instances]);
            self.set(slot, word);
        }
    }

    /// Sets the board's name to that of the list, unless the board is known by another mark, such
    /// as the size of its FPGA.
    fn set_board(&mut self, board: &str) {
        let name = [NAME, NAME + 4].map(|address| self.word(address).to_le_bytes());
        let name = name.concat();
        let own = String::from_utf8_lossy(&name).to_lowercase();
        let own = own.trim_start_matches("mesa").trim().to_owned();
        if board.starts_with(&own) {
            return;
        }
        let name = format!("MESA{:<4.4}", board.to_uppercase());
        let bytes = name.as_bytes();
        for (address, bytes) in [NAME, NAME + 4].into_iter().zip(bytes.chunks(4)) {
            let word = bytes
                .iter()
                .rev()
                .fold(0, |word, byte| word << 8 | u32::from(*byte));
            self.set(address, word);
        }
        if matches!(board, "5i25" | "6i25" | "5i24") {
            // Boards on the PCI bus have its clock.
            self.set(CLOCKS[0], 33_333_333);
            self.set(CLOCKS[1], 200_000_000);
        }
    }

    fn set_dpll(&mut self, is_there: bool) -> Result<(), String> {
        match self.module(DPLL) {
            // Without instances it is no module.
            Some((slot, _)) if !is_there => self.set(slot, self.word(slot) & 0x00FF_FFFF),
            None if is_there => drop(self.add_module(DPLL_DESCRIPTOR)?),
            _ => {}
        }
        Ok(())
    }

    /// Adds a module in the first free slot, whose address is returned.
    fn add_module(&mut self, descriptor: [u32; 3]) -> Result<u16, String> {
        let first = IDROM + self.word(OFFSET_TO_MODULES) as u16;
        let mut slots = (0..SLOTS).map(|slot| first + 12 * slot);
        let free = slots.find(|&slot| self.word(slot) == 0);
        let free = free.ok_or("no free slot for a module")?;
        for (address, word) in [free, free + 4, free + 8].into_iter().zip(descriptor) {
            self.set(address, word);
        }
        Ok(free)
    }

    fn set_instances(&mut self, kind: &Kind, wanted: u8) -> Result<(), String> {
        let slot = match self.module(kind.tag) {
            Some((slot, _)) => slot,
            None if wanted == 0 => return Ok(()),
            None => self.add_module(kind.descriptor)?,
        };
        self.set_count(slot, wanted);
        Ok(())
    }

    /// Sets the number of instances in the descriptor of a slot.
    fn set_count(&mut self, slot: u16, instances: u8) {
        let word = self.word(slot) & 0x00FF_FFFF | u32::from(instances) << 24;
        self.set(slot, word);
    }

    /// Frees pins that the list has free, and uses those that it has in use.
    ///
    /// Pins of serial channels stay: on which of them a card answers is what the driver finds out.
    /// A machine whose list has no port at all may have none in its firmware; its pins stay, too.
    fn set_pins(&mut self, list: &List) -> Result<(), String> {
        let mut seen = BTreeSet::new();
        let mut free = Vec::new();
        for pin in 0..self.pins() {
            let at = self.pin_at(pin);
            let word = self.word(at);
            let [_, tag, unit, _] = word.to_le_bytes();
            let has_unit = tag == SERIAL || tag != 0 && self.has_unit(tag, unit);
            let stays = has_unit && (tag == SERIAL || is_used(list, pin)) && seen.insert(word);
            if !stays {
                self.set(at, PLAIN);
                free.push(pin);
            }
        }
        let mut missing = self.missing(list);
        for pin in free.into_iter().filter(|pin| is_used(list, *pin)) {
            let word = missing.pop();
            let word = word.ok_or_else(|| format!("nothing is left for I/O pin {pin}"))?;
            self.set(self.pin_at(pin), word);
        }
        Ok(())
    }

    fn has_unit(&self, tag: u8, unit: u8) -> bool {
        let units = match tag {
            MUXED_ENCODER => self.instances(tag).div_ceil(2),
            // The select line of multiplexed encoders.
            MUX_SELECT => return self.instances(MUXED_ENCODER) > 0,
            _ => self.instances(tag),
        };
        unit < units || tag == STEPGEN && unit == 0x80
    }

    /// Words of pins that the machine has and the words do not, the most certain ones last: those
    /// of outputs whose names are in the list.
    fn missing(&self, list: &List) -> Vec<u32> {
        let (mut named, mut wanted) = (Vec::new(), Vec::new());
        for kind in &KINDS {
            let mut units = self.instances(kind.tag);
            if kind.tag == MUXED_ENCODER {
                // In pairs, which share their pins and the select line.
                units = units.div_ceil(2);
                let is_there =
                    |unit: &u8| list.has(&format!("encoder.{unit:02}.sel0.invert_output"));
                let lines = (0..u8::MAX).filter(is_there);
                named.extend(lines.map(|unit| pin_word(MUX_SELECT, unit, 0x81)));
            }
            for unit in 0..units {
                for pin in kind.pins(list, unit) {
                    let word = pin_word(kind.tag, unit, pin);
                    let output = output_name(kind.tag, pin);
                    let name = format!("{}{unit:02}.{output}.invert_output", kind.begin);
                    if list.has(&name) {
                        named.push(word);
                    } else {
                        wanted.push(word);
                    }
                }
            }
        }
        for card in &list.cards {
            let (unit, channel) = (card.port as u8, card.channel as u8);
            let pins = [0x91, 0x01, 0x81].map(|pin| pin_word(SERIAL, unit, pin + channel));
            named.extend(pins);
        }
        wanted.extend(named);
        let own: Vec<u32> = (0..self.pins())
            .map(|pin| self.word(self.pin_at(pin)))
            .collect();
        wanted.retain(|word| !own.contains(word));
        wanted
    }
}

/// LinuxCNC's name of an output.
fn output_name(tag: u8, pin: u8) -> &'static str {
    match (tag, pin) {
        (STEPGEN, 0x81) => "step",
        (STEPGEN, 0x82) => "direction",
        (PWM, 0x81) => "out0",
        (PWM, 0x82) => "out1",
        (PWM, 0x83) => "enable",
        _ => "",
    }
}

fn pin_word(tag: u8, unit: u8, pin: u8) -> u32 {
    u32::from_le_bytes([pin, tag, unit, 0x03])
}

/// True if a module uses the I/O pin: only a free one can be set.
fn is_used(list: &List, pin: u16) -> bool {
    !list.has(&format!("gpio.{pin:03}.out"))
}
