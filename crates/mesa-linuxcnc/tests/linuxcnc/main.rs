//! The component in LinuxCNC itself, beside hostmot2 and hm2_eth on the same simulated board.
//!
//! Needs root and the package `linuxcnc-uspace`: see `examples/linuxcnc.sh`.

mod boards;
mod cost;
mod faults;
#[path = "../../../mesa-tools/tests/interop/halcmd.rs"]
#[allow(dead_code, unreachable_pub, reason = "shared with mesa-tools")]
mod halcmd;
mod installed;
mod look;
mod messages;
mod names;
mod operator;
mod outage;
#[path = "../../../mesa-tools/tests/interop/passive.rs"]
#[allow(unreachable_pub, reason = "shared with mesa-tools")]
mod passive;
mod pci;
#[path = "../fake_hal/pci_board.rs"]
#[allow(unreachable_pub, reason = "shared with the tests without LinuxCNC")]
mod pci_board;
mod servo;
mod session;
mod stepper;
mod threads;
#[path = "../../../mesa-tools/tests/interop/tools.rs"]
#[allow(dead_code, unreachable_pub, reason = "shared with mesa-tools")]
mod tools;
mod whole;
mod written;

use std::time::Duration;

use halcmd::{alone, skipped};
use session::Session;

#[test]
fn wrong_words_are_refused_by_name_and_linuxcnc_lives() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut session = Session::start();
    session.hal("loadrt threads name1=servo period1=1000000");
    for (words, word) in [
        ("board_ip=7i97", "board_ip=7i97"),
        ("board_ip=10.97.0.2 config=num_encoder=6", "num_encoder=6"),
        (
            "board_ip=10.97.0.2 config=sserial_port_0=0z",
            "sserial_port_0=0z",
        ),
        ("board_ip=10.97.0.2 config=num_encoders=60", "60"),
        ("board_ip=10.97.0.9", "board_ip=10.97.0.9"),
    ] {
        let answer = session.try_hal(&format!("loadrt mesa_eth {words}"));
        let mut messages = answer.expect_err("it is refused").join("\n");
        // What the realtime part says comes late.
        for _ in 0..50 {
            if messages.contains(word) {
                break;
            }
            std::thread::sleep(Duration::from_millis(20));
            messages += &session.hal("list comp").join("\n");
        }
        assert!(messages.contains("mesa_eth: "), "{words}: {messages}");
        assert!(messages.contains(word), "{words}: {messages}");
    }
    let list = session.hal("list comp").join(" ");
    assert!(
        list.contains("threads") && !list.contains("mesa_eth"),
        "{list}"
    );
    session.hal("loadrt mesa_eth board_ip=10.97.0.2 config=sserial_port_0=000xxxxx");
    session.stop();
}
