//! The component in LinuxCNC itself, beside hostmot2 and hm2_eth on the same simulated board.
//!
//! Needs root and the package `linuxcnc-uspace`: see `examples/linuxcnc.sh`.

mod boards;
mod cost;
#[path = "../../../mesa-tools/tests/interop/halcmd.rs"]
#[allow(dead_code, unreachable_pub, reason = "shared with mesa-tools")]
mod halcmd;
mod names;
mod session;
mod threads;
#[path = "../../../mesa-tools/tests/interop/tools.rs"]
#[allow(unreachable_pub, reason = "shared with mesa-tools")]
mod tools;

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

/// The lines of HAL that the page and the manual page have for an emergency stop.
fn lines_for_estop() -> Vec<&'static str> {
    let page = include_str!("../../../../docs/linuxcnc.md");
    let manual = include_str!("../../packaging/mesa_eth.9");
    let lines = page.lines().filter(|line| line.contains("inputs-valid"));
    let lines: Vec<_> = lines.filter(|line| !line.contains('`')).collect();
    assert_eq!(lines.len(), 4, "{lines:?}");
    for line in &lines {
        assert!(manual.lines().any(|other| other == *line), "{line}");
    }
    lines
}

/// The table of faults in `docs/linuxcnc.md`.
#[test]
fn faults_end_as_the_page_says() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let mut session = Session::load("mesa_eth");
    session.run();
    session.switch_on();
    // The lines of the page, and of the manual page, for an emergency stop.
    for line in lines_for_estop() {
        // The arrow is for readers; the shell of this session would take it for a file.
        session.hal(&line.replace("servo-thread", "servo").replace("=> ", ""));
    }
    let are_valid = |session: &mut Session| session.value("getp inputs-valid.out");
    session.until("inputs are valid", |session| are_valid(session) == "TRUE");
    session.board("unplug 0");
    session.until("an input is not", |session| are_valid(session) == "FALSE");
    session.board("plug 0");
    session.until("inputs are valid", |session| are_valid(session) == "TRUE");
    session.set("7i77.0.0.rearm", "TRUE");
    session.expect_outputs([true; 3]);

    // A card is pulled, and put back.
    session.board("unplug 2");
    session.expect("7i72.0.2.valid", "FALSE");
    // Its own watchdog does that: nothing reaches it.
    session.expect_outputs([true, false, true]);
    session.set("7i77.0.0.output-03", "FALSE");
    session.expect_outputs([false, false, true]);
    session.set("7i77.0.0.output-03", "TRUE");
    session.board("plug 2");
    session.expect("7i72.0.2.valid", "TRUE");
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(session.outputs(), "[true, false, true]");
    assert_eq!(session.get("7i72.0.2.armed"), "FALSE");
    session.set("sserial.port-0.run", "FALSE");
    session.expect_outputs([false, false, true]);
    session.set("sserial.port-0.run", "TRUE");
    session.expect_outputs([true; 3]);

    // The same, with the pin of the remote.
    session.board("unplug 2");
    session.expect("7i72.0.2.valid", "FALSE");
    session.board("plug 2");
    session.expect("7i72.0.2.valid", "TRUE");
    session.set("7i72.0.2.rearm", "TRUE");
    session.expect_outputs([true; 3]);

    // A parameter that the card keeps is written while its port starts.
    session.set("7i72.0.2.nvwatchdogtimeout", "1900");
    session.set("sserial.port-0.run", "FALSE");
    session.expect_outputs([false, false, true]);
    session.set("sserial.port-0.run", "TRUE");
    session.expect_outputs([true; 3]);
    assert_eq!(session.board("watchdog 2"), "1900 ms");
    assert_eq!(session.get("7i72.0.2.nvwatchdogtimeout"), "1900");

    // The thread stops for longer than the watchdog's time.
    session.hal("stop");
    std::thread::sleep(Duration::from_secs(2));
    session.hal("start");
    session.expect("watchdog.has_bit", "TRUE");
    session.expect("valid", "FALSE");
    session.set("watchdog.has_bit", "FALSE");
    session.expect_outputs([true; 3]);

    // Packets are lost.
    session.set("packet-error-limit", "10");
    session.board("lose 1");
    session.expect("io_error", "TRUE");
    session.board("lose 0");
    session.set("packet-error-limit", "100000");
    // Nothing is exchanged until it is cleared.
    let errors = session.get("packet-error-total");
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(session.get("packet-error-total"), errors);
    assert_eq!(session.get("valid"), "FALSE");
    session.set("io_error", "FALSE");
    session.expect_outputs([true; 3]);
    session.expect("valid", "TRUE");

    // The end and another beginning, in one LinuxCNC.
    for _ in 0..3 {
        session.hal("stop");
        session.hal("unloadrt mesa_eth");
        session.expect_outputs([false; 3]);
        session.hal(&format!("loadrt mesa_eth {}", session::WORDS));
        session.set("packet-error-limit", "100000");
        session.set("watchdog.timeout_ns", "1000000000");
        session.hal("addf .read servo");
        session.hal("addf .write servo");
        session.hal("start");
        session.switch_on();
    }
    session.hal("stop");
    session.stop();
}
