//! Arbitrary sequences of calls, faults and pauses: the cycle never hangs, never panics, and never
//! publishes a value that the simulated remote did not send as its newest reply.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, fpga_with_field};
use mesa_hal::Settings;
use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::Driver;
use mesa_hal::sim::SimFpga;
use mesa_hal::sim::devices::FieldIo;
use mesa_hal::sim::remote::{Toward, WireFault};
use mesa_hal::sim::wire::{Burst, Nanos, RemoteEnd};
use mesa_hal::transport::{Fault, Faulty};
use proptest::prelude::*;

/// What a remote has sent as the reply to its newest process-data request.
#[derive(Debug, Default)]
struct Record {
    requests: u64,
    newest: Option<(u64, u32)>,
}

/// Stands directly in front of a remote and writes down what it sends.
#[derive(Debug)]
struct Witness {
    remote: Box<dyn RemoteEnd>,
    record: Arc<Mutex<Record>>,
    is_process_data: bool,
}

impl RemoteEnd for Witness {
    fn advance(&mut self, now: Nanos) {
        self.remote.advance(now);
    }

    fn receive(&mut self, burst: &Burst) {
        self.is_process_data = burst.bytes().first() == Some(&0xBD);
        if self.is_process_data {
            self.record
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .requests += 1;
        }
        self.remote.receive(burst);
    }

    fn transmit(&mut self) -> Option<Burst> {
        let burst = self.remote.transmit()?;
        if let (true, [_fault, a, b, c, d, _crc]) = (self.is_process_data, burst.bytes()) {
            let mut record = self.record.lock().unwrap_or_else(PoisonError::into_inner);
            let word = u32::from_le_bytes([*a, *b, *c, *d]);
            record.newest = Some((record.requests, word));
        }
        Some(burst)
    }

    fn holds_line_low(&self) -> bool {
        self.remote.holds_line_low()
    }

    fn inner(&self) -> Option<&dyn RemoteEnd> {
        Some(self.remote.as_ref())
    }

    fn inner_mut(&mut self) -> Option<&mut dyn RemoteEnd> {
        Some(self.remote.as_mut())
    }
}

/// One thing that an application, the world or fate does.
#[derive(Clone, Debug)]
enum Step {
    Cycles(u8),
    Read,
    Write,
    WaitTransfers(u16),
    PassMicros(u32),
    Wire(usize, Toward, WireFault, u32),
    Heal(usize),
    Plug(usize, bool),
    Power(usize, bool),
    FieldVolts(f64),
    OverCurrent(bool),
    Bus(Fault, u64),
    Rearm,
    Restart(usize),
    Run(bool),
    Output(f64),
}

fn channel() -> impl Strategy<Value = usize> {
    prop_oneof![4 => Just(FIELD), 1 => Just(ANALOG), 1 => Just(OUTPUTS)]
}

fn wire_fault() -> impl Strategy<Value = WireFault> {
    prop_oneof![
        Just(WireFault::Lost),
        Just(WireFault::Corrupted),
        (1u8..4).prop_map(WireFault::Short),
        (1u8..4).prop_map(WireFault::Long),
        // No reply is later than the rest after a failure: see `FaultPolicy::rest`.
        (0u64..700_000).prop_map(WireFault::Late),
        Just(WireFault::Break),
    ]
}

fn bus_fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        Just(Fault::Executed(BusErrorKind::Late)),
        Just(Fault::Executed(BusErrorKind::Lost)),
        Just(Fault::NotExecuted(BusErrorKind::Lost)),
        Just(Fault::SilentWrite),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    let toward = prop_oneof![Just(Toward::Fpga), Just(Toward::Remote)];
    prop_oneof![
        12 => (1u8..40).prop_map(Step::Cycles),
        3 => Just(Step::Read),
        3 => Just(Step::Write),
        2 => (0u16..400).prop_map(Step::WaitTransfers),
        4 => (0u32..400).prop_map(Step::PassMicros),
        1 => (0u32..90_000).prop_map(Step::PassMicros),
        10 => (channel(), toward, wire_fault(), 1u32..6)
            .prop_map(|(c, t, f, n)| Step::Wire(c, t, f, n)),
        1 => channel().prop_map(Step::Heal),
        3 => (channel(), prop::bool::weighted(0.7)).prop_map(|(c, on)| Step::Plug(c, on)),
        2 => (channel(), prop::bool::weighted(0.7)).prop_map(|(c, on)| Step::Power(c, on)),
        1 => prop_oneof![Just(24.0), Just(3.0), Just(40.0)].prop_map(Step::FieldVolts),
        1 => any::<bool>().prop_map(Step::OverCurrent),
        5 => (bus_fault(), 0u64..4).prop_map(|(f, n)| Step::Bus(f, n)),
        4 => Just(Step::Rearm),
        1 => channel().prop_map(Step::Restart),
        1 => prop::bool::weighted(0.8).prop_map(Step::Run),
        2 => any::<f64>().prop_map(Step::Output),
    ]
}

/// The machine, its witness, and what was published so far.
struct Trial {
    machine: Machine<Faulty<SimFpga>>,
    record: Arc<Mutex<Record>>,
    /// What the inputs are told, another number each time.
    word: u32,
    last_used: u64,
    published: u64,
}

impl Trial {
    fn new() -> Self {
        let record = Arc::default();
        let field = Witness {
            remote: Box::new(FieldIo::i7i77().expect("7I77")),
            record: Arc::clone(&record),
            is_process_data: false,
        };
        let bus = Faulty::new(fpga_with_field(Box::new(field)), 1);
        let driver = Driver::start(bus, Settings::default()).expect("the machine is complete");
        Self {
            machine: Machine::with(driver),
            record,
            word: 0,
            last_used: 0,
            published: 0,
        }
    }

    fn read(&mut self) {
        let start = self.machine.now();
        let _ = self.machine.driver.read();
        self.took_less_than(start, 100_000);
        self.check_published();
    }

    fn write(&mut self) {
        self.word = self.word.wrapping_add(1);
        let word = self.word.wrapping_mul(0x9E37_79B9);
        for n in 0..32 {
            let on = word >> n & 1 != 0;
            self.machine
                .device_mut(FIELD)
                .set_input(n, on)
                .expect("input");
        }
        let start = self.machine.now();
        let _ = self.machine.driver.write();
        self.took_less_than(start, 100_000);
    }

    fn took_less_than(&self, start: Nanos, limit: Nanos) {
        let took = self.machine.now() - start;
        assert!(took <= limit, "{took} ns");
    }

    /// What is shown as new is the remote's reply to the newest request, and is shown once.
    fn check_published(&mut self) {
        let group = self.machine.status(FIELD).pins.group;
        let state = self
            .machine
            .driver
            .pins()
            .group_state(group)
            .expect("group");
        if !state.valid || state.age.cycles != 0 {
            return;
        }
        let pins = self.machine.driver.pins();
        let published = (0..32u32)
            .zip(&self.machine.cards.field.inputs)
            .fold(0, |word, (n, input)| {
                word | u32::from(pins.read(input.pin).value) << n
            });
        let record = self.record.lock().unwrap_or_else(PoisonError::into_inner);
        let (request, sent) = record.newest.expect("it has sent something");
        assert_eq!(published, sent, "published, and sent in reply to {request}");
        assert!(request > self.last_used, "reply {request} is shown twice");
        assert_eq!(request, record.requests, "there is a newer request");
        self.last_used = request;
        self.published += 1;
    }

    fn run(&mut self, step: &Step) {
        let now = self.machine.now();
        match *step {
            Step::Cycles(count) => {
                for _ in 0..count {
                    self.read();
                    self.write();
                    self.machine.pass(Duration::from_millis(1));
                }
            }
            Step::Read => self.read(),
            Step::Write => self.write(),
            Step::WaitTransfers(micros) => {
                let limit = Duration::from_micros(micros.into());
                let _ = self.machine.driver.wait_transfers(limit);
                self.took_less_than(now, u64::from(micros) * 1000 + 10_000);
            }
            Step::PassMicros(micros) => {
                self.machine.pass_nanos(u64::from(micros) * 1000);
            }
            Step::Wire(channel, toward, fault, count) => {
                self.machine.cable(channel).inject(toward, fault, count);
            }
            Step::Heal(channel) => self.machine.cable(channel).heal(),
            Step::Plug(channel, true) => self.machine.cable(channel).replug(),
            Step::Plug(channel, false) => self.machine.cable(channel).unplug(),
            Step::Power(channel, on) => self.machine.device_mut(channel).set_power(now, on),
            Step::FieldVolts(volts) => {
                let device = self.machine.device_mut(FIELD);
                device.set_field_volts(now, volts).expect("field power");
            }
            Step::OverCurrent(shorted) => {
                let device = self.machine.device_mut(FIELD);
                device.set_over_current(3, shorted).expect("output");
            }
            Step::Bus(fault, after) => {
                let bus = self.machine.driver.bus_mut();
                let at = bus.exchanges() + after;
                bus.fail_at(at, fault);
            }
            Step::Rearm => {
                let _ = self.machine.driver.rearm();
                self.took_less_than(now, 200_000);
            }
            Step::Restart(channel) => {
                self.machine.driver.restart(0, channel as u8);
            }
            Step::Run(on) => {
                let pins = self.machine.driver.pins_mut();
                let run = pins.output("hm2_7i92.0.sserial.port-0.run").expect("run");
                pins.set(run, on);
            }
            Step::Output(value) => {
                let pins = self.machine.driver.pins_mut();
                pins.set(self.machine.cards.analog.analog_out[2].volts, value);
                pins.set(self.machine.cards.field.outputs[3].pin, value > 0.0);
            }
        }
    }

    /// When all is repaired, everything runs again.
    fn recovers(&mut self) {
        let before = self.published;
        self.machine.driver.bus_mut().heal();
        let now = self.machine.now();
        for channel in [FIELD, ANALOG, OUTPUTS] {
            self.machine.cable(channel).heal();
            self.machine.cable(channel).replug();
            self.machine.device_mut(channel).set_power(now, true);
        }
        let field = self.machine.device_mut(FIELD);
        field.set_field_volts(now, 24.0).expect("field power");
        field.set_over_current(3, false).expect("output");
        self.run(&Step::Run(true));
        for _ in 0..30_000 {
            let _ = self.machine.driver.rearm();
            self.run(&Step::Cycles(1));
            let armed = [FIELD, ANALOG, OUTPUTS].into_iter().all(|channel| {
                self.machine.is_running(channel)
                    && self.machine.is_armed(channel)
                    && self.machine.status(channel).faults.is_empty()
            });
            if armed && self.published > before + 20 {
                return;
            }
        }
        panic!(
            "it does not recover: {:?}",
            self.machine.driver.board_state()
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn nothing_hangs_and_nothing_wrong_is_published(
        steps in prop::collection::vec(step(), 1..150),
    ) {
        let mut trial = Trial::new();
        for step in &steps {
            trial.run(step);
        }
        trial.recovers();
    }
}
