//! Target board of a command.

use std::cell::OnceCell;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

use clap::Args;
use mesa_hal::Settings;
use mesa_hal::bus::{BusError, BusErrorKind};
use mesa_hal::ethernet::{EthernetBoard, Identity};
use mesa_hal::lbp16;
use mesa_hal::transport::search::{self, AddressResult};
use mesa_hal::transport::udp::{SocketError, UdpBus, UdpConfig, UdpError, UdpLink};

use crate::consent::Asks;
use crate::context::{Failure, told};
use crate::link::{BoardLink, Bus};
use crate::look::LookBus;
use crate::sim::machine::{Machine, MachineOptions};
use crate::simulated::{Passage, Simulated};
use mesa_tools::Counted;

/// Timeout of an answer when the identity of a board is checked again.
const AGAIN: Duration = Duration::from_millis(100);

/// Minimum deadline of a reply from a program on this host, such as `mesa sim`: it answers when the
/// host lets it run. A real board answers within the deadlines of a command.
const ON_THIS_HOST: Duration = Duration::from_millis(500);

/// Deadline of a reply in a look at a running machine.
const LOOK: Duration = Duration::from_millis(200);

/// Minimum watchdog time of a simulated board, whose outputs are not real: on a busy host neither
/// this program nor the board runs in time.
const WATCHDOG: Duration = Duration::from_secs(3);

/// Cycles without a transfer after which inputs of a simulated board are not valid.
const STALE_AFTER: u32 = 50;

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
    /// The first board that answered at the address.
    who: OnceCell<Identity>,
    /// Simulated machine in place of a board.
    simulated: Option<Simulated>,
}

impl Target {
    /// Determines the address of the board; builds the simulated machine if that is the board.
    pub fn find(&self) -> Result<Found, Failure> {
        let (address, simulated) = match (&self.sim, self.addr) {
            (Some(options), _) => {
                let machine = Machine::new(options)?;
                let address = SocketAddrV4::new(Ipv4Addr::LOCALHOST, lbp16::PORT);
                (address, Some(Simulated::new(machine.board)))
            }
            (None, Some(address)) => (address, None),
            (None, None) => (from_environment()?, None),
        };
        Ok(Found {
            address,
            who: OnceCell::new(),
            simulated,
        })
    }
}

impl Found {
    /// Sets how the time of a simulated machine passes; the default is virtual time.
    pub fn pass_time(self, passage: Passage) -> Self {
        if let Some(simulated) = &self.simulated {
            simulated.set_passage(passage);
        }
        self
    }

    /// The board as it was when it was opened first.
    pub fn identity(&self) -> Option<&Identity> {
        self.who.get()
    }

    /// The same board at another IP address; `None` for an embedded simulated one, which has none.
    pub fn moved_to(&self, ip: Ipv4Addr) -> Option<Self> {
        let is_real = self.simulated.is_none();
        is_real.then(|| Self {
            address: SocketAddrV4::new(ip, self.address.port()),
            who: self.who.clone(),
            simulated: None,
        })
    }

    /// A link to the board. Nothing is sent.
    pub fn link(&self) -> Result<BoardLink, SocketError> {
        match &self.simulated {
            Some(simulated) => Ok(BoardLink::Simulated(simulated.link())),
            None => UdpLink::connect(self.address).map(BoardLink::Socket),
        }
    }

    /// A bus for a look at the board beside a program that drives it. Nothing is sent.
    pub fn look(&self) -> Result<LookBus, Failure> {
        let deadline = if self.is_on_this_host() {
            ON_THIS_HOST
        } else {
            LOOK
        };
        Ok(LookBus::new(self.link()?, deadline))
    }

    /// Opens the bus of the board. Fails if another program drives the board, which is not
    /// disturbed.
    pub fn open(&self) -> Result<Bus, Failure> {
        self.open_with(UdpConfig::default())
    }

    /// As [`open`](Self::open), with the deadlines of `config`; longer ones if the board is a
    /// program on this host.
    pub fn open_with(&self, config: UdpConfig) -> Result<Bus, Failure> {
        let config = self.patient(config);
        let tries = config.setup_tries;
        let link = self.link().map_err(UdpError::from);
        let bus = link.and_then(|link| UdpBus::new(link, config));
        let mut bus = bus.map_err(|error| self.refuses(tries, error))?;
        let is = EthernetBoard::new(&mut bus).identity()?;
        self.check_same(is)?;
        Ok(bus)
    }

    /// True if the board is simulated, in this program or in another one on this host.
    fn is_on_this_host(&self) -> bool {
        self.address.ip().is_loopback()
    }

    fn patient(&self, mut config: UdpConfig) -> UdpConfig {
        if self.is_on_this_host() {
            config.setup_deadline = config.setup_deadline.max(ON_THIS_HOST);
            config.cycle_deadline = config.cycle_deadline.max(ON_THIS_HOST);
        }
        config
    }

    /// Lengthens the times in `settings` after which a simulated board and its inputs are given up.
    pub fn with_patience(&self, mut settings: Settings) -> Settings {
        if self.is_on_this_host() {
            settings.watchdog = settings.watchdog.map(|time| time.max(WATCHDOG));
            settings.fault_policy.stale_after = STALE_AFTER;
        }
        settings
    }

    /// Fails if another board answers than before. Boards share factory addresses, and an action
    /// must reach the board that was inspected.
    fn check_same(&self, is: Identity) -> Result<(), Failure> {
        let was = self.who.get_or_init(|| is.clone());
        if (&was.card, was.mac) == (&is.card, is.mac) {
            return Ok(());
        }
        let Identity { card, mac, .. } = was;
        let (other, its) = (is.card, is.mac);
        Err(Failure::refused(format_args!(
            "{}: another board answers here by now: a {other} with the MAC address {its}; it was a {card} \
             with {mac}. Nothing was done to it",
            self.address
        )))
    }

    /// Checks again, before an action, that no other program drives the board and that it is still
    /// the same one. Changes nothing on the board.
    pub fn check_free(&self) -> Result<(), Failure> {
        let config = self.patient(UdpConfig::default());
        let link = self.link().map_err(UdpError::from);
        let free = link.and_then(|link| UdpBus::check_free(link, config));
        free.map_err(|error| self.refuses(config.setup_tries, error))?;
        if self.who.get().is_none() || self.simulated.is_some() {
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
        let (said, tries) = (told(&error), Counted::of(tries as usize, "time"));
        let why = match error.kind() {
            _ if matches!(error, UdpError::Foreign { .. }) => {
                format!("no board answers, asked {tries}, but another host does: {said}")
            }
            BusErrorKind::Lost => format!("no board answers, asked {tries}: {said}"),
            _ => said,
        };
        Failure::of(&error, format_args!("{}: {why}", self.address))
    }
}

fn from_environment() -> Result<SocketAddrV4, Failure> {
    let Ok(text) = std::env::var(ADDRESS) else {
        let advice = "Give --addr IP, --sim MACHINE, or the environment variable MESA_ADDR";
        return Err(Failure::usage(format_args!("which board? {advice}")).advising(advice));
    };
    parse_address(&text).map_err(|error| {
        Failure::usage(format_args!("the environment variable {ADDRESS}: {error}"))
    })
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
