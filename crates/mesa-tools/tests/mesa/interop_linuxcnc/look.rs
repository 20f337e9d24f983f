//! A look at the board beside LinuxCNC's own driver, from the computer that LinuxCNC runs on.

use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use super::linuxcnc::Machine;
use crate::interop::{console::Values, mesa, passive::compare_errors};
use crate::run::Run;

const BOARD: [&str; 2] = ["--addr", "10.97.0.2"];

/// `mesa info --passive`, `mesa watch --passive` and `mesa peek` show what LinuxCNC shows, write
/// nothing, and cost LinuxCNC no packet.
pub fn check(machine: &mut Machine) {
    open_firewall(machine);
    machine.board.run("turn 0 20");
    std::thread::sleep(Duration::from_millis(200));
    machine.board.run("turn 0 0");
    std::thread::sleep(Duration::from_millis(100));
    let counts = machine.number("encoder.00.rawcounts") as i64 as u64 & 0xFFFF;
    assert_ne!(counts, 0);
    let peek = json(machine, &["peek", "encoder.00.count", "--json"]);
    let raw = peek["registers"][0]["value"].as_u64();
    assert_eq!(raw.map(|raw| raw & 0xFFFF), Some(counts));
    let lines = watch(machine);
    let count = value(&lines, "encoder.00.count")["value"].as_u64();
    assert_eq!(count.map(|count| count & 0xFFFF), Some(counts));
    let info = json(machine, &["info", "--passive", "--json"]);
    assert_eq!(info["firmware"]["board"], "MESA7I97");
    let state = value(&info, "sserial.0.0.cs")["text"].as_str();
    assert!(
        state.is_some_and(|state| state.starts_with("running")),
        "{info:#}"
    );
    assert_pins_are_those_of(machine, &info);
    machine.board.run("turn 0 free");
    compare_errors(machine, mesa());
    assert_nothing_written(&machine.board.show("network"));
}

/// The value of a pin or register with this name.
fn value<'a>(shown: &'a Value, name: &str) -> &'a Value {
    let mut values = shown["values"].as_array().expect("values").iter();
    let found = values.find(|value| value["name"] == name);
    found.unwrap_or_else(|| panic!("no {name}: {shown:#}"))
}

/// Each pin that is shown, and that LinuxCNC has, has the value that it has there. I/O pins of
/// modules are left out: lines of serial ports and multiplexers never rest.
fn assert_pins_are_those_of(machine: &mut Machine, info: &Value) {
    let theirs = machine.values();
    let mut compared = 0;
    for shown in info["values"].as_array().expect("values") {
        let name = shown["name"].as_str().unwrap_or_default();
        let name = name.strip_prefix("hm2_7i97.0.").unwrap_or(name);
        let number = name.strip_prefix("gpio.").and_then(|rest| rest.get(..3));
        if number.is_some_and(|number| number < "034") {
            continue;
        }
        if let (Some(is_on), Some(value)) = (shown["value"].as_bool(), theirs.get(name)) {
            assert_eq!(value == "TRUE", is_on, "{name} is {value} in LinuxCNC");
            compared += 1;
        }
    }
    println!("{compared} pins of a look have LinuxCNC's values");
    assert!(compared > 100, "{compared} pins");
}

/// LinuxCNC's driver lets no other program out to its board: the command names the way.
fn open_firewall(machine: &Machine) {
    let blocked = look(machine, &["info", "--passive"]);
    assert_eq!(blocked.code, Some(1), "{blocked:?}");
    let rule = "iptables -I hm2-eth-rules-output -p udp -d 10.97.0.2 --dport 27181 -j ACCEPT";
    assert!(blocked.err.contains(rule), "{blocked:?}");
    let mut words = rule.split(' ');
    let program = words.next().expect("iptables");
    let opened = machine.beside(Path::new(program)).args(words).status();
    assert!(opened.expect("iptables runs").success());
}

fn look(machine: &Machine, arguments: &[&str]) -> Run {
    let mut command = machine.beside(mesa());
    command.args(arguments).args(BOARD).env("NO_COLOR", "1");
    command.output().expect("mesa starts").into()
}

fn json(machine: &Machine, arguments: &[&str]) -> Value {
    let run = look(machine, arguments);
    assert_eq!(run.code, Some(0), "{run:?}");
    serde_json::from_str(&run.out).expect("JSON")
}

/// The first line of `mesa watch`, which ends when nobody reads the next.
fn watch(machine: &Machine) -> Value {
    let mut command = machine.beside(Path::new("sh"));
    let script =
        "\"$0\" watch --passive --json --every 50ms encoder.00 --addr 10.97.0.2 | head -n 1";
    let output = command.args(["-c", script]).arg(mesa()).output();
    let run = Run::from(output.expect("a shell"));
    serde_json::from_str(&run.out).unwrap_or_else(|error| panic!("{error}: {run:?}"))
}

/// All packets that wrote something came from LinuxCNC.
fn assert_nothing_written(network: &Values) {
    let count = |client: usize, what: &str| -> Option<u64> {
        network
            .get(&format!("network.client.{client}.{what}"))?
            .parse()
            .ok()
    };
    let clients = (0..8).filter_map(|n| Some((count(n, "packets")?, count(n, "writes")?)));
    let mut clients: Vec<_> = clients.collect();
    clients.sort_unstable();
    let linuxcnc = clients.pop().expect("LinuxCNC");
    assert!(linuxcnc.1 > 1000, "{linuxcnc:?}");
    assert!(clients.len() > 2, "{clients:?}");
    assert!(
        clients.iter().all(|(_, writes)| *writes == 0),
        "{clients:?}"
    );
}
