//! What an operator reads on the screen of all of LinuxCNC, from its error channel: the fault, the
//! pin that ends it, and what has to be homed again.

use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::halcmd::{alone, skipped};
use crate::session::SETTLE;
use crate::whole::LinuxCnc;
use crate::written::{expect, load, switch_on};

const IO_ERROR: &str = "set hm2_7i97.0.io_error to FALSE to go on";
const HAS_BIT: &str = "set hm2_7i97.0.watchdog.has_bit to FALSE to go on";
const REARM: &str = "set hm2_7i97.0.7i77.0.0.rearm to FALSE and TRUE to go on";
const HOME: &str = "position unsure of encoders 00, 01, 02, 03, 04, 05; home again";

/// Waits for a message, and forgets those before it.
fn read(linuxcnc: &mut LinuxCnc, begin: &str, end: &str) {
    let is_it = |said: &String| said.starts_with(begin) && said.ends_with(end);
    let begun = Instant::now();
    while !linuxcnc.halcmd.messages.iter().any(is_it) {
        let messages = &linuxcnc.halcmd.messages;
        assert!(begun.elapsed() < SETTLE, "{begin} ... {end}: {messages:#?}");
        // It comes with the answer to any command.
        linuxcnc.hal("joints");
        sleep(Duration::from_millis(20));
    }
    linuxcnc.halcmd.messages.clear();
}

/// The network is away for longer than the board's watchdog waits.
fn outage(linuxcnc: &mut LinuxCnc) {
    linuxcnc.board("loss 1");
    sleep(Duration::from_millis(500));
    linuxcnc.board("loss 0");
}

#[test]
fn screen_shows_each_fault_its_clearing_pin_and_axes_to_home() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut linuxcnc = load("operator");
    let messages = &linuxcnc.halcmd.messages;
    let is_unsure = |said: &String| said.contains("home again");
    assert!(!messages.iter().any(is_unsure), "{messages:#?}");

    outage(&mut linuxcnc);
    read(
        &mut linuxcnc,
        "hm2_7i97.0: connection lost for 0.",
        IO_ERROR,
    );
    // F1 and F2.
    switch_on(&mut linuxcnc);
    read(&mut linuxcnc, "hm2_7i97.0: ", HOME);

    linuxcnc.board("unplug 0");
    let offline = "hm2_7i97.0.7i77.0.0: card offline, outputs off: no reply";
    read(&mut linuxcnc, offline, REARM);
    linuxcnc.board("plug 0");
    read(&mut linuxcnc, "hm2_7i97.0.7i77.0.0: card back", REARM);
    switch_on(&mut linuxcnc);
    expect(&mut linuxcnc, "hm2_7i97.0.7i77.0.0.armed", true, SETTLE);

    // Found while the board waits for the operator.
    linuxcnc.board("reset 500ms");
    let reset = "hm2_7i97.0: the board was reset or lost power";
    read(&mut linuxcnc, reset, IO_ERROR);
    switch_on(&mut linuxcnc);
    read(&mut linuxcnc, "hm2_7i97.0: ", HOME);

    linuxcnc.hal("setp hm2_7i97.0.packet-error-limit 100000");
    outage(&mut linuxcnc);
    let bitten = "hm2_7i97.0: the board's watchdog has bitten (";
    read(&mut linuxcnc, bitten, HAS_BIT);
    switch_on(&mut linuxcnc);
    read(&mut linuxcnc, "hm2_7i97.0: ", HOME);
    linuxcnc.halcmd.end();
}
