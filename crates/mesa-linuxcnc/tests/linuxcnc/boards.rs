//! Names, types, directions and values of a fresh load, on two kinds of boards.

use std::thread;

use super::cost;
use super::halcmd::{alone, skipped};
use super::names;
use super::session::{I7I97, Session, Setup};

/// A 7I92, with a 7I97 as the second board.
const I7I92: Setup = Setup {
    options: &["--board", "7i92-7i77", "--second", "7i97"],
    prefix: "hm2_7i92.0",
    words: "board_ip=10.97.0.2 config=sserial_port_0=000xxxxx",
    last: "7i72.0.2.output-47",
};

/// A 7I92 with a 7I76.
const STEPPERS: Setup = Setup {
    options: &["--board", "7i92-7i76"],
    prefix: "hm2_7i92.0",
    words: "board_ip=10.97.0.2 config=sserial_port_0=0xxxxxxx",
    last: "7i76.0.0.output-15",
};

/// The same with index, probe and tables. The last two generators are not in use, and the outputs
/// of tables are, as far as the first of them.
const STEPPERS_WITH_INDEX: Setup = Setup {
    options: &["--board", "7i92-7i76-index"],
    words: "board_ip=10.97.0.2 config=\"num_stepgens=3 stepgen_width=3 sserial_port_0=0xxxxxxx\"",
    ..STEPPERS
};

/// Loads hostmot2 and `mesa_eth`, each in a LinuxCNC of its own, and compares what HAL has.
fn loaded_by_both(setup: &Setup, at_least: usize) -> [Session; 2] {
    let load = |driver| {
        let mut session = Session::load_with(setup, driver);
        let list = session.list();
        names::keep(&format!("{}-{driver}", setup.prefix), &list);
        (session, list)
    };
    let (hostmot2, theirs) = load("hm2_eth");
    let (ours, own) = load("mesa_eth");
    names::compare(&theirs, &own, at_least);
    [hostmot2, ours]
}

/// Waits for both at the same time.
fn stop([one, other]: [Session; 2]) {
    let one = thread::spawn(|| one.stop());
    other.stop();
    one.join().expect("it stops");
}

#[test]
fn pins_of_a_7i97_match_hostmot2_and_the_cycle_cost_is_printed() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut both = loaded_by_both(&I7I97, 600);
    cost::measure(&mut both);
    stop(both);
}

#[test]
fn step_generators_of_a_7i76_are_those_that_hostmot2_makes() {
    if skipped() {
        return;
    }
    let _alone = alone();
    stop(loaded_by_both(&STEPPERS, 300));
    stop(loaded_by_both(&STEPPERS_WITH_INDEX, 300));
}

#[test]
fn pins_of_a_7i92_and_of_two_boards_have_the_hostmot2_names() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let [hostmot2, mut ours] = loaded_by_both(&I7I92, 500);
    ours.hal("unloadrt mesa_eth");
    ours.hal(
        "loadrt mesa_eth board_ip=10.97.0.2:27182,10.97.0.2 \
         config=\"num_encoders=6 sserial_port_0=000xxxxx,sserial_port_0=000xxxxx\"",
    );
    ours.hal("loadrt threads name1=servo period1=1000000");
    for board in ["hm2_7i97.0", "hm2_7i92.0"] {
        ours.hal(&format!("setp {board}.packet-error-limit 100000"));
        ours.hal(&format!("setp {board}.watchdog.timeout_ns 1000000000"));
        ours.hal(&format!("addf {board}.read servo"));
        ours.hal(&format!("addf {board}.write servo"));
    }
    ours.hal("start");
    for pin in ["hm2_7i97.0.valid", "hm2_7i92.0.7i72.0.2.armed"] {
        ours.until(pin, |ours| ours.value(&format!("getp {pin}")) == "TRUE");
    }
    ours.hal("stop");
    stop([hostmot2, ours]);
}
