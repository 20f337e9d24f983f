//! `mesa info`, `mesa watch` and `mesa peek` on a board that `mesa-hal`'s driver drives at 1 kHz in
//! another process.

use std::net::Ipv4Addr;
use std::process::Stdio;

use serde_json::Value;

use crate::interop::board::Board;
use crate::interop::{Process, mesa, realtime, wait_until};
use crate::run::{Run, command, done, hold_against_schema, json, run};
use crate::terminal::Terminal;

const BOARD: [&str; 8] = [
    "--board",
    "7i97",
    "--remote",
    "0=7i77-io",
    "--remote",
    "1=7i77-analog",
    "--port",
    "0",
];

/// A program that drives a board: `mesa latency`, which ends with a failure if another program
/// drives it as well.
struct Driven {
    board: Board,
    address: String,
    driver: Process,
}

impl Driven {
    fn start() -> Self {
        let mut board = Board::start(Ipv4Addr::LOCALHOST, &BOARD);
        let address = board.address.to_string();
        let mut driver = realtime(mesa());
        let driver = driver
            .args(["latency", "--pace", "host", "--seconds", "3600"])
            .args(["--addr", &address])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let driver = Process::new(driver.expect("mesa starts"));
        board.wait_for_packets(1000);
        Self {
            board,
            address,
            driver,
        }
    }

    /// Packets that write something, of all clients but the driver.
    fn writes_of_others(&mut self) -> Vec<(u64, u64)> {
        let network = self.board.console.show("network");
        let of = |what: &str| -> Vec<u64> {
            let counts = network.iter().filter(|(name, _)| {
                name.starts_with("network.client.") && name.ends_with(&format!(".{what}"))
            });
            counts
                .map(|(_, count)| count.parse().expect("a count"))
                .collect()
        };
        let mut clients: Vec<_> = of("packets").into_iter().zip(of("writes")).collect();
        clients.sort_unstable();
        let driver = clients.pop().expect("the driver");
        assert!(driver.1 > 100, "it writes: {driver:?}");
        clients
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn passive_inspection_writes_nothing_and_the_driver_goes_on() {
    let mut driven = Driven::start();
    let address = driven.address.clone();
    let refused = run(&["info", "--addr", &address]);
    assert!(
        refused.err.contains("another program or host"),
        "{refused:?}"
    );

    let at = ["--addr", &address];
    let text = done(&[&["info", "--passive"], &at[..]].concat());
    for said in [
        "Ethernet board 7I97",
        "MESA7I97, other programs send ",
        "Not known without a command to the board:",
        "names, unit numbers, modes, terminals and parameters of remotes",
        "none of them written",
    ] {
        assert!(text.contains(said), "{said}: {text}");
    }
    let mut lines = text.lines();
    let channel = lines.find(|line| line.starts_with("  sserial.0.0.cs  "));
    let is_running = channel.is_some_and(|line| line.contains("  running"));
    assert!(is_running, "{text}");
    let info = done(&[&["info", "--passive", "--json"], &at[..]].concat());
    let info: Value = serde_json::from_str(&info).expect("JSON");
    hold_against_schema("info_passive", &info);

    driven.board.console.run("turn 1 20");
    wait_until("it turns", || {
        let peek = json(&[&["peek", "encoder.01.count"], &at[..]].concat());
        peek["registers"][0]["value"].as_u64() > Some(0)
    });
    driven.board.console.run("turn 1 0");
    let motors = driven.board.console.show("motors");
    let counts: f64 = motors["motor.1.counts"].parse().expect("a number");
    let peek = done(&[&["peek", "encoder.01.count"], &at[..]].concat());
    let low = format!("{:04X}  ", (counts as i64) & 0xFFFF);
    assert!(peek.contains(&low), "{counts}: {peek}");

    let pin = "hm2_7i97.0.pwmgen.00.enable";
    let text = done(&[&["peek", pin], &at[..]].concat());
    assert!(text.starts_with(&format!("{pin}  off ")), "{text}");
    let pins = json(&[&["peek", "encoder.01"], &at[..]].concat());
    hold_against_schema("peek", &pins);
    for (name, said) in [
        ("encoder.01.position", "no register shows it"),
        ("dac.3", "no pin `dac.3`"),
    ] {
        let unknown = run(&[&["peek", name], &at[..]].concat());
        assert_eq!(unknown.code, Some(1), "{unknown:?}");
        assert!(unknown.err.contains(said), "{unknown:?}");
    }

    let watch = [&["watch", "--passive", "--json", "encoder.01"], &at[..]].concat();
    let mut watch = Process::new(command(&watch).spawn().expect("mesa starts"));
    driven.board.wait_for_packets(4000);
    watch.signal("INT");
    let ended = Run::from(watch.output());
    assert_eq!(ended.code, Some(130), "{ended:?}");
    let samples: Vec<Value> = ended
        .out
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert!(samples.len() > 3, "{ended:?}");
    for sample in &samples {
        hold_against_schema("watch", sample);
    }
    let value = |name: &str| {
        let values = samples[0]["values"].as_array().expect("values");
        let found = values.iter().find(|value| value["name"] == name);
        found.map(|value| value["value"].clone())
    };
    let count = value("encoder.01.count").and_then(|count| count.as_u64());
    assert_eq!(
        count.map(|count| count & 0xFFFF),
        Some(counts as u64 & 0xFFFF)
    );
    let error = value("hm2_7i97.0.encoder.01.quad-error");
    assert_eq!(error, Some(Value::Bool(false)));

    let others = driven.writes_of_others();
    let written: Vec<_> = others.iter().filter(|(_, writes)| *writes > 0).collect();
    // `mesa info` without --passive numbers its requests; nothing else writes.
    assert!(written.len() <= 1, "{others:?}");
    assert!(others.len() >= 3, "{others:?}");
    assert!(!driven.driver.has_ended(), "the driver goes on");
    driven.driver.signal("INT");
    let latency = Run::from(driven.driver.output());
    assert_eq!(latency.code, Some(130), "{latency:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn passive_screen_shows_registers_and_its_read_rate() {
    let driven = Driven::start();
    let arguments = format!("watch --passive --every 200ms --addr {}", driven.address);
    let Some(terminal) = Terminal::start("passive", &arguments) else {
        return;
    };
    let text = terminal.wait_for_text("packets a second from other programs");
    for said in [
        " hm2_7i97.0 at ",
        "every 200 ms, at most 20 packets a second",
        "nothing is written",
        "watchdog",
    ] {
        assert!(text.contains(said), "{said}: {text}");
    }
    terminal.type_keys(&["/"]);
    terminal.type_keys(&["-l", "sserial.0.0"]);
    terminal.type_keys(&["Enter"]);
    let text = terminal.wait_for("the channel", |text| text.contains("filter: sserial.0.0 "));
    assert!(text.contains("running"), "{text}");
    terminal.type_keys(&["q"]);
    let text = terminal.wait_for_text("exit code 0");
    assert!(text.contains("nothing was written"), "{text}");
}

#[test]
fn simulated_board_in_the_command_itself_can_be_looked_at_too() {
    let text = done(&["info", "--passive", "--sim", "7i92-7i77"]);
    assert!(
        text.contains("MESA7I92, no other program sends packets"),
        "{text}"
    );
    let busy = run(&["info", "--passive", "--mode", "0.0=1", "--sim", "7i97"]);
    assert_eq!(busy.code, Some(2), "{busy:?}");
    let screen = run(&["watch", "--passive", "--sim", "7i97"]);
    assert_eq!(screen.code, Some(2), "{screen:?}");
    assert!(
        screen.err.contains("`--json` prints the values"),
        "{screen:?}"
    );
}
