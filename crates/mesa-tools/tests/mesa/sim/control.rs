//! `mesa sim`: scheduled commands, control sockets, several boards, captures.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{Ipv4Addr, SocketAddrV4, TcpStream, UdpSocket};
use std::os::unix::net::UnixStream;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};

use crate::interop::board::Board;
use crate::interop::console::{Console, Values, values};
use crate::interop::{PATIENCE, Process, Scratch};
use crate::run::{SIM_7I97, command, hold_against_schema, run};

const ASK_COOKIE: [u8; 4] = [0x01, 0x42, 0x00, 0x01];
const COOKIE: [u8; 4] = [0xFE, 0xCA, 0xAA, 0x55];

fn start(arguments: &[&str]) -> Board {
    let usual = ["--board", "7i97", "--port", "0"];
    Board::start(Ipv4Addr::LOCALHOST, &[&usual, arguments].concat())
}

fn client(address: SocketAddrV4) -> UdpSocket {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    socket.connect(address).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    socket
}

fn ask_cookie(socket: &UdpSocket) {
    socket.send(&ASK_COOKIE).unwrap();
    let mut buffer = [0; 100];
    let len = socket.recv(&mut buffer).expect("the board answers");
    assert_eq!(buffer[..len], COOKIE);
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn mishaps_are_changed_while_it_runs() {
    let mut board = start(&[]);
    let socket = client(board.address);
    ask_cookie(&socket);
    board.console.run("loss 1");
    socket.send(&ASK_COOKIE).unwrap();
    board.console.run("wait until network.received.lost 1");
    board.console.run("loss 0");
    board.console.run("dup 1");
    ask_cookie(&socket);
    board.console.run("late 1");
    board.console.run("dup 0");
    socket.send(&ASK_COOKIE).unwrap();
    board.console.run("wait until network.sent.late >0");
    for bad in ["loss 2", "loss", "late x", "dup -1"] {
        assert!(board.console.command(bad).is_err(), "{bad}");
    }
    let summary = board.stop("INT");
    assert_eq!(summary["network.received.lost"], "1");
    assert_eq!(summary["network.received.duplicate"], "1");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_that_is_reset_is_away_for_the_time_and_answers_again() {
    let mut board = start(&[]);
    let socket = client(board.address);
    ask_cookie(&socket);
    board.console.run("reset 400ms");
    let brief = Duration::from_millis(20);
    socket.set_read_timeout(Some(brief)).unwrap();
    let (mut missed, mut buffer) = (0, [0; 100]);
    loop {
        socket.send(&ASK_COOKIE).unwrap();
        match socket.recv(&mut buffer) {
            Ok(len) => break assert_eq!(buffer[..len], COOKIE),
            Err(_) => missed += 1,
        }
        assert!(missed < 1_000, "it stays away");
    }
    assert!(missed >= 3, "{missed}");
    for bad in ["reset", "reset x", "reset -1s", "reset 1s 2s"] {
        assert!(board.console.command(bad).is_err(), "{bad}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn commands_are_done_at_their_time_and_waits_end_when_it_comes() {
    let mut board = start(&[]);
    let console = &mut board.console;
    console.run("at +300ms turn 0 50");
    assert_eq!(
        console.show("motor.0.velocity")["motor.0.velocity"],
        "0.0000"
    );
    let agenda = console.command("agenda").unwrap();
    assert!(
        agenda.iter().any(|line| line.ends_with("turn 0 50")),
        "{agenda:?}"
    );
    let answer = console.command("wait until motor.0.position >1.5 within 20s");
    assert!(answer.unwrap()[0].starts_with("motor.0.position "));
    let time: f64 = console.show("time")["time"].parse().unwrap();
    assert!(time > 0.3, "{time}");
    console.run("at +2ms pin 40 low");
    console.run("wait until board.pin-040 0 within 20s");
    let agenda = values(console.command("agenda").unwrap());
    assert_eq!(
        (&*agenda["agenda.done"], &*agenda["agenda.failed"]),
        ("2", "0")
    );
    for (bad, said) in [
        (
            "wait until motor.0.position <-5 within 50ms",
            "the time is over",
        ),
        (
            "wait until motor.9.position 1",
            "no value `motor.9.position`",
        ),
        ("wait until motor.0.position", "wait until NAME"),
        ("wait for", "wait until NAME"),
        ("at 0s turn 0 1", "is over"),
        ("at soon turn 0 1", "2.5s"),
        ("at 5s", "at TIME COMMAND"),
        ("at 5s wait until time >9", "cannot be scheduled"),
        ("show motor.*.colour", "nothing is like"),
        ("show foo", "expected all, network, board"),
        (
            "at +1ms quit now",
            "`quit` is no command, or it takes something else",
        ),
        ("@1 show", "no board `1`; expected 0 (board)"),
    ] {
        let refused = console.command(bad).unwrap_err();
        assert!(refused.contains(said), "{bad}: {refused}");
    }
    let some = console.show("motor.*.position");
    assert_eq!(some.len(), 6);
    console.run("at +10ms quit");
    console.wait_for("summary");
    assert!(board.wait().success());
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn timed_command_is_refused_when_given_with_the_same_message() {
    let mut board = start(&["--remote", "1=7i77-io", "--remote", "2=7i72"]);
    let console = &mut board.console;
    let bad = [
        "jump",
        "quit now",
        "turn 99 1",
        "turn 0 fast",
        "turn 0 1e9",
        "stall spindle",
        "wheel 3",
        "estop on",
        "pin 400 low",
        "pin 3 up",
        "leds me",
        "loss 2",
        "late",
        "input board 99 on",
        "input board 3 maybe",
        "input 1 32 on",
        "input 2 0 on",
        "input 7 0 on",
        "volts 1 0 nan",
        "field 1 much",
        "field 5 24",
        "power 1 up",
        "jumper 1 gone",
        "shorted 1 16 on",
        "hot 2 48 on",
        "unplug 5",
        "unplug x",
        "wire 1 nowhere lost 1",
        "wire 1 remote eaten 1",
        "wire 1 remote lost often",
        "wire 1 remote lost chance 2",
        "firmware 1 2000 /nowhere/7i77.bin",
        "firmware 1 15 /nowhere/7i77.bin",
    ];
    for bad in bad {
        let later = console.command(&format!("at +1h {bad}"));
        assert!(later.is_err(), "{bad}: an hour has no such unit");
        let later = console.command(&format!("at +3600s {bad}")).unwrap_err();
        assert_eq!(console.command(bad).unwrap_err(), later, "{bad}");
    }
    let file = Scratch::new("later.bin");
    let good = [
        "turn 0 1",
        "stall 5",
        "pin 3 low",
        "leds packets",
        "loss 0.5",
        "input board 3 on",
        "input 1 31 on",
        "volts 1 0 5",
        "field 1 24",
        "power 2 off",
        "jumper 1 setup",
        "shorted 1 15 on",
        "hot 2 47 off",
        "unplug 1",
        "wire 1 fpga late=50 3",
        "wire 1 heal",
        &format!("firmware 1 15 {}", file.path()),
        "quit",
    ];
    let before = console.show("all");
    for good in good {
        console.run(&format!("at +3600s {good}"));
    }
    let agenda = console.command("agenda").unwrap();
    assert_eq!(agenda.len(), 2 + good.len(), "{agenda:?}");
    assert!(!file.0.exists(), "nothing is done before its time");
    let after = console.show("all");
    let is_kept = |(name, value): (&String, &String)| {
        let moves = ["time", "network.client.", "remote.", "motor."];
        moves.iter().any(|begin| name.starts_with(begin)) || after[name] == *value
    };
    assert!(before.iter().all(is_kept), "{before:?} {after:?}");
    let plugged = ["remote.1.plugged", "remote.1.powered", "remote.1.output-15"];
    assert!(plugged.iter().all(|name| before[*name] == after[*name]));
    board.stop("TERM");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn file_of_commands_is_done_up_to_the_first_error() {
    let good = Scratch::new("good.cmd");
    let bad = Scratch::new("bad.cmd");
    let own = Scratch::new("own.cmd");
    fs::write(
        &good.0,
        "# a comment\n\ninput board 3 on\nshow motor.0.counts\n",
    )
    .unwrap();
    fs::write(
        &bad.0,
        format!("source {}\npin 400 low\nturn 0 5\n", good.path()),
    )
    .unwrap();
    fs::write(&own.0, format!("source {}\n", own.path())).unwrap();
    let mut board = start(&[]);
    let lines = board.console.command(&format!("source {}", good.path()));
    assert_eq!(lines.unwrap(), ["motor.0.counts 0.0000"]);
    let refused = board.console.command(&format!("source {}", bad.path()));
    let refused = refused.unwrap_err();
    assert!(
        refused.contains("line 2: pin 400: this board has 51"),
        "{refused}"
    );
    let velocity = board.console.show("motor.0.velocity");
    assert_eq!(velocity["motor.0.velocity"], "0.0000", "nothing after it");
    let refused = board.console.command(&format!("source {}", own.path()));
    assert!(refused.unwrap_err().contains("deep"));
    for file in ["/nowhere", "/dev/zero"] {
        let refused = board.console.command(&format!("source {file}"));
        assert!(refused.unwrap_err().contains(file));
    }
    board.stop("INT");
}

/// Sends a line of JSON and returns the answer.
fn ask_json(stream: &mut (impl Write + ?Sized), lines: &mut impl BufRead, command: &str) -> Value {
    writeln!(stream, "{}", json!({ "command": command })).unwrap();
    let mut answer = String::new();
    lines.read_line(&mut answer).unwrap();
    let answer = serde_json::from_str(&answer).expect("JSON");
    hold_against_schema("sim", &answer);
    answer
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn other_programs_command_it_over_sockets_in_lines_and_in_json() {
    let path = Scratch::new("control.sock");
    let mut child = command(&SIM_7I97)
        .args(["--control", path.path(), "--control", "0"])
        .spawn()
        .unwrap();
    let own = Console::new(std::io::sink(), child.stdout.take().unwrap());
    own.wait_for("control on");
    let tcp = own.wait_for("control on 127.0.0.1:");
    let mut process = Process::new(child);

    let tcp = TcpStream::connect(tcp.strip_prefix("control on ").unwrap()).unwrap();
    let mut first = Console::new(tcp.try_clone().unwrap(), tcp);
    first.run("turn 0 5");
    assert!(first.command("turn 9 5").is_err());
    first.raw(&[0xFF, 0x00, b'\n']);
    assert!(first.answer().is_err());
    assert_eq!(first.show("motor.0.velocity")["motor.0.velocity"], "5.0000");

    let unix = UnixStream::connect(&path.0).unwrap();
    unix.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut lines = BufReader::new(unix.try_clone().unwrap());
    let mut unix = unix;
    let shown = ask_json(&mut unix, &mut lines, "show motor.0.velocity");
    assert_eq!(
        shown,
        json!({"ok": true, "values": {"motor.0.velocity": 5.0}})
    );
    assert_eq!(
        ask_json(&mut unix, &mut lines, "turn 0 free"),
        json!({"ok": true, "values": {}})
    );
    let refused = ask_json(&mut unix, &mut lines, "turn 9 1");
    assert_eq!(refused["ok"], false);
    assert!(refused["error"].as_str().unwrap().contains("axis"));
    assert!(ask_json(&mut unix, &mut lines, "help")["text"].is_string());
    for nonsense in [
        "{",
        "{}",
        "{\"command\": 1}",
        "{\"command\": \"help\", \"x\": 1}",
    ] {
        writeln!(unix, "{nonsense}").unwrap();
        let mut answer = String::new();
        lines.read_line(&mut answer).unwrap();
        let answer: Value = serde_json::from_str(&answer).unwrap();
        hold_against_schema("sim", &answer);
        assert_eq!(answer["ok"], false, "{nonsense}");
    }

    // A client waits; the others are served meanwhile, up to the limit.
    first.raw(b"wait until board.pin-040 0 within 20s\n");
    let more: Vec<_> = (0..14)
        .map(|_| UnixStream::connect(&path.0).unwrap())
        .collect();
    let one_more = UnixStream::connect(&path.0).unwrap();
    let mut said = String::new();
    BufReader::new(one_more).read_line(&mut said).unwrap();
    assert!(said.contains("no more than 16 clients"), "{said}");
    assert_eq!(ask_json(&mut unix, &mut lines, "pin 40 low")["ok"], true);
    assert_eq!(first.answer().unwrap(), ["board.pin-040 0"]);
    drop(more);

    let taken = run(&[&SIM_7I97[..], &["--control", path.path()]].concat());
    assert_eq!(taken.code, Some(1));
    assert!(taken.err.contains("name another path"), "{taken:?}");
    assert_eq!(ask_json(&mut unix, &mut lines, "quit")["ok"], true);
    own.wait_for("summary");
    assert!(process.child().wait().unwrap().success());
    assert!(!path.0.exists(), "it is cleared away");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn several_boards_run_in_one_process_each_with_its_address() {
    let mill = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/mill.toml");
    let other = Scratch::new("lathe.toml");
    fs::write(&other.0, "board = \"7i92-7i77\"\n").unwrap();
    let capture = Scratch::new("both.pcap");
    let mut child = command(&["sim"])
        .args(["--machine", mill, "--machine", other.path(), "--port", "0"])
        .args(["--listen", "127.0.0.1", "--listen", "127.0.0.2"])
        .args(["--mac", "00:60:1b:1b:00:01", "--mac", "00:60:1b:1b:00:02"])
        .args(["--pcap", capture.path()])
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let mut console = Console::new(input, output);
    let address = |line: String| line.rsplit(' ').next().unwrap().parse().unwrap();
    let mut boards: Vec<SocketAddrV4> = Vec::new();
    for name in [
        "7I97 listening on 127.0.0.1:",
        "7I92 listening on 127.0.0.2:",
    ] {
        boards.push(address(console.wait_for(name)));
    }
    console.wait_for("help");
    let mut process = Process::new(child);
    for board in &boards {
        ask_cookie(&client(*board));
    }
    let packets = |values: Values| values["network.received.packets"].clone();
    assert_eq!(packets(console.show("network")), "1");
    let lathe = other.0.file_stem().unwrap().to_str().unwrap().to_owned();
    console.run(&format!("@{lathe} turn 0 5"));
    assert_eq!(
        console.show("motor.0.velocity")["motor.0.velocity"],
        "0.0000"
    );
    let shown = console.command("@1 show motor.0.velocity").unwrap();
    assert_eq!(shown, ["motor.0.velocity 5.0000"]);
    let list = values(console.command("boards").unwrap());
    assert_eq!(list["board.mill"], boards[0].to_string());
    let refused = console.command("@2 show").unwrap_err();
    assert!(refused.contains("mill"), "{refused}");

    process.signal("TERM");
    for _ in 0..2 {
        console.wait_for("summary");
        console.answer().unwrap();
    }
    assert!(process.child().wait().unwrap().success());
    held_against_tools(&capture, &boards);
}

/// Asserts that a request and a reply of each board are in the capture; tcpdump reads it, if
/// installed.
fn held_against_tools(capture: &Scratch, boards: &[SocketAddrV4]) {
    let bytes = fs::read(&capture.0).unwrap();
    // Payloads of 4 bytes, behind 16 bytes of the record and 42 of headers.
    assert_eq!(bytes.len(), 24 + 4 * (16 + 42 + 4));
    let replies = bytes.windows(4).filter(|window| *window == COOKIE).count();
    assert_eq!(replies, 2);
    let tcpdump = Command::new("tcpdump")
        .args(["-nn", "-vvr", capture.path()])
        .output();
    let Ok(read) = tcpdump else {
        println!("skipped: there is no tcpdump");
        return;
    };
    let text = String::from_utf8_lossy(&read.stdout);
    for board in boards {
        let end = format!("{}.{} > ", board.ip(), board.port());
        assert!(text.contains(&end), "{text}");
    }
    assert!(!text.contains("bad"), "{text}");
}

#[test]
fn options_that_make_no_sense_together_are_refused() {
    let mill = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/mill.toml");
    let two = ["sim", "--port", "0", "--machine", mill, "--machine", mill];
    let one = ["sim", "--port", "0", "--machine", mill];
    let cases: [(&[&str], &[&str], i32, &str); 9] = [
        (&two, &["--listen", "127.0.0.1"], 2, "give it for each"),
        (&two, &["--mac", "00:60:1b:1b:00:97"], 2, "give it for each"),
        (&two, &["--state", "/tmp/state"], 2, "--state"),
        (&one, &["--mac", "01:60:1b:1b:00:97"], 2, "MAC"),
        (&one, &["--control", "65536"], 2, "0 to 65535"),
        (&one, &["--control", "/dev/null"], 1, "another path"),
        (&one, &["--pcap", "/nowhere/file"], 1, "/nowhere/file"),
        (&one, &["--pcap-limit", "5"], 2, "--pcap"),
        (&one, &["--pcap", "x", "--pcap-limit", "0"], 2, "1..=100000"),
    ];
    for (arguments, more, code, said) in cases {
        let run = run(&[arguments, more].concat());
        assert_eq!(run.code, Some(code), "{more:?}: {run:?}");
        assert!(run.err.contains(said), "{more:?}: {run:?}");
    }
}
