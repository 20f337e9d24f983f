//! A simulated board with its driver on virtual time. Every remote is at the end of a cable that
//! can fail.

use std::time::Duration;

use mesa_hal::boards::{I7i72, I7i77Analog, I7i77Field, I7i97};
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{
    CycleReport, Driver, DriverError, Pace, RemoteState, RemoteStatus, Settings,
};
use mesa_hal::hal::{Input, Output, Param, Pins, Reading, Value};
use mesa_hal::sslbp::Channel;
use mesa_hal::transport::udp::UdpBus;
use mesa_hal::transport::{Faulty, Recording};
use mesa_hal_sim::devices::{Device, FieldIo, SimDevice, find, find_cable, find_mut};
use mesa_hal_sim::remote::Cable;
use mesa_hal_sim::wire::RemoteEnd;
use mesa_hal_sim::{SimFpga, SimPciBus, machines};

use super::ethernet::SimLink;

pub const FIELD: usize = 0;
pub const ANALOG: usize = 1;
pub const OUTPUTS: usize = 2;

/// The simulated FPGA with its three remotes.
pub fn fpga() -> SimFpga {
    machines::i7i92_with_cards()
}

/// The same FPGA with another remote on the channel of the field I/O.
pub fn fpga_with_field(field: Box<dyn RemoteEnd>) -> SimFpga {
    let mut fpga = fpga();
    fpga.plug(0, FIELD, Some(Box::new(Cable::new(field, 0))));
    fpga
}

/// The device on a channel.
pub fn device(fpga: &SimFpga, channel: usize) -> &dyn SimDevice {
    find(fpga.remote(0, channel).expect("remote")).expect("device")
}

/// A bus with a simulated FPGA at its end.
pub trait World: RegisterBus + Clock {
    fn fpga(&mut self) -> &mut SimFpga;

    /// The whole board loses its configuration, and gets it back after this time.
    fn reset_for(&mut self, nanos: u64) {
        match nanos {
            0 => self.fpga().reload(),
            _ => self.fpga().reset_for(nanos),
        }
    }
}

/// A bus whose FPGA can be inspected without an access to the bus.
pub trait Embedded: World {
    fn look(&self) -> &SimFpga;
}

impl World for SimFpga {
    fn fpga(&mut self) -> &mut SimFpga {
        self
    }
}

impl Embedded for SimFpga {
    fn look(&self) -> &SimFpga {
        self
    }
}

impl World for Faulty<SimFpga> {
    fn fpga(&mut self) -> &mut SimFpga {
        &mut self.inner
    }
}

impl Embedded for Faulty<SimFpga> {
    fn look(&self) -> &SimFpga {
        &self.inner
    }
}

impl<B: World> World for Recording<B> {
    fn fpga(&mut self) -> &mut SimFpga {
        self.inner.fpga()
    }
}

impl<B: Embedded> Embedded for Recording<B> {
    fn look(&self) -> &SimFpga {
        self.inner.look()
    }
}

impl World for UdpBus<SimLink> {
    fn fpga(&mut self) -> &mut SimFpga {
        self.link().board.gateware_mut()
    }

    fn reset_for(&mut self, nanos: u64) {
        let link = self.link();
        let now = link.time();
        link.resets.push((now, nanos));
    }
}

impl World for SimPciBus {
    fn fpga(&mut self) -> &mut SimFpga {
        self.board.gateware_mut()
    }
}

/// Starts a driver with the default settings, modified by `change`.
pub fn start<B: RegisterBus + Clock>(
    bus: B,
    change: impl FnOnce(&mut Settings),
) -> Result<Driver<B>, DriverError> {
    let mut settings = Settings::default();
    change(&mut settings);
    Driver::start(bus, settings)
}

/// The handles of an application for a board.
pub trait Cards {
    fn of<B: World>(driver: &Driver<B>) -> Self;
}

/// A 7I77 and a 7I72 on channels 0 to 2.
#[derive(Clone, Debug)]
pub struct Remotes {
    pub field: I7i77Field,
    pub analog: I7i77Analog,
    pub outputs: I7i72,
}

impl Remotes {
    /// Switches an output of each card on: 3 of the field I/O, 7 of the 7I72, and 5 V on output 1.
    pub fn set_one_of_each(&self, pins: &mut Pins) {
        pins.set(self.field.outputs[3].pin, true);
        pins.set(self.outputs.outputs[7].pin, true);
        pins.set(self.analog.analog_out[1].volts, 5.0);
        pins.set(self.analog.analogena.pin, true);
    }

    /// Switches all outputs on, analog outputs at 5 V.
    pub fn set_all(&self, pins: &mut Pins) {
        for output in self.field.outputs {
            pins.set(output.pin, true);
        }
        for output in self.outputs.outputs {
            pins.set(output.pin, true);
        }
        for output in self.analog.analog_out {
            pins.set(output.volts, 5.0);
        }
        pins.set(self.analog.analogena.pin, true);
        pins.set(self.analog.spinena.pin, true);
    }
}

impl Cards for Remotes {
    fn of<B: World>(driver: &Driver<B>) -> Self {
        Self {
            field: driver.attach((0, FIELD as u8)).expect("field I/O"),
            analog: driver.attach((0, ANALOG as u8)).expect("analog outputs"),
            outputs: driver.attach((0, OUTPUTS as u8)).expect("outputs"),
        }
    }
}

/// No handles: for a test that finds pins by their names.
impl Cards for () {
    fn of<B: World>(_: &Driver<B>) -> Self {}
}

impl Cards for I7i97 {
    fn of<B: World>(driver: &Driver<B>) -> Self {
        driver.attach_board().expect("a 7I97")
    }
}

fn status<B: World>(driver: &Driver<B>, channel: usize) -> RemoteStatus<'_> {
    let channel = Channel::new(channel as u8).expect("channel");
    let port = driver.ports().first().expect("port");
    port.remote(channel).expect("remote")
}

/// A board with its driver, on virtual time.
#[derive(Debug)]
pub struct Machine<B: World = SimFpga, C = Remotes> {
    pub driver: Driver<B>,
    pub cards: C,
    pub period: Duration,
    /// At the board's pace, cycles follow each other without a pause.
    pub pace: Pace,
}

impl Machine {
    /// The machine of the README with all remotes in mode 0 and a cycle of 1 ms.
    pub fn new() -> Self {
        Self::build(|_| {})
    }

    pub fn build(change: impl FnOnce(&mut Settings)) -> Self {
        Self::on(fpga(), change)
    }
}

impl<B: World> Machine<B> {
    pub fn with(driver: Driver<B>) -> Self {
        Self::of(driver)
    }
}

impl<B: World, C: Cards> Machine<B, C> {
    pub fn on(bus: B, change: impl FnOnce(&mut Settings)) -> Self {
        Self::of(start(bus, change).expect("the machine is complete"))
    }

    pub fn of(driver: Driver<B>) -> Self {
        Self {
            cards: C::of(&driver),
            period: driver.period(),
            pace: Pace::Host,
            driver,
        }
    }
}

impl<B: World, C> Machine<B, C> {
    /// Runs one period: read, write, and the rest of the time.
    pub fn cycle(&mut self) -> CycleReport {
        let report = self.driver.read().expect("the bus does not fail");
        self.finish();
        report
    }

    /// The write, and the rest of the period.
    pub fn finish(&mut self) {
        self.driver.write().expect("the bus does not fail");
        self.rest();
    }

    /// Waits for the next period, so that periods do not grow by the time of accesses.
    pub fn rest(&mut self) {
        if self.pace == Pace::Host {
            self.pass(self.period);
        }
    }

    /// Waits for the next multiple of `time`.
    pub fn pass(&mut self, time: Duration) {
        let bus = self.driver.bus_mut();
        let time = time.as_nanos() as u64;
        let rest = time - bus.now().as_nanos() % time;
        bus.wait(Duration::from_nanos(rest));
    }

    /// Lets some milliseconds pass without a cycle.
    pub fn sleep(&mut self, millis: u64) {
        self.pass_nanos(millis * 1_000_000);
    }

    pub fn pass_nanos(&mut self, nanos: u64) {
        self.driver.bus_mut().wait(Duration::from_nanos(nanos));
    }

    pub fn fpga(&mut self) -> &mut SimFpga {
        self.driver.bus_mut().fpga()
    }

    pub fn input<T: Value>(&self, name: &str) -> Input<T> {
        let pin = self.driver.pins().input(&self.full(name));
        pin.unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn output<T: Value>(&self, name: &str) -> Output<T> {
        let pin = self.driver.pins().output(&self.full(name));
        pin.unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn param<T: Value>(&self, name: &str) -> Param<T> {
        let pin = self.driver.pins().parameter(&self.full(name));
        pin.unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn set_param<T: Value>(&mut self, param: Param<T>, value: T) {
        let set = self.driver.pins_mut().set_param(param, value);
        set.expect("a value that it takes");
    }

    /// Turns a motor by hand, in units per second.
    pub fn turn(&mut self, axis: usize, velocity: f64) {
        let motor = self.fpga().motor(axis).expect("an axis");
        motor.turn_by_hand(Some(velocity));
    }

    fn full(&self, name: &str) -> String {
        format!("{}.{name}", self.driver.name())
    }

    pub fn cycles(&mut self, count: usize) {
        for _ in 0..count {
            let _ = self.cycle();
        }
    }

    /// Runs cycles until `done`; returns their number.
    pub fn until(&mut self, limit: usize, mut done: impl FnMut(&mut Self) -> bool) -> usize {
        for n in 0..limit {
            if done(self) {
                return n;
            }
            let _ = self.cycle();
        }
        panic!("not within {limit} cycles: {:#?}", self.status(FIELD).state);
    }

    /// Re-arms in each cycle until nothing is waiting.
    pub fn rearm_all(&mut self, limit: usize) {
        let is_done = |machine: &mut Self| {
            let rearmed = machine.driver.rearm();
            rearmed.is_ok_and(|rearmed| rearmed.waiting == 0)
        };
        self.until(limit, is_done);
    }

    pub fn status(&self, channel: usize) -> RemoteStatus<'_> {
        status(&self.driver, channel)
    }

    pub fn is_running(&self, channel: usize) -> bool {
        self.status(channel).state == RemoteState::Running
    }

    pub fn is_armed(&self, channel: usize) -> bool {
        let group = self.status(channel).pins.group;
        self.driver.pins().group_state(group).expect("group").armed
    }

    pub fn is_valid(&self, channel: usize) -> bool {
        let group = self.status(channel).pins.group;
        self.driver.pins().group_state(group).expect("group").valid
    }

    pub fn bit(&self, name: &str) -> bool {
        self.driver.pins().read(self.input(name)).value
    }

    pub fn cable(&mut self, channel: usize) -> &mut Cable {
        let end = self.fpga().remote_mut(0, channel).expect("remote");
        find_cable(end).expect("cable")
    }

    pub fn device_mut(&mut self, channel: usize) -> &mut dyn SimDevice {
        find_mut(self.fpga().remote_mut(0, channel).expect("remote")).expect("device")
    }
}

impl<B: World> Machine<B> {
    /// An input of the field I/O.
    pub fn field_input(&self, input: usize) -> Reading<bool> {
        let pin = self.cards.field.inputs[input].pin;
        self.driver.pins().read(pin)
    }
}

impl<B: Embedded, C> Machine<B, C> {
    pub fn now(&self) -> u64 {
        SimFpga::now(self.driver.bus().look())
    }

    pub fn device(&self, channel: usize) -> &dyn SimDevice {
        device(self.driver.bus().look(), channel)
    }
}

pub type FieldRemote = mesa_hal_sim::remote::SimRemote<Device<FieldIo>>;
