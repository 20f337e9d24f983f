//! Faults of the board, of a card or of the thread, and the acts after them.

use super::*;

#[test]
fn pulled_card_fails_alone_and_stays_safe_until_run_is_switched() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.pull(OUTPUTS);
    bench.run(200);
    assert_eq!(bench.outputs(), [true, false, true]);
    assert!(!bench.is_on("7i72.0.2.valid"));
    let errors = bench.heard(Level::Error);
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert!(errors[0].starts_with("hm2_7i97.0.7i72.0.2: "), "{errors:?}");
    // The others follow.
    bench.set("7i77.0.0.output-03", false);
    bench.run(3);
    assert_eq!(bench.outputs(), [false, false, true]);
    bench.set("7i77.0.0.output-03", true);
    bench.put_back(OUTPUTS);
    bench.run(10_000);
    assert_eq!(bench.outputs(), [true, false, true]);
    assert!(bench.is_on("7i72.0.2.valid"));
    assert!(!bench.is_on("7i72.0.2.armed"));
    bench.set("sserial.port-0.run", false);
    bench.run(200);
    assert_eq!(bench.outputs(), [false, false, true]);
    bench.set("sserial.port-0.run", true);
    bench.run(1_000);
    assert_eq!(bench.outputs(), [true; 3]);
    assert!(bench.is_on("7i72.0.2.armed"));
}

#[test]
fn rising_edge_of_rearm_arms_one_remote_even_before_it_is_back() {
    let mut bench = Bench::running();
    bench.switch_on();
    for channel in [FIELD, OUTPUTS] {
        bench.pull(channel);
    }
    bench.run(200);
    bench.set("7i72.0.2.rearm", true);
    bench.run(10);
    for channel in [FIELD, OUTPUTS] {
        bench.put_back(channel);
    }
    bench.run(10_000);
    assert_eq!(bench.outputs(), [false, true, true]);
    // The pin is still on: no edge.
    bench.pull(OUTPUTS);
    bench.run(200);
    bench.put_back(OUTPUTS);
    bench.run(10_000);
    assert_eq!(bench.outputs(), [false, false, true]);
    bench.set("7i77.0.0.rearm", true);
    bench.run(10);
    assert_eq!(bench.outputs(), [true, false, true]);
}

#[test]
fn stopped_thread_makes_outputs_safe_until_has_bit_is_cleared() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.wait(Duration::from_secs(2));
    bench.run(500);
    assert_eq!(bench.outputs(), [false; 3]);
    assert!(bench.is_on("watchdog.has_bit"));
    assert!(!bench.is_on("io_error"));
    let errors = bench.heard(Level::Error);
    assert!(errors[0].contains("watchdog has bitten"), "{errors:?}");
    bench.set("watchdog.has_bit", false);
    bench.run(1_000);
    assert_eq!(bench.outputs(), [true; 3]);
    assert!(!bench.is_on("watchdog.has_bit"));
}

#[test]
fn lost_packets_set_io_error_and_clearing_it_restores_outputs() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench
        .cycle
        .driver
        .bus_mut()
        .fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
    bench.run(400);
    assert!(bench.is_on("io_error"));
    assert!(!bench.is_on("valid"));
    bench.cycle.driver.bus_mut().heal();
    bench.run(500);
    assert_eq!(bench.outputs(), [false; 3]);
    bench.set("io_error", false);
    bench.run(1_000);
    assert_eq!(bench.outputs(), [true; 3]);
    assert!(!bench.is_on("io_error") && !bench.is_on("watchdog.has_bit"));
    assert!(bench.is_on("valid"));
}

/// A signal reaches it, as that of F1, and no parameter.
#[test]
fn boards_rearm_clears_io_error_and_has_bit() {
    for held_before in [false, true] {
        let mut bench = Bench::running();
        bench.switch_on();
        bench.set("rearm", held_before);
        bench.run(10);
        bench
            .cycle
            .driver
            .bus_mut()
            .fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
        bench.run(400);
        bench.cycle.driver.bus_mut().heal();
        bench.run(500);
        assert!(bench.is_on("io_error"), "nobody has asked for anything");
        bench.set("rearm", false);
        bench.run(2);
        assert!(bench.is_on("io_error"));
        bench.set("rearm", true);
        bench.run(1_000);
        assert_eq!(bench.outputs(), [true; 3]);
        assert!(!bench.is_on("io_error") && !bench.is_on("watchdog.has_bit"));
    }
}

#[test]
fn new_fault_withdraws_what_was_asked_for() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.pull(OUTPUTS);
    bench.wait(Duration::from_secs(2));
    bench.run(10);
    bench.set("watchdog.has_bit", false);
    bench.run(500);
    // The pulled card is awaited.
    assert_eq!(bench.outputs(), [true, false, true]);
    bench.wait(Duration::from_secs(2));
    bench.run(10);
    bench.put_back(OUTPUTS);
    bench.run(10_000);
    assert_eq!(bench.outputs(), [false; 3]);
    bench.set("watchdog.has_bit", false);
    bench.run(1_000);
    assert_eq!(bench.outputs(), [true; 3]);
}

/// As with hm2_eth, whose board is not fed meanwhile either.
#[test]
fn io_error_of_the_user_lets_the_board_bite_if_it_lasts() {
    for (millis, has_bitten) in [(3, false), (1_000, true)] {
        let mut bench = Bench::running();
        bench.switch_on();
        bench.set("io_error", true);
        let before = exchanges(&bench);
        bench.run(millis);
        assert_eq!(exchanges(&bench), before);
        bench.set("io_error", false);
        bench.run(1_000);
        assert_eq!(bench.is_on("watchdog.has_bit"), has_bitten, "{millis} ms");
        assert_eq!(bench.outputs(), [!has_bitten; 3], "{millis} ms");
        bench.set("watchdog.has_bit", false);
        bench.run(1_000);
        assert_eq!(bench.outputs(), [true; 3], "{millis} ms");
    }
}

#[test]
fn io_error_stops_all_writes_and_clearing_it_restores_outputs() {
    let mut bench = Bench::running();
    bench.switch_on();
    // By the user.
    bench.set("io_error", true);
    let before = exchanges(&bench);
    bench.run(3);
    assert_eq!(exchanges(&bench), before);
    for name in ["valid", "7i77.0.0.valid", "7i72.0.2.valid"] {
        assert!(!bench.is_on(name), "{name}");
    }
    bench.set("io_error", false);
    bench.run(1_000);
    assert!(bench.is_on("valid") && bench.is_on("7i72.0.2.valid"));
    assert_eq!(bench.outputs(), [true; 3]);
    // By the driver: the errors are not counted on and on.
    let bus = bench.cycle.driver.bus_mut();
    bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
    bench.run(50);
    assert!(bench.is_on("io_error"));
    let errors = bench.bits("packet-error-total");
    bench.run(1_000);
    assert_eq!(bench.bits("packet-error-total"), errors);
    assert_eq!(bench.outputs(), [false; 3]);
    bench.cycle.driver.bus_mut().heal();
    bench.run(100);
    assert!(bench.is_on("io_error"), "nobody has cleared it");
    bench.set("io_error", false);
    bench.run(1_000);
    assert_eq!(bench.outputs(), [true; 3]);
}

/// The board is away for a second, which loses its configuration; the user clears `io_error` before
/// or after it is known that it did.
#[test]
fn no_message_claims_safe_outputs_that_are_on() {
    let mut known_before = [0; 2];
    for wait in (0..12).step_by(2) {
        for is_between in [false, true] {
            let mut bench = Bench::running();
            bench.switch_on();
            bench.fpga().reset_for(1_000_000_000);
            bench.run(900);
            assert!(bench.is_on("io_error"));
            bench.run(100 + wait);
            if is_between {
                bench.cycle.read(PERIOD);
            }
            let is_known = bench.cycle.driver.board_state() == BoardState::Reset;
            known_before[usize::from(is_known)] += 1;
            bench.set("io_error", false);
            if is_between {
                bench.cycle.write(PERIOD);
                bench.wait(PERIOD);
            }
            bench.run(300);
            let told = format!(
                "{wait}, between {is_between}, known {is_known}: {:#?}",
                bench.heard(Level::Error)
            );
            if !is_known {
                let state = bench.cycle.driver.board_state();
                assert_eq!(state, BoardState::Reset, "{told}");
                assert_eq!(bench.outputs(), [false; 3], "{told}");
                assert!(bench.is_on("io_error") && !bench.is_on("armed"), "{told}");
                bench.set("io_error", false);
                bench.run(300);
            }
            // What is known is covered.
            assert_eq!(bench.outputs(), [true; 3], "{told}");
            assert!(bench.is_on("armed") && !bench.is_on("io_error"), "{told}");
        }
    }
    assert!(
        known_before.iter().all(|&count| count > 1),
        "{known_before:?}"
    );
}

/// A thread that has `write` and not `read` for a while.
#[test]
fn outputs_off_after_writes_alone_are_shown_and_re_armed() {
    let mut bench = Bench::running();
    bench.switch_on();
    assert!(bench.is_on("armed") && bench.is_on("valid"));
    for _ in 0..20 {
        bench.cycle.write(PERIOD);
        bench.wait(PERIOD);
    }
    bench.run(10);
    assert_eq!(bench.outputs(), [false; 3]);
    assert!(bench.is_on("valid") && !bench.is_on("armed"));
    assert!(!bench.is_on("7i77.0.0.armed") && !bench.is_on("7i72.0.2.armed"));
    bench.set("rearm", true);
    bench.run(10);
    assert_eq!(bench.outputs(), [false, false, true]);
    assert!(bench.is_on("armed") && !bench.is_on("7i77.0.0.armed"));
    bench.set("7i77.0.0.rearm", true);
    bench.run(10);
    assert_eq!(bench.outputs(), [true, false, true]);
    // The user's own `io_error` stops all exchanges: nothing follows then.
    bench.set("io_error", true);
    bench.run(1);
    assert!(!bench.is_on("armed") && !bench.is_on("7i77.0.0.armed"));
}

/// An emergency stop that cuts field power leaves a card without it when LinuxCNC loads the driver.
#[test]
fn card_without_field_power_at_the_load_has_all_its_pins() {
    let set_volts = |fpga: &mut SimFpga, volts| {
        let now = SimFpga::now(fpga);
        let remote = fpga.remote_mut(0, FIELD).expect("a remote");
        let device = find_mut(remote).expect("a device");
        device.set_field_volts(now, volts).expect("field power");
    };
    let mut fpga = machines::six_axes_7i97(Motor::default());
    set_volts(&mut fpga, 0.0);
    let mut bench = Bench::on(fpga, Settings::default());
    let names = ["7i77.0.0.input-03", "7i77.0.0.input-03-not"];
    let shown = |bench: &Bench| names.map(|name| bench.is_on(name));
    assert_eq!(shown(&bench), [false, true]);
    bench.run(300);
    assert_eq!(shown(&bench), [false, true]);
    assert!(!bench.is_on("7i77.0.0.valid") && !bench.is_on("7i77.0.0.armed"));
    assert!(bench.is_on("7i72.0.2.valid") && bench.is_on("7i72.0.2.armed"));
    let errors = bench.heard(Level::Error);
    assert!(
        errors.iter().any(|error| error.contains("7i77.0.0")),
        "{errors:#?}"
    );
    set_volts(bench.fpga(), 24.0);
    let remote = bench.fpga().remote_mut(0, FIELD).expect("a remote");
    let device = find_mut(remote).expect("a device");
    device.set_input(3, true).expect("an input");
    bench.set("sserial.port-0.run", false);
    bench.run(100);
    bench.set("sserial.port-0.run", true);
    bench.run(100);
    assert_eq!(shown(&bench), [true, false]);
    assert!(bench.is_on("7i77.0.0.valid") && bench.is_on("7i77.0.0.armed"));
}
