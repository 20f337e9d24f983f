//! The driver on an Ethernet board behind a bad network, on virtual time: lost and doubled packets
//! and replies that come late, behind later ones, are counted, and no pin ever shows what was not
//! true at its time.

mod ethernet_support;

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use ethernet_support::{SimLink, WIRE};
use mesa_hal::boards::{I7i77Analog, I7i77Field, OutputType};
use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{Driver, FaultPolicy};
use mesa_hal::hal::{Input, Output};
use mesa_hal::sim::devices::{Analog, Device, find_mut};
use mesa_hal::sim::remote::Remote;
use mesa_hal::sim::{BoardConfig, MotorConfig, machines};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};

type EthernetDriver = Driver<UdpBus<SimLink>>;

/// What the network did on purpose.
#[derive(Default)]
struct Injected {
    lost_requests: Cell<u64>,
    lost_replies: Cell<u64>,
    late_replies: Cell<u64>,
    doubled: Cell<u64>,
    lost_writes: Cell<u64>,
    /// The newest write that was sent, and the newest that arrived.
    writes: Cell<(u64, u64)>,
    /// Nothing is injected while this is false.
    active: Cell<bool>,
}

fn add(cell: &Cell<u64>) {
    cell.set(cell.get() + 1);
}

/// A small generator, so that a seed says everything about a run.
struct Chance(u64);

impl Chance {
    fn percent(&mut self) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % 100
    }
}

/// Requests that are answered begin with their number (`82D11000`); writes of the cycle do not.
fn is_answered(packet: &[u8]) -> bool {
    packet.starts_with(&[0x82, 0xD1, 0x10, 0x00])
}

/// 3 % of the requests and replies are lost, 3 % of the replies come after their deadline and
/// thereby after later ones, 3 % come twice.
fn bad_network(seed: u64, deadline: Duration, period: Duration) -> (SimLink, Rc<Injected>) {
    let injected = Rc::new(Injected::default());
    let mut link = SimLink::new(
        BoardConfig::new("7I92"),
        machines::six_axes_7i92(MotorConfig::default()),
    );
    let (mut chance, counts) = (Chance(seed), Rc::clone(&injected));
    link.to_board = Box::new(move |packet| {
        let lost = counts.active.get() && chance.percent() < 3;
        if is_answered(packet) {
            if lost {
                add(&counts.lost_requests);
                return vec![];
            }
        } else {
            let (sent, arrived) = counts.writes.get();
            let newest = if lost { arrived } else { sent + 1 };
            counts.writes.set((sent + 1, newest));
            if lost {
                add(&counts.lost_writes);
                return vec![];
            }
        }
        vec![WIRE]
    });
    let (mut chance, counts) = (Chance(seed ^ 0xABCD), Rc::clone(&injected));
    let late = (deadline + period / 2).as_nanos() as u64;
    link.to_host = Box::new(move |_| {
        if !counts.active.get() {
            return vec![WIRE];
        }
        match chance.percent() {
            0..3 => {
                add(&counts.lost_replies);
                vec![]
            }
            3..6 => {
                add(&counts.late_replies);
                vec![late]
            }
            6..9 => {
                add(&counts.doubled);
                vec![WIRE, WIRE + 3_000]
            }
            _ => vec![WIRE],
        }
    });
    (link, injected)
}

fn driver(link: SimLink, deadline: Duration, period: Duration) -> EthernetDriver {
    let config = UdpConfig {
        cycle_deadline: deadline,
        ..UdpConfig::default()
    };
    let bus = UdpBus::new(link, config).expect("the board answers");
    // Set aside late: this test is about the network, not about remotes.
    let policy = FaultPolicy {
        fault_lim: 10_000,
        ..FaultPolicy::default()
    };
    Driver::builder(bus)
        .period(period)
        .bus_error_limit(50)
        .watchdog(Duration::from_millis(50))
        .fault_policy(policy)
        .build()
        .expect("the machine is complete")
}

fn field(driver: &EthernetDriver) -> I7i77Field {
    let remote = driver.ports()[0].remotes().next().expect("channel 0");
    I7i77Field::new(driver.pins(), remote.pins(), OutputType::Sourcing).expect("field I/O")
}

fn set_inputs(driver: &mut EthernetDriver, pattern: u32) {
    let fpga = driver.bus_mut().link().board.gateware_mut();
    let end = fpga.remote_mut(0, 0).expect("plugged");
    let device = find_mut(end).expect("a device");
    for n in 0..32 {
        device
            .set_input(n, pattern >> n & 1 != 0)
            .expect("an input");
    }
}

/// The inputs as one number, and how many cycles ago they were like that; `None` if not valid.
fn read_pattern(driver: &EthernetDriver, inputs: &[Input<bool>; 32]) -> Option<(u32, u32)> {
    let first = driver.pins().read(inputs[0]).age;
    let pattern = inputs
        .iter()
        .enumerate()
        .try_fold(0, |pattern, (n, input)| {
            let reading = driver.pins().read(*input);
            assert_eq!(reading.age, first, "inputs of one transfer");
            reading
                .valid
                .then_some(pattern | u32::from(reading.value) << n)
        })?;
    Some((
        pattern,
        u32::try_from(first.cycles).expect("valid is young"),
    ))
}

/// Runs the machine for some cycles; returns how many cycles had new inputs.
fn run(seed: u64, rate: u32, cycles: u32) -> u32 {
    let period = Duration::from_secs(1) / rate;
    let deadline = period * 3 / 5;
    let (link, injected) = bad_network(seed, deadline, period);
    let mut driver = driver(link, deadline, period);
    let inputs = field(&driver).inputs.map(|pair| pair.pin);
    let before = driver.bus().statistics();
    injected.active.set(true);
    let mut good = 0;
    for n in 1..=cycles {
        let started = driver.bus_mut().now();
        let writes_before = injected.writes.get();
        let counted = driver.bus().statistics().lost_writes;
        if driver.read().is_ok() {
            // The newest write sent is the newest executed, or the read says so.
            let missing = u64::from(writes_before.0 > 0 && writes_before.1 != writes_before.0);
            let said = driver.bus().statistics().lost_writes - counted;
            assert_eq!(
                said > 0,
                missing > 0,
                "seed {seed}, cycle {n}: {writes_before:?}"
            );
        }
        if let Some((pattern, age)) = read_pattern(&driver, &inputs) {
            assert_eq!(
                pattern,
                n - 1 - age,
                "seed {seed}, cycle {n}: what the inputs were {age} cycles ago"
            );
            good += u32::from(age == 0);
        }
        set_inputs(&mut driver, n);
        let _ = driver.write();
        let end = started.after(period);
        let left = end.since(driver.bus_mut().now());
        driver.bus_mut().wait(left);
    }
    injected.active.set(false);
    driver.bus_mut().wait(period * 4);
    let _ = driver.read();
    let counted = driver.bus().statistics();
    let lost = injected.lost_requests.get() + injected.lost_replies.get();
    assert_eq!(counted.lost - before.lost, lost, "seed {seed}");
    assert_eq!(
        counted.late - before.late,
        injected.late_replies.get(),
        "seed {seed}"
    );
    assert_eq!(
        counted.duplicate - before.duplicate,
        injected.doubled.get(),
        "seed {seed}"
    );
    let (known, unknown) = (counted.lost_writes, counted.unconfirmed_writes);
    let lost = injected.lost_writes.get();
    assert!(
        known > 0 && known <= lost && lost <= known + unknown,
        "seed {seed}: {lost} writes lost, {known} counted, {unknown} unconfirmed"
    );
    assert_eq!(
        (counted.foreign, counted.short, counted.stale),
        (0, 0, 0),
        "seed {seed}"
    );
    println!("seed {seed}, {rate} Hz, {cycles} cycles, {good} with new inputs: {counted:?}");
    good
}

#[test]
fn at_1_khz_on_a_bad_network_every_mishap_is_counted_and_no_pin_is_wrong() {
    for seed in [1, 97, 2026] {
        assert!(run(seed, 1000, 2000) > 1300, "seed {seed}");
    }
}

#[test]
fn at_4_khz_on_a_bad_network_every_mishap_is_counted_and_no_pin_is_wrong() {
    for seed in [4, 7] {
        assert!(run(seed, 4000, 4000) > 2600, "seed {seed}");
    }
}

#[test]
fn on_a_good_network_nothing_is_lost_and_a_cycle_is_two_packets_out_and_one_back() {
    let period = Duration::from_millis(1);
    let link = SimLink::new(
        BoardConfig::new("7I92"),
        machines::six_axes_7i92(MotorConfig::default()),
    );
    let mut driver = driver(link, period / 2, period);
    let before = driver.bus().statistics();
    for _ in 0..1000 {
        assert!(driver.read().expect("a good network").lost_writes == 0);
        driver.write().expect("a good network");
        driver.bus_mut().wait(period);
    }
    let after = driver.bus().statistics();
    assert_eq!(after.exchanges - before.exchanges, 2000);
    assert_eq!(
        (after.lost, after.late, after.lost_writes),
        (before.lost, before.late, 0)
    );
    println!(
        "{} bytes out, {} bytes in each cycle",
        (after.bytes_sent - before.bytes_sent) / 1000,
        (after.bytes_received - before.bytes_received) / 1000,
    );
}

#[test]
fn when_the_cable_is_pulled_the_outputs_go_off_and_come_back_only_when_rearmed() {
    let period = Duration::from_millis(1);
    let link = SimLink::new(
        BoardConfig::new("7I92"),
        machines::six_axes_7i92(MotorConfig::default()),
    );
    let mut driver = driver(link, period / 2, period);
    let remote = driver.ports()[0].remotes().nth(1).expect("channel 1");
    let analog = I7i77Analog::new(driver.pins(), remote.pins()).expect("analog");
    let drive: Output<f64> = analog.analog_out[0].pin;
    let cycle = |driver: &mut EthernetDriver, n: u32| {
        let mut good = 0;
        for _ in 0..n {
            good += u32::from(driver.read().is_ok_and(|report| report.is_good()));
            driver.pins_mut().set(drive, 5.0);
            driver.pins_mut().set(analog.analogena.pin, true);
            let _ = driver.write();
            driver.bus_mut().wait(period);
        }
        good
    };
    let volts = |driver: &mut EthernetDriver| {
        let fpga = driver.bus_mut().link().board.gateware_mut();
        fpga.device::<Remote<Device<Analog>>>(0, 1)
            .and_then(|remote| remote.application().world().volts(0))
            .expect("an analog output")
    };
    let _ = driver.rearm();
    cycle(&mut driver, 20);
    let _ = driver.rearm();
    assert_eq!(cycle(&mut driver, 20), 20);
    assert!(
        (volts(&mut driver) - 5.0).abs() < 0.01,
        "{}",
        volts(&mut driver)
    );

    driver.bus_mut().link().to_board = Box::new(|_| vec![]);
    assert_eq!(cycle(&mut driver, 120), 0, "nothing comes back");
    assert_eq!(volts(&mut driver), 0.0, "the remote's own watchdog");

    driver.bus_mut().link().to_board = Box::new(|_| vec![WIRE]);
    cycle(&mut driver, 200);
    assert_eq!(volts(&mut driver), 0.0, "not before it is re-armed");
    for _ in 0..20 {
        let _ = driver.rearm();
        cycle(&mut driver, 50);
    }
    assert!(
        (volts(&mut driver) - 5.0).abs() < 0.01,
        "{}",
        volts(&mut driver)
    );
}
