//! The component as LinuxCNC loads it, without LinuxCNC: the built library over a HAL on the heap,
//! in real time against the simulated board.

mod board;
mod hal;
mod pci;
#[allow(unreachable_pub, reason = "shared with the tests in LinuxCNC")]
mod pci_board;
#[path = "../../../mesa-tools/tests/interop/tools.rs"]
#[allow(dead_code, unreachable_pub, reason = "shared with mesa-tools")]
mod tools;

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use board::{Board, OUTPUTS};
use hal::{Hal, Loaded, hal};
use mesa_hal_sim::{FirmwareImage, SimFpga};
use tools::realtime_thread;

/// Long enough for a busy computer: the deadline of a reply is 80 % of it.
const PERIOD: Duration = Duration::from_millis(4);
/// Time limit for a change on one side to arrive at the other.
const SETTLE: Duration = Duration::from_secs(20);

const WATCHDOG: Duration = Duration::from_secs(2);

/// A board that answers in time on a busy computer, as does the calling thread.
fn on_time(board: Board) -> Board {
    realtime_thread();
    board.with(|_, _| realtime_thread());
    board
}

/// A board, and the component in its cycle.
struct Machine<'a> {
    board: &'a Board,
    loaded: Loaded<'a>,
    prefix: &'static str,
}

impl<'a> Machine<'a> {
    fn load(hal: &'a Hal, board: &'a Board) -> Self {
        let address = board.address.to_string();
        let words = [
            ("board_ip", address.as_str()),
            ("config", "num_encoders=6 sserial_port_0=000xxxxx"),
            ("debug", "1"),
            ("trace", "0"),
            ("firewall", "none"),
            ("board_rtnet", "posix"),
        ];
        let loaded = hal.load(&words);
        let loaded = loaded.unwrap_or_else(|result| panic!("{result}: {}", hal.messages()));
        let messages = hal.messages();
        let is_error = |line: &str| line.starts_with("1 ");
        assert!(!messages.lines().any(is_error), "{messages}");
        let machine = Self {
            board,
            loaded,
            prefix: "hm2_7i97.0",
        };
        // A busy computer is no fault.
        machine.set("watchdog.timeout_ns", WATCHDOG.as_nanos() as f64);
        machine.set("packet-error-limit", 1e6);
        machine
    }

    fn name(&self, name: &str) -> String {
        format!("{}.{name}", self.prefix)
    }

    fn set(&self, name: &str, value: f64) {
        self.loaded.set(&self.name(name), value);
    }

    fn is_on(&self, name: &str) -> bool {
        self.loaded.get(&self.name(name)) != 0.0
    }

    fn cycle(&self) {
        let period = PERIOD.as_nanos() as i64;
        self.loaded.call(&self.name("read"), period);
        self.loaded.call(&self.name("write"), period);
        std::thread::sleep(PERIOD);
    }

    fn run(&self, time: Duration) {
        let start = Instant::now();
        while start.elapsed() < time {
            self.cycle();
        }
    }

    /// Cycles until it is so.
    fn until(&self, what: &str, is_so: impl Fn(&Self) -> bool) {
        let start = Instant::now();
        while !is_so(self) {
            let in_time = start.elapsed() < SETTLE;
            assert!(in_time, "{what}: {}", self.loaded.messages());
            self.cycle();
        }
    }

    fn outputs(&self) -> [bool; 3] {
        self.board.outputs()
    }

    fn switch_on(&self) {
        self.set("7i77.0.0.output-03", 1.0);
        self.set("7i72.0.2.output-17", 1.0);
        self.set("ssr.00.out-02", 1.0);
        self.until("outputs follow", |machine| machine.outputs() == [true; 3]);
    }
}

/// Values of signals.
static SIGNALS: [AtomicU64; 2] = [const { AtomicU64::new(0) }; 2];

#[test]
fn component_loads_with_hm2_eth_arguments_and_drives_the_board() {
    let (hal, board) = (hal(), on_time(Board::start()));
    let machine = Machine::load(&hal, &board);
    assert!(machine.loaded.names().count() > 700);
    for (name, kind) in [
        ("7i77.0.0.input-07", ("bit", "OUT")),
        ("7i77.0.1.analogout0", ("float", "IN")),
        ("7i77.0.1.analogout0-scalemax", ("float", "RW")),
        ("7i77.0.0.swrevision", ("u32", "RO")),
        ("7i77.0.0.nvwatchdogtimeout", ("u32", "RW")),
        ("encoder.00.count", ("s32", "OUT")),
        ("encoder.00.index-enable", ("bit", "I/O")),
        ("sserial.port-0.run", ("bit", "IN")),
        ("sserial.port-0.transfers", ("u32", "OUT")),
        ("valid", ("bit", "OUT")),
        ("7i72.0.2.armed", ("bit", "OUT")),
        ("7i72.0.2.rearm", ("bit", "IN")),
    ] {
        assert_eq!(machine.loaded.kind(&machine.name(name)), kind, "{name}");
    }
    machine.switch_on();
    board.set_input(7, true);
    machine.until("input", |machine| machine.is_on("7i77.0.0.input-07"));
    assert!(machine.is_on("valid") && machine.is_on("7i72.0.2.armed"));
    // `net` turns the pointers of pins at run time.
    machine
        .loaded
        .link("hm2_7i97.0.7i77.0.0.output-03", &SIGNALS[0]);
    machine
        .loaded
        .link("hm2_7i97.0.7i77.0.0.input-07", &SIGNALS[1]);
    machine.until("signal 0", |machine| !machine.outputs()[0]);
    SIGNALS[0].store(1, Ordering::Relaxed);
    machine.until("signal 1", |machine| machine.outputs()[0]);
    assert_eq!(SIGNALS[1].load(Ordering::Relaxed) & 0xFF, 1);
    machine.loaded.call("hm2_7i97.0.read-request", 4_000_000);
    machine.cycle();
    machine.loaded.unload();
    assert_eq!(
        board.outputs(),
        [false; 3],
        "the end switches everything off"
    );
}

#[test]
fn pulled_card_fails_alone_and_follows_again_after_run() {
    let (hal, board) = (hal(), on_time(Board::start()));
    let machine = Machine::load(&hal, &board);
    machine.switch_on();
    board.plug(OUTPUTS, false);
    machine.until("the card is lost", |machine| {
        !machine.is_on("7i72.0.2.valid")
    });
    machine.run(Duration::from_millis(200));
    assert!(machine.outputs()[0] && machine.outputs()[2]);
    let messages = hal.messages();
    let errors: Vec<_> = messages
        .lines()
        .filter(|line| line.starts_with("1 "))
        .collect();
    assert_eq!(errors.len(), 1, "{messages}");
    assert!(
        errors[0].starts_with("1 hm2_7i97.0.7i72.0.2: card offline"),
        "{errors:?}"
    );
    board.plug(OUTPUTS, true);
    machine.until("the card is back", |machine| {
        machine.is_on("7i72.0.2.valid")
    });
    machine.run(Duration::from_millis(200));
    assert_eq!(machine.outputs(), [true, false, true]);
    machine.set("sserial.port-0.run", 0.0);
    machine.run(Duration::from_millis(200));
    machine.set("sserial.port-0.run", 1.0);
    machine.until("all follow", |machine| machine.outputs() == [true; 3]);
}

#[test]
fn clearing_has_bit_restores_outputs_after_a_stopped_thread() {
    let (hal, board) = (hal(), on_time(Board::start()));
    let machine = Machine::load(&hal, &board);
    machine.switch_on();
    std::thread::sleep(WATCHDOG + Duration::from_secs(1));
    machine.until("a bite", |machine| machine.is_on("watchdog.has_bit"));
    machine.run(Duration::from_millis(200));
    assert!(!machine.outputs()[2]);
    machine.set("watchdog.has_bit", 0.0);
    machine.until("all follow", |machine| machine.outputs() == [true; 3]);
}

#[test]
fn clearing_io_error_restores_outputs_after_lost_packets() {
    let (hal, board) = (hal(), on_time(Board::start()));
    let machine = Machine::load(&hal, &board);
    machine.switch_on();
    machine.set("packet-error-limit", 10.0);
    board.lose(1.0);
    machine.until("an error", |machine| machine.is_on("io_error"));
    board.lose(0.0);
    machine.set("packet-error-limit", 1e6);
    assert!(!machine.is_on("valid"));
    machine.set("io_error", 0.0);
    machine.until("all follow", |machine| machine.outputs() == [true; 3]);
}

#[test]
fn fifteen_rounds_of_load_and_unload() {
    let (hal, board) = (hal(), on_time(Board::start()));
    for _ in 0..15 {
        let machine = Machine::load(&hal, &board);
        machine.until("valid", |machine| machine.is_on("7i72.0.2.valid"));
        machine.loaded.unload();
    }
}

#[test]
fn two_boards_of_a_kind_are_numbered() {
    let (hal, boards) = (hal(), [on_time(Board::start()), on_time(Board::start())]);
    let address = format!("{},{}", boards[0].address, boards[1].address);
    let loaded = hal.load(&[("board_ip", &address), ("config", "num_encoders=6")]);
    let loaded = loaded.unwrap_or_else(|result| panic!("{result}: {}", hal.messages()));
    for name in [
        "hm2_7i97.0.valid",
        "hm2_7i97.1.valid",
        "hm2_7i97.1.7i72.0.2.valid",
    ] {
        assert!(loaded.names().any(|own| own == name), "{name}");
    }
    loaded.call("hm2_7i97.0.read", 4_000_000);
    loaded.call("hm2_7i97.1.read", 4_000_000);
}

/// The first board of the line is not the first one of its kind in the order of names.
#[test]
fn two_kinds_of_boards_in_one_line_have_numbers_of_their_own() {
    let hal = hal();
    let boards = [
        on_time(Board::start()),
        on_time(Board::start_with(board::i7i92)),
        on_time(Board::start()),
    ];
    let addresses = boards.each_ref().map(|board| board.address.to_string());
    let loaded = hal.load(&[
        ("board_ip", &addresses.join(",")),
        (
            "config",
            "sserial_port_0=000xxxxx,num_encoders=2 sserial_port_0=000xxxxx,num_encoders=6",
        ),
    ]);
    let loaded = loaded.unwrap_or_else(|result| panic!("{result}: {}", hal.messages()));
    let kinds = ["hm2_7i97.0", "hm2_7i92.0", "hm2_7i97.1"];
    let named: BTreeSet<_> = loaded
        .names()
        .map(|name| name.split('.').take(2).collect::<Vec<_>>().join("."))
        .collect();
    assert_eq!(named, kinds.map(str::to_owned).into());
    let has = |name: &str| loaded.names().any(|own| own == name);
    assert!(has("hm2_7i92.0.encoder.01.count") && !has("hm2_7i92.0.encoder.02.count"));
    for kind in kinds {
        loaded.set(&format!("{kind}.watchdog.timeout_ns"), 2e9);
        loaded.set(&format!("{kind}.packet-error-limit"), 1e6);
        loaded.set(&format!("{kind}.7i72.0.2.output-17"), 1.0);
    }
    // Each drives its own board.
    loaded.set("hm2_7i97.1.7i72.0.2.output-17", 0.0);
    let start = Instant::now();
    let outputs = || boards.each_ref().map(|board| board.output(OUTPUTS, 17));
    while outputs() != [true, true, false] {
        let in_time = start.elapsed() < SETTLE;
        assert!(in_time, "{:?}: {}", outputs(), hal.messages());
        for kind in kinds {
            loaded.call(&format!("{kind}.read"), 4_000_000);
            loaded.call(&format!("{kind}.write"), 4_000_000);
        }
        std::thread::sleep(PERIOD);
    }
}

#[test]
fn channels_without_a_remote_are_one_note_for_each_port() {
    let (hal, board) = (
        hal(),
        on_time(Board::start_with(|| {
            let mut fpga = board::i7i97();
            fpga.plug(0, OUTPUTS, None);
            fpga
        })),
    );
    let address = board.address.to_string();
    let loaded = hal.load(&[
        ("board_ip", &address),
        ("config", "sserial_port_0=000xxxxx"),
    ]);
    assert!(loaded.is_ok(), "{}", hal.messages());
    let messages = hal.messages();
    let about: Vec<_> = messages
        .lines()
        .filter(|line| line.contains("remote answers"))
        .collect();
    let [note] = about[..] else {
        panic!("{messages}");
    };
    let expected = "0 mesa_eth: hm2_7i97.0: no remote answers on these channels of port 0: 2; ";
    assert!(note.starts_with(expected), "{note}");
    assert!(
        !messages.lines().any(|line| line.starts_with("1 ")),
        "{messages}"
    );
}

#[test]
fn wrong_words_are_refused_by_name_and_leave_nothing() {
    let (hal, board) = (hal(), on_time(Board::start()));
    let address = board.address.to_string();
    for (words, said) in [
        (vec![], "board_ip= is missing"),
        (
            vec![("board_ip", "7i97")],
            "board_ip=7i97: not an IP address",
        ),
        (
            vec![("board_ip", address.as_str()), ("config", "num_encoder=6")],
            "'num_encoder=6'",
        ),
        (
            vec![
                ("board_ip", address.as_str()),
                ("config", "sserial_port_0=0z"),
            ],
            "'sserial_port_0=0z'",
        ),
        (
            vec![
                ("board_ip", address.as_str()),
                ("config", "sserial_port_3=00"),
            ],
            "config=sserial_port_3=00: ",
        ),
        (
            vec![
                ("board_ip", address.as_str()),
                ("config", "num_encoders=60"),
            ],
            "config=num_encoders=60: ",
        ),
        (
            vec![("board_ip", "127.0.0.1:9"), ("config", "")],
            "board_ip=127.0.0.1:9",
        ),
    ] {
        let result = hal.load(&words).err().expect("it is refused");
        assert!(result < 0);
        let messages = hal.messages();
        assert!(messages.starts_with("1 mesa_eth: "), "{messages}");
        assert!(messages.contains(said), "{said}: {messages}");
    }
    let machine = Machine::load(&hal, &board);
    machine.until("valid", |machine| machine.is_on("valid"));
}

/// A public firmware with absolute encoders.
#[test]
fn module_that_is_not_driven_is_named_at_the_load() {
    const FIRMWARE: &str =
        include_str!("../../../../tests/transcripts/firmwares/7I92-7I74_SSI_SSx2_34.txt");
    let hal = hal();
    let board = on_time(Board::start_with(|| {
        let image = FirmwareImage::parse(FIRMWARE).expect("a firmware");
        SimFpga::from_image(&image).expect("a firmware")
    }));
    let address = board.address.to_string();
    let loaded = hal.load(&[("board_ip", address.as_str())]);
    assert!(loaded.is_ok(), "{}", hal.messages());
    let messages = hal.messages();
    let is_note = |line: &str| line.starts_with("0 mesa_eth: hm2_7i92.0: SSI (08) version 0");
    assert!(messages.lines().any(is_note), "{messages}");
}

/// Components for Modbus call functions of hostmot2 that a packet UART is there for.
#[test]
fn modules_unusable_by_linuxcnc_components_are_reported_at_load() {
    const FIRMWARE: &str =
        include_str!("../../../../tests/transcripts/firmwares/7I95-7I95_1PktD_58.txt");
    let hal = hal();
    let board = on_time(Board::start_with(|| {
        let image = FirmwareImage::parse(FIRMWARE).expect("a firmware");
        SimFpga::from_image(&image).expect("a firmware")
    }));
    let address = board.address.to_string();
    let load = |config| hal.load(&[("board_ip", address.as_str()), ("config", config)]);
    let loaded = load("num_encoders=6 firmware=hm2/7i95/x.bit");
    assert!(loaded.is_ok(), "{}", hal.messages());
    drop(loaded);
    let messages = hal.messages();
    for said in [
        "0 mesa_eth: hm2_7i95.0: PktUARTTransmit (1B) version 0",
        "components that use it through hostmot2 (Modbus, SPI) cannot be loaded: they need hm2_eth",
        "firmware=hm2/7i95/x.bit is not loaded",
    ] {
        assert!(messages.contains(said), "{said}: {messages}");
    }
    assert!(load("num_encoders=6 num_pktuarts=1").is_err());
    let messages = hal.messages();
    let is_refusal = |line: &str| line.starts_with("1 ") && line.contains("'num_pktuarts=1'");
    assert!(messages.lines().any(is_refusal), "{messages}");
}

#[test]
fn hal_that_is_full_is_an_error() {
    let (hal, board) = (hal(), on_time(Board::start()));
    hal.limit(7_000);
    let address = board.address.to_string();
    let result = hal.load(&[("board_ip", &address)]).err();
    hal.limit(1 << 20);
    assert!(result.is_some_and(|result| result < 0));
    let messages = hal.messages();
    assert!(messages.contains("HAL"), "{messages}");
}

#[cfg(debug_assertions)]
#[test]
fn panic_ends_the_board_alone_and_its_outputs_go_off() {
    let (hal, board) = (hal(), on_time(Board::start()));
    let address = board.address.to_string();
    let words = [("board_ip", address.as_str()), ("panic_in", "3000")];
    let loaded = hal.load(&words);
    let loaded = loaded.unwrap_or_else(|result| panic!("{result}: {}", hal.messages()));
    let machine = Machine {
        board: &board,
        loaded,
        prefix: "hm2_7i97.0",
    };
    machine.set("watchdog.timeout_ns", 5e8);
    machine.set("packet-error-limit", 1e6);
    machine.switch_on();
    machine.until("a panic", |machine| {
        machine.loaded.messages().contains("a panic in")
    });
    assert!(machine.is_on("io_error") && !machine.is_on("valid"));
    machine.until("outputs are off", |machine| machine.outputs() == [false; 3]);
    // The user cannot acknowledge it.
    machine.set("io_error", 0.0);
    machine.cycle();
    assert!(machine.is_on("io_error"));
    for name in [
        "valid",
        "7i77.0.0.valid",
        "7i77.0.0.armed",
        "7i72.0.2.armed",
    ] {
        assert!(!machine.is_on(name), "{name}");
    }
    machine.loaded.unload();
    let machine = Machine::load(&hal, &board);
    machine.switch_on();
}
