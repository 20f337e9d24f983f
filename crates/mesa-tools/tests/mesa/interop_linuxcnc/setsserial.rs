//! LinuxCNC's `setsserial` writes parameters and firmware of a simulated remote, with the same
//! results as `mesa param` and `mesa update` (FACTS 1.6). `setsserial` only writes; parameters that
//! `mesa param` has written are read by LinuxCNC's driver when it loads.

use std::net::Ipv4Addr;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use super::expected::Expected;
use super::linuxcnc::{Machine, alone, skipped};
use crate::interop::board::Board;
use crate::interop::{Scratch, mesa};

/// Only the required name is looked for.
const I7I72: &str = "param u32 RW 7i72.0.0.nvwatchdogtimeout";

/// Time limit for writing firmware.
const PATIENCE: Duration = Duration::from_secs(60);

/// Path of a file as LinuxCNC looks for firmware: below /lib/firmware.
fn below_firmware(path: &str) -> String {
    let firmware = Path::new("/lib/firmware").canonicalize();
    let depth = firmware.map_or(2, |path| path.components().count() - 1);
    format!("{}{path}", "/..".repeat(depth))
}

#[test]
fn setsserial_writes_program_and_parameter_to_simulated_remote() {
    if skipped() {
        return;
    }
    if !Path::new("/usr/lib/linuxcnc/modules/setsserial.so").exists() {
        crate::interop::tools::skip("LinuxCNC has no `setsserial`");
        return;
    }
    if !Path::new("/lib/firmware").exists() {
        crate::interop::tools::skip("there is no /lib/firmware, where LinuxCNC looks for firmware");
        return;
    }
    let _alone = alone();
    let expected = Expected::of(&[I7I72]);
    let board = "--board 7i97 --remote 0=7i72:setup";
    // The baud rate of the jumper's setup position.
    let hostmot2 = "loadrt hostmot2 sserial_baudrate=115200";
    let mut machine = Machine::load_with("hm2_7i97.0", "setsserial", board, &expected, hostmot2);
    let file = Scratch::public("7I72-60.BIN");
    machine.board.run(&format!("firmware 0 60 {}", file.path()));

    let set = "loadrt setsserial cmd=\"set hm2_7i97.0.7i72.0.0.nvwatchdogtimeout 75\"";
    // Its messages come late, and on another process's standard error: the board has the truth.
    machine.said(set);
    machine.expect_board("0", "remote.0.parameter.nvwatchdogtimeout", |time| {
        time == 75.0
    });
    machine.said("unloadrt setsserial");

    assert_eq!(machine.board.show("0")["remote.0.revision"], "14");
    let flash = format!(
        "loadrt setsserial cmd=\"flash hm2_7i97.0.7i72.0.0 {}\"",
        below_firmware(file.path())
    );
    let mut said = machine.said(&flash);
    let since = Instant::now();
    while !said.contains("Firmware Flash") && since.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(100));
        said += &machine.said("show comp setsserial");
    }
    machine.board.run("jumper 0 operate");
    let shown = machine.board.show("0");
    assert_eq!(shown["remote.0.bootloader"], "0", "{said}");
    assert_eq!(shown["remote.0.revision"], "60", "{said}");
    machine.stop();
}

#[test]
fn linuxcnc_reads_parameters_written_by_mesa_param() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let state = Scratch::new("param.state");
    let kept = format!("--board 7i97 --remote 0=7i72 --state {}", state.path());
    // Outside of LinuxCNC's network, which is private.
    let arguments: Vec<&str> = kept.split(' ').collect();
    let mut board = Board::start(Ipv4Addr::new(127, 97, 0, 4), &arguments);
    let before = board.console.show("0")["remote.0.parameter.nvwatchdogtimeout"].clone();
    assert_ne!(before, "77");
    let set = Command::new(mesa())
        .args(["param", "set", "0.0.nvwatchdogtimeout", "77", "--yes"])
        .args(["--addr", &board.address.to_string()])
        .output()
        .expect("mesa starts");
    let error = String::from_utf8_lossy(&set.stderr);
    assert!(set.status.success(), "{error}");
    board.stop("TERM");
    let mut machine = Machine::load("hm2_7i97.0", "param", &kept, &Expected::of(&[I7I72]));
    assert_eq!(machine.number("7i72.0.0.nvwatchdogtimeout"), 77.0);
    machine.stop();
}
