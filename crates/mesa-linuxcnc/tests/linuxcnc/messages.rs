//! What a reader of LinuxCNC's messages sees of faults and of settings that cannot be.

use std::time::{Duration, Instant};

use super::halcmd::{alone, skipped};
use super::session::{I7I97, SETTLE, Session, Setup};

/// Waits for a message, which comes with the answer to any command.
fn expect(session: &mut Session, begin: &str, end: &str) {
    let is_it = |said: &String| said.starts_with(begin) && said.ends_with(end);
    let begun = Instant::now();
    while !session.messages.iter().any(is_it) {
        let in_time = begun.elapsed() < SETTLE;
        assert!(in_time, "{begin} ... {end}: {:#?}", session.messages);
        session.hal("list comp");
        std::thread::sleep(Duration::from_millis(20));
    }
    session.messages.clear();
}

#[test]
fn messages_of_faults_name_the_pin_that_ends_them() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut session = Session::load_with(&I7I97, "mesa_eth");
    session.run();
    session.switch_on();
    session.board("unplug 2");
    let card = "hm2_7i97.0.7i72.0.2";
    let rearm = "set hm2_7i97.0.7i72.0.2.rearm to FALSE and TRUE to go on";
    expect(
        &mut session,
        &format!("{card}: card offline, outputs off: no reply"),
        rearm,
    );
    session.board("plug 2");
    expect(
        &mut session,
        &format!("{card}: card back, outputs off: "),
        rearm,
    );
    session.set("7i72.0.2.rearm", "TRUE");
    expect(
        &mut session,
        &format!("{card}: card runs, outputs follow"),
        "",
    );
    session.set("pwmgen.00.enable", "TRUE");
    session.set("packet-error-limit", "10");
    session.board("lose 1");
    let io_error = "set hm2_7i97.0.io_error to FALSE to go on";
    expect(&mut session, "hm2_7i97.0: connection lost for 0.", io_error);
    session.board("lose 0");
    session.set("packet-error-limit", "100000");
    session.set("pwmgen.00.enable", "FALSE");
    session.cycles();
    session.set("pwmgen.00.enable", "TRUE");
    expect(
        &mut session,
        "hm2_7i97.0: the machine is on, and all outputs are off",
        io_error,
    );
    session.set("io_error", "FALSE");
    expect(&mut session, "hm2_7i97.0: ", "the board runs again");
    session.expect_outputs([true; 3]);
    session.stop();
}

#[test]
fn command_above_the_limit_is_reported_with_the_generator() {
    const I7I92: Setup = Setup {
        options: &["--board", "7i92-7i76"],
        prefix: "hm2_7i92.0",
        words: "board_ip=10.97.0.2 config=\"num_stepgens=1 sserial_port_0=0xxxxxxx\"",
        last: "7i76.0.0.output-15",
    };
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut session = Session::load_with(&I7I92, "mesa_eth");
    session.run();
    for (name, value) in [
        ("position-scale", "100"),
        ("maxaccel", "100000"),
        ("maxvel", "100000"),
        ("steplen", "5000"),
        ("stepspace", "5000"),
        ("enable", "TRUE"),
    ] {
        session.set(&format!("stepgen.00.{name}"), value);
    }
    session.cycles();
    session.set("stepgen.00.position-cmd", "100000");
    let check = "check maxvel, position-scale, steplen and stepspace";
    expect(&mut session, "hm2_7i92.0.stepgen.00: ", check);
    session.stop();
}

/// As after an emergency stop that cuts field power.
#[test]
fn card_without_field_power_at_load_is_reported_and_recovers() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut session = Session::start();
    session.board("field 0 0");
    session.hal(&format!("loadrt mesa_eth {}", I7I97.words));
    let card = "hm2_7i97.0.7i77.0.0";
    let offline = format!("mesa_eth: {card}: card offline: field voltage too low");
    expect(&mut session, &offline, "");
    session.run();
    for (name, value) in [
        ("valid", "FALSE"),
        ("input-07", "FALSE"),
        ("input-07-not", "TRUE"),
    ] {
        assert_eq!(session.get(&format!("7i77.0.0.{name}")), value, "{name}");
    }
    expect(
        &mut session,
        &format!("{card}: card offline, outputs off: field voltage too low"),
        "and its outputs follow then",
    );
    session.board("field 0 24");
    session.board("input 7 on");
    session.expect("7i77.0.0.valid", "TRUE");
    session.expect("7i77.0.0.input-07", "TRUE");
    session.expect("7i77.0.0.input-07-not", "FALSE");
    session.switch_on();
    session.stop();
}

#[test]
fn out_of_range_values_are_corrected_and_reported() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut session = Session::load_with(&I7I97, "mesa_eth");
    session.run();
    for (name, set, used, allowed) in [
        ("pwmgen.00.output-type", "5", "1", "1 to 4"),
        ("pwmgen.pwm_frequency", "10000000", "390619", "1 to 390619"),
        ("pwmgen.pdm_frequency", "0", "1", "1 to 199996948"),
    ] {
        session.set(name, set);
        expect(
            &mut session,
            &format!("hm2_7i97.0: {name}: {set} is out of range {allowed}"),
            &format!("{used} is used"),
        );
        session.expect(name, used);
    }
    session.stop();
}

#[test]
fn period_that_cannot_be_drives_nothing_until_it_can() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut session = Session::load_with(&I7I97, "mesa_eth");
    session.hal("loadrt threads name1=servo period1=2000000");
    session.set("packet-error-limit", "100000");
    session.set("watchdog.timeout_ns", "3000000");
    session.set("ssr.00.out-02", "TRUE");
    session.hal("addf .read servo");
    session.hal("addf .write servo");
    session.hal("start");
    let refused = "hm2_7i97.0: all outputs off: its watchdog bites after 3 ms, and a thread of 2 ms needs 4 ms; \
                   choose a faster thread, or set watchdog.timeout_ns; ";
    let again = "then set hm2_7i97.0.io_error to FALSE to try again";
    // Twice: it is repeated.
    for _ in 0..2 {
        expect(&mut session, refused, again);
        assert_eq!(session.get("io_error"), "TRUE");
        assert_eq!(session.get("valid"), "FALSE");
        session.expect_outputs([false; 3]);
    }
    session.set("watchdog.timeout_ns", "1000000000");
    session.set("io_error", "FALSE");
    session.expect("valid", "TRUE");
    session.expect_outputs([false, false, true]);
    session.stop();
}
