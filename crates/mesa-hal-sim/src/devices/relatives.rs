//! Relatives of the 7I77's field I/O: the 7I84, and the 7I76, which is part of the 7I76E as well.
//!
//! Known are names and numbers of modes, names and directions of parameters, and the range of the
//! spindle output: from lists of real machines. FACTS 8.7, 8.8. The widths of the elements are
//! those of the 7I77's; that of the spindle output is not known.

use super::{Description, DescriptionError, Device, FieldIo, spindle::Spindle};
use crate::remote::SimRemote;

/// Process data that all these cards have in all modes.
const IO: &str = "  data Output 16 bits out\n  data Input 32 bits in\n";

/// The spindle output of a 7I76: a share of the voltage at its potentiometer terminals.
const SPINDLE: &str = "\
  data SpinOut 13 unsigned out 0 100 percent
  data SpinEna 1 boolean out
  data SpinDir 1 boolean out
";

const ANALOG: &str = "\
  data AnalogIn0 8 unsigned in 0 36.3 volts
  data AnalogIn1 8 unsigned in 0 36.3 volts
  data AnalogIn2 8 unsigned in 0 36.3 volts
  data AnalogIn3 8 unsigned in 0 36.3 volts
";

const FIELD: &str = "  data FieldVoltage 8 unsigned in 0 36.3 volts\n";

const MPGS: &str = "  data Enc0 8 encoder in\n  data Enc1 8 encoder in\n";

/// Modes of a 7I84.
const MODES_7I84: [(&str, &[&str]); 3] = [
    ("input_output", &[IO]),
    ("io_analog_fieldvoltage", &[IO, ANALOG, FIELD]),
    ("io_encoder_analog", &[IO, ANALOG, MPGS]),
];

/// Modes of a 7I76.
const MODES_7I76: [(&str, &[&str]); 3] = [
    ("IO_Spin", &[IO, SPINDLE]),
    ("IO_Ana_Spin", &[IO, SPINDLE, ANALOG]),
    ("IO_Enc_Ana_Spin_FV", &[IO, SPINDLE, ANALOG, FIELD, MPGS]),
];

/// Parameters whose directions differ between the revisions of a card, and their factory values.
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
#[derive(Clone, Copy)]
struct Edition {
    software: u8,
    hardware: u8,
    /// True if the host may write the unit number and the watchdog time, and sees the baud rate.
    settings: bool,
    /// True if the host may write the modes of the MPGs.
    encoder_modes: bool,
    /// True for a card whose outputs can sink, source, or both.
    output_modes: bool,
    /// True for a card whose spindle outputs can be forward and reverse.
    spindle_mode: bool,
}

/// The 7I76 of three real machines.
const I7I76: Edition = Edition {
    software: 15,
    hardware: 1,
    settings: true,
    encoder_modes: true,
    output_modes: false,
    spindle_mode: false,
};

/// An older 7I76, of a 5I25.
const I7I76_OF_REVISION_14: Edition = Edition {
    software: 14,
    settings: false,
    encoder_modes: false,
    ..I7I76
};

/// The 7I76 of a 7I76EU.
const I7I76EU: Edition = Edition {
    software: 34,
    hardware: 2,
    encoder_modes: false,
    output_modes: true,
    spindle_mode: true,
    ..I7I76
};

/// Revision and directions of a 7I84 are not known.
const I7I84: Edition = I7I76;

/// Revision of a 7I84U is not known; it has the 7I76EU's new parameters of the outputs.
const I7I84U: Edition = Edition {
    spindle_mode: false,
    ..I7I76EU
};

impl Edition {
    /// The statements of parameters and working copies.
    fn parameters(self) -> String {
        let direction = |writable| if writable { "both" } else { "in" };
        let (settings, modes) = (direction(self.settings), direction(self.encoder_modes));
        let baud_rate = if self.settings {
            "parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9\nbaud-rate NVBaudRate\n"
        } else {
            ""
        };
        let outputs = if self.output_modes {
            "parameter Output_Source 16 unsigned both 0 65535 = 65535\n\
             parameter Output_Sink 16 unsigned both 0 65535 = 0\n"
        } else {
            ""
        };
        let spindle = if self.spindle_mode {
            "parameter SpinMode 16 unsigned both 0 65535 = 0\n"
        } else {
            ""
        };
        format!(
            "parameter SwRevision 16 unsigned both 0 65535 = {}\n\
             parameter HwRevision 16 unsigned both 0 65535 = {}\n\
             parameter NVUnitNumber 32 nonvol-unsigned {settings} 0 4294967295\n\
             parameter NVWatchDogTimeout 16 nonvol-unsigned {settings} 0 65535 mS = 50\n\
             parameter NVEncMode0 8 nonvol-unsigned {modes} 0 255 = 0\n\
             parameter NVEncMode1 8 nonvol-unsigned {modes} 0 255 = 0\n\
             parameter EncMode0 8 unsigned {modes} 0 255 = 0\n\
             parameter EncMode1 8 unsigned {modes} 0 255 = 0\n\
             {baud_rate}{outputs}{spindle}\
             working UnitNumber 32 NVUnitNumber\n\
             working WatchDogTime 16 NVWatchDogTimeout\n\
             working EncMode0 8 NVEncMode0\n\
             working EncMode1 8 NVEncMode1\n\
             watchdog WatchDogTime\n\
             unit-number UnitNumber\n",
            self.software, self.hardware
        )
    }

    /// The description of a card of this edition.
    fn card(
        self,
        name: &str,
        unit: u32,
        modes: &[(&str, &[&str])],
    ) -> Result<Description, DescriptionError> {
        let mut text = format!(
            "remote {name}\nunit {unit:#010x}\nrevision {}\nhardware 0 standard\n",
            self.software
        );
        for (index, (name, data)) in modes.iter().enumerate() {
            text.extend([format!("mode {index} {name}\n"), data.concat()]);
        }
        Description::parse(&(text + &self.parameters()))
    }
}

/// The mode of all these cards in which the MPGs count.
const MPG_MODE: u8 = 2;

impl FieldIo {
    /// A 7I84: 32 inputs, 16 sourcing outputs, MPGs in mode 2. Its unit number is not known.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i84() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        let description = I7I84.card("7I84", 0x8400_0001, &MODES_7I84)?;
        Device::remote(&description, Self::of_relative(MPG_MODE, None))
    }

    /// A 7I84U: a 7I84 whose outputs source, sink, or both, by two parameters. Its unit number is
    /// not known.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i84u() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        let description = I7I84U.card("7I84", 0x8400_0002, &MODES_7I84)?;
        Device::remote(&description, Self::of_relative(MPG_MODE, None))
    }

    /// A 7I76: 32 inputs, 16 sourcing outputs, a spindle output, MPGs in mode 2.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i76() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::with_spindle(&Self::description_7i76()?)
    }

    /// An older 7I76, of software revision 14, most of whose parameters are read-only.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i76_of_revision_14() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::with_spindle(&I7I76_OF_REVISION_14.card("7I76", 0x1000_0001, &MODES_7I76)?)
    }

    /// The description of a 7I76; change its unit number to distinguish two cards.
    ///
    /// # Errors
    /// None: a test proves that it is valid.
    pub fn description_7i76() -> Result<Description, DescriptionError> {
        I7I76.card("7I76", 0x1000_0001, &MODES_7I76)
    }

    /// The 7I76 of a 7I76E, on the serial port of that board.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i76e() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::with_spindle(&I7I76.card("7I76", 0x1A00_0001, &MODES_7I76)?)
    }

    /// The 7I76 of a 7I76EU: its outputs source, sink, or both, and its spindle outputs are enable
    /// and direction, or forward and reverse, by three parameters.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i76eu() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::with_spindle(&I7I76EU.card("7I76", 0x1A00_0002, &MODES_7I76)?)
    }

    /// A 7I76U: the 7I76 of a 7I76EU as a card of its own, which is assumed to differ in the top
    /// byte of its unit number only.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i76u() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::with_spindle(&I7I76EU.card("7I76", 0x1000_0002, &MODES_7I76)?)
    }

    /// A card with a spindle output and this description.
    ///
    /// # Errors
    /// The description is not valid.
    pub fn with_spindle(
        description: &Description,
    ) -> Result<SimRemote<Device<Self>>, DescriptionError> {
        let spindle = Some(Spindle::default());
        Device::remote(description, Self::of_relative(MPG_MODE, spindle))
    }
}
