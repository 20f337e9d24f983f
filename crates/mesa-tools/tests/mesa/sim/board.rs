//! The simulated board as a program: its command line, its console, its end.

use std::{
    fs,
    io::Write,
    net::{Ipv4Addr, SocketAddrV4, UdpSocket},
    process::Stdio,
    time::Duration,
};

use crate::common::chance::Chance;
use crate::interop::{
    PATIENCE, Process, Scratch,
    board::Board,
    console::{Console, values},
};
use crate::run::{Run, SIM_7I97, command, done, patient, run};
use mesa_hal::{
    bus::RegisterBus,
    discovery::{DiscoveryOptions, discover_port},
    hostmot2::HostMot2,
    sslbp::{Channel, Port, PortLayout, PortLink},
    transport::udp::UdpBus,
};

const ASK_COOKIE: [u8; 4] = [0x01, 0x42, 0x00, 0x01];
const COOKIE: [u8; 4] = [0xFE, 0xCA, 0xAA, 0x55];

/// A board on a free port of loopback, and a client.
struct Client {
    board: Board,
    socket: UdpSocket,
}

impl Client {
    fn start(arguments: &[&str]) -> Self {
        let arguments = [&["--port", "0"], arguments].concat();
        let board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        socket.connect(board.address).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        Self { board, socket }
    }

    fn ask(&self, request: &[u8]) -> Vec<u8> {
        self.socket.send(request).unwrap();
        let mut buffer = [0; 2048];
        let len = self.socket.recv(&mut buffer).expect("the board answers");
        buffer[..len].to_vec()
    }
}

fn sim(arguments: &[&str]) -> Run {
    run(&[&["sim"], arguments].concat())
}

#[test]
fn help_names_every_option() {
    let text = done(&["sim", "--help"]);
    for option in [
        "--board",
        "--listen",
        "--port",
        "--remote",
        "--state",
        "--loss",
        "--late",
        "--dup",
        "--seed",
        "7i97",
        "7i92-7i77",
        "7i77-io",
        "7i77-analog",
        "7i72",
        "7i64",
    ] {
        assert!(text.contains(option), "{option}");
    }
}

#[test]
fn command_lines_that_make_no_sense_are_refused_with_the_reason() {
    let board = ["--board", "7i97", "--listen", "127.0.0.1", "--port", "0"];
    let cases: [(&[&str], &str); 18] = [
        (&["--nonsense"], "nonsense"),
        (&["--board", "7i43"], "7i92-7i77"),
        (&["--listen", "nowhere"], "IPv4"),
        (&["--remote", "7i72"], "CH=DEVICE"),
        (&["--remote", "8=7i72"], "channels 0 to 7"),
        (&["--remote", "0=7i72", "--remote", "0=7i64"], "two remotes"),
        (&["--remote", "0=7i72:9"], "no mode 9"),
        (&["--remote", "0=/nowhere"], "/nowhere"),
        (&["--loss", "2"], "probability"),
        (&["--seed", "-"], "-"),
        (&["--state", "/nowhere/at/all"], "/nowhere/at/all"),
        (&["--state", "/proc/state"], "could not be written"),
        (&["--state", "/dev/zero"], "no regular file"),
        (&["--state", "/bin/true"], "no state of a simulated board"),
        (&["--state", ""], "a value is required"),
        (&["--remote", "0=7i99"], "7i77-analog"),
        (&["--remote", "0=/dev/zero"], "no regular file"),
        (&["--remote", "1.0=7i72"], "port 0 only"),
    ];
    for (arguments, reason) in cases {
        let mut all = board.to_vec();
        all.extend(arguments);
        let refused = sim(&all);
        assert_ne!(refused.code, Some(0), "{arguments:?}");
        assert!(refused.err.contains(reason), "{arguments:?}: {refused:?}");
    }
    let error = sim(&["--listen", "127.0.0.1"]).err;
    assert!(error.contains("not provided:\n  --board"), "{error}");
}

/// Waits until a file exists with a content other than `before`.
fn changed(file: &Scratch, before: &[u8]) -> Vec<u8> {
    for _ in 0..2000 {
        match fs::read(&file.0) {
            Ok(state) if state != before => return state,
            _ => std::thread::sleep(Duration::from_millis(10)),
        }
    }
    panic!("nothing is written");
}

/// Sets a non-volatile parameter of the remote on channel 0, over the network.
fn set_parameter(address: SocketAddrV4, name: &str, value: f64) {
    let mut bus = UdpBus::connect(address, patient()).unwrap();
    let hostmot2 = HostMot2::identify(&mut bus).unwrap();
    // TX and TXEN of TB4.
    for register in [0x1204, 0x1104] {
        bus.write(register, 0x1_8000).unwrap();
    }
    let mut port = Port::new(PortLayout::locate(&hostmot2, 0).unwrap());
    port.on(&mut bus).reset().unwrap();
    let [first, ..] = Channel::ALL;
    let start = [(first, 0)];
    let options = DiscoveryOptions::default();
    let found = discover_port(&mut port, &mut bus, &start, &options).unwrap();
    let found = found[0].as_ref().unwrap();
    let parameter = found.descriptor.parameter(name).unwrap();
    let mut memory = PortLink {
        port: &mut port,
        bus: &mut bus,
        channel: first,
    };
    parameter.write_parameter(&mut memory, value).unwrap();
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn written_state_is_kept_even_if_the_board_is_killed() {
    let file = Scratch::new("killed");
    let arguments = [
        "--board",
        "7i97",
        "--remote",
        "0=7i77-io",
        "--state",
        file.path(),
    ];
    let mut client = Client::start(&arguments);
    // Manual: 7I97, "SPACE 2: ETHERNET EEPROM CHIP ACCESS", with a read to wait for the write.
    let set_address = [
        0x01, 0xD9, 0x1A, 0x00, 0x02, 0x5A, 0x82, 0xC9, 0x20, 0x00, 0x20, 0x00, 0xA8, 0xC0, 0x82,
        0x49, 0x20, 0x00,
    ];
    assert_eq!(client.ask(&set_address), [0x20, 0x00, 0xA8, 0xC0]);
    let state = changed(&file, &[]);
    set_parameter(client.board.address, "NVWatchDogTimeout", 120.0);
    let state = changed(&file, &state);
    client.board.kill();

    // The remains of a power cut in the middle of a write.
    let mut half = file.0.as_os_str().to_owned();
    half.push(".9-0.new");
    fs::write(&half, &state[..state.len() / 2]).unwrap();

    let mut client = Client::start(&arguments);
    assert_eq!(
        fs::read(&half).unwrap().len(),
        state.len() / 2,
        "it belongs to no running board"
    );
    fs::remove_file(&half).unwrap();
    let ask_address = [0x82, 0x49, 0x20, 0x00];
    assert_eq!(client.ask(&ask_address), [0x20, 0x00, 0xA8, 0xC0]);
    let remote = client.board.console.show("0");
    assert_eq!(remote["remote.0.parameter.nvwatchdogtimeout"], "120");
    drop(client);

    for damaged in [&state[..100], &state[..state.len() - 1], b"nonsense", b""] {
        fs::write(&file.0, damaged).unwrap();
        let mut all = vec!["--listen", "127.0.0.1", "--port", "0"];
        all.extend(arguments);
        let refused = sim(&all);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(
            refused.err.contains("file"),
            "it says what to do: {refused:?}"
        );
        assert_eq!(fs::read(&file.0).unwrap(), damaged, "and leaves it alone");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn console_answers_everything_and_survives_any_bytes() {
    let mut client = Client::start(&[
        "--board",
        "7i97",
        "--remote",
        "0=7i77-io:2",
        "--remote",
        "1=7i77-analog",
        "--remote",
        "2=7i64",
    ]);
    let console = &mut client.board.console;
    assert!(console.command("help").unwrap().len() > 10);
    for good in [
        "",
        "input board 3 on",
        "pin 40 low",
        "pin 40 free",
        "turn 0 5",
        "turn 0 free",
        "input 0 31 on",
        "volts 0 1 12.5",
        "field 0 0",
        "field 0 24",
        "power 2 off",
        "power 2 on",
        "shorted 0 3 on",
        "hot 0 3 on",
        "unplug 1",
        "plug 1",
        "wire 0 fpga lost 3",
        "wire 0 remote corrupted 1",
        "wire 0 fpga late=100 1",
        "wire 0 fpga short=2 chance 0.1",
        "wire 0 heal",
    ] {
        assert!(console.command(good).is_ok(), "{good}");
    }
    for bad in [
        "nonsense",
        "input",
        "input board 99 on",
        "input board 1 maybe",
        "pin 400 low",
        "turn 9 1",
        "turn 0 nan",
        "turn 0 inf",
        "turn 0 1e308",
        "input 7 0 on",
        "volts 0 0 NaN",
        "unplug 5",
        "wire 0 fpga melted 1",
        "wire 0 up lost 1",
        "wire 0 fpga lost chance nan",
        "wire 0 fpga lost chance 1.5",
        "wire 0 fpga lost chance -1",
        "shorted 1 0 on",
        "quit now",
        "show nothing",
    ] {
        let refused = console.command(bad).unwrap_err();
        assert!(!refused.is_empty(), "{bad}");
    }
    let remote = console.show("0");
    assert_eq!(remote["remote.0.mode"], "2");
    assert_eq!(remote["remote.0.input-31"], "1");
    assert_eq!(remote["remote.0.analogin1"], "12.5000");
    let weird: Vec<u8> = (0..=255)
        .filter(|&byte| byte != b'\n')
        .cycle()
        .take(5000)
        .collect();
    console.raw(&weird);
    assert!(
        console.command("").is_err(),
        "the rest of a line of nonsense"
    );
    assert!(console.command("").is_ok());
    assert_eq!(client.ask(&ASK_COOKIE), COOKIE);
    client.board.console.run("quit");
    client.board.console.wait_for("summary");
    let summary = values(client.board.console.answer().unwrap());
    assert_eq!(summary["network.received.packets"], "1");
    assert!(client.board.wait().success());
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn any_datagram_is_survived() {
    let mut client = Client::start(&["--board", "7i92-7i77"]);
    let mut chance = Chance(0x1234_5678);
    for len in (0..300).chain([1472, 1473, 2000]) {
        let bytes: Vec<u8> = (0..len).map(|_| chance.below(256) as u8).collect();
        // Waits, erases and resets are executed, so that the board may be silent for some time.
        client.socket.send(&bytes).unwrap();
    }
    client
        .socket
        .set_read_timeout(Some(Duration::from_millis(50)))
        .unwrap();
    let mut buffer = [0; 2048];
    let answered = (0..2000).any(|_| {
        while client.socket.recv(&mut buffer).is_ok() {}
        client.socket.send(&ASK_COOKIE).unwrap();
        client
            .socket
            .recv(&mut buffer)
            .is_ok_and(|len| buffer[..len] == COOKIE)
    });
    assert!(answered);
    // Repeated waits for a stopped timer, each as long as possible; then the console and the signal
    // work as at any other time.
    let mut waits = vec![0x01, 0xD1, 0x04, 0x00, 0xFF, 0xFF];
    for _ in 0..200 {
        waits.extend([0x01, 0x51, 0x06, 0x00]);
    }
    client.socket.send(&waits).unwrap();
    assert!(!client.board.console.show("board").is_empty());
    client.board.console.run("unplug 0");
    client.board.stop("INT");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn closed_standard_input_does_not_end_it() {
    let mut child = command(&SIM_7I97).stdin(Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    input.write_all(b"show network").unwrap();
    drop(input);
    let console = Console::new(std::io::sink(), child.stdout.take().unwrap());
    console.wait_for("help");
    // The last line counts, with or without its end.
    assert!(console.answer().is_ok());
    std::thread::sleep(Duration::from_millis(100));
    assert!(child.try_wait().unwrap().is_none(), "it still runs");
    let mut board = Process::new(child);
    board.signal("TERM");
    console.wait_for("summary");
    assert!(board.child().wait().unwrap().success());
}
