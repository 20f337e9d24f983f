//! The boards that are simulated by name, with their usual firmware.

use clap::ValueEnum;
use clap::builder::PossibleValue;
use mesa_hal_sim::{SimFpga, machines};

use super::devices::{ANALOG, FIELD_IO, I7I76};
use super::slot;

/// A simulated board with its usual firmware, and with the cards on its connectors.
#[derive(Debug)]
pub struct Board {
    /// Name on the command line and in machine files.
    pub name: &'static str,
    help: &'static str,
    /// Makes the FPGA, with this number of serial channels where it is selectable.
    fpga: fn(u8) -> SimFpga,
    /// The remotes of the cards that are part of the board, each with its channel.
    pub own_remotes: &'static [(u8, &'static str)],
    pub is_on_pci: bool,
    /// Number of analog outputs, from 0 on, that are on the board itself.
    pub own_outputs: u8,
    /// Number of analog outputs, each with an encoder, of the board and its card: the last one of
    /// a 7I76 is its spindle. 0 for a firmware image, whose axes are unknown.
    pub outputs: u8,
    /// Number of step generators.
    pub generators: usize,
}

/// A 7I97 with the serial channels that remotes are plugged into.
const I7I97: Board = Board {
    name: "7i97",
    help: "a 7I97",
    fpga: machines::i7i97,
    own_remotes: &[],
    is_on_pci: false,
    own_outputs: 6,
    outputs: 6,
    generators: 0,
};

/// A 7I92 with a 7I77.
const I7I92_7I77: Board = Board {
    name: "7i92-7i77",
    help: "a 7I92 with a 7I77 on P2",
    fpga: |_| machines::i7i92_7i77(),
    own_remotes: &[(0, FIELD_IO), (1, ANALOG)],
    own_outputs: 0,
    ..I7I97
};

/// A 5I25 with a 7I77.
const I5I25_7I77: Board = Board {
    name: "5i25-7i77",
    help: "a 5I25 (PCI) with a 7I77 on P3",
    fpga: |_| machines::i5i25_7i77(),
    is_on_pci: true,
    ..I7I92_7I77
};

/// All boards, in the order of the help.
static BOARDS: [&Board; 10] = [
    &I7I97,
    &Board {
        name: "7i97-7i77",
        help: "a 7I97 with a 7I77 on P1: twelve axes",
        fpga: |_| machines::i7i97_7i77(),
        own_remotes: &[(1, FIELD_IO), (2, ANALOG)],
        outputs: 12,
        ..I7I97
    },
    &Board {
        name: "7i97t",
        help: "a 7I97T (PWM version 1, ClockHigh 160 MHz)",
        fpga: machines::i7i97t,
        ..I7I97
    },
    &I7I92_7I77,
    &Board {
        name: "7i80-7i77",
        help: "a 7I80DB with a 7I77 and firmware of 2016, whose registers are at other addresses",
        fpga: |_| machines::i7i80_of_2016(),
        ..I7I92_7I77
    },
    &Board {
        name: "7i92-7i76",
        help: "a 7I92 with a 7I76 on P2: five stepper axes",
        fpga: |_| machines::i7i92_7i76(),
        own_remotes: &[(0, I7I76)],
        own_outputs: 0,
        outputs: 1,
        generators: 5,
        ..I7I97
    },
    &Board {
        name: "7i97-7i76",
        help: "a 7I97 with a 7I76 on P1: six servo axes and five stepper axes",
        fpga: |_| machines::i7i97_7i76(),
        own_remotes: &[(0, I7I76)],
        outputs: 7,
        generators: 5,
        ..I7I97
    },
    &I5I25_7I77,
    &Board {
        name: "5i25-7i77x2",
        help: "a 5I25 (PCI) with two 7I77: twelve axes",
        fpga: |_| machines::i5i25_7i77x2(),
        own_remotes: &[(0, FIELD_IO), (1, ANALOG), (3, FIELD_IO), (4, ANALOG)],
        outputs: 12,
        ..I5I25_7I77
    },
    &Board {
        name: "5i25-7i77-7i76",
        help: "a 5I25 (PCI) with a 7I77 on P3 and a 7I76 on P2: six servo axes and five stepper axes",
        fpga: |_| machines::i5i25_7i77_7i76(),
        own_remotes: &[(0, FIELD_IO), (1, ANALOG), (3, I7I76)],
        outputs: 7,
        generators: 5,
        ..I5I25_7I77
    },
];

/// Any board: its firmware is given as an image, which replaces the FPGA.
pub static OF_FIRMWARE: Board = Board {
    name: "firmware",
    help: "",
    own_outputs: 0,
    outputs: 0,
    ..I7I97
};

impl Board {
    /// The board of a name; upper and lower case are the same.
    pub fn named(name: &str) -> Option<&'static Self> {
        let mut boards = BOARDS.into_iter();
        boards.find(|board| board.name.eq_ignore_ascii_case(name))
    }

    /// Names of all boards.
    pub fn names() -> String {
        BOARDS.map(|board| board.name).join(", ")
    }

    /// The FPGA with the board's usual firmware, with `channels` serial channels where the number
    /// is selectable.
    pub fn fpga(&self, channels: u8) -> SimFpga {
        (self.fpga)(channels)
    }

    /// Maximum number of channels of each serial port.
    pub fn channels(&self) -> Vec<u8> {
        slot::channels(&self.fpga(u8::MAX))
    }

    /// The output that is the spindle of a 7I76.
    pub const fn spindle(&self) -> Option<u8> {
        match self.generators {
            0 => None,
            _ => self.outputs.checked_sub(1),
        }
    }
}

/// Boards are told apart by their names.
impl PartialEq for Board {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl ValueEnum for &'static Board {
    fn value_variants<'a>() -> &'a [Self] {
        &BOARDS
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name).help(self.help))
    }
}
