//! Faults of the board and of the bus: the watchdog, lost packets, a missing remote, the end.

use std::time::Duration;

use crate::common::machine::{ANALOG, Embedded, FIELD, Machine, OUTPUTS, device, fpga, start};
use mesa_hal::MesaError;
use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::{BoardState, CycleError, Driver};
use mesa_hal::hal::Pins;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal::{I7i77Field, RemoteId, Settings};
use mesa_hal_sim::SimFpga;

const ALL: [usize; 3] = [FIELD, ANALOG, OUTPUTS];

fn switch_on<B: Embedded>(machine: &mut Machine<B>) {
    machine.cards.set_one_of_each(machine.driver.pins_mut());
}

fn are_outputs_on<B: Embedded>(machine: &Machine<B>) -> [bool; 3] {
    are_on(machine.driver.bus().look())
}

fn are_on(fpga: &SimFpga) -> [bool; 3] {
    let world = |channel| device(fpga, channel).world();
    [
        world(FIELD).output(3) == Some(true),
        world(ANALOG)
            .analog_output(1)
            .is_some_and(|volts| volts > 4.9),
        world(OUTPUTS).output(7) == Some(true),
    ]
}

fn running() -> Machine {
    let mut machine = Machine::new();
    switch_on(&mut machine);
    machine.cycles(5);
    assert_eq!(are_outputs_on(&machine), [true; 3]);
    machine
}

/// Re-arms until everything follows again.
fn rearm_all<B: Embedded>(machine: &mut Machine<B>) {
    machine.rearm_all(300);
    switch_on(machine);
    machine.cycles(5);
    assert_eq!(are_outputs_on(machine), [true; 3]);
}

#[test]
fn boards_watchdog_makes_everything_safe_until_it_is_rearmed() {
    let mut machine = running();
    machine.sleep(20);
    assert!(machine.driver.bus().watchdog().has_bitten());
    let report = machine.cycle();
    assert_eq!(report.board, BoardState::WatchdogBitten);
    assert!(!report.is_good());
    for _ in 0..200 {
        let report = machine.cycle();
        assert_eq!(report.board, BoardState::WatchdogBitten);
        switch_on(&mut machine);
        assert!(
            ALL.iter()
                .all(|&c| !machine.is_valid(c) && !machine.is_armed(c))
        );
    }
    assert_eq!(
        are_outputs_on(&machine),
        [false; 3],
        "the remotes' own watchdogs"
    );
    assert_eq!(machine.driver.statistics().watchdog_bites, 1);
    rearm_all(&mut machine);
    assert_eq!(machine.cycle().board, BoardState::Running);
    assert!(machine.bit("7i77.0.0.running"));
}

#[test]
fn clearing_has_bit_restores_the_board_but_rearms_no_output() {
    let mut machine = running();
    machine.sleep(20);
    machine.cycles(3);
    let pins = machine.driver.pins_mut();
    let has_bit = pins.inout::<bool>("hm2_7i92.0.watchdog.has_bit").unwrap();
    assert!(pins.read(has_bit).value);
    pins.set(has_bit, false);
    machine.cycles(200);
    assert_eq!(machine.driver.board_state(), BoardState::Running);
    assert!(
        ALL.iter()
            .all(|&c| machine.is_running(c) && !machine.is_armed(c))
    );
    assert_eq!(are_outputs_on(&machine), [false; 3]);
    rearm_all(&mut machine);
}

#[test]
fn dropped_driver_stops_the_ports_and_leaves_no_pin_driven() {
    let mut simulated = fpga();
    {
        let driver = Driver::start(&mut simulated, Settings::default()).unwrap();
        let mut driver = driver;
        for _ in 0..5 {
            let _ = driver.read().unwrap();
            let output = driver
                .pins()
                .output("hm2_7i92.0.7i77.0.0.output-03")
                .unwrap();
            driver.pins_mut().set(output, true);
            driver.write().unwrap();
            driver.bus_mut().pass(1);
        }
        assert_eq!(output_3(driver.bus()), Some(true));
    }
    assert_eq!(
        output_3(&simulated),
        Some(false),
        "told to switch off, not left to bite"
    );
    for channel in 0..3u16 {
        assert_eq!(
            simulated.read_register(0x5D00 + 4 * channel) & 0xFFFF,
            0xC100
        );
    }
    simulated.pass(1);
    assert!(simulated.watchdog().has_bitten());
    assert_eq!(simulated.read_register(0x1100), 0, "all pins are inputs");
}

fn output_3(fpga: &SimFpga) -> Option<bool> {
    let end = fpga.remote(0, FIELD)?;
    mesa_hal_sim::devices::find(end)?.world().output(3)
}

trait Pass {
    fn pass(&mut self, millis: u64);
}

impl Pass for SimFpga {
    fn pass(&mut self, millis: u64) {
        let now = SimFpga::now(self);
        self.advance_to(now + millis * 1_000_000);
    }
}

#[test]
fn shut_down_driver_returns_the_bus_with_all_outputs_off() {
    let (mut fpga, stopped) = running().driver.shutdown();
    stopped.unwrap();
    assert_eq!(are_on(&fpga), [false; 3]);
    fpga.pass(1);
    assert!(fpga.watchdog().has_bitten());
}

fn faulty() -> Machine<Faulty<SimFpga>> {
    let driver = Driver::start(Faulty::new(fpga(), 7), Settings::default()).unwrap();
    let mut machine = Machine::with(driver);
    switch_on(&mut machine);
    machine.cycles(5);
    machine
}

/// Runs a cycle whose read may fail.
fn try_cycle(machine: &mut Machine<Faulty<SimFpga>>) -> bool {
    let is_ok = machine.driver.read().is_ok();
    let _ = machine.driver.write();
    machine.pass(Duration::from_millis(1));
    is_ok
}

#[test]
fn lost_read_takes_no_input_and_stops_nothing() {
    let mut machine = faulty();
    let next = machine.driver.bus_mut().exchanges();
    let lost = Fault::Executed(BusErrorKind::Lost);
    machine.driver.bus_mut().fail_at(next, lost);
    machine.device_mut(FIELD).set_input(9, true).unwrap();
    let Err(CycleError::Read { consecutive: 1, .. }) = machine.driver.read() else {
        panic!("the read was lost");
    };
    let input = machine.field_input(9);
    assert_eq!(
        (input.value, input.valid, input.age.cycles),
        (false, true, 1)
    );
    machine.driver.write().unwrap();
    machine.pass(Duration::from_millis(1));
    machine.cycles(3);
    let input = machine.field_input(9);
    assert_eq!(
        (input.value, input.valid, input.age.cycles),
        (true, true, 0)
    );
    assert!(ALL.iter().all(|&c| machine.is_armed(c)));
    assert_eq!(machine.driver.statistics().read_errors, 1);
}

#[test]
fn inputs_of_a_lost_doit_are_not_taken_as_new() {
    let mut machine = faulty();
    let _ = machine.driver.read().unwrap();
    let next = machine.driver.bus_mut().exchanges();
    machine.driver.bus_mut().fail_at(next, Fault::AckedButLost);
    machine.driver.write().unwrap();
    machine.pass(Duration::from_millis(1));
    let report = machine.driver.read().unwrap();
    assert_eq!((report.lost_writes, report.good), (1, 0));
    // A missed cycle: nothing failed on the wire. The reply of the next one could belong to the
    // lost request, and is not taken either.
    let group = machine.status(FIELD).pins.group;
    for age in 1..=2 {
        let state = machine.driver.pins().group_state(group).unwrap();
        assert_eq!((state.valid, state.age.cycles), (true, age));
        machine.driver.write().unwrap();
        machine.pass(Duration::from_millis(1));
        assert_eq!(machine.driver.read().unwrap().failed, 0);
    }
    let state = machine.driver.pins().group_state(group).unwrap();
    assert_eq!((state.valid, state.age.cycles), (true, 0));
    assert!(machine.is_armed(FIELD));
    assert_eq!(machine.driver.statistics().lost_writes, 1);
}

#[test]
fn bus_down_makes_outputs_safe_and_stops_feeding_the_watchdog() {
    let mut machine = faulty();
    let fault = Fault::NotExecuted(BusErrorKind::Unreachable);
    machine.driver.bus_mut().fail_randomly(fault, 1.0);
    for n in 1..=30 {
        assert!(!try_cycle(&mut machine));
        let expected = if n < 3 {
            BoardState::Running
        } else {
            BoardState::BusDown
        };
        // Read and write both fail, and five failures in total are allowed.
        assert_eq!(machine.driver.board_state(), expected, "cycle {n}");
    }
    assert!(
        ALL.iter()
            .all(|&c| !machine.is_valid(c) && !machine.is_armed(c))
    );
    machine.driver.bus_mut().heal();
    for _ in 0..100 {
        assert!(try_cycle(&mut machine));
        switch_on(&mut machine);
    }
    assert_eq!(
        machine.driver.board_state(),
        BoardState::BusDown,
        "until it is re-armed"
    );
    assert_eq!(are_outputs_on(&machine), [false; 3]);
    machine.rearm_all(500);
    switch_on(&mut machine);
    machine.cycles(5);
    assert_eq!(are_outputs_on(&machine), [true; 3]);
}

/// Runs one cycle in which only the read fails.
fn lose_a_read(machine: &mut Machine<Faulty<SimFpga>>) {
    let next = machine.driver.bus_mut().exchanges();
    let lost = Fault::Executed(BusErrorKind::Lost);
    machine.driver.bus_mut().fail_at(next, lost);
    assert!(!try_cycle(machine));
}

/// Manual page hm2_eth(9).
#[test]
fn errors_are_counted_on_from_what_the_application_sets() {
    let mut machine = faulty();
    let total = "hm2_7i92.0.packet-error-total";
    let total = machine.driver.pins().inout::<u32>(total).expect("a pin");
    let count = |machine: &Machine<Faulty<SimFpga>>| machine.driver.pins().read(total).value;
    assert_eq!(count(&machine), 0);
    for _ in 0..3 {
        lose_a_read(&mut machine);
        machine.cycles(2);
    }
    assert_eq!(count(&machine), 3);
    machine.driver.pins_mut().set(total, 0);
    machine.cycles(5);
    assert_eq!(count(&machine), 0, "it stays reset");
    lose_a_read(&mut machine);
    assert_eq!(count(&machine), 1);
    machine.driver.pins_mut().set(total, u32::MAX);
    lose_a_read(&mut machine);
    machine.cycles(1);
    assert_eq!(count(&machine), u32::MAX, "it does not wrap");
    assert_eq!(machine.driver.statistics().read_errors, 5);
}

/// Manual page hm2_eth(9): each cycle with an error adds the increment, each without one subtracts
/// the decrement, and the level stays within 0 and the limit.
#[test]
fn error_level_is_a_leaky_bucket_not_a_count_in_a_row() {
    let mut machine = faulty();
    let pins = machine.driver.pins();
    let count = pins.input::<i32>("hm2_7i92.0.packet-error-level");
    let count = count.expect("a pin");
    let exceeded = pins.input::<bool>("hm2_7i92.0.packet-error-exceeded");
    let exceeded = exceeded.expect("a pin");
    let level = |machine: &Machine<Faulty<SimFpga>>| {
        let read = machine.driver.pins();
        (read.read(count).value, read.read(exceeded).value)
    };
    let limit = "hm2_7i92.0.packet-error-limit";
    let limit_of = |pins: &Pins| pins.param(pins.parameter::<i32>(limit).expect("a parameter"));
    assert_eq!(limit_of(pins), 10);
    // Never two in a row: 2, 1, 3, 2, 4, 3 ... 10.
    for n in 0..8 {
        lose_a_read(&mut machine);
        assert_eq!(level(&machine), (n + 2, false));
        assert_eq!(machine.driver.board_state(), BoardState::Running);
        machine.cycles(1);
        assert_eq!(level(&machine), (n + 1, false));
    }
    lose_a_read(&mut machine);
    assert_eq!(level(&machine), (10, true));
    assert_eq!(machine.driver.board_state(), BoardState::BusDown);
    for _ in 0..5 {
        lose_a_read(&mut machine);
        assert_eq!(level(&machine), (10, true), "it is full");
    }
    assert!(ALL.iter().all(|&c| !machine.is_armed(c)));

    let settings = Settings {
        bus_error_limit: 3,
        ..Settings::default()
    };
    let driver = Driver::start(Faulty::new(fpga(), 7), settings).unwrap();
    assert_eq!(limit_of(driver.pins()), 6, "three failures in a row");
}

#[test]
fn board_without_firmware_is_not_mistaken_for_inputs_off() {
    let mut machine = running();
    machine.driver.bus_mut().override_rom(0x0100, 0xFFFF_FFFF);
    let error = machine.driver.read().unwrap_err();
    assert_eq!(
        error,
        CycleError::NotThere {
            found: 0xFFFF_FFFF,
            consecutive: 1
        }
    );
    let text = error.with_advice().to_string();
    assert!(
        text.contains("0xFFFFFFFF") && text.contains("power"),
        "{text}"
    );
}

#[test]
fn missing_remote_is_reported_with_its_reason_and_the_rest_runs() {
    let mut simulated = fpga();
    let removed = simulated.plug(0, OUTPUTS, None);
    let mut driver = Driver::start(&mut simulated, Settings::default()).unwrap();
    let [missing] = driver.missing() else {
        panic!("{:?}", driver.missing());
    };
    assert_eq!(missing.remote, Some(RemoteId::new(0, 2).into()));
    let text = missing.kind.to_string();
    assert!(
        text.contains("no reply") || text.contains("does not answer"),
        "{text}"
    );
    assert_eq!(driver.ports()[0].remotes().count(), 2);
    for _ in 0..5 {
        let _ = driver.read().unwrap();
        driver.write().unwrap();
        driver.bus_mut().pass(1);
    }
    assert_eq!(driver.read().unwrap().good, 2);
    drop(driver);
    simulated.plug(0, OUTPUTS, removed);
    assert!(
        Driver::start(&mut simulated, Settings::default())
            .unwrap()
            .missing()
            .is_empty()
    );
}

/// Reads that come before the transfer is complete.
#[test]
fn too_short_cycle_writes_no_doit_and_takes_no_input_twice() {
    let mut machine = running();
    let counted = |machine: &Machine| machine.driver.ports()[0].statistics().too_short;
    let (before, mut too_short) = (counted(&machine), 0);
    for _ in 0..500 {
        let report = machine.driver.read().unwrap();
        too_short += report.too_short;
        assert_eq!(report.failed + report.offline, 0, "{report:?}");
        machine.driver.write().unwrap();
        machine.pass(Duration::from_micros(30));
    }
    assert_eq!(counted(&machine) - before, u64::from(too_short));
    assert!(too_short > 200, "{too_short}");
    for channel in ALL {
        let failures = machine.status(channel).failures;
        assert_eq!(failures.total(), 0, "a DOIT while busy would be rejected");
        let transfers = machine.status(channel).transfers;
        assert!(
            transfers + u64::from(too_short) <= 506,
            "each is taken once"
        );
    }
    machine.cycles(3);
    assert!(machine.cycle().is_good());
}

#[test]
fn port_can_be_switched_off_and_on() {
    let mut machine = running();
    let run = machine
        .driver
        .pins()
        .output("hm2_7i92.0.sserial.port-0.run")
        .unwrap();
    machine.driver.pins_mut().set(run, false);
    machine.cycles(2);
    let off = "switched off, not left to their watchdogs";
    assert_eq!(are_outputs_on(&machine), [false; 3], "{off}");
    machine.cycles(2);
    assert!(
        ALL.iter()
            .all(|&c| !machine.is_running(c) && !machine.is_valid(c))
    );
    machine.cycles(60);
    assert_eq!(are_outputs_on(&machine), [false; 3]);
    machine.driver.pins_mut().set(run, true);
    machine.until(20, |machine| ALL.iter().all(|&c| machine.is_running(c)));
    machine.cycles(3);
    rearm_all(&mut machine);
}

#[test]
fn writes_alone_do_not_bring_back_a_board_whose_bus_was_down() {
    let driver = start(Faulty::new(fpga(), 1), |s| s.bus_error_limit = 1).unwrap();
    let mut machine = Machine::with(driver);
    machine.cycles(3);
    let bus = machine.driver.bus_mut();
    let next = bus.exchanges();
    bus.fail_at(next, Fault::NotExecuted(BusErrorKind::Lost));
    assert!(machine.driver.write().is_err());
    for _ in 0..3 {
        assert!(machine.driver.write().is_ok());
        assert_eq!(machine.driver.board_state(), BoardState::BusDown);
    }
}

/// A killed process runs nothing at its end: its driver is not even dropped.
#[test]
fn outputs_are_off_after_the_host_is_killed() {
    let mut simulated = fpga();
    let cycles = |simulated: &mut SimFpga, is_on: bool| {
        let mut driver = Driver::start(simulated, Settings::default()).unwrap();
        let field: I7i77Field = driver.attach((0, FIELD as u8)).unwrap();
        let output = field.outputs[3];
        for _ in 0..5 {
            let _ = driver.read().unwrap();
            output.set(driver.pins_mut(), is_on);
            driver.write().unwrap();
            driver.bus_mut().pass(1);
        }
        std::mem::forget(driver);
    };
    cycles(&mut simulated, true);
    assert_eq!(output_3(&simulated), Some(true));
    simulated.pass(5);
    assert!(simulated.watchdog().has_bitten());
    assert_eq!(simulated.read_register(0x1100), 0, "all pins are inputs");
    simulated.pass(55);
    assert_eq!(output_3(&simulated), Some(false), "its own watchdog");
    // A new process starts as if there had been none.
    cycles(&mut simulated, false);
    assert_eq!(output_3(&simulated), Some(false));
    cycles(&mut simulated, true);
    assert_eq!(output_3(&simulated), Some(true));
}

#[test]
fn stuck_port_goes_stale_then_safe_and_restarts() {
    let mut machine = running();
    machine.fpga().write_register(0x5B00, 0x3000); // COMMAND
    let is_stale = |machine: &mut Machine| ALL.iter().all(|&c| !machine.is_valid(c));
    assert!(machine.until(20, is_stale) <= 7);
    let is_safe = |machine: &mut Machine| ALL.iter().all(|&c| !machine.is_armed(c));
    machine.until(100, is_safe);
    let is_back = |machine: &mut Machine| ALL.iter().all(|&c| machine.is_running(c));
    machine.until(2_000, is_back);
    assert_eq!(machine.driver.ports()[0].statistics().stuck, 1);
    switch_on(&mut machine);
    machine.cycles(5);
    assert_eq!(are_outputs_on(&machine), [false; 3], "until re-armed");
    rearm_all(&mut machine);
}
