//! The emergency-stop chain that `mesa hal --driver mesa_eth` writes, in all of LinuxCNC, on the
//! simulated mill. The truth is the board's console.

use std::time::{Duration, Instant};

use crate::halcmd::{alone, skipped};
use crate::session::SETTLE;
use crate::whole::{LinuxCnc, Machine, written_for};

const MILL: Machine = Machine {
    toml: "../../../../examples/mill.toml",
    prefix: "hm2_7i97.0",
};

const OPTIONS: &[&str] = &["--driver", "mesa_eth", "--axes", "XYZ"];

/// Within this time after a fault the machine is off: inputs may be invalid for a tenth of a
/// second.
const STOPS: Duration = Duration::from_secs(2);

/// Attempts to switch the machine on.
const TRIES: usize = 5;

pub fn load(name: &str) -> LinuxCnc {
    let files = written_for(MILL, OPTIONS, include_str!("written/values.ini"));
    let mut linuxcnc = LinuxCnc::load(name, &files, MILL);
    switch_on(&mut linuxcnc);
    linuxcnc.hal("home 0");
    linuxcnc
}

/// F1 and F2, again where a busy computer stops the machine at once.
pub fn switch_on(linuxcnc: &mut LinuxCnc) {
    for _ in 0..TRIES {
        linuxcnc.hal("on");
        std::thread::sleep(Duration::from_millis(300));
        if is_on(linuxcnc, "motion.motion-enabled") {
            return;
        }
        for link in ["watchdog", "network", "inputs", "position", "button"] {
            let ok = is_on(linuxcnc, &format!("estop-{link}.ok-out"));
            println!("estop-{link}: {ok}");
        }
    }
    panic!("the machine stays off");
}

fn is_on(linuxcnc: &mut LinuxCnc, name: &str) -> bool {
    linuxcnc.halcmd.value(&format!("getp {name}")) == "TRUE"
}

pub fn expect(linuxcnc: &mut LinuxCnc, name: &str, on: bool, within: Duration) {
    let begun = Instant::now();
    while is_on(linuxcnc, name) != on {
        assert!(begun.elapsed() < within, "{name} stays {}", !on);
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Its home, limit and emergency-stop inputs keep their last value while it is unplugged.
#[test]
fn unplugged_card_stops_the_machine_that_mesa_hal_wrote() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut linuxcnc = load("written-unplugged");
    switch_on(&mut linuxcnc);
    linuxcnc.board("unplug 0");
    expect(&mut linuxcnc, "motion.motion-enabled", false, STOPS);
    assert!(
        is_on(&mut linuxcnc, "joint.0.homed"),
        "the axis is where it was"
    );
    linuxcnc.board("plug 0");
    // The screen's button: it lets the card's outputs follow again, too.
    switch_on(&mut linuxcnc);
    expect(&mut linuxcnc, "hm2_7i97.0.7i77.0.0.armed", true, SETTLE);
    linuxcnc.halcmd.end();
}

/// A 7I97's encoders are multiplexed: while its watchdog has bitten, they are not read.
#[test]
fn joint_is_unhomed_when_a_fault_makes_its_position_unsure() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut linuxcnc = load("written-unsure");
    expect(&mut linuxcnc, "joint.0.homed", true, SETTLE);
    expect(
        &mut linuxcnc,
        "hm2_7i97.0.encoder.00.count-unsure",
        false,
        SETTLE,
    );
    for _ in 0..2 {
        linuxcnc.board("loss 1");
        std::thread::sleep(Duration::from_millis(600));
        linuxcnc.board("loss 0");
        expect(&mut linuxcnc, "motion.motion-enabled", false, STOPS);
        expect(&mut linuxcnc, "halui.estop.is-activated", true, SETTLE);
        // F1 clears io_error and has_bit: that is all it takes.
        switch_on(&mut linuxcnc);
        expect(&mut linuxcnc, "joint.0.homed", false, SETTLE);
        // Homed without an index.
        linuxcnc.hal("home 0");
        expect(
            &mut linuxcnc,
            "hm2_7i97.0.encoder.00.count-unsure",
            false,
            SETTLE,
        );
        switch_on(&mut linuxcnc);
    }
    linuxcnc.halcmd.end();
}
