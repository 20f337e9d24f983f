//! Which board a command is for.

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

/// How long a board may take to say again who it is.
const AGAIN: Duration = Duration::from_millis(100);

/// Environment variable with the address of the board.
const ADDRESS: &str = "MESA_ADDR";

/// Which board a command is for: one on the network, or an embedded simulated one.
#[derive(Clone, Debug, Args)]
pub struct Target {
    /// An Ethernet board; the port is 27181 unless given. Default: MESA_ADDR
    #[arg(long, value_name = "IP[:PORT]", value_parser = parse_address, conflicts_with = "sim")]
    addr: Option<SocketAddrV4>,
    /// A simulated machine in this program: 7i92-7i77, 7i97, or another board of `mesa sim --board`,
    /// and what is plugged into its serial channels as in `mesa sim --remote`:
    /// 7i97,0=7i72,1=7i77-io:2; or one that a file describes, whose name ends in .toml
    /// (examples/mill.toml); or in place of the board the image of a firmware, whose name ends in .txt
    /// (`mesa sim --firmware`)
    #[arg(long, value_name = "MACHINE")]
    sim: Option<MachineOptions>,
}

/// The board of a command that changes it.
#[derive(Clone, Debug, Args)]
pub struct ChangedTarget {
    #[command(flatten)]
    target: Target,
    /// Check everything, print what would be done, and do nothing
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

/// A board that a command talks to, and the simulated machine behind it if there is one.
#[derive(Debug)]
pub struct Found {
    /// Where it is.
    pub address: SocketAddrV4,
    /// Card and MAC address of what answered there first.
    who: OnceCell<(String, MacAddress)>,
    // Ends when nobody talks to it any more.
    _simulated: Option<Embedded>,
}

impl Target {
    /// Where the board is; starts the simulated machine if that is the board.
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
    /// The bus of the board. A board that another program drives is left alone.
    pub fn open(&self) -> Result<UdpBus, Failure> {
        self.open_with(UdpConfig::default())
    }

    /// The same with these deadlines.
    pub fn open_with(&self, config: UdpConfig) -> Result<UdpBus, Failure> {
        let tries = config.setup_tries;
        let bus = UdpBus::connect(self.address, config);
        let mut bus = bus.map_err(|error| self.refuses(tries, error))?;
        let is = EthernetBoard::new(&mut bus).identity()?;
        self.check_same(is)?;
        Ok(bus)
    }

    /// Boards come with the same address: what is done is done to the one that was looked at.
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

    /// Looks again whether another program drives the board, and whether it still is that one, before
    /// something is done to it. Nothing is changed there.
    pub fn check_free(&self) -> Result<(), Failure> {
        let config = UdpConfig::default();
        let free = UdpLink::connect(self.address)
            .map_err(UdpError::from)
            .and_then(|link| UdpBus::check_free(link, config));
        free.map_err(|error| self.refuses(config.setup_tries, error))?;
        if self.who.get().is_none() {
            return Ok(());
        }
        // With no bus, which would clear what another one counts on.
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
                format!("asked {tries} times, and no board answers, but somebody: {error}")
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

/// An IPv4 address, with a port if it is not 27181.
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

/// The longest time between two looks at whether it shall end.
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
