//! What a reader of LinuxCNC's messages sees of faults and of settings that cannot be.

use super::halcmd::{alone, skipped};
use super::session::{I7I97, Session, Setup};

/// Waits for a message, which comes with the answer to any command.
fn expect(session: &mut Session, begin: &str, end: &str) {
    let is_it = |said: &String| said.starts_with(begin) && said.ends_with(end);
    session.until(&format!("{begin} ... {end}"), |session| {
        session.hal("list comp");
        session.messages.iter().any(is_it)
    });
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
fn a_command_above_the_limit_is_said_with_the_generator() {
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
