//! The analog section of a 7I77: six outputs of +-10 V and their enables.

use super::{Description, DescriptionError, Device, SignalValue, SimLayout, World};
use crate::remote::{SimMemory, SimRemote};

/// FACTS 8.1 and 8.3. Type and limits of the analog elements are not confirmed.
const DESCRIPTION: &str = "
remote 7I77
unit 0x11000001
hardware 0 standard
mode 0 analogout_enables
  data AnalogOut0 13 signed out -10 10 volts
  data AnalogOut1 13 signed out -10 10 volts
  data AnalogOut2 13 signed out -10 10 volts
  data AnalogOut3 13 signed out -10 10 volts
  data AnalogOut4 13 signed out -10 10 volts
  data AnalogOut5 13 signed out -10 10 volts
  data AnalogEna 1 boolean out
  data SpinEna 1 boolean out
parameter SwRevision 16 unsigned both 0 65535 = 14
parameter HwRevision 16 unsigned both 0 65535 = 1
parameter UnitNumber 32 unsigned in 0 4294967295
parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9
parameter NVUnitNumber 32 nonvol-unsigned in 0 4294967295
parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 mS = 50
working UnitNumber 32 NVUnitNumber
working WatchDogTime 16 NVWatchDogTimeout
watchdog WatchDogTime
unit-number UnitNumber
baud-rate NVBaudRate
";

const CHANNELS: usize = 6;
const NAMES: [&str; CHANNELS] = [
    "AnalogOut0",
    "AnalogOut1",
    "AnalogOut2",
    "AnalogOut3",
    "AnalogOut4",
    "AnalogOut5",
];

/// The analog terminals and enables of a 7I77.
#[derive(Clone, Debug, Default)]
pub struct Analog {
    raw: [i16; CHANNELS],
    ena: bool,
    spin_ena: bool,
    places: Places,
}

/// Addresses of the process data in memory, looked up once.
#[derive(Clone, Copy, Debug, Default)]
struct Places {
    raw: [u16; CHANNELS],
    ena: u16,
    spin_ena: u16,
}

impl Analog {
    /// A 7I77's analog section.
    pub fn i7i77() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Device::remote(&Self::description()?, Self::default())
    }

    /// The description of the analog section.
    pub fn description() -> Result<Description, DescriptionError> {
        Description::parse(DESCRIPTION)
    }

    /// Voltage of analog output `channel`. 0 V while its enable is off.
    pub fn volts(&self, channel: usize) -> Option<f64> {
        let raw = f64::from(*self.raw.get(channel)?);
        let volts = raw / 4096.0 * 10.0;
        Some(if self.enable(channel)? { volts } else { 0.0 })
    }

    /// True if the enable output ENA`channel` conducts: 0 to 4 are common, 5 is the spindle's.
    pub fn enable(&self, channel: usize) -> Option<bool> {
        match channel {
            0..=4 => Some(self.ena),
            5 => Some(self.spin_ena),
            _ => None,
        }
    }
}

impl World for Analog {
    fn power_up(&mut self, layout: &SimLayout, _memory: &SimMemory) {
        let at = |name: &str| layout.address(name).unwrap_or_default();
        self.places = Places {
            raw: NAMES.map(at),
            ena: at("AnalogEna"),
            spin_ena: at("SpinEna"),
        };
    }

    fn sample(&mut self, _mode: u8, _layout: &SimLayout, _memory: &mut SimMemory) {}

    fn drive(&mut self, _layout: &SimLayout, memory: &SimMemory) {
        let places = self.places;
        for (raw, address) in self.raw.iter_mut().zip(places.raw) {
            // 13 bits, sign extended.
            *raw = (memory.word(address, 2) as u16) as i16;
            *raw = *raw << 3 >> 3;
        }
        self.ena = memory.byte(places.ena) & 1 != 0;
        self.spin_ena = memory.byte(places.spin_ena) & 1 != 0;
    }

    fn off(&mut self) {
        *self = Self {
            places: self.places,
            ..Self::default()
        };
    }

    fn inputs(&self, _layout: &SimLayout) -> Vec<(String, SignalValue)> {
        Vec::new()
    }

    fn outputs(&self, _layout: &SimLayout) -> Vec<(String, SignalValue)> {
        let volts = (0..CHANNELS).filter_map(|n| Some((n, self.volts(n)?)));
        let volts = volts.map(|(n, volts)| (format!("analogout{n}"), SignalValue::Volts(volts)));
        let enables = [("analogena", self.ena), ("spinena", self.spin_ena)];
        let enables = enables.map(|(name, on)| (name.to_owned(), SignalValue::Bool(on)));
        volts.chain(enables).collect()
    }

    /// 0 to 4: the common enable, 5: the spindle's.
    fn output(&self, n: usize) -> Option<bool> {
        self.enable(n)
    }

    fn analog_output(&self, n: usize) -> Option<f64> {
        self.volts(n)
    }
}
