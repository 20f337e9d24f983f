//! The 7I72: 48 outputs.

use super::{
    Description, DescriptionError, Device, SignalValue, SimLayout, World, WorldError,
    drivers::{Drivers, FieldPower},
};
use crate::remote::{SimMemory, SimRemote};
use mesa_wire::lbp::RemoteFaults;

/// FACTS 8.4. The scale of the field voltage and the names of the modes are not confirmed.
const DESCRIPTION: &str = "
remote 7I72
unit 0x72000001
hardware 0 standard
mode 0 output_only
  data Output 48 bits out
mode 1 output_fieldvoltage
  data Output 48 bits out
  data FieldVoltage 16 unsigned in 0 36.3 volts
parameter SwRevision 16 unsigned in 0 65535 = 14
parameter HwRevision 16 unsigned in 0 65535 = 1
parameter UnitNumber 32 unsigned in 0 4294967295
parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9
parameter NVUnitNumber 32 nonvol-unsigned both 0 4294967295
parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 mS = 50
working UnitNumber 32 NVUnitNumber
working WatchDogTime 16 NVWatchDogTimeout
watchdog WatchDogTime
unit-number UnitNumber
baud-rate NVBaudRate
";

const FULL_SCALE: f64 = 36.3;

/// The terminals of a 7I72.
#[derive(Clone, Debug)]
pub struct Outputs48 {
    power: FieldPower,
    drivers: Drivers,
}

impl Default for Outputs48 {
    fn default() -> Self {
        Self {
            power: FieldPower::new(),
            drivers: Drivers::new(48),
        }
    }
}

impl Outputs48 {
    /// A 7I72.
    pub fn i7i72() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Device::remote(&Self::description()?, Self::default())
    }

    /// The description of a 7I72.
    pub fn description() -> Result<Description, DescriptionError> {
        Description::parse(DESCRIPTION)
    }
}

impl World for Outputs48 {
    fn sample(&mut self, _mode: u8, layout: &SimLayout, memory: &mut SimMemory) {
        if let Some(address) = layout.address("FieldVoltage") {
            let raw = (self.power.volts / FULL_SCALE * 65535.0).round();
            memory.set_word(address, 2, raw.clamp(0.0, 65535.0) as u64);
        }
    }

    fn drive(&mut self, layout: &SimLayout, memory: &SimMemory) {
        if let Some(address) = layout.address("Output") {
            self.drivers.command(memory.word(address, 6));
        }
    }

    fn off(&mut self) {
        self.drivers.off();
    }

    fn faults(&self) -> RemoteFaults {
        self.power.faults() | self.drivers.faults()
    }

    fn faults_cleared(&mut self) {
        self.drivers.faults_cleared();
    }

    fn set_field_volts(&mut self, volts: f64) -> Result<(), WorldError> {
        self.power.volts = volts.max(0.0);
        Ok(())
    }

    fn set_over_current(&mut self, n: usize, shorted: bool) -> Result<(), WorldError> {
        self.drivers.set_shorted(n, shorted)
    }

    fn set_over_temperature(&mut self, n: usize, hot: bool) -> Result<(), WorldError> {
        self.drivers.set_hot(n, hot)
    }

    fn inputs(&self, _layout: &SimLayout) -> Vec<(String, SignalValue)> {
        vec![(
            "fieldvoltage".to_owned(),
            SignalValue::Volts(self.power.volts),
        )]
    }

    fn outputs(&self, _layout: &SimLayout) -> Vec<(String, SignalValue)> {
        let outputs = (0..self.drivers.count()).map(|n| {
            let on = self.output(n) == Some(true);
            (format!("output-{n:02}"), SignalValue::Bool(on))
        });
        outputs.collect()
    }

    fn output(&self, n: usize) -> Option<bool> {
        let on = self.drivers.is_on(n)?;
        Some(on && self.power.volts >= 1.0)
    }
}
