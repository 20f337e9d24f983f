//! The machine of the README for the tests of the cycle: a 7I92 with a 7I77 and a 7I72 on its
//! expansion port, every remote at the end of a cable that can fail.

use std::time::Duration;

use mesa_hal::boards::{I7i72, I7i77Analog, I7i77Field};
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{Builder, CycleReport, Driver, RemoteState, RemoteStatus};
use mesa_hal::sim::devices::{
    Analog, Device, FieldIo, Outputs48, SimDevice, find, find_cable, find_mut,
};
use mesa_hal::sim::remote::Cable;
use mesa_hal::sim::wire::RemoteEnd;
use mesa_hal::sim::{SimFpga, machines};
use mesa_hal::sslbp::Channel;
use mesa_hal::transport::Faulty;

pub const FIELD: usize = 0;
pub const ANALOG: usize = 1;
pub const OUTPUTS: usize = 2;

/// The simulated FPGA with its three remotes.
pub fn fpga() -> SimFpga {
    fpga_with_field(Box::new(FieldIo::i7i77().expect("7I77")))
}

/// The same with another end on the channel of the field I/O.
pub fn fpga_with_field(field: Box<dyn RemoteEnd>) -> SimFpga {
    let mut fpga = machines::i7i92_7i77();
    let analog = Analog::i7i77().expect("7I77");
    let outputs = Outputs48::i7i72().expect("7I72");
    let ends: [Box<dyn RemoteEnd>; 3] = [field, Box::new(analog), Box::new(outputs)];
    for (channel, end) in ends.into_iter().enumerate() {
        fpga.plug(0, channel, Some(Box::new(Cable::new(end, channel as u64))));
    }
    fpga
}

/// The machine with its driver.
#[derive(Debug)]
pub struct Machine<B: Simulated = SimFpga> {
    pub driver: Driver<B>,
    pub field: I7i77Field,
    pub analog: I7i77Analog,
    pub outputs: I7i72,
    pub period: Duration,
}

/// A bus with a simulated FPGA at its end.
pub trait Simulated: RegisterBus + Clock {
    fn sim(&self) -> &SimFpga;
    fn sim_mut(&mut self) -> &mut SimFpga;
}

impl Simulated for SimFpga {
    fn sim(&self) -> &SimFpga {
        self
    }

    fn sim_mut(&mut self) -> &mut SimFpga {
        self
    }
}

impl Simulated for Faulty<SimFpga> {
    fn sim(&self) -> &SimFpga {
        self.inner_ref()
    }

    fn sim_mut(&mut self) -> &mut SimFpga {
        self.inner()
    }
}

impl Machine {
    /// With all remotes in mode 0 and a cycle of 1 ms.
    pub fn new() -> Self {
        Self::build(|builder| builder)
    }

    pub fn build(configure: impl FnOnce(Builder<SimFpga>) -> Builder<SimFpga>) -> Self {
        let builder = configure(Driver::builder(fpga()));
        Self::with(builder.build().expect("the machine is complete"))
    }
}

impl<B: Simulated> Machine<B> {
    pub fn with(driver: Driver<B>) -> Self {
        let field = driver.attach(0, 0).expect("field I/O");
        let analog = driver.attach(0, 1).expect("analog outputs");
        let outputs = driver.attach(0, 2).expect("outputs");
        let period = driver.period();
        Self {
            driver,
            field,
            analog,
            outputs,
            period,
        }
    }

    /// One period: read, write, and the rest of the time.
    pub fn cycle(&mut self) -> CycleReport {
        let report = self.driver.read().expect("the bus does not fail");
        self.driver.write().expect("the bus does not fail");
        self.pass(self.period);
        report
    }

    /// Up to the next multiple of `time`, so that periods do not grow by what accesses cost.
    pub fn pass(&mut self, time: Duration) {
        let sim = self.driver.bus_mut().sim_mut();
        let period = time.as_nanos() as u64;
        let next = (SimFpga::now(sim) / period + 1) * period;
        sim.advance_to(next);
    }

    /// The application does nothing for some milliseconds.
    pub fn sleep(&mut self, millis: u64) {
        self.pass_nanos(millis * 1_000_000);
    }

    pub fn pass_nanos(&mut self, nanos: u64) {
        let sim = self.driver.bus_mut().sim_mut();
        let until = SimFpga::now(sim) + nanos;
        sim.advance_to(until);
    }

    pub fn now(&self) -> u64 {
        self.driver.bus().sim().now()
    }

    pub fn cycles(&mut self, count: usize) {
        for _ in 0..count {
            let _ = self.cycle();
        }
    }

    /// Cycles until `done`; how many it took.
    pub fn until(&mut self, limit: usize, mut done: impl FnMut(&mut Self) -> bool) -> usize {
        for n in 0..limit {
            if done(self) {
                return n;
            }
            let _ = self.cycle();
        }
        panic!(
            "not within {limit} cycles: {:#?}",
            self.status(FIELD).state()
        );
    }

    pub fn status(&self, channel: usize) -> RemoteStatus<'_> {
        let channel = Channel::new(channel as u8).expect("channel");
        let port = self.driver.ports().first().expect("port");
        port.remote(channel).expect("remote")
    }

    pub fn is_running(&self, channel: usize) -> bool {
        self.status(channel).state() == RemoteState::Running
    }

    pub fn is_armed(&self, channel: usize) -> bool {
        let group = self.status(channel).group();
        self.driver.pins().group_state(group).expect("group").armed
    }

    pub fn is_valid(&self, channel: usize) -> bool {
        let group = self.status(channel).group();
        self.driver.pins().group_state(group).expect("group").valid
    }

    pub fn bit(&self, name: &str) -> bool {
        let pins = self.driver.pins();
        let pin = pins.input(&format!("hm2_7i92.0.{name}")).expect("pin");
        pins.read(pin).value
    }

    pub fn cable(&mut self, channel: usize) -> &mut Cable {
        let end = self
            .driver
            .bus_mut()
            .sim_mut()
            .remote_mut(0, channel)
            .expect("remote");
        find_cable(end).expect("cable")
    }

    pub fn device(&self, channel: usize) -> &dyn SimDevice {
        find(self.driver.bus().sim().remote(0, channel).expect("remote")).expect("device")
    }

    pub fn device_mut(&mut self, channel: usize) -> &mut dyn SimDevice {
        let end = self
            .driver
            .bus_mut()
            .sim_mut()
            .remote_mut(0, channel)
            .expect("remote");
        find_mut(end).expect("device")
    }
}

pub type FieldRemote = mesa_hal::sim::remote::Remote<Device<FieldIo>>;
