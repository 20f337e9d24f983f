//! The simulated machines.

use mesa_hal_sim::devices::{Analog, Description, Device, FieldIo, Outputs48};
use mesa_hal_sim::remote::Cable;
use mesa_hal_sim::wire::RemoteEnd;
use mesa_hal_sim::{
    AxisWiring, DriveSource, Motor, MotorConfig, OUTPUT_PIN, SimFirmware, SimFpga,
    SimModuleDescriptor, SimPinDescriptor, Stepper, StepperConfig, StepperWiring, gtag, machines,
};

use super::journal::{Journal, Outputs, PORTS, Recorder};
use super::plan::{Board, Card, Plan, Steppers};

/// The machine of a plan, and those of its pins that the application uses.
pub fn machine(plan: &Plan, journal: &Journal) -> (SimFpga, Gpio) {
    let mut firmware = firmware(plan);
    let gpio = Gpio::of(&firmware);
    add_step_generators(&mut firmware, plan);
    let clocks = [firmware.clock_low, firmware.clock_high].map(nominal);
    let mut fpga = SimFpga::new(quickened(firmware, plan.extras.ppm));
    // The clocks according to the firmware.
    for (address, hz) in [CLOCK_LOW, CLOCK_HIGH].into_iter().zip(clocks) {
        fpga.override_rom(address, hz);
    }
    for remote in 0..plan.remotes() {
        let (port, channel) = plan.place(remote);
        let watchdog = plan.extras.remote_watchdog;
        let end = end(plan.card(remote), (remote, remote), watchdog, journal);
        fpga.plug(port, channel, Some(end));
    }
    for axis in 0..axes(plan, &mut fpga) {
        let config = MotorConfig::default();
        let config = MotorConfig {
            counts_per_revolution: plan.extras.turn,
            position: plan.begins_at(axis) / config.counts_per_unit,
            ..config
        };
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Nothing,
            encoder: axis,
            motor: Motor::new(config).expect("a motor"),
        });
    }
    for generator in 0..plan.steppers.count.into() {
        fpga.wire_stepper(StepperWiring {
            generator,
            encoder: None,
            motor: Stepper::new(StepperConfig {
                max_acceleration: f64::INFINITY,
                start_speed: f64::INFINITY,
                max_speed: f64::INFINITY,
                ..StepperConfig::default()
            })
            .expect("a motor"),
        });
    }
    (fpga, gpio)
}

/// Adds the step generators of a plan, on a connector of their own, unless the firmware has them.
fn add_step_generators(firmware: &mut SimFirmware, plan: &Plan) {
    let Steppers { count, version, .. } = plan.steppers;
    if count == 0 || plan.steppers.is_7i76 {
        return;
    }
    let module = SimModuleDescriptor {
        gtag: gtag::STEPGEN,
        version,
        instances: count,
        base: 0x2000,
        registers: 10,
        multiple: 0x1FF,
        ..SimModuleDescriptor::default()
    };
    firmware.modules.push(module);
    let before = firmware.pins.len();
    for unit in 0..count {
        for output in [2, 1] {
            let pin = SimPinDescriptor::new(gtag::STEPGEN, unit, OUTPUT_PIN | output);
            firmware.pins.push(pin);
        }
    }
    let width = firmware.port_width as usize;
    firmware
        .pins
        .resize(before + width, SimPinDescriptor::gpio());
    firmware.ports += 1;
    if let Some(ports) = firmware.module_mut(gtag::IO_PORT) {
        ports.instances += 1;
    }
}

/// The words of the IDROM that contain the clock frequencies (FACTS 2.2).
pub const CLOCK_LOW: u16 = 0x0428;
const CLOCK_HIGH: u16 = 0x042C;

/// The nominal frequency of a clock that is slightly faster or slower: whole tenths of a MHz.
pub fn nominal(clock: u32) -> u32 {
    (clock + 50_000) / 100_000 * 100_000
}

/// A firmware whose oscillator is faster by `ppm` parts per million.
fn quickened(mut firmware: SimFirmware, ppm: i64) -> SimFirmware {
    for clock in [&mut firmware.clock_low, &mut firmware.clock_high] {
        *clock = (i64::from(*clock) + i64::from(*clock) * ppm / 1_000_000) as u32;
    }
    firmware
}

/// Number of motors that have encoders.
fn axes(plan: &Plan, fpga: &mut SimFpga) -> usize {
    let encoders = fpga.encoders().map_or(0, |bank| bank.encoders());
    plan.extras.axes.min(encoders)
}

/// A card at the end of a cable; `unit` distinguishes cards of the same kind.
pub fn end(
    card: Card,
    (number, unit): (usize, usize),
    watchdog: u64,
    journal: &Journal,
) -> Box<dyn RemoteEnd> {
    let remote = remote(card, unit, watchdog);
    let recorder = Recorder::new(remote, number, card, journal);
    Box::new(Cable::new(Box::new(recorder), unit as u64))
}

/// The cards of a machine differ in their unit numbers.
fn remote(card: Card, unit: usize, watchdog: u64) -> Box<dyn RemoteEnd> {
    let known = "known to the simulator";
    let mut description = description(card);
    description.unit += unit as u32;
    let mut parameters = description.parameters.iter_mut();
    if let Some(own) = parameters.find(|own| own.record.name == "NVWatchDogTimeout") {
        own.value = watchdog;
    }
    match card {
        Card::Field => Box::new(Device::remote(&description, FieldIo::new(false)).expect(known)),
        Card::Field76 => Box::new(FieldIo::with_spindle(&description).expect(known)),
        Card::Analog => Box::new(Device::remote(&description, Analog::default()).expect(known)),
        Card::Outputs => Box::new(Device::remote(&description, Outputs48::default()).expect(known)),
    }
}

fn description(card: Card) -> Description {
    let description = match card {
        Card::Field => FieldIo::description(),
        Card::Field76 => FieldIo::description_7i76(),
        Card::Analog => Analog::description(),
        Card::Outputs => Outputs48::description(),
    };
    description.expect("known to the simulator")
}

/// The unit number of the card of remote `number`.
pub fn unit_number(card: Card, number: usize) -> u32 {
    description(card).unit + number as u32
}

fn firmware(plan: &Plan) -> SimFirmware {
    let mut firmware = plain_firmware(plan);
    if plan.extras.dithers
        && let Some(pwm) = firmware.module_mut(gtag::PWM)
    {
        pwm.version = 1;
    }
    firmware
}

fn plain_firmware(plan: &Plan) -> SimFirmware {
    let channels: Vec<u8> = plan.ports.iter().map(|cards| cards.len() as u8).collect();
    match (plan.board, &channels[..]) {
        (Board::I7i92, _) if plan.steppers.is_7i76 => machines::firmware_7i92_7i76(),
        (Board::I7i97, _) if plan.steppers.is_7i76 => machines::firmware_7i97_7i76(),
        (Board::I7i92, [1..=3]) => machines::firmware_7i92_7i77(),
        (Board::I7i92, _) => {
            let mut firmware = machines::firmware_serial(&channels);
            firmware.board = *b"MESA7I92";
            firmware
        }
        (Board::I7i97, [only]) => machines::firmware_7i97(*only),
        (Board::I7i97, [first, more @ ..]) => with_ports(machines::firmware_7i97(*first), more),
        (Board::I7i97, []) => machines::firmware_7i97(1),
    }
}

/// A firmware with more serial ports, on more pins.
fn with_ports(mut firmware: SimFirmware, more: &[u8]) -> SimFirmware {
    for (unit, count) in (1..).zip(more) {
        for channel in 0..*count {
            firmware
                .pins
                .push(SimPinDescriptor::new(gtag::SSERIAL, unit, 1 + channel));
            let transmit = OUTPUT_PIN | (1 + channel);
            firmware
                .pins
                .push(SimPinDescriptor::new(gtag::SSERIAL, unit, transmit));
        }
    }
    let width = firmware.port_width as usize;
    let ports = firmware.pins.len().div_ceil(width);
    firmware
        .pins
        .resize(ports * width, SimPinDescriptor::gpio());
    firmware.ports = ports as u32;
    for module in &mut firmware.modules {
        match module.gtag {
            gtag::IO_PORT => module.instances = ports as u8,
            gtag::SSERIAL => module.instances = 1 + more.len() as u8,
            _ => {}
        }
    }
    firmware
}

/// The pins that no module uses: every other one is an output.
#[derive(Clone, Debug)]
pub struct Gpio {
    pub outputs: Vec<usize>,
    pub inputs: Vec<usize>,
    pub width: usize,
}

impl Gpio {
    fn of(firmware: &SimFirmware) -> Self {
        let pins = firmware.pins.iter().enumerate();
        let free: Vec<_> = pins
            .filter(|(_, pin)| pin.secondary == 0)
            .map(|(n, _)| n)
            .collect();
        let half = |rest| {
            free.iter()
                .copied()
                .filter(move |n| n % 2 == rest)
                .collect()
        };
        Self {
            outputs: half(0),
            inputs: half(1),
            width: firmware.port_width as usize,
        }
    }

    pub fn driven(&self) -> Outputs {
        let mut gpio = [0; PORTS];
        for pin in &self.outputs {
            gpio[pin / self.width] |= 1 << (pin % self.width);
        }
        Outputs {
            port_width: self.width,
            gpio,
        }
    }
}
