//! Cards without terminals of their own kind: values in, values out. FACTS 4.7, 8.8.
//!
//! Known are the numbers of inputs, outputs and channels, the pins' names and the modes' numbers,
//! from manual pages and lists of real machines. Not known are widths of analog values and counters
//! (assumed: 8 bits, as on a 7I77), full scales, names of modes where not said otherwise, unit
//! numbers, and revisions.

use super::{Description, DescriptionError, Device, Outputs48, Plain};
use crate::remote::SimRemote;

/// The 7I64: 24 inputs, 24 outputs, analog inputs of 3.3 V; a remote without discovery. FACTS 4.7;
/// the elements are those of the built-in table of LinuxCNC. They fill the 8 bytes of RXSize, and
/// the gateware copies byte 0 of the reply into the interface registers too (T:t26): there is no
/// fault byte.
const I7I64: &str = "
remote 7I64
unit 0x64000001
mode 0 standard
  data Output 24 bits out
  data PadOut 8 pad out
  data Input 24 bits in
  data PadIn 8 pad in
  data Analog0 16 unsigned in 0 3.3 volts
  data Analog1 16 unsigned in 0 3.3 volts
no-discovery
no-fault-byte
clear-faults 3 3
";

/// Parameters of a card whose own are not known: those that all known cards have.
const PARAMETERS: &str = "
parameter SwRevision 16 unsigned both 0 65535 = 14
parameter HwRevision 16 unsigned both 0 65535 = 1
parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9
parameter NVUnitNumber 32 nonvol-unsigned both 0 4294967295
parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 mS = 50
working UnitNumber 32 NVUnitNumber
working WatchDogTime 16 NVWatchDogTimeout
watchdog WatchDogTime
unit-number UnitNumber
baud-rate NVBaudRate
";

/// The 7I69: 48 inputs and outputs at the same terminals. Modes: manual page sserial(9) and a
/// published log.
const I7I69: &str = "
remote 7I69
unit 0x69000001
hardware 0 mesa_pinout
mode 0 bidir
  data Output 48 bits out
  data Input 48 bits in
mode 1 input_only
  data Input 48 bits in
mode 2 output_only
  data Output 48 bits out
mode 3 24in_24out
  data Output 24 bits out
  data Input 24 bits in
mode 4 bidir_encoder
  data Output 48 bits out
  data Input 48 bits in
  data Enc0 8 encoder in
  data Enc1 8 encoder in
  data Enc2 8 encoder in
  data Enc3 8 encoder in
";

/// The 7I70: 48 inputs, six of them analog. The modes' names are not known.
const I7I70: &str = "
remote 7I70
unit 0x70000001
hardware 0 standard
mode 0 input
  data Input 48 bits in
mode 1 input_analog
  data Input 48 bits in
  data Analog0 8 unsigned in 0 36.3 volts
  data Analog1 8 unsigned in 0 36.3 volts
  data Analog2 8 unsigned in 0 36.3 volts
  data Analog3 8 unsigned in 0 36.3 volts
  data Analog4 8 unsigned in 0 36.3 volts
  data Analog5 8 unsigned in 0 36.3 volts
mode 2 input_fieldvoltage
  data Input 48 bits in
  data FieldVoltage 8 unsigned in 0 36.3 volts
";

/// The 7I71: 48 sourcing outputs. The modes' names are not known.
const I7I71: &str = "
remote 7I71
unit 0x71000001
hardware 0 standard
mode 0 output_only
  data Output 48 bits out
mode 1 output_fieldvoltage
  data Output 48 bits out
  data FieldVoltage 16 unsigned in 0 36.3 volts
";

/// Process data of a 7I73 without keypad in all modes.
const IO_7I73: &str = "\
  data Output 22 bits out
  data PadOut 2 pad out
  data Input 24 bits in
  data Enc0 8 encoder in
  data Enc1 8 encoder in
  data Enc2 8 encoder in
  data Enc3 8 encoder in
";

/// Process data of a 7I73 with a display: the display takes ten of the outputs.
const IO_7I73_DISPLAY: &str = "\
  data Output 12 bits out
  data PadOut 4 pad out
  data Input 24 bits in
  data Enc0 8 encoder in
  data Enc1 8 encoder in
  data Enc2 8 encoder in
  data Enc3 8 encoder in
";

/// Four of the analog inputs: more do not fit into a frame beside the rest.
const ANALOG_7I73: &str = "\
  data AnalogIn0 8 unsigned in 0 3.3 volts
  data AnalogIn1 8 unsigned in 0 3.3 volts
  data AnalogIn2 8 unsigned in 0 3.3 volts
  data AnalogIn3 8 unsigned in 0 3.3 volts
";

const DISPLAY: &str = "  data Display 8 stream out\n";

const WIDE_DISPLAY: &str = "  data Display32 32 stream out\n";

/// Parameters of a 7I73. Manual page sserial(9); their widths are not known.
const PARAMETERS_7I73: &str = "
parameter SwRevision 16 unsigned in 0 65535 = 14
parameter NVAnalogFilter 8 nonvol-unsigned in 0 255
parameter NVBaudRate 16 nonvol-unsigned in 0 11 = 9
parameter NVContrast 8 nonvol-unsigned in 0 255
parameter NVDispMode 8 nonvol-unsigned in 0 255
parameter NVEncMode0 8 nonvol-unsigned in 0 255
parameter NVEncMode1 8 nonvol-unsigned in 0 255
parameter NVEncMode2 8 nonvol-unsigned in 0 255
parameter NVEncMode3 8 nonvol-unsigned in 0 255
parameter NVKeyTimer 8 nonvol-unsigned in 0 255
parameter NVUnitNumber 32 nonvol-unsigned in 0 4294967295
parameter NVWatchDogTimeout 16 nonvol-unsigned in 0 65535 mS = 50
working UnitNumber 32 NVUnitNumber
working WatchDogTime 16 NVWatchDogTimeout
watchdog WatchDogTime
unit-number UnitNumber
baud-rate NVBaudRate
";

/// The 7I83: six analog outputs with an enable each. Pins and parameters: a list of a real machine.
const I7I83: &str = "
remote 7I83
unit 0x17000001
hardware 0 standard
mode 0 analogout_enables
  data AnalogOut0 13 signed out -10 10 volts
  data AnalogOut1 13 signed out -10 10 volts
  data AnalogOut2 13 signed out -10 10 volts
  data AnalogOut3 13 signed out -10 10 volts
  data AnalogOut4 13 signed out -10 10 volts
  data AnalogOut5 13 signed out -10 10 volts
  data AnalogEna0 1 boolean out
  data AnalogEna1 1 boolean out
  data AnalogEna2 1 boolean out
  data AnalogEna3 1 boolean out
  data AnalogEna4 1 boolean out
  data AnalogEna5 1 boolean out
  data PadOut 4 pad out
  data FieldVoltage 8 unsigned in 0 36.3 volts
parameter SwRevision 16 unsigned both 0 65535 = 14
parameter HwRevision 16 unsigned both 0 65535 = 1
parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9
parameter NVUnitNumber 32 nonvol-unsigned in 0 4294967295
parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 mS = 50
working UnitNumber 32 NVUnitNumber
working WatchDogTime 16 NVWatchDogTimeout
watchdog WatchDogTime
unit-number UnitNumber
baud-rate NVBaudRate
";

/// The 7I87: eight analog inputs. Of its records nothing is known: eight values of 12 bits fill the
/// largest frame.
const I7I87: &str = "
remote 7I87
unit 0x87000001
hardware 0 standard
mode 0 analog_input
  data AnalogIn0 12 signed in -10 10 volts
  data AnalogIn1 12 signed in -10 10 volts
  data AnalogIn2 12 signed in -10 10 volts
  data AnalogIn3 12 signed in -10 10 volts
  data AnalogIn4 12 signed in -10 10 volts
  data AnalogIn5 12 signed in -10 10 volts
  data AnalogIn6 12 signed in -10 10 volts
  data AnalogIn7 12 signed in -10 10 volts
";

impl Plain {
    /// A 7I64.
    ///
    /// # Errors
    /// None, as for all built-in cards: a test proves that its description is valid.
    pub fn i7i64() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::from_description(I7I64)
    }

    /// A 7I69: 48 inputs, 48 outputs, or 24 of each, by its mode.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i69() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::from_description(&[I7I69, PARAMETERS].concat())
    }

    /// A 7I70: 48 inputs, six of them analog in mode 1.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i70() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::from_description(&[I7I70, PARAMETERS].concat())
    }

    /// A 7I73 without keypad and display (hardware mode 0): 24 inputs, 22 outputs, four MPGs, four
    /// analog inputs in modes 1 and 2. Modes: a published log.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i73() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::from_description(
            &[
                "remote 7I73\nunit 0x73000001\nhardware 0 nokeyboardnodisplay\n",
                "mode 0 inputoutputencoder\n",
                IO_7I73,
                "mode 1 inputoutputencoderanalog\n",
                IO_7I73,
                ANALOG_7I73,
                "mode 2 inputoutputencoderanalog\n",
                IO_7I73,
                ANALOG_7I73,
                PARAMETERS_7I73,
            ]
            .concat(),
        )
    }

    /// A 7I73 with a display and without a keypad (hardware mode 1): 12 outputs, and characters for
    /// the display, one or four in a cycle.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i73_display() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::from_description(
            &[
                "remote 7I73\nunit 0x73000002\nhardware 1 nokeyboarddisplay\n",
                "mode 0 inputoutputencoderdisplay\n",
                IO_7I73_DISPLAY,
                DISPLAY,
                "mode 1 inputoutputencoderanalogdisplay\n",
                IO_7I73_DISPLAY,
                ANALOG_7I73,
                DISPLAY,
                "mode 2 inputoutputencoderanalogwidedisplay\n",
                IO_7I73_DISPLAY,
                ANALOG_7I73,
                WIDE_DISPLAY,
                PARAMETERS_7I73,
            ]
            .concat(),
        )
    }

    /// A 7I83: six analog outputs of +-10 V with an enable each, and the field voltage.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i83() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::from_description(I7I83)
    }

    /// A 7I87: eight analog inputs.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i87() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Self::from_description(&[I7I87, PARAMETERS].concat())
    }
}

impl Outputs48 {
    /// A 7I71: 48 sourcing outputs.
    ///
    /// # Errors
    /// None: a test proves that its description is valid.
    pub fn i7i71() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        let description = Description::parse(&[I7I71, PARAMETERS].concat())?;
        Device::remote(&description, Self::default())
    }
}
