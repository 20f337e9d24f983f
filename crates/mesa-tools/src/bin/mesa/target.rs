//! Target board of a command.

use std::cell::OnceCell;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use clap::Args;
use mesa_hal::bus::{BusError, BusErrorKind};
use mesa_hal::ethernet::{EthernetBoard, Identity, MacAddress};
use mesa_hal::lbp16;
use mesa_hal::transport::search::{self, AddressResult};
use mesa_hal::transport::udp::{UdpBus, UdpConfig, UdpError, UdpLink};
use mesa_hal_sim::{Mishaps, UdpFace};

use crate::consent::Asks;
use crate::context::Failure;
use crate::output::complain;
use crate::sim::machine::{Machine, MachineOptions};

/// Timeout of an answer when the identity of a board is checked again.
const AGAIN: Duration = Duration::from_millis(100);

/// Environment variable with the address of the board.
const ADDRESS: &str = "MESA_ADDR";

/// Target board of a command: one on the network, or an embedded simulated one.
#[derive(Clone, Debug, Args)]
pub struct Target {
    /// Address of an Ethernet board; the port is 27181 unless given. Default: MESA_ADDR
    #[arg(long, value_name = "IP[:PORT]", value_parser = parse_address, conflicts_with = "sim")]
    addr: Option<SocketAddrV4>,
    /// Simulated machine in this process: 7i92-7i77, 7i97 or another board of `mesa sim --board`,
    /// with remotes on its serial channels as in `mesa sim --remote` (7i97,0=7i72,1=7i77-io:2); a
    /// machine file that ends in .toml (examples/mill.toml); or, in place of the board, a firmware
    /// image that ends in .txt (`mesa sim --firmware`)
    #[arg(long, value_name = "MACHINE")]
    sim: Option<MachineOptions>,
}

/// Target board of a command that changes it.
#[derive(Clone, Debug, Args)]
pub struct ChangedTarget {
    #[command(flatten)]
    target: Target,
    /// Check everything and print the planned action without doing it
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub asks: Asks,
}

impl ChangedTarget {
    /// As [`Target::find`].
    pub fn find(&self) -> Result<Found, Failure> {
        self.target.find()
    }
}

/// Address of the target board, and the simulated machine behind it, if any.
#[derive(Debug)]
pub struct Found {
    /// Address of the board.
    pub address: SocketAddrV4,
    /// Card and MAC address of the first board that answered at the address.
    who: OnceCell<(String, MacAddress)>,
    // Dropping it ends the simulated machine.
    _simulated: Option<Embedded>,
}

impl Target {
    /// Determines the address of the board; starts the simulated machine if that is the board.
    pub fn find(&self) -> Result<Found, Failure> {
        if let Some(machine) = &self.sim {
            let embedded = Embedded::start(machine)?;
            return Ok(Found {
                address: embedded.address,
                who: OnceCell::new(),
                _simulated: Some(embedded),
            });
        }
        let address = match self.addr {
            Some(address) => address,
            None => from_environment()?,
        };
        Ok(Found {
            address,
            who: OnceCell::new(),
            _simulated: None,
        })
    }
}

impl Found {
    /// Opens the bus of the board. Fails if another program drives the board, which is not
    /// disturbed.
    pub fn open(&self) -> Result<UdpBus, Failure> {
        self.open_with(UdpConfig::default())
    }

    /// As [`open`](Self::open), with the deadlines of `config`.
    pub fn open_with(&self, config: UdpConfig) -> Result<UdpBus, Failure> {
        let tries = config.setup_tries;
        let bus = UdpBus::connect(self.address, config);
        let mut bus = bus.map_err(|error| self.refuses(tries, error))?;
        let is = EthernetBoard::new(&mut bus).identity()?;
        self.check_same(is)?;
        Ok(bus)
    }

    /// Fails if another board answers than before. Boards share factory addresses, and an action
    /// must reach the board that was inspected.
    fn check_same(&self, is: Identity) -> Result<(), Failure> {
        let is = (is.card, is.mac);
        let was = self.who.get_or_init(|| is.clone());
        if *was == is {
            return Ok(());
        }
        let ((card, mac), (other, its)) = (was, is);
        Err(Failure::refused(format_args!(
            "{}: another board answers here by now: a {other} with the MAC address {its}; it was a {card} \
             with {mac}. Nothing was done to it",
            self.address
        )))
    }

    /// Checks again, before an action, that no other program drives the board and that it is still
    /// the same one. Changes nothing on the board.
    pub fn check_free(&self) -> Result<(), Failure> {
        let config = UdpConfig::default();
        let free = UdpLink::connect(self.address)
            .map_err(UdpError::from)
            .and_then(|link| UdpBus::check_free(link, config));
        free.map_err(|error| self.refuses(config.setup_tries, error))?;
        if self.who.get().is_none() {
            return Ok(());
        }
        // Without opening a bus, which would clear counters that another program relies on.
        for _ in 0..config.setup_tries {
            let asked = search::ask(&[self.address], AGAIN)?;
            if let Some(AddressResult { found: Ok(is), .. }) = asked.into_iter().next() {
                return self.check_same(is);
            }
        }
        let address = self.address;
        Err(Failure::refused(format_args!(
            "{address}: no board answers any more; nothing was done"
        )))
    }

    fn refuses(&self, tries: u32, error: UdpError) -> Failure {
        let why = match error.kind() {
            _ if matches!(error, UdpError::Foreign { .. }) => {
                format!("no board answers, asked {tries} times, but another host does: {error}")
            }
            BusErrorKind::Lost => format!("no board answers, asked {tries} times: {error}"),
            _ => error.to_string(),
        };
        Failure::refused(format_args!("{}: {why}", self.address))
    }
}

fn from_environment() -> Result<SocketAddrV4, Failure> {
    match std::env::var(ADDRESS) {
        Ok(text) => parse_address(&text).map_err(|error| {
            Failure::usage(format_args!("the environment variable {ADDRESS}: {error}"))
        }),
        Err(_) => Err(Failure::usage(
            "which board? Give --addr IP, --sim MACHINE, or the environment variable MESA_ADDR",
        )),
    }
}

/// Parses an IPv4 address, with a port if it is not 27181.
pub fn parse_address(text: &str) -> Result<SocketAddrV4, String> {
    let with_port = || text.parse().ok();
    let ip = text.parse::<Ipv4Addr>().ok();
    ip.map(|ip| SocketAddrV4::new(ip, lbp16::PORT))
        .or_else(with_port)
        .ok_or_else(|| {
            format!("`{text}` is no IPv4 address; give it as 10.10.10.10 or 10.10.10.10:27181")
        })
}

/// A simulated machine that runs in a thread, in real time, until it is dropped.
#[derive(Debug)]
struct Embedded {
    address: SocketAddrV4,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Longest time between two checks for the end.
const TICK: Duration = Duration::from_millis(1);

impl Embedded {
    fn start(options: &MachineOptions) -> Result<Self, Failure> {
        let mut machine = Machine::new(options)?;
        let free = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0);
        let mut face = UdpFace::bind(free, Mishaps::default())?;
        let address = SocketAddrV4::new(Ipv4Addr::LOCALHOST, face.local_addr()?.port());
        let stop = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                if let Err(error) = face.step(&mut machine.board, TICK) {
                    complain(format_args!("mesa: the simulated machine ends: {error}"));
                    return;
                }
            }
        });
        Ok(Self {
            address,
            stop,
            thread: Some(thread),
        })
    }
}

impl Drop for Embedded {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
