//! Positions after faults, on each bus, compared with the motors: the counters of the board run on.

mod at_the_start;
mod encoders;
mod followed;
mod steppers;

use std::time::Duration;

use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::{BoardState, Driver, EventKind, Events, Positions, Settings};
use mesa_hal::modules::encoder::{EncoderPins, Encoders};
use mesa_hal::modules::stepgen::{StepgenPins, Stepgens};
use mesa_hal::transport::udp::UdpBus;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::{
    AxisWiring, BoardConfig, DEFAULT_ACCESS_COST, DriveSource, Motor, MotorConfig, SimBoard,
    SimFpga, SimPciBus, Stepper, StepperConfig, StepperWiring, machines,
};

use crate::common::ethernet::{self, SimLink, cut, good};
use crate::common::machine::World;
use crate::common::watch::Watch;

/// Failed exchanges after which the bus is down: for longer than the shortest troubles.
const LIMIT: u32 = 60;
/// Longer than the times in which a bus fails without a bite.
const WATCHDOG: Duration = Duration::from_millis(100);
const SCALE: f64 = 1_000.0;

/// A bus that can fail for a while.
trait Rig: World {
    /// Loses everything, in both directions.
    fn cut(&mut self);
    /// Loses what comes from the board.
    fn deafen(&mut self);
    fn mend(&mut self);
}

impl Rig for Faulty<SimFpga> {
    fn cut(&mut self) {
        self.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
    }

    fn deafen(&mut self) {
        self.fail_randomly(Fault::Executed(BusErrorKind::Late), 1.0);
    }

    fn mend(&mut self) {
        self.heal();
    }
}

impl Rig for UdpBus<SimLink> {
    fn cut(&mut self) {
        self.link().to_board = cut();
    }

    fn deafen(&mut self) {
        self.link().to_host = cut();
    }

    fn mend(&mut self) {
        (self.link().to_board, self.link().to_host) = (good(), good());
    }
}

impl Rig for Faulty<SimPciBus> {
    fn cut(&mut self) {
        self.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
    }

    fn deafen(&mut self) {
        self.fail_randomly(Fault::Executed(BusErrorKind::Late), 1.0);
    }

    fn mend(&mut self) {
        self.heal();
    }
}

impl World for Faulty<SimPciBus> {
    fn fpga(&mut self) -> &mut SimFpga {
        self.inner.board.gateware_mut()
    }
}

/// A fault of a moving machine, and the time for which it lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The bus loses everything.
    Cut(u64),
    /// The bus loses all replies.
    Deaf(u64),
    /// The host stops.
    Stall(u64),
    /// The host stops between read and write, and the write gives another time to the watchdog.
    Retimed(u64),
    /// The board is reset.
    Reset,
    /// The host stops, and the board is reset meanwhile: the first write lets it bite.
    ResetInStall(u64),
}

/// A board, a motor on an encoder and one on a step generator.
struct Machine<B: Rig> {
    driver: Driver<B>,
    encoder: EncoderPins,
    /// The motor of the encoder.
    axis: usize,
    generator: Option<StepgenPins>,
    events: Events,
    name: String,
}

/// With a 7I76: a plain encoder, and step generators.
fn plain() -> SimFpga {
    let mut fpga = machines::i7i92_7i76();
    let motor = Motor::new(MotorConfig::default()).expect("a motor");
    fpga.wire_axis(AxisWiring {
        source: DriveSource::Nothing,
        encoder: 0,
        motor,
    });
    let motor = Stepper::new(StepperConfig {
        max_acceleration: f64::INFINITY,
        start_speed: f64::INFINITY,
        max_speed: f64::INFINITY,
        ..StepperConfig::default()
    });
    fpga.wire_stepper(StepperWiring {
        generator: 0,
        encoder: None,
        motor: motor.expect("a motor"),
    });
    fpga
}

/// With a 7I77: encoders with a select line.
fn muxed() -> SimFpga {
    machines::six_axes_7i92(Motor::new(MotorConfig::default()).expect("a motor"))
}

fn embedded(fpga: SimFpga) -> Faulty<SimFpga> {
    Faulty::new(fpga, 1)
}

fn network(fpga: SimFpga) -> UdpBus<SimLink> {
    ethernet::bus(fpga)
}

fn pci(fpga: SimFpga) -> Faulty<SimPciBus> {
    let board = SimBoard::new(BoardConfig::new("5I25"), fpga);
    Faulty::new(SimPciBus::new(board), 1)
}

impl<B: Rig> Machine<B> {
    /// Of which no packet of the set-up is in flight.
    fn new(bus: B, name: &str) -> Self {
        let mut machine = Self::fresh(bus, name);
        machine.cycles(150);
        machine
    }

    /// Before the first cycle.
    fn fresh(bus: B, name: &str) -> Self {
        let settings = Settings {
            watchdog: Some(WATCHDOG),
            bus_error_limit: LIMIT,
            ..Settings::default()
        };
        let driver = Driver::start(bus, settings).expect("it starts");
        let encoders = driver.modules::<Encoders>().next().expect("encoders");
        // Of a multiplexed pair the one that is still seen while the select line is released.
        let axis = usize::from(encoders.pins().len() > 1);
        let encoder = encoders.pins().nth(axis).expect("an encoder");
        let generators = driver.modules::<Stepgens>().next();
        let generator = generators.and_then(|all| all.pins().next());
        let mut machine = Self {
            events: driver.events(),
            driver,
            encoder,
            axis,
            generator,
            name: name.into(),
        };
        if let Some(pins) = machine.generator {
            let to = machine.driver.pins_mut();
            let params = [
                (pins.position_scale, SCALE),
                (pins.maxvel, 20.0),
                (pins.maxaccel, 1e3),
            ];
            for (param, value) in params {
                to.set_param(param, value).expect("a value");
            }
            for time in [pins.steplen, pins.stepspace, pins.dirsetup, pins.dirhold] {
                to.set_param(time, 2_500).expect("a time");
            }
        }
        machine
    }

    fn cycle(&mut self) {
        let _ = self.driver.read();
        let _ = self.driver.write();
        self.rest();
    }

    fn rest(&mut self) {
        let bus = self.driver.bus_mut();
        let rest = 1_000_000 - bus.now().as_nanos() % 1_000_000;
        bus.wait(Duration::from_nanos(rest));
    }

    fn cycles(&mut self, count: u64) {
        for _ in 0..count {
            self.cycle();
        }
    }

    fn wait(&mut self, ms: u64) {
        self.driver.bus_mut().wait(Duration::from_millis(ms));
    }

    fn happens(&mut self, trouble: Trouble) {
        match trouble {
            Trouble::Cut(ms) => {
                self.driver.bus_mut().cut();
                self.cycles(ms);
                self.driver.bus_mut().mend();
            }
            Trouble::Deaf(ms) => {
                self.driver.bus_mut().deafen();
                self.cycles(ms);
                self.driver.bus_mut().mend();
            }
            Trouble::Stall(ms) => self.wait(ms),
            Trouble::Retimed(ms) => {
                let _ = self.driver.read();
                self.retime(WATCHDOG / 2);
                self.wait(ms);
                let _ = self.driver.write();
                self.cycle();
                self.retime(WATCHDOG);
            }
            Trouble::Reset => self.driver.bus_mut().fpga().reload(),
            Trouble::ResetInStall(ms) => {
                self.wait(ms / 2);
                self.driver.bus_mut().fpga().reload();
                self.wait(ms / 2);
            }
        }
    }

    /// Sets the time of the board's watchdog.
    fn retime(&mut self, time: Duration) {
        let name = format!("{}.watchdog.timeout_ns", self.driver.name());
        let nanos = u32::try_from(time.as_nanos()).expect("a short time");
        let param = self
            .driver
            .pins()
            .parameter::<u32>(&name)
            .expect("it is there");
        let done = self.driver.pins_mut().set_param(param, nanos);
        done.expect("a time within the limits");
    }

    /// The machine is re-armed, if it has to be.
    fn comes_back(&mut self) {
        for _ in 0..5 {
            self.cycle();
            if self.driver.board_state() != BoardState::Running {
                let _ = self.driver.rearm();
            }
        }
        assert_eq!(
            self.driver.board_state(),
            BoardState::Running,
            "{}",
            self.name
        );
    }

    /// The numbers of the counters of a kind whose positions were reported to be unsure.
    fn told(&mut self, kind: Positions) -> u32 {
        let masks = self.events.by_ref().filter_map(|event| match event.kind {
            EventKind::PositionUnsure { of, first: 0, mask } if of == kind => Some(mask),
            _ => None,
        });
        masks.fold(0, |all, mask| all | mask)
    }
}
