//! Field I/O of the 7I77, and of its relatives: 32 inputs, 16 outputs, analog inputs, field
//! voltage, two MPGs.

use super::{
    Description, DescriptionError, Device, SignalValue, SimLayout, World, WorldError,
    drivers::{Drivers, FieldPower, Switches},
    spindle::Spindle,
};
use crate::fpga::DriveSignal;
use crate::remote::{SimMemory, SimRemote};
use mesa_wire::lbp::RemoteFaults;

/// FACTS 8.1 and 8.2. The width of the MPG counters is not confirmed.
const DESCRIPTION: &str = "
remote 7I77
unit 0x12000001
hardware 0 standard
mode 0 input_output
  data Output 16 bits out
  data Input 32 bits in
mode 1 io_analog
  data Output 16 bits out
  data Input 32 bits in
  data AnalogIn0 8 unsigned in 0 36.3 volts
  data AnalogIn1 8 unsigned in 0 36.3 volts
  data AnalogIn2 8 unsigned in 0 36.3 volts
  data AnalogIn3 8 unsigned in 0 36.3 volts
mode 2 io_analog_fieldvoltage
  data Output 16 bits out
  data Input 32 bits in
  data AnalogIn0 8 unsigned in 0 36.3 volts
  data AnalogIn1 8 unsigned in 0 36.3 volts
  data AnalogIn2 8 unsigned in 0 36.3 volts
  data AnalogIn3 8 unsigned in 0 36.3 volts
  data FieldVoltage 8 unsigned in 0 36.3 volts
mode 3 io_encoder_analog_fieldvoltage
  data Output 16 bits out
  data Input 32 bits in
  data AnalogIn0 8 unsigned in 0 36.3 volts
  data AnalogIn1 8 unsigned in 0 36.3 volts
  data AnalogIn2 8 unsigned in 0 36.3 volts
  data AnalogIn3 8 unsigned in 0 36.3 volts
  data FieldVoltage 8 unsigned in 0 36.3 volts
  data Enc0 8 encoder in
  data Enc1 8 encoder in
parameter SwRevision 16 unsigned in 0 65535 = 14
parameter HwRevision 16 unsigned in 0 65535 = 2
parameter UnitNumber 32 unsigned in 0 4294967295
parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9
parameter NVUnitNumber 32 nonvol-unsigned in 0 4294967295
parameter NVWatchDogTimeout 16 nonvol-unsigned both 0 65535 mS = 50
parameter NVEncMode0 8 nonvol-unsigned in 0 255 = 0
parameter NVEncMode1 8 nonvol-unsigned in 0 255 = 0
parameter EncMode0 8 unsigned in 0 255 = 0
parameter EncMode1 8 unsigned in 0 255 = 0
working UnitNumber 32 NVUnitNumber
working WatchDogTime 16 NVWatchDogTimeout
working EncMode0 8 NVEncMode0
working EncMode1 8 NVEncMode1
watchdog WatchDogTime
unit-number UnitNumber
baud-rate NVBaudRate
";

const INPUTS: usize = 32;
const OUTPUTS: usize = 16;
/// First input of each MPG; B is the next one.
const MPG_INPUTS: [usize; 2] = [16, 18];
/// The software mode of a 7I77 in which the MPG inputs have thresholds for 5 V.
const MPG_MODE: u8 = 3;
/// Full scale of the analog inputs and of the field voltage.
const FULL_SCALE: f64 = 36.3;

/// The field terminals of a 7I77, a 7I84 or a 7I76.
#[derive(Clone, Debug)]
pub struct FieldIo {
    switches: Switches,
    /// The software mode in which the MPGs count.
    mpg_mode: u8,
    spindle: Option<Spindle>,
    power: FieldPower,
    volts: [f64; INPUTS],
    sensed: u32,
    drivers: Drivers,
    mpgs: [Mpg; 2],
    mode: u8,
    places: Places,
}

/// Addresses of the process data in memory, looked up once.
#[derive(Clone, Copy, Debug, Default)]
struct Places {
    output: u16,
    input: u16,
    analog: [u16; 4],
    field: u16,
    encoders: [u16; 2],
    /// Masks of the switches to field power and to ground, on cards that have them.
    switches: Option<[u16; 2]>,
}

impl Places {
    fn new(layout: &SimLayout) -> Self {
        let at = |name: &str| layout.address(name).unwrap_or_default();
        Self {
            output: at("Output"),
            input: at("Input"),
            analog: ["AnalogIn0", "AnalogIn1", "AnalogIn2", "AnalogIn3"].map(at),
            field: at("FieldVoltage"),
            encoders: ["Enc0", "Enc1"].map(at),
            switches: layout
                .address("Output_Source")
                .zip(layout.address("Output_Sink"))
                .map(Into::into),
        }
    }
}

impl FieldIo {
    /// A 7I77's field I/O: outputs are high-side drivers.
    pub fn i7i77() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Device::remote(&Self::description()?, Self::new(false))
    }

    /// A 7I77D's field I/O: outputs are low-side drivers.
    pub fn i7i77d() -> Result<SimRemote<Device<Self>>, DescriptionError> {
        Device::remote(&Self::description()?, Self::new(true))
    }

    /// The description of both; change its unit number to distinguish two cards.
    pub fn description() -> Result<Description, DescriptionError> {
        Description::parse(DESCRIPTION)
    }

    /// Terminals with 24 V of field power, all inputs at 0 V.
    pub fn new(sinking: bool) -> Self {
        let switches = if sinking {
            Switches::SINKING
        } else {
            Switches::SOURCING
        };
        Self {
            switches,
            mpg_mode: MPG_MODE,
            spindle: None,
            power: FieldPower::new(),
            volts: [0.0; INPUTS],
            sensed: 0,
            drivers: Drivers::new(OUTPUTS),
            mpgs: [Mpg::default(); 2],
            mode: 0,
            places: Places::default(),
        }
    }

    /// The terminals of a card with another MPG mode, and an optional spindle output.
    pub(super) fn of_relative(mpg_mode: u8, spindle: Option<Spindle>) -> Self {
        Self {
            mpg_mode,
            spindle,
            ..Self::new(false)
        }
    }

    /// Voltage of the spindle output of a 7I76, 0 V while its enable is off; `None` for other
    /// cards.
    pub fn spindle_volts(&self) -> Option<f64> {
        self.spindle.as_ref().map(Spindle::volts)
    }

    /// The spindle output of a 7I76 as a drive sees it: negative while its direction output is on;
    /// `None` for other cards.
    pub fn spindle(&self) -> Option<DriveSignal> {
        self.spindle.as_ref().map(Spindle::signal)
    }

    /// True if output `n` only sinks (7I77D) instead of sourcing.
    pub const fn is_sinking(&self, n: usize) -> bool {
        self.switches.source >> n & 1 == 0 && self.switches.conducts(n)
    }

    /// Gives VIN its own supply (the default) or connects it to field power. With its own supply
    /// the card survives the loss of field power and can report it. Manual: 7I77, "FIELD VOLTAGE
    /// MONITORING".
    pub const fn set_separate_vin(&mut self, separate: bool) {
        self.power.separate_vin = separate;
    }

    /// Voltage on output terminal `n` with a load: to ground if it sources, to field power if it
    /// only sinks.
    pub fn output_volts(&self, n: usize) -> Option<f64> {
        let on = self.drivers.is_on(n)?;
        Some(if self.switches.is_high(n, on) {
            self.power.volts
        } else {
            0.0
        })
    }

    /// Thresholds of input `n`: off at or below the first, on at or above the second.
    ///
    /// Manual: 7I77, "FIELD INPUT CHARACTERISTICS": 40 % and 60 % of field power; "MPG INPUTS": 2.5
    /// V, taken as the middle of the same hysteresis for a supply of 5 V.
    fn thresholds(&self, n: usize) -> (f64, f64) {
        let mpg = MPG_INPUTS.iter().any(|&a| n == a || n == a + 1);
        let supply = if mpg && self.mode == self.mpg_mode {
            5.0
        } else {
            self.power.volts.max(1.0)
        };
        (0.4 * supply, 0.6 * supply)
    }

    fn sense(&mut self, n: usize) {
        let (off, on) = self.thresholds(n);
        let Some(&volts) = self.volts.get(n) else {
            return;
        };
        if volts >= on {
            self.sensed |= 1 << n;
        } else if volts <= off {
            self.sensed &= !(1 << n);
        }
        for (mpg, a) in self.mpgs.iter_mut().zip(MPG_INPUTS) {
            let level = |input: usize| self.sensed >> input & 1 != 0;
            mpg.update(Quadrature {
                a: level(a),
                b: level(a + 1),
            });
        }
    }

    fn sense_all(&mut self) {
        for n in 0..INPUTS {
            self.sense(n);
        }
    }

    fn check_input(n: usize) -> Result<(), WorldError> {
        if n < INPUTS {
            Ok(())
        } else {
            Err(WorldError::NoSuchInput {
                index: n,
                count: INPUTS,
            })
        }
    }
}

impl World for FieldIo {
    fn power_up(&mut self, layout: &SimLayout, memory: &SimMemory) {
        self.places = Places::new(layout);
        if let Some(spindle) = &mut self.spindle {
            spindle.power_up(layout);
        }
        self.sensed = 0;
        self.mode = 0;
        self.sense_all();
        for (mpg, name) in self.mpgs.iter_mut().zip(["EncMode0", "EncMode1"]) {
            mpg.count = 0;
            let mode = layout.address(name).map(|address| memory.byte(address));
            mpg.every_edge = mode.is_some_and(|mode| mode != 0);
        }
    }

    fn sample(&mut self, mode: u8, _layout: &SimLayout, memory: &mut SimMemory) {
        if self.mode != mode {
            self.mode = mode;
            self.sense_all();
        }
        let places = self.places;
        memory.set_word(places.input, 4, u64::from(self.sensed));
        for (address, &volts) in places.analog.into_iter().zip(&self.volts) {
            memory.set_word(address, 1, convert(volts));
        }
        memory.set_word(places.field, 1, convert(self.power.volts));
        for (address, mpg) in places.encoders.into_iter().zip(&self.mpgs) {
            memory.set_byte(address, mpg.count);
        }
    }

    fn drive(&mut self, _layout: &SimLayout, memory: &SimMemory) {
        if let Some(masks) = self.places.switches {
            let [source, sink] = masks.map(|address| memory.word(address, 2));
            self.switches = Switches { source, sink };
        }
        self.drivers.command(memory.word(self.places.output, 2));
        if let Some(spindle) = &mut self.spindle {
            spindle.drive(memory);
        }
    }

    fn off(&mut self) {
        self.drivers.off();
        if let Some(spindle) = &mut self.spindle {
            spindle.off();
        }
    }

    fn faults(&self) -> RemoteFaults {
        self.power.faults() | self.drivers.faults()
    }

    fn faults_cleared(&mut self) {
        self.drivers.faults_cleared();
    }

    fn is_supplied(&self) -> bool {
        self.power.supplies_processor()
    }

    fn set_input(&mut self, n: usize, on: bool) -> Result<(), WorldError> {
        let volts = self.power.volts.max(5.0);
        self.set_input_volts(n, if on { volts } else { 0.0 })
    }

    fn set_input_volts(&mut self, n: usize, volts: f64) -> Result<(), WorldError> {
        Self::check_input(n)?;
        if let Some(input) = self.volts.get_mut(n) {
            *input = volts;
        }
        self.sense(n);
        Ok(())
    }

    fn set_field_volts(&mut self, volts: f64) -> Result<(), WorldError> {
        self.power.volts = volts.max(0.0);
        self.sense_all();
        Ok(())
    }

    fn set_over_current(&mut self, n: usize, shorted: bool) -> Result<(), WorldError> {
        self.drivers.set_shorted(n, shorted)
    }

    fn set_over_temperature(&mut self, n: usize, hot: bool) -> Result<(), WorldError> {
        self.drivers.set_hot(n, hot)
    }

    fn inputs(&self, _layout: &SimLayout) -> Vec<(String, SignalValue)> {
        let bits = (0..INPUTS).map(|n| {
            let on = self.sensed >> n & 1 != 0;
            (format!("input-{n:02}"), SignalValue::Bool(on))
        });
        let analog = self.volts.iter().take(4).enumerate();
        let analog = analog.map(|(n, &v)| (format!("analogin{n}"), SignalValue::Volts(v)));
        let field = (
            "fieldvoltage".to_owned(),
            SignalValue::Volts(self.power.volts),
        );
        let mpgs = self.mpgs.iter().enumerate();
        let mpgs = mpgs.map(|(n, mpg)| (format!("enc{n}"), SignalValue::Count(mpg.count.into())));
        bits.chain(analog).chain([field]).chain(mpgs).collect()
    }

    fn outputs(&self, _layout: &SimLayout) -> Vec<(String, SignalValue)> {
        let outputs = (0..OUTPUTS).map(|n| {
            let on = self.output(n) == Some(true);
            (format!("output-{n:02}"), SignalValue::Bool(on))
        });
        let spindle = self.spindle.iter().flat_map(Spindle::outputs);
        outputs.chain(spindle).collect()
    }

    fn analog_output(&self, n: usize) -> Option<f64> {
        self.spindle_volts().filter(|_| n == 0)
    }

    /// True if current can flow through the load: the switch is on and field power is present.
    fn output(&self, n: usize) -> Option<bool> {
        let on = self.drivers.is_on(n)? && self.switches.conducts(n);
        Some(on && self.power.volts >= 1.0)
    }
}

/// Conversion to 8 bits over the full scale.
fn convert(volts: f64) -> u64 {
    (volts / FULL_SCALE * 255.0).round().clamp(0.0, 255.0) as u64
}

/// Levels of two lines in quadrature.
#[derive(Clone, Copy, Debug, Default)]
struct Quadrature {
    a: bool,
    b: bool,
}

impl Quadrature {
    /// Position within a cycle: 0 to 3.
    fn phase(self) -> u8 {
        u8::from(self.b) << 1 | u8::from(self.a ^ self.b)
    }
}

/// A manual pulse generator: a counter of quadrature.
#[derive(Clone, Copy, Debug, Default)]
struct Mpg {
    count: u8,
    every_edge: bool,
    lines: Quadrature,
}

impl Mpg {
    /// Counts up if A leads B. 1X counts the edges of A while B is low, so that a bouncing A does
    /// not accumulate; 4X counts all edges.
    fn update(&mut self, lines: Quadrature) {
        let before = core::mem::replace(&mut self.lines, lines);
        let step = lines.phase().wrapping_sub(before.phase()) & 3;
        let up = match step {
            1 => true,
            3 => false,
            _ => return,
        };
        if self.every_edge || (lines.a != before.a && !lines.b) {
            self.count = if up {
                self.count.wrapping_add(1)
            } else {
                self.count.wrapping_sub(1)
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_switch_at_60_and_40_percent_of_field_power() {
        // Manual 7I77, "FIELD INPUT CHARACTERISTICS": 14.4 V and 9.6 V at 24 V.
        let mut world = FieldIo::new(false);
        for (volts, on) in [
            (14.3, false),
            (14.5, true),
            (9.7, true),
            (9.5, false),
            (14.3, false),
        ] {
            world.set_input_volts(5, volts).unwrap();
            assert_eq!(world.sensed, u32::from(on) << 5, "{volts} V");
        }
        world.set_field_volts(12.0).unwrap();
        world.set_input_volts(5, 7.3).unwrap();
        assert_eq!(world.sensed, 1 << 5);
        assert!(world.set_input_volts(32, 1.0).is_err());
    }

    #[test]
    fn quadrature_cycle_is_one_count_or_four() {
        for (every_edge, expected) in [(false, 3), (true, 12)] {
            let mut mpg = Mpg {
                every_edge,
                ..Mpg::default()
            };
            for _ in 0..3 {
                for (a, b) in [(true, false), (true, true), (false, true), (false, false)] {
                    mpg.update(Quadrature { a, b });
                }
            }
            assert_eq!(mpg.count, expected);
            for _ in 0..4 {
                for (a, b) in [(false, true), (true, true), (true, false), (false, false)] {
                    mpg.update(Quadrature { a, b });
                }
            }
            let back = if every_edge { 16 } else { 4 };
            assert_eq!(mpg.count, expected.wrapping_sub(back));
        }
    }

    #[test]
    fn sinking_outputs_pull_the_load_to_ground() {
        for sinking in [false, true] {
            let mut world = FieldIo::new(sinking);
            world.drivers.command(1);
            let (on, off) = if sinking { (0.0, 24.0) } else { (24.0, 0.0) };
            assert_eq!(world.output_volts(0), Some(on));
            assert_eq!(world.output_volts(1), Some(off));
            assert_eq!(world.output(0), Some(true));
            world.set_field_volts(0.0).unwrap();
            assert_eq!(world.output(0), Some(false), "no field power, no current");
        }
    }
}
