//! Contents of an image, read from its words alone.

use std::collections::BTreeMap;

/// A module descriptor (FACTS 9.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Module {
    pub tag: u8,
    pub version: u8,
    pub clock: u8,
    pub instances: u8,
    pub base: u16,
    pub registers: u8,
    pub strides: u8,
    pub mask: u32,
}

/// A pin descriptor (FACTS 9.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    pub signal: u8,
    pub tag: u8,
    pub unit: u8,
    pub primary: u8,
}

/// A firmware.
pub struct Truth {
    pub board: String,
    pub fpga_size: u32,
    pub clocks: [u32; 2],
    pub instance_strides: [u32; 2],
    pub register_strides: [u32; 2],
    pub modules: Vec<Module>,
    /// Slot and descriptor of the entries behind the first empty slot.
    pub behind: Vec<(u8, Module)>,
    pub pins: Vec<Pin>,
    pub local: Vec<Pin>,
}

/// Module tags.
pub mod tag {
    pub const ENCODER: u8 = 0x04;
    pub const STEPGEN: u8 = 0x05;
    pub const PWM: u8 = 0x06;
    pub const MUXED: u8 = 0x0C;
    pub const SELECT: u8 = 0x0D;
    pub const DPLL: u8 = 0x1A;
    pub const IN_MUX: u8 = 0x1E;
    pub const IN_M: u8 = 0x23;
    pub const OUT_M: u8 = 0x2D;
    pub const SSERIAL: u8 = 0xC1;
    pub const SSR: u8 = 0xC3;
    pub const SSERIAL_B: u8 = 0xC6;
}

impl Truth {
    pub fn read(text: &str) -> Self {
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        let words = lines.map(|line| {
            let mut words = line.split(' ');
            let mut hex = || u32::from_str_radix(words.next().expect("two words"), 16);
            (hex().expect("an address"), hex().expect("a word"))
        });
        let words: BTreeMap<u32, u32> = words.collect();
        let at = |address: u32| words.get(&address).copied().unwrap_or(0);
        assert_eq!(at(0x100), 0x55AA_CAFE);
        let name = [at(0x40C), at(0x410)].map(u32::to_le_bytes).concat();
        let (mut modules, mut behind) = (Vec::new(), Vec::new());
        let mut has_ended = false;
        for slot in 0..32 {
            let [first, second, mask] = [0, 4, 8].map(|n| at(0x440 + 12 * slot + n));
            let module = Module {
                tag: first as u8,
                version: (first >> 8) as u8,
                clock: (first >> 16) as u8,
                instances: (first >> 24) as u8,
                base: second as u16,
                registers: (second >> 16) as u8,
                strides: (second >> 24) as u8,
                mask,
            };
            match (module.tag, has_ended) {
                (0, _) => has_ended = true,
                (_, false) => modules.push(module),
                (_, true) => behind.push((slot as u8, module)),
            }
        }
        let pin = |n: u32| {
            let word = at(0x5C0 + 4 * n);
            Pin {
                signal: word as u8,
                tag: (word >> 8) as u8,
                unit: (word >> 16) as u8,
                primary: (word >> 24) as u8,
            }
        };
        let width = at(0x420);
        assert!((1..=144).contains(&width), "{width} I/O pins");
        Self {
            board: String::from_utf8(name).expect("a name"),
            fpga_size: at(0x414),
            clocks: [at(0x428), at(0x42C)],
            instance_strides: [at(0x430), at(0x434)],
            register_strides: [at(0x438), at(0x43C)],
            modules,
            behind,
            pins: (0..width).map(pin).collect(),
            local: (width..144)
                .map(pin)
                .take_while(|pin| pin.primary == 0x40)
                .collect(),
        }
    }

    /// LinuxCNC's name of the board: the name of its card.
    pub fn linuxcnc_name(&self) -> &'static str {
        match (&*self.board, self.fpga_size) {
            ("MESA7I96", 20) => "7i96s",
            ("MESA7I76", _) => "7i76e",
            (name, _) => {
                let names = [
                    "4i65", "4i68", "4i69", "4i74", "5i20", "5i21", "5i22", "5i23", "5i24", "5i25",
                    "6i25", "7i43", "7i77", "7i80", "7i90", "7i92", "7i93", "7i94", "7i95", "7i96",
                    "7i97", "7i98", "7ia0", "7c80", "7c81", "7i60", "7i61", "7i62", "3x20",
                ];
                let is_it = |known: &&str| name == format!("MESA{}", known.to_uppercase());
                names.into_iter().find(is_it).expect("a board of Mesa's")
            }
        }
    }

    /// Instances of a kind, in all of its modules that are driven.
    pub fn instances(&self, tag: u8) -> u8 {
        let modules = self.modules.iter();
        let driven = modules.filter(|module| module.tag == tag && is_driven(self, module));
        driven.map(|module| module.instances).sum()
    }

    /// The pins of a module's kind and unit.
    pub fn of(&self, tag: u8, unit: u8) -> impl Iterator<Item = (u16, Pin)> + '_ {
        let pins = (0..).zip(self.pins.iter().copied());
        pins.filter(move |(_, pin)| (pin.tag, pin.unit) == (tag, unit))
    }

    /// The channels of a serial port: the highest number that has a pin.
    pub fn channels(&self, tag: u8, unit: u8) -> u8 {
        let pins = self.of(tag, unit).filter(|(_, pin)| pin.signal < 0xB0);
        pins.map(|(_, pin)| pin.signal & 0xF).max().unwrap_or(0)
    }

    /// The serial ports that are driven: kind, unit and channels.
    pub fn ports(&self) -> Vec<(u8, u8, u8)> {
        let serial = self.modules.iter();
        let serial = serial.filter(|m| matches!(m.tag, tag::SSERIAL | tag::SSERIAL_B));
        let ports = serial.flat_map(|m| (0..m.instances).map(|unit| (m.tag, unit)));
        let ports = ports.map(|(tag, unit)| (tag, unit, self.channels(tag, unit).min(8)));
        ports
            .filter(|(_, _, channels)| *channels > 0)
            .take(4)
            .collect()
    }

    /// The number of inputs of an input module.
    pub fn inputs(&self, tag: u8, unit: u8) -> u32 {
        let hint = if tag == tag::IN_MUX { 0x1F } else { 0x24 };
        let mut behind = self.behind.iter();
        let hint = behind.find(|(_, module)| module.tag == hint + unit);
        // Without a hint, all that the pins can have.
        let pins = self
            .of(tag, unit)
            .filter(|(_, pin)| (tag == tag::IN_M) == (pin.signal < 0x80));
        let most = match (tag, pins.count() as u32) {
            (tag::IN_MUX, lines) => 1 << lines,
            (_, pins) => pins,
        };
        hint.map_or(most, |(_, width)| width.mask)
    }
}

/// True if the crate drives a module: the kinds and versions that its documentation names.
pub fn is_driven(truth: &Truth, module: &Module) -> bool {
    let version = module.version & 0x7F;
    match module.tag {
        // Watchdog, I/O ports and LEDs.
        0x02
        | 0x03
        | 0x80
        | tag::DPLL
        | tag::IN_MUX
        | tag::IN_M
        | tag::OUT_M
        | tag::SSR
        | tag::SSERIAL
        | tag::SSERIAL_B => true,
        tag::ENCODER => matches!(version, 2 | 3),
        tag::MUXED => (2..=4).contains(&version),
        tag::PWM => module.version <= 1,
        tag::STEPGEN => matches!(module.version, 0..=2 | 0x42 | 0xC2),
        tag::SELECT => truth
            .modules
            .iter()
            .any(|m| m.tag == tag::MUXED && is_driven(truth, m)),
        _ => false,
    }
}
