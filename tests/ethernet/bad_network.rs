//! The driver on an Ethernet board behind a bad network, on virtual time: lost, duplicate, late and
//! reordered packets of every kind are each counted, and no pin ever shows a value that was not
//! true at its time.

mod truth;

use crate::common::machine::start;
use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use crate::common::chance::Chance;
use crate::common::ethernet::{SimLink, WIRE, cut, good, volts};
use mesa_hal::boards::{I7i77Analog, I7i77Field};
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{Driver, EventKind, EventMask, FaultPolicy, Pace, Repeating};
use mesa_hal::hal::{Input, Output, Param};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal_sim::devices::find_mut;
use mesa_hal_sim::{Motor, machines};
use truth::Truth;

type EthernetDriver = Driver<UdpBus<SimLink>>;

/// The fate of a packet: 2 % are lost, 2 % are delayed by up to `spread`, behind later ones, and 2
/// % are duplicated, immediately or with that delay.
fn fate(chance: &mut Chance, spread: u64) -> Vec<u64> {
    let late = WIRE + chance.below(spread);
    match chance.below(200) {
        0..4 => vec![],
        4..8 => vec![late],
        8..10 => vec![WIRE, WIRE + 3_000],
        10..12 => vec![WIRE, late],
        _ => vec![WIRE],
    }
}

/// A machine behind a network that is bad while the flag is set.
fn bad_network(seed: u64, period: Duration, pace: Pace) -> (SimLink, Rc<Cell<bool>>) {
    let mut link = link(pace);
    let is_bad = Rc::new(Cell::new(false));
    let fates = |seed, spread: Duration| {
        let (mut chance, is_bad) = (Chance(seed), Rc::clone(&is_bad));
        Box::new(move |_: u64, _: &[u8]| {
            if is_bad.get() {
                fate(&mut chance, spread.as_nanos() as u64)
            } else {
                vec![WIRE]
            }
        })
    };
    let spread = period * 3 / 2;
    link.to_board = fates(seed, spread);
    link.to_host = fates(seed ^ 0xABCD, spread);
    (link, is_bad)
}

/// A board that can pace has a phase-locked loop, which a 7I97 has.
fn link(pace: Pace) -> SimLink {
    let motor = Motor::default();
    match pace {
        Pace::Host => SimLink::new(machines::six_axes_7i92(motor)),
        Pace::Board => SimLink::new(machines::six_axes_7i97(motor)),
    }
}

fn driver(link: SimLink, deadline: Duration, period: Duration, pace: Pace) -> EthernetDriver {
    let config = UdpConfig {
        cycle_deadline: deadline,
        ..UdpConfig::default()
    };
    let bus = UdpBus::new(link, config).expect("the board answers");
    // Remotes go offline late: this test is about the network, not about remotes.
    let policy = FaultPolicy {
        fault_lim: 10_000,
        ..FaultPolicy::default()
    };
    start(bus, |s| {
        s.period = period;
        s.pace = pace;
        s.bus_error_limit = 50;
        s.watchdog = Some(Duration::from_millis(50));
        s.fault_policy = policy;
    })
    .expect("the machine is complete")
}

/// A good network, and the period: 1 ms.
fn good_network() -> (EthernetDriver, Duration) {
    let period = Duration::from_millis(1);
    let driver = driver(link(Pace::Host), period / 2, period, Pace::Host);
    (driver, period)
}

fn field(driver: &EthernetDriver) -> I7i77Field {
    driver.attach((0, 0)).expect("field I/O")
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

/// The inputs as one number, and their age in cycles; `None` if not valid.
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

/// The bit of an encoder's control register for the long filter.
const FILTER: u32 = 1 << 11;

/// Number of cycles after which the setting is changed; the board must have it before.
const SETTING: u32 = 16;

/// A setting of an encoder.
fn filter(driver: &EthernetDriver) -> Param<bool> {
    let name = format!("{}.encoder.00.filter", driver.name());
    driver.pins().parameter(&name).expect("a parameter")
}

/// Checks that the board has the setting, whatever happened to its first packet.
fn check_filter(driver: &mut EthernetDriver, filter: Param<bool>, seed: u64, cycle: u32) {
    let is_set = driver.pins().param(filter);
    let firmware = driver.firmware();
    let encoders = [Gtag::ENCODER, Gtag::MUXED_ENCODER];
    let encoders = encoders.iter().find_map(|gtag| firmware.find(*gtag));
    let control = encoders.expect("encoders").register(1, 0);
    let control = control.expect("a control register");
    let gateware = driver.bus_mut().link().board.gateware_mut();
    let control = gateware.read_register(control);
    let has = control & FILTER != 0;
    assert_eq!(has, is_set, "seed {seed}, cycle {cycle}: {control:#X}");
}

/// Runs the machine for some cycles; returns the number of cycles with new inputs.
fn run(seed: u64, rate: u32, cycles: u32, pace: Pace) -> u32 {
    let period = Duration::from_secs(1) / rate;
    let deadline = period * 3 / 5;
    let (link, is_bad) = bad_network(seed, period, pace);
    let mut driver = driver(link, deadline, period, pace);
    let inputs = field(&driver).inputs.map(|pair| pair.pin);
    let before = driver.bus().statistics();
    let mut truth = Truth::from(driver.bus_mut().link());
    let filter = filter(&driver);
    is_bad.set(true);
    let mut good = 0;
    for n in 1..=cycles {
        let started = driver.bus_mut().now();
        let doubts = driver.bus().statistics().doubts;
        let result = driver.read();
        let said = driver.bus().statistics().doubts > doubts;
        if result.is_ok() {
            let is_certain = truth.heard(driver.bus_mut().link());
            assert!(is_certain || said, "seed {seed}, cycle {n}: nothing said");
        }
        if let Some((pattern, age)) = read_pattern(&driver, &inputs) {
            // The inputs of a late write are taken later than the driver can know.
            assert!(
                ((n - 1).saturating_sub(age)..n).contains(&pattern),
                "seed {seed}, cycle {n}: {pattern} is older than {age} cycles"
            );
            good += u32::from(age == 0);
        }
        set_inputs(&mut driver, n);
        if n % SETTING == 0 {
            check_filter(&mut driver, filter, seed, n);
            // Where the board paces, a changed setting makes the cycle two packets.
            let is_set = !driver.pins().param(filter);
            let pins = driver.pins_mut();
            pins.set_param(filter, is_set).expect("a setting");
        }
        if n == cycles {
            is_bad.set(false);
        }
        let _ = driver.write();
        if pace == Pace::Host {
            let end = started.after(period);
            let left = end.since(driver.bus_mut().now());
            driver.bus_mut().wait(left);
        }
    }
    // Packets still in flight arrive, and are counted.
    driver.bus_mut().wait(period * 4);
    for _ in 0..3 {
        if driver.read().is_ok() {
            truth.heard(driver.bus_mut().link());
        }
        driver.bus_mut().wait(period * 4);
    }
    let counted = driver.bus().statistics();
    println!("seed {seed}, {rate} Hz, {cycles} cycles, {good} with new inputs: {counted:?}");
    truth.check(driver.bus_mut().link(), before, counted, seed);
    good
}

#[test]
fn every_network_fault_at_1_khz_is_counted_and_no_pin_is_wrong() {
    for seed in [1, 97, 2026] {
        assert!(run(seed, 1000, 2000, Pace::Host) > 1300, "seed {seed}");
    }
}

#[test]
fn every_network_fault_at_4_khz_is_counted_and_no_pin_is_wrong() {
    for seed in [4, 7] {
        assert!(run(seed, 4000, 4000, Pace::Host) > 2500, "seed {seed}");
    }
}

#[test]
fn every_board_paced_network_fault_is_counted_with_no_pin_wrong() {
    for (seed, rate) in [(3, 1000), (11, 1000), (12, 4000)] {
        assert!(run(seed, rate, 3000, Pace::Board) > 1800, "seed {seed}");
    }
}

#[test]
fn good_network_has_no_loss_with_two_packets_out_and_one_back() {
    let (mut driver, period) = good_network();
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
fn outputs_go_off_on_a_pulled_cable_and_return_only_on_rearm() {
    let (mut driver, period) = good_network();
    let analog: I7i77Analog = driver.attach((0, 1)).expect("analog");
    let drive: Output<f64> = analog.analog_out[0].volts;
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
    let _ = driver.rearm();
    cycle(&mut driver, 20);
    let _ = driver.rearm();
    assert_eq!(cycle(&mut driver, 20), 20);
    assert!(
        (volts(driver.bus_mut()) - 5.0).abs() < 0.01,
        "{}",
        volts(driver.bus_mut())
    );

    driver.bus_mut().link().to_board = cut();
    assert_eq!(cycle(&mut driver, 120), 0, "nothing comes back");
    assert_eq!(volts(driver.bus_mut()), 0.0, "the remote's own watchdog");

    driver.bus_mut().link().to_board = good();
    cycle(&mut driver, 200);
    assert_eq!(volts(driver.bus_mut()), 0.0, "not before it is re-armed");
    for _ in 0..20 {
        let _ = driver.rearm();
        cycle(&mut driver, 50);
    }
    assert!(
        (volts(driver.bus_mut()) - 5.0).abs() < 0.01,
        "{}",
        volts(driver.bus_mut())
    );
}

/// The time of its last edge shows that it has not moved. tests/driver/positions has encoders that
/// turn.
#[test]
fn encoder_that_stood_still_in_a_gap_is_sure() {
    let (mut driver, period) = good_network();
    let unsure = driver.pins().input("hm2_7i92.0.encoder.02.count-unsure");
    let unsure: Input<bool> = unsure.expect("a pin");
    let run = |driver: &mut EthernetDriver, cycles: u32, is_cut: bool| {
        driver.bus_mut().link().is_unreachable = is_cut;
        for _ in 0..cycles {
            assert_eq!(driver.read().is_err(), is_cut);
            assert_eq!(driver.write().is_err(), is_cut);
            driver.bus_mut().wait(period);
        }
        driver.pins().read(unsure)
    };
    // Until no packet of the set-up is in flight.
    assert!(!run(&mut driver, 110, false).value);
    // 32768 counts take 5.2 ms at 6.25 million per second: manual 7I77, "MAXIMUM ENCODER COUNT
    // RATE".
    let _ = run(&mut driver, 6, true);
    let after = run(&mut driver, 10, false);
    assert!(after.valid && !after.value);
}

#[test]
fn reply_timeout_can_be_set_as_in_linuxcnc() {
    let (mut driver, _) = good_network();
    let timeout = driver.pins().parameter("hm2_7i92.0.packet-read-timeout");
    let timeout = timeout.expect("a parameter");
    let mut waits = |set: Option<i32>| {
        if let Some(set) = set {
            let pins = driver.pins_mut();
            pins.set_param::<i32>(timeout, set).expect("a number");
        }
        let _ = driver.write();
        driver.bus_mut().link().to_board = cut();
        let before = driver.bus_mut().now();
        driver.read().expect_err("nothing comes");
        let waited = driver.bus_mut().now().since(before);
        driver.bus_mut().link().to_board = good();
        waited.as_micros()
    };
    assert_eq!(waits(None), 500, "that of the bus");
    for (set, expected) in [
        (60, 600),
        (0, 800),
        (-5, 800),
        (1, 100),
        (250_000, 250),
        (99, 990),
    ] {
        assert_eq!(waits(Some(set)), expected, "{set}");
    }
}

#[test]
fn running_driver_is_not_disturbed_by_a_free_check_of_its_board() {
    let (mut driver, period) = good_network();
    let analog: I7i77Analog = driver.attach((0, 1)).expect("analog");
    let mut good = 0;
    for n in 0..400_u32 {
        good += u32::from(driver.read().expect("a good network").is_good());
        let pins = driver.pins_mut();
        pins.set(analog.analog_out[0].volts, 5.0);
        pins.set(analog.analogena.pin, true);
        driver.write().expect("a good network");
        if matches!(n, 100 | 150 | 250 | 300) {
            // Another program's query (the packets that `UdpBus::new` sends first), at any time.
            let question = [
                0x82, 0xD1, 0x1C, 0x00, n as u8, 0x00, 0x00, 0x00, 0x44, 0x59, 0x0A, 0x00, 0x48,
                0x51, 0x10, 0x00,
            ];
            let link = driver.bus_mut().link();
            let now = link.board.time();
            let reply = link.board.handle_packet(now, &question, &mut Vec::new());
            assert!(reply.is_some(), "it is answered");
        }
        driver.bus_mut().wait(period);
        if n > 20 {
            let volts = volts(driver.bus_mut());
            assert!((volts - 5.0).abs() < 0.01, "cycle {n}: {volts} V");
        }
    }
    assert!(good > 400 - 20 - 4 * 3, "{good} good cycles");
    assert_eq!(driver.board_state(), mesa_hal::driver::BoardState::Running);
}

/// A second of cycles beside a program that sends this number of packets before each; returns the
/// events.
fn beside(driver: &mut EthernetDriver, packets: usize) -> Vec<EventKind> {
    // The cookie, which any program may read.
    let question = [0x81, 0x42, 0x00, 0x01];
    let mut events = driver.events();
    let period = driver.period();
    let mut reported = 0;
    for _ in 0..1000 {
        let link = driver.bus_mut().link();
        for _ in 0..packets {
            let now = link.board.time();
            let reply = link.board.handle_packet(now, &question, &mut Vec::new());
            assert!(reply.is_some(), "it is answered");
        }
        reported += driver.read().expect("a good network").foreign_packets;
        driver.write().expect("a good network");
        driver.bus_mut().wait(period);
    }
    assert_eq!(reported > 0, packets > 0);
    let told = events.by_ref().map(|event| event.kind);
    told.filter(|kind| match kind {
        EventKind::Repeated { what, .. } => *what == Repeating::OtherMaster,
        kind => kind.mask() == EventMask::OTHER_MASTER,
    })
    .collect()
}

#[test]
fn later_second_master_is_an_event_and_counted_and_ends_nothing() {
    let (mut driver, _) = good_network();
    assert_eq!(beside(&mut driver, 0), []);
    let told = beside(&mut driver, 2);
    let said = told.first().expect("an event").to_string();
    assert!(
        said.contains("another program or host drives this board"),
        "{said}"
    );
    assert_eq!(told.len(), 1, "{told:?}");
    for _ in 0..3 {
        assert_eq!(beside(&mut driver, 2), [], "it is the same one");
    }
    assert_eq!(
        driver.statistics().foreign_packets,
        driver.bus_mut().statistics().foreign_packets
    );
    assert!(driver.statistics().foreign_packets > 100);
    assert_eq!(driver.board_state(), mesa_hal::driver::BoardState::Running);
    let counted = driver.statistics().foreign_packets;
    let mut over = Vec::new();
    for _ in 0..12 {
        over.extend(beside(&mut driver, 0));
    }
    let [EventKind::Repeated { count, lasted, .. }] = over[..] else {
        panic!("it has gone, and that is told once: {over:?}");
    };
    assert_eq!(u64::from(count), driver.statistics().foreign_packets);
    assert!(lasted >= Duration::from_secs(2), "{lasted:?}");
    assert_eq!(driver.statistics().foreign_packets, counted);
    assert_eq!(beside(&mut driver, 2).len(), 1, "another one");
}
