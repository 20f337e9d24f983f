//! LinuxCNC (Debian package `linuxcnc-uspace`, driver hm2_eth) works with the simulated board as
//! with a real one, at 1 kHz.
//!
//! Needs root, for a private network: the driver requires a board with a MAC address of its own.
//! See `examples/linuxcnc.sh`. The names that LinuxCNC created are kept under `target/interop/`
//! (`NAME.pins`: type, direction and name of each pin; `NAME.params`), for comparison with other
//! lists.

mod cost;
mod expected;
mod firmwares;
mod linuxcnc;
mod look;
mod names;
mod setsserial;
mod skeleton;

use std::time::{Duration, Instant};

use crate::interop::console::Values;
use crate::interop::tools::LINUXCNC_NICE;
use crate::interop::{realtime, wait_until};
use expected::Expected;
use linuxcnc::{Machine, SETTLE, alone, skipped};
use mesa_eth::Config;
use mesa_hal::driver::Driver;
use mesa_hal_sim::{Motor, SimFpga, machines};

/// Minimum duration over which the rate of the cycle is measured.
const LEAST: Duration = Duration::from_secs(10);

/// Pins and parameters of a 7I77 on channels 0 and 1. FACTS 8.6.
const I7I77: &str = "
pin bit OUT 7i77.0.0.input-{NN} 32
pin bit OUT 7i77.0.0.input-{NN}-not 32
pin bit IN 7i77.0.0.output-{NN} 16
param bit RW 7i77.0.0.output-{NN}-invert 16
pin float IN 7i77.0.1.analogout{N} 6
param float RW 7i77.0.1.analogout{N}-scalemax 6
param float RW 7i77.0.1.analogout{N}-maxlim 6
param float RW 7i77.0.1.analogout{N}-minlim 6
pin bit IN 7i77.0.1.analogena
pin bit IN 7i77.0.1.spinena
param bit RW 7i77.0.1.analogena-invert
param bit RW 7i77.0.1.spinena-invert
param u32 RO 7i77.0.0.nvencmode{N} 2
param u32 RO 7i77.0.0.encmode{N} 2
param u32 RO 7i77.0.0.nvunitnumber
param u32 RW 7i77.0.0.nvwatchdogtimeout
param u32 RW 7i77.0.0.nvbaudrate
param u32 RO 7i77.0.0.swrevision
param u32 RO 7i77.0.0.hwrevision
";

/// Pins and parameters of the board and its serial port. FACTS 8.6.
const BOARD: &str = "
pin s32 OUT encoder.{NN}.count 6
pin s32 OUT encoder.{NN}.rawcounts 6
pin float OUT encoder.{NN}.position 6
pin float OUT encoder.{NN}.velocity 6
pin bit I/O encoder.{NN}.index-enable 6
param float RW encoder.{NN}.scale 6
pin bit IN sserial.port-0.run
pin u32 OUT sserial.port-0.port_state
pin u32 OUT sserial.port-0.port_state2
pin u32 OUT sserial.port-0.port_state3
pin u32 OUT sserial.port-0.fault-count
param u32 RW sserial.port-0.fault-inc
param u32 RW sserial.port-0.fault-dec
param u32 RW sserial.port-0.fault-lim
pin bit I/O watchdog.has_bit
param u32 RW watchdog.timeout_ns
param bit RW io_error
pin bit OUT packet-error
";

/// Pins and parameters of a 7I97 with a 7I72 on channel 2.
const I7I97: &str = "
pin bit IN 7i72.0.2.output-{NN} 48
param bit RW 7i72.0.2.output-{NN}-invert 48
pin bit OUT inmux.00.input-{NN} 16
pin bit OUT inmux.00.input-{NN}-not 16
pin s32 OUT inmux.00.enc{N}-count 4
pin bit IN ssr.00.out-{NN} 6
pin float IN pwmgen.{NN}.value 6
pin bit IN pwmgen.{NN}.enable 6
pin bit IN led.CR01
pin bit IN led.CR02
pin bit IN led.CR03
pin bit IN led.CR04
pin bit OUT gpio.{NNN}.in 51
pin float OUT dpll.phase-error-us
";

/// Digital outputs, analog volts and booleans from HAL to the 7I77 and back.
fn check_7i77(machine: &mut Machine) {
    machine.set("7i77.0.0.output-03", "true");
    machine.set("7i77.0.0.output-15", "true");
    machine.set("7i77.0.0.output-07-invert", "true");
    for n in 0..16 {
        let on = [3, 7, 15].contains(&n);
        let name = format!("remote.0.output-{n:02}");
        machine.expect_board("0", &name, |value| value == f64::from(u8::from(on)));
    }
    machine.set("7i77.0.1.analogena", "true");
    for (n, volts) in ["5", "-10", "10", "-2.5", "0.01", "7"]
        .into_iter()
        .enumerate()
    {
        machine.set(&format!("7i77.0.1.analogout{n}-scalemax"), "10");
        machine.set(&format!("7i77.0.1.analogout{n}"), volts);
    }
    // 13 bits over 20 V; output 5 stays at 0 V until it has its own enable.
    for (n, volts) in [5.0, -10.0, 10.0, -2.5, 0.01, 0.0].into_iter().enumerate() {
        let near = move |value: f64| (value - volts).abs() < 0.005;
        machine.expect_board("1", &format!("remote.1.analogout{n}"), near);
    }
    machine.set("7i77.0.1.spinena", "true");
    machine.expect_board("1", "remote.1.analogout5", |volts| {
        (volts - 7.0).abs() < 0.005
    });
    machine.expect_board("1", "remote.1.spinena", |on| on == 1.0);

    for input in [0, 7, 31] {
        let name = format!("7i77.0.0.input-{input:02}");
        machine.expect(&name, "FALSE");
        machine.board.run(&format!("input 0 {input} on"));
        machine.expect(&name, "TRUE");
        machine.expect(&format!("{name}-not"), "FALSE");
        machine.board.run(&format!("input 0 {input} off"));
        machine.expect(&name, "FALSE");
    }
}

/// Turns a motor by hand and stops it: LinuxCNC must count the encoder's counts.
fn check_encoders(machine: &mut Machine) {
    for axis in 0..6 {
        machine.set(&format!("encoder.{axis:02}.scale"), "1000");
        let speed = if axis % 2 == 0 { 20 } else { -20 };
        machine.board.run(&format!("turn {axis} {speed}"));
    }
    std::thread::sleep(Duration::from_millis(500));
    for axis in 0..6 {
        let velocity = machine.number(&format!("encoder.{axis:02}.velocity"));
        let speed = if axis % 2 == 0 { 20.0 } else { -20.0 };
        assert!(
            (velocity - speed).abs() < 2.0,
            "axis {axis}: {velocity} for {speed}"
        );
        machine.board.run(&format!("turn {axis} 0"));
    }
    std::thread::sleep(Duration::from_millis(100));
    let motors = machine.board.show("motors");
    for axis in 0..6 {
        let counts: f64 = motors[&format!("motor.{axis}.counts")].parse().unwrap();
        let count = machine.number(&format!("encoder.{axis:02}.count"));
        assert!(counts.abs() > 5_000.0, "axis {axis} moved by {counts}");
        assert!(
            (count - counts).abs() <= 1.0,
            "axis {axis}: {count} of {counts}"
        );
        machine.board.run(&format!("turn {axis} free"));
    }
}

/// Stops the serial port, which makes the remotes safe, and starts it again.
fn check_run_and_stop(machine: &mut Machine) {
    machine.expect_board("0", "remote.0.output-03", |on| on == 1.0);
    machine.set("sserial.port-0.run", "false");
    machine.expect_board("0", "remote.0.output-03", |on| on == 0.0);
    machine.expect_board("1", "remote.1.analogout0", |volts| volts == 0.0);
    machine.start_port();
    machine.expect_board("0", "remote.0.output-03", |on| on == 1.0);
    machine.expect_board("1", "remote.1.analogout0", |volts| {
        (volts - 5.0).abs() < 0.005
    });
}

/// Pulls a remote: LinuxCNC counts a fault in every cycle, and stops the port at the limit. Plugs
/// the remote in and starts the port again.
fn check_unplugging(machine: &mut Machine, channel: usize) {
    wait_for_few_faults(machine);
    machine.set("sserial.port-0.fault-lim", "5000");
    machine.board.run(&format!("unplug {channel}"));
    let start = Instant::now();
    while machine.number("sserial.port-0.fault-count") < 4000.0 {
        assert!(start.elapsed() < SETTLE, "no faults are counted");
    }
    // The stopped port makes all its remotes safe.
    machine.expect_board("0", "remote.0.output-03", |on| on == 0.0);
    machine.board.run(&format!("plug {channel}"));
    machine.set("sserial.port-0.fault-lim", "1000000");
    machine.set("sserial.port-0.run", "false");
    std::thread::sleep(Duration::from_millis(200));
    machine.start_port();
    machine.expect_board("0", "remote.0.output-03", |on| on == 1.0);
    wait_for_few_faults(machine);
}

/// Waits until the faults of a busy computer, of which LinuxCNC forgets one in each good cycle, are
/// few.
fn wait_for_few_faults(machine: &mut Machine) {
    wait_until("fewer than 1000 faults", || {
        machine.number("sserial.port-0.fault-count") < 1000.0
    });
}

/// Asserts one cycle in each millisecond of `time`, by the board's counters, and no error.
fn assert_cycled(before: &Values, after: &Values, time: Duration) {
    let rate = cycles(before, after) / time.as_secs_f64();
    println!("{rate:.0} cycles a second");
    // Not realtime: LinuxCNC leaves out the cycle after a late reply.
    assert!((800.0..1100.0).contains(&rate), "{rate} cycles a second");
    for error in ["parse", "memory", "write"] {
        assert_eq!(after[&format!("board.errors.{error}")], "0");
    }
}

/// Number of cycles, with two packets each.
fn cycles(before: &Values, after: &Values) -> f64 {
    let packets = |values: &Values| -> f64 { values["network.received.packets"].parse().unwrap() };
    (packets(after) - packets(before)) / 2.0
}

/// `mesa-hal`'s driver for the same machine, with the words of LinuxCNC's configuration, has the
/// same pins and parameters, with the same values.
fn compare_names(machine: &mut Machine, prefix: &str, ours: SimFpga) {
    let settings = Config::parse(linuxcnc::CONFIG)
        .expect("words of LinuxCNC")
        .settings;
    let driver = Driver::start(ours, settings).expect("the machine is complete");
    let (pins, params) = (machine.list("pin"), machine.list("param"));
    names::compare(prefix, [&pins, &params], driver.pins(), 400);
    names::compare_values(prefix, &machine.values(), driver.pins(), 150);
}

#[test]
fn a_7i97_with_three_remotes_runs_at_1_khz() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let remotes = "--remote 0=7i77-io --remote 1=7i77-analog --remote 2=7i72";
    let expected = Expected::of(&[I7I77, BOARD, I7I97]);
    let board = format!("--board 7i97 {remotes}");
    let mut machine = Machine::load("hm2_7i97.0", "7i97", &board, &expected);
    let ours = machines::six_axes_7i97(Motor::default());
    compare_names(&mut machine, "hm2_7i97.0", ours);

    // LinuxCNC writes parameters to the remotes' non-volatile memory when it starts the port.
    let time = "remote.0.parameter.nvwatchdogtimeout";
    machine.expect_board("0", time, |millis| millis == 50.0);
    // Sets longer ones.
    machine.run(&["7i77.0.0", "7i77.0.1", "7i72.0.2"]);
    let (start, before) = (Instant::now(), machine.board.show("network"));
    machine.expect_board("0", time, |millis| millis == 1000.0);
    check_7i77(&mut machine);
    check_7i72(&mut machine);
    check_isolated_io(&mut machine);
    check_encoders(&mut machine);
    look::check(&mut machine);
    check_analog_outputs(&mut machine);
    check_run_and_stop(&mut machine);
    check_unplugging(&mut machine, 2);
    std::thread::sleep(LEAST.saturating_sub(start.elapsed()));
    let after = machine.board.show("network");
    assert_cycled(&before, &after, start.elapsed());
    assert_eq!(machine.get("io_error"), "FALSE");
    assert_eq!(machine.get("watchdog.has_bit"), "FALSE");
    print_costs(&mut machine, &board);
    println!("packet errors: {}", machine.get("packet-error-total"));
    // Without a thread LinuxCNC lets the watchdogs bite.
    machine.hal("stop");
    machine.expect_board("0", "remote.0.output-03", |on| on == 0.0);
    machine.expect_board("board", "board.output-02", |on| on == 0.0);
    let summary = machine.stop();
    assert_eq!(summary["remote.0.output-03"], "0");
    assert_eq!(summary["board.output-02"], "0");
}

/// Prints the cost of a cycle for LinuxCNC, and for `mesa-hal` beside it.
fn print_costs(machine: &mut Machine, board: &str) {
    let start = machine.board.show("network");
    let beside = cost::run_beside(board, || cycles(&start, &machine.board.show("network")));
    cost::print(&beside);
}

fn check_7i72(machine: &mut Machine) {
    for n in [0, 17, 47] {
        machine.set(&format!("7i72.0.2.output-{n:02}"), "true");
    }
    for n in 0..48 {
        let on = [0, 17, 47].contains(&n);
        let name = format!("remote.2.output-{n:02}");
        machine.expect_board("2", &name, |value| value == f64::from(u8::from(on)));
    }
}

/// Isolated inputs through InMux, isolated outputs through SSR, an MPG on inputs 2 and 3, LEDs, and
/// a pin of P1 both ways.
fn check_isolated_io(machine: &mut Machine) {
    machine.set("ssr.00.out-02", "true");
    for n in 0..6 {
        let name = format!("board.output-{n:02}");
        machine.expect_board("board", &name, |on| on == f64::from(u8::from(n == 2)));
    }
    for n in [0, 9, 15] {
        let name = format!("inmux.00.input-{n:02}");
        machine.expect(&name, "FALSE");
        machine.board.run(&format!("input board {n} on"));
        machine.expect(&name, "TRUE");
        machine.expect(&format!("{name}-not"), "FALSE");
        machine.board.run(&format!("input board {n} off"));
    }
    machine.set("inmux.00.enc1_4xmode", "true");
    machine.set("inmux.00.enc1-reset", "true");
    machine.expect("inmux.00.enc1-count", "0");
    machine.set("inmux.00.enc1-reset", "false");
    // Steps that LinuxCNC reads with the old value are not counted.
    std::thread::sleep(Duration::from_millis(200));
    // Two detents, B ahead of A. LinuxCNC counts from what it reads, so it has to see each step.
    for (on, level) in [("on", "TRUE"), ("off", "FALSE")].repeat(2) {
        for input in [3, 2] {
            machine.board.run(&format!("input board {input} {on}"));
            machine.expect(&format!("inmux.00.input-{input:02}"), level);
        }
    }
    machine.expect("inmux.00.enc1-count", "8");
    machine.set("led.CR02", "true");
    // In the factory setting these LEDs count packets.
    machine.board.run("leds fpga");
    machine.expect_board("board", "board.led-1", |lit| lit == 1.0);
    machine.board.run("pin 50 low");
    machine.expect("gpio.050.in", "FALSE");
    machine.board.run("pin 50 free");
    machine.expect("gpio.050.in", "TRUE");
    machine.set("gpio.049.is_output", "true");
    machine.set("gpio.049.out", "false");
    machine.expect_board("board", "board.pin-049", |level| level == 0.0);
    machine.set("gpio.049.out", "true");
    machine.expect_board("board", "board.pin-049", |level| level == 1.0);
}

/// PWM in offset mode controls the voltage of the 7I97's analog outputs, which turn motors.
fn check_analog_outputs(machine: &mut Machine) {
    for (n, volts) in ["2.5", "-2.5", "1", "-1", "9", "-9"]
        .into_iter()
        .enumerate()
    {
        machine.set(&format!("pwmgen.{n:02}.offset-mode"), "true");
        machine.set(&format!("pwmgen.{n:02}.scale"), "10");
        machine.set(&format!("pwmgen.{n:02}.value"), volts);
        machine.set(&format!("pwmgen.{n:02}.enable"), "true");
    }
    for (n, volts) in [2.5, -2.5, 1.0, -1.0, 9.0, -9.0].into_iter().enumerate() {
        let near = move |value: f64| (value - volts).abs() < 0.03;
        machine.expect_board("board", &format!("board.analogout{n}"), near);
        machine.expect_board("board", &format!("board.enable{n}"), |on| on == 1.0);
        // 100 units a second at 10 V.
        let name = format!("motor.{n}.velocity");
        let follows = move |velocity: f64| (velocity - 10.0 * volts).abs() < 0.5;
        machine.expect_board("motors", &name, follows);
    }
    let velocity = machine.number("encoder.00.velocity");
    assert!((velocity - 25.0).abs() < 2.0, "{velocity}");
    for n in 0..6 {
        machine.set(&format!("pwmgen.{n:02}.enable"), "false");
        machine.expect_board("board", &format!("board.enable{n}"), |on| on == 0.0);
        machine.expect_board("motors", &format!("motor.{n}.velocity"), |v| v.abs() < 0.01);
    }
}

#[test]
fn a_7i92_with_a_7i77_runs_at_1_khz() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let expected = Expected::of(&[I7I77, BOARD]);
    let board = "--board 7i92-7i77";
    let mut machine = Machine::load("hm2_7i92.0", "7i92-7i77", board, &expected);
    let mut ours = machines::i7i92_7i77();
    machines::plug_7i77(&mut ours, 0, 0);
    compare_names(&mut machine, "hm2_7i92.0", ours);

    machine.run(&["7i77.0.0", "7i77.0.1"]);
    let (start, before) = (Instant::now(), machine.board.show("network"));
    check_encoders(&mut machine);
    check_7i77(&mut machine);
    // Analog output 0 is at 5 V: 50 units a second.
    machine.expect_board("motors", "motor.0.velocity", |v| (v - 50.0).abs() < 0.5);
    let velocity = machine.number("encoder.00.velocity");
    assert!((velocity - 50.0).abs() < 2.0, "{velocity}");
    check_run_and_stop(&mut machine);
    check_unplugging(&mut machine, 1);
    std::thread::sleep(LEAST.saturating_sub(start.elapsed()));
    let after = machine.board.show("network");
    assert_cycled(&before, &after, start.elapsed());
    assert_eq!(machine.get("io_error"), "FALSE");
    machine.stop();
}

/// The commands for the script that the README names, and their results.
#[test]
fn readme_script_runs_linuxcnc_on_a_simulated_board() {
    if skipped() {
        return;
    }
    let _alone = alone();
    let script = "examples/linuxcnc.sh";
    assert!(include_str!("../../../../../README.md").contains(script));
    for (options, name) in [
        (&[][..], "hm2_7i97.0"),
        (&["--board", "7i92-7i77"], "hm2_7i92.0"),
    ] {
        let mut child = realtime(format!("{}/../../{script}", env!("CARGO_MANIFEST_DIR")))
            .args(options)
            .env("MESA", crate::interop::mesa())
            .env(LINUXCNC_NICE.0, LINUXCNC_NICE.1)
            .stdin(std::process::Stdio::piped())
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .expect("the script starts");
        let mut input = child.stdin.take().expect("an input");
        let typed = format!("show pin {name}.encoder.00.count\nshow param {name}.io_error\nexit\n");
        std::io::Write::write_all(&mut input, typed.as_bytes()).expect("it listens");
        drop(input);
        let output = child.wait_with_output().expect("it ends");
        let text = String::from_utf8_lossy(&output.stdout);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{text}{error}");
        let has = |pin: &str| {
            let mut lines = text.lines();
            lines.any(|line| line.ends_with(&format!(" {name}.{pin}")))
        };
        assert!(has("encoder.00.count"), "{text}{error}");
        assert!(has("io_error"), "{text}{error}");
    }
}
