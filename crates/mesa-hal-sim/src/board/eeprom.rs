//! Space 2: the EEPROM with MAC address, card name and IP address.

use super::BoardConfig;
use crate::wire::Nanos;
use mesa_wire::lbp16::registers::eeprom::{
    CARD_NAME, FIRST_WRITABLE, IP_ADDRESS, LED_MODE, LEN, MAC, NETMASK, NETMASK_FIRMWARE,
    SIMULATED, SIMULATED_MARK,
};

/// Time to program one word of the Ethernet chip's serial EEPROM. Unknown; mesaflash, which waits 2
/// ms for its first reply, must find a board whose address it has just set (FACTS 10.2).
const PROGRAM: Nanos = 500_000;

/// Words of the EEPROM.
pub(super) const EEPROM_WORDS: usize = LEN as usize / 2;

/// A write that the write enable, or the address, does not permit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NotWritable;

/// The EEPROM. Manual: 7I97, "ETHERNET EEPROM LAYOUT".
#[derive(Clone, Debug)]
pub(super) struct Eeprom {
    words: [u16; EEPROM_WORDS],
    /// The mark of a simulated board. Not among the words: saved states from before it are good.
    mark: [u16; SIMULATED_MARK.len()],
    changes: u64,
}

impl Eeprom {
    /// An EEPROM in factory state.
    pub(super) fn new(config: &BoardConfig) -> Self {
        let mut this = Self {
            words: [0; EEPROM_WORDS],
            mark: if config.is_marked {
                SIMULATED_MARK
            } else {
                Default::default()
            },
            changes: 0,
        };
        for (address, word) in (MAC..).step_by(2).zip(config.mac_words()) {
            this.put(address, word);
        }
        for (address, word) in (CARD_NAME..).step_by(2).zip(config.name_words()) {
            this.put(address, word);
        }
        this.put_ip(IP_ADDRESS, config.ip.octets());
        if config.firmware_version >= NETMASK_FIRMWARE {
            this.put_ip(NETMASK, config.netmask.octets());
        }
        // "The green user LEDs default function is to count received Ethernet packets."
        this.put(LED_MODE, 1);
        this
    }

    /// The word at a byte address within the space.
    pub(super) fn read(&self, address: u16) -> u16 {
        let of_mark = address.checked_sub(SIMULATED).map(|from| from / 2);
        let mark = of_mark.and_then(|word| self.mark.get(usize::from(word)));
        let word = mark.or_else(|| self.words.get(usize::from(address / 2)));
        word.copied().unwrap_or(0)
    }

    /// Writes a word; returns the time that the write takes.
    pub(super) fn write(
        &mut self,
        address: u16,
        value: u16,
        enabled: bool,
    ) -> Result<Nanos, NotWritable> {
        if !enabled || address < FIRST_WRITABLE {
            return Err(NotWritable);
        }
        self.put(address, value);
        self.changes += 1;
        Ok(PROGRAM)
    }

    /// Bit 0 of the LED mode: 1 if the LEDs show debug information after power-up.
    pub(super) fn led_mode(&self) -> u16 {
        self.read(LED_MODE) & 1
    }

    /// Number of changes of the contents.
    pub(super) fn changes(&self) -> u64 {
        self.changes
    }

    /// The contents.
    pub(super) fn words(&self) -> &[u16; EEPROM_WORDS] {
        &self.words
    }

    /// Restores the contents.
    pub(super) fn restore(&mut self, words: [u16; EEPROM_WORDS]) {
        self.words = words;
    }

    fn put_ip(&mut self, address: u16, [a, b, c, d]: [u8; 4]) {
        self.put(address, u16::from_be_bytes([c, d]));
        self.put(address + 2, u16::from_be_bytes([a, b]));
    }

    fn put(&mut self, address: u16, value: u16) {
        if let Some(word) = self.words.get_mut(usize::from(address / 2)) {
            *word = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_stand_where_clients_look_for_them() {
        let eeprom = Eeprom::new(&BoardConfig::new("7I97"));
        // FACTS 10.3 and the layout of the manual.
        let mac: Vec<_> = [2, 4, 6].map(|at| eeprom.read(at)).into();
        assert_eq!(mac, [0x0097, 0x1B1B, 0x0060]);
        assert_eq!(eeprom.read(0x10).to_le_bytes(), *b"7I");
        assert_eq!(eeprom.read(0x12).to_le_bytes(), *b"97");
        assert_eq!([eeprom.read(0x20), eeprom.read(0x22)], [0x0A0A, 0x0A0A]);
        assert_eq!([eeprom.read(0x24), eeprom.read(0x26)], [0xFF00, 0xFFFF]);
    }

    #[test]
    fn simulated_board_marks_eeprom_words_that_read_0_on_a_real_one() {
        let read = |eeprom: &Eeprom| -> Vec<_> {
            let words = (0x08..0x10).step_by(2).map(|at| eeprom.read(at));
            words.flat_map(u16::to_le_bytes).collect()
        };
        let mut config = BoardConfig::new("7I97");
        let mut marked = Eeprom::new(&config);
        assert_eq!(read(&marked), *b"mesa-sim");
        marked.restore(*marked.words());
        assert_eq!(read(&marked), *b"mesa-sim");
        config.is_marked = false;
        assert_eq!(read(&Eeprom::new(&config)), [0; 8]);
    }

    #[test]
    fn firmware_before_16_has_no_netmask() {
        let mut config = BoardConfig::new("7I97");
        config.firmware_version = 15;
        let eeprom = Eeprom::new(&config);
        assert_eq!([eeprom.read(0x24), eeprom.read(0x26)], [0, 0]);
    }

    #[test]
    fn first_0x20_bytes_stay_and_the_rest_needs_the_enable() {
        let mut eeprom = Eeprom::new(&BoardConfig::new("7I97"));
        assert_eq!(eeprom.write(0x1E, 1, true), Err(NotWritable));
        assert_eq!(eeprom.write(0x20, 1, false), Err(NotWritable));
        assert_eq!(eeprom.changes(), 0);
        assert!(eeprom.write(0x20, 1, true).is_ok());
        assert_eq!((eeprom.read(0x20), eeprom.changes()), (1, 1));
        assert!(eeprom.write(0x7E, 2, true).is_ok());
        assert_eq!(eeprom.read(0x7E), 2);
    }
}
