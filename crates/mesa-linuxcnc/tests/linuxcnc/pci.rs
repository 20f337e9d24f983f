//! `mesa_pci` in LinuxCNC itself, on a simulated 5I25 in mapped memory.

use std::path::Path;
use std::time::{Duration, Instant};

use mesa_hal_sim::{Motor, Stepper, machines};

use super::halcmd::{Halcmd, Started, alone, skipped};
use super::pci_board::PciBoard;
use super::session::{SETTLE, built};
use super::tools::realtime;

/// Steps of a unit.
const SCALE: f64 = 1_000.0;
/// The first stepper motor among the axes of the board.
const STEPPERS: usize = 6;

/// LinuxCNC with the board in place of those of the computer.
fn start(folder: &Path, sysfs: &str) -> Halcmd {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sandbox = realtime(package.join("tests/linuxcnc/on_pci.sh"));
    sandbox
        .arg(sysfs)
        .arg(built("libmesa_eth.so"))
        .arg(package.join("../mesa-tools/tests/mesa/interop_linuxcnc/session.sh"));
    std::fs::create_dir_all(folder).expect("a folder");
    let Started { halcmd, .. } = Halcmd::start("hm2_5i25.0", sandbox, folder);
    halcmd
}

fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < SETTLE, "never: {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn mesa_pci_drives_a_5i25_with_7i77_and_7i76_as_hm2_pci_does() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let fpga = machines::eleven_axes_5i25(Motor::default(), Stepper::default());
    let board = PciBoard::start("in-linuxcnc", fpga);
    board.seen.set_input(7, true);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mesa_pci");
    let mut hal = start(&folder, board.root());
    hal.hal("loadrt hostmot2");
    let words = "config=\"num_encoders=6 num_stepgens=5 sserial_port_0=00x0xxxx\"";
    // The user has no rights to the files, and what the user names is not opened as root.
    let sysfs = format!("loadrt mesa_pci {words} sysfs={}", board.root());
    assert!(hal.try_hal(&sysfs).is_err());
    hal.hal(&format!("loadrt mesa_pci {words}"));
    hal.hal("loadrt threads name1=fast period1=500000 name2=servo period2=1000000");
    hal.set("watchdog.timeout_ns", "1000000000");
    for (name, value) in [
        ("stepgen.04.position-scale", "1000"),
        ("stepgen.04.maxvel", "2"),
        ("stepgen.04.maxaccel", "10"),
        ("stepgen.04.steplen", "5000"),
        ("stepgen.04.stepspace", "5000"),
        ("stepgen.04.dirsetup", "10000"),
        ("stepgen.04.dirhold", "10000"),
        ("stepgen.04.position-cmd", "0.5"),
        ("stepgen.04.enable", "TRUE"),
        ("7i77.0.0.output-03", "TRUE"),
    ] {
        hal.set(name, value);
    }
    hal.hal("addf .read servo");
    hal.hal("addf .write servo");
    // I/O pins alone, in a faster thread.
    hal.hal("addf .read_gpio fast");
    hal.hal("addf .write_gpio fast");
    hal.hal("start");
    until("a fast call", || hal.get("write_gpio.time") != "0");
    until("output 3", || board.seen.output_3());
    until("input 7", || hal.get("7i77.0.0.input-07") == "TRUE");
    let pulses = || {
        let motor = |fpga: &mut mesa_hal_sim::SimFpga| fpga.stepper(STEPPERS + 4).copied();
        board.seen.with(motor).expect("a motor").commanded()
    };
    until("0.5 units", || {
        let shown = hal.number("stepgen.04.position-fb");
        (shown - 0.5).abs() <= 1.0 / SCALE && (pulses() as f64 - 0.5 * SCALE).abs() <= 1.0
    });
    hal.hal("stop");
    hal.hal("unloadrt mesa_pci");
    assert!(!board.seen.output_3(), "off at the end");
    hal.end();
}
