//! Signals to commands whose board does not answer, loses packets, or answers nonsense.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

use crate::check::set::{OUTPUT, impatient_board, lit};
use crate::common::chance::Chance;
use crate::interop::board::Board;
use crate::interop::{Process, Scratch, wait_until};
use crate::run::{Run, command};
use crate::terminal::Terminal;

/// Longest time from a signal to the end of a command: 0.9 s of missing replies, and a busy
/// computer.
const SOON: Duration = Duration::from_secs(2);

/// Time in which a command notices that replies are missing.
const A_WHILE: Duration = Duration::from_millis(300);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Network {
    Good,
    Silent,
    /// Loses half of the packets in each direction.
    Lossy,
    /// Spoils nine of ten replies: cut off, or too long.
    Spoiled,
}

const FAULTS: [Network; 3] = [Network::Silent, Network::Lossy, Network::Spoiled];

/// A relay to a board, whose network becomes bad on request. It serves one socket of a client at a
/// time, as the commands use.
pub struct Relay {
    pub address: SocketAddrV4,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    network: AtomicU8,
    packets: AtomicU64,
    is_over: AtomicBool,
}

impl Relay {
    pub fn start(board: SocketAddrV4, network: Network) -> Self {
        let front = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
        let port = front.local_addr().expect("bound").port();
        let shared = Arc::new(Shared::default());
        shared.network.store(network as u8, Ordering::Relaxed);
        let thread = std::thread::spawn({
            let shared = Arc::clone(&shared);
            move || shared.serve(&front, board)
        });
        Self {
            address: SocketAddrV4::new(Ipv4Addr::LOCALHOST, port),
            shared,
            thread: Some(thread),
        }
    }

    pub fn set(&self, network: Network) {
        self.shared.network.store(network as u8, Ordering::Relaxed);
    }

    fn packets(&self) -> u64 {
        self.shared.packets.load(Ordering::Relaxed)
    }
}

impl Shared {
    fn serve(&self, front: &UdpSocket, board: SocketAddrV4) {
        let mut chance = Chance(7);
        let mut buffer = [0; 2048];
        let (mut client, mut back) = (None, None);
        front.set_nonblocking(true).expect("a socket");
        while !self.is_over.load(Ordering::Relaxed) {
            let mut idles = true;
            if let Ok((len, from)) = front.recv_from(&mut buffer) {
                idles = false;
                self.packets.fetch_add(1, Ordering::Relaxed);
                if client != Some(from) {
                    // A new socket, as a board behind a relay sees other ports for other clients.
                    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
                    socket.connect(board).expect("the board");
                    socket.set_nonblocking(true).expect("a socket");
                    (client, back) = (Some(from), Some(socket));
                }
                if let Some(back) = back.as_ref().filter(|_| self.passes(&mut chance)) {
                    let _ = back.send(&buffer[..len]);
                }
            }
            let reply = back.as_ref().map(|back| back.recv(&mut buffer[..2000]));
            if let (Some(Ok(len)), Some(client)) = (reply, client) {
                idles = false;
                let len = self.spoil(&mut chance, len);
                if self.passes(&mut chance) {
                    let _ = front.send_to(&buffer[..len], client);
                }
            }
            if idles {
                sleep(Duration::from_micros(100));
            }
        }
    }

    fn is(&self, network: Network) -> bool {
        self.network.load(Ordering::Relaxed) == network as u8
    }

    fn passes(&self, chance: &mut Chance) -> bool {
        let is_lost = self.is(Network::Lossy) && chance.one_in(2);
        !is_lost && !self.is(Network::Silent)
    }

    /// The length of a reply that is passed on.
    fn spoil(&self, chance: &mut Chance, len: usize) -> usize {
        if !self.is(Network::Spoiled) || chance.one_in(10) {
            return len;
        }
        if chance.one_in(2) {
            len.div_ceil(2)
        } else {
            len + 4
        }
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn board() -> Board {
    let card = ["--board", "7i92-7i77", "--port", "0"];
    Board::start(Ipv4Addr::LOCALHOST, &card)
}

fn code_of(signal: &str) -> i32 {
    if signal == "INT" { 130 } else { 143 }
}

/// Ends a command by a signal, and returns its result; fails if it does not end soon.
fn ended_soon(what: &str, mut process: Process, signal: &str) -> Run {
    assert!(!process.has_ended(), "{what}: {:?}", process.output());
    process.signal(signal);
    let begun = Instant::now();
    let run = Run::from(process.output());
    assert!(
        begun.elapsed() < SOON,
        "{what}: {:?}: {run:?}",
        begun.elapsed()
    );
    run
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn command_ends_soon_after_a_signal_while_replies_are_missing() {
    let (backup, page) = (Scratch::new("signals.bin"), Scratch::new("signals.html"));
    let (csv, whole) = (
        Scratch::new("signals.csv"),
        Scratch::new("signals-whole.bin"),
    );
    std::fs::write(&whole.0, vec![0; 2 << 20]).expect("a scratch file");
    let input = "7i77.0.0.input-00";
    let scope = [
        "scope",
        input,
        "--trigger",
        input,
        "--csv",
        csv.path(),
        "--yes",
    ];
    // After how many packets the network becomes bad: a board has answered 40 long before the end
    // of those commands.
    let commands: &[(u64, &[&str])] = &[
        (40, &["info"]),
        (0, &["info"]),
        (40, &["pins"]),
        (0, &["hal"]),
        (40, &["hal"]),
        (40, &["doctor", "--yes"]),
        (0, &["doctor", "--yes"]),
        (40, &["latency"]),
        (40, &["set", OUTPUT, "on", "--for", "60s", "--yes"]),
        (0, &["set", OUTPUT, "on", "--for", "60s", "--yes"]),
        (40, &["wiring", input, "--timeout", "60"]),
        (40, &scope),
        (40, &["report", page.path(), "--yes"]),
        (0, &["flash", "backup", backup.path(), "--yes"]),
        (0, &["flash", "verify", whole.path()]),
        (0, &["flash", "restore", whole.path(), "--yes"]),
        (40, &["param", "list"]),
        (0, &["param", "set", "0.0.NVWatchDogTimeout", "60", "--yes"]),
        (0, &["peek", "0:0x100"]),
        (0, &["ip"]),
        (0, &["led"]),
        (0, &["reload", "--yes"]),
    ];
    std::thread::scope(|threads| {
        for network in FAULTS {
            threads.spawn(move || {
                let board = board();
                for (n, &(packets, line)) in commands.iter().enumerate() {
                    let first = if packets == 0 { network } else { Network::Good };
                    let signal = ["INT", "TERM"][n % 2];
                    let what = format!("{network:?} after {packets}, {signal}: {line:?}");
                    let relay = Relay::start(board.address, first);
                    let to = relay.address.to_string();
                    let started = command(&[line, &["--addr", &to]].concat()).spawn();
                    let mut process = Process::new(started.expect("mesa starts"));
                    wait_until(&what, || {
                        relay.packets() >= packets.max(1) || process.has_ended()
                    });
                    relay.set(network);
                    sleep(A_WHILE);
                    let run = ended_soon(&what, process, signal);
                    assert_eq!(run.code, Some(code_of(signal)), "{what}: {run:?}");
                    assert!(!run.err.contains("check the"), "{what}: {run:?}");
                }
            });
        }
    });
    for file in [&backup, &page, &csv] {
        assert!(!file.0.exists(), "{}", file.path());
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn screen_ends_soon_after_a_signal_while_replies_are_missing() {
    for (n, network) in FAULTS.into_iter().enumerate() {
        let board = board();
        let relay = Relay::start(board.address, Network::Good);
        let arguments = format!("watch --addr {}", relay.address);
        let Some(terminal) = Terminal::start(&format!("signals-{n}"), &arguments) else {
            return;
        };
        terminal.wait_for_text("encoder.00.position");
        relay.set(network);
        sleep(A_WHILE);
        terminal.signal("TERM");
        let begun = Instant::now();
        terminal.wait_for_text("exit code ");
        assert!(begun.elapsed() < SOON, "{network:?}: {:?}", begun.elapsed());
    }
}

/// A remote that is not reached any more is made safe by its own watchdog, and said to be.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn output_goes_off_after_a_signal_while_replies_are_missing() {
    for (network, signal) in FAULTS.into_iter().zip(["INT", "TERM", "INT"]) {
        let mut board = impatient_board();
        let relay = Relay::start(board.address, Network::Good);
        let to = relay.address.to_string();
        let line = ["set", OUTPUT, "on", "--for", "60s", "--yes", "--addr", &to];
        let process = Process::new(command(&line).spawn().expect("mesa starts"));
        wait_until("the output is on", || !lit(&mut board).is_empty());
        relay.set(network);
        let run = ended_soon(&format!("{network:?}"), process, signal);
        // The watchdogs of board and remote, 100 and 50 ms, on a busy computer.
        wait_until("its watchdog bites", || lit(&mut board).is_empty());
        let is_off = run.err.contains("all outputs are off") && run.code == Some(code_of(signal));
        let is_told = run.err.contains("by its watchdog") && run.code == Some(1);
        assert!(is_off || is_told, "{network:?}: {run:?}");
    }
}
