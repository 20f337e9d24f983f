//! Relatives of the 7I77's field I/O: the 7I84, and the 7I76, which is part of the 7I76E as well.
//!
//! The names and numbers of modes, pins and revisions are known, and the unit numbers of the 7I76
//! and the 7I76E (FACTS 8.7). The elements have the widths, types and ranges of the 7I77's, and the
//! parameters are the 7I77's: no listing of either is public.

use super::{Description, DescriptionError, Device, FieldIo, spindle::Spindle};
use crate::remote::SimRemote;

/// The unit number is unknown.
const I7I84: &str = "
remote 7I84
unit 0x84000001
hardware 0 standard
mode 0 input_output
  data Output 16 bits out
  data Input 32 bits in
mode 1 io_analog_fieldvoltage
  data Output 16 bits out
  data Input 32 bits in
  data AnalogIn0 8 unsigned in 0 36.3 volts
  data AnalogIn1 8 unsigned in 0 36.3 volts
  data AnalogIn2 8 unsigned in 0 36.3 volts
  data AnalogIn3 8 unsigned in 0 36.3 volts
  data FieldVoltage 8 unsigned in 0 36.3 volts
mode 2 io_encoder_analog
  data Output 16 bits out
  data Input 32 bits in
  data AnalogIn0 8 unsigned in 0 36.3 volts
  data AnalogIn1 8 unsigned in 0 36.3 volts
  data AnalogIn2 8 unsigned in 0 36.3 volts
  data AnalogIn3 8 unsigned in 0 36.3 volts
  data Enc0 8 encoder in
  data Enc1 8 encoder in
parameter SwRevision 16 unsigned in 0 65535 = 14
parameter HwRevision 16 unsigned in 0 65535 = 1
parameter UnitNumber 32 unsigned in 0 4294967295
parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9
parameter NVUnitNumber 32 nonvol-unsigned both 0 4294967295
parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 mS = 50
parameter NVEncMode0 8 nonvol-unsigned both 0 255 = 0
parameter NVEncMode1 8 nonvol-unsigned both 0 255 = 0
working UnitNumber 32 NVUnitNumber
working WatchDogTime 16 NVWatchDogTimeout
working EncMode0 8 NVEncMode0
working EncMode1 8 NVEncMode1
watchdog WatchDogTime
unit-number UnitNumber
baud-rate NVBaudRate
";

const I7I76: &str = "
remote 7I76
unit 0x10000001
hardware 0 standard
mode 0 IO_Spin
  data Output 16 bits out
  data Input 32 bits in
  data SpinOut 13 signed out -10 10 volts
  data SpinEna 1 boolean out
  data SpinDir 1 boolean out
mode 1 IO_Ana_Spin
  data Output 16 bits out
  data Input 32 bits in
  data SpinOut 13 signed out -10 10 volts
  data SpinEna 1 boolean out
  data SpinDir 1 boolean out
  data AnalogIn0 8 unsigned in 0 36.3 volts
  data AnalogIn1 8 unsigned in 0 36.3 volts
  data AnalogIn2 8 unsigned in 0 36.3 volts
  data AnalogIn3 8 unsigned in 0 36.3 volts
mode 2 IO_Enc_Ana_Spin_FV
  data Output 16 bits out
  data Input 32 bits in
  data SpinOut 13 signed out -10 10 volts
  data SpinEna 1 boolean out
  data SpinDir 1 boolean out
  data AnalogIn0 8 unsigned in 0 36.3 volts
  data AnalogIn1 8 unsigned in 0 36.3 volts
  data AnalogIn2 8 unsigned in 0 36.3 volts
  data AnalogIn3 8 unsigned in 0 36.3 volts
  data FieldVoltage 8 unsigned in 0 36.3 volts
  data Enc0 8 encoder in
  data Enc1 8 encoder in
parameter SwRevision 16 unsigned in 0 65535 = 14
parameter HwRevision 16 unsigned in 0 65535 = 1
parameter UnitNumber 32 unsigned in 0 4294967295
parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9
parameter NVUnitNumber 32 nonvol-unsigned both 0 4294967295
parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 mS = 50
parameter NVEncMode0 8 nonvol-unsigned both 0 255 = 0
parameter NVEncMode1 8 nonvol-unsigned both 0 255 = 0
working UnitNumber 32 NVUnitNumber
working WatchDogTime 16 NVWatchDogTimeout
working EncMode0 8 NVEncMode0
working EncMode1 8 NVEncMode1
watchdog WatchDogTime
unit-number UnitNumber
baud-rate NVBaudRate
";

/// The mode of all these cards in which the MPGs count.
const MPG_MODE: u8 = 2;

/// Top byte of the unit number of the 7I76 that is part of a 7I76E, and its software revision, from
/// the output of one such board.
const CLASS_7I76E: u32 = 0x1A;
const REVISION_7I76E: u64 = 15;

impl FieldIo {
    /// A 7I84: 32 inputs, 16 sourcing outputs, MPGs in mode 2.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i84() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        let description = Description::parse(I7I84)?;
        Device::remote(&description, Self::of_relative(MPG_MODE, None))
    }

    /// A 7I76: 32 inputs, 16 sourcing outputs, a spindle output, MPGs in mode 2.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i76() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::with_spindle(&Self::description_7i76()?)
    }

    /// The description of a 7I76; change its unit number to distinguish two cards.
    ///
    /// # Errors
    /// None: a test proves that it is valid.
    pub fn description_7i76() -> Result<Description, DescriptionError> {
        Description::parse(I7I76)
    }

    /// The 7I76 of a 7I76E, on the serial port of that board.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i76e() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        let mut description = Description::parse(I7I76)?;
        description.unit = description.unit & 0x00FF_FFFF | CLASS_7I76E << 24;
        for parameter in &mut description.parameters {
            if parameter.record.name == "SwRevision" {
                parameter.value = REVISION_7I76E;
            }
        }
        description.revision = REVISION_7I76E as u8;
        Self::with_spindle(&description)
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
