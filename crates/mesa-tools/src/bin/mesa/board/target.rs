//! Target board of a command.

use std::cell::{Cell, OnceCell};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

use clap::Args;
use mesa_hal::bus::{BusError, BusErrorKind, LinkError};
use mesa_hal::ethernet::{EthernetBoard, EthernetError, Identity};
use mesa_hal::lbp16::{self, Space, registers::eeprom};
use mesa_hal::transport::search::{self, AddressResult};
use mesa_hal::transport::udp::{UdpBus, UdpConfig, UdpLink};
use mesa_hal::{MesaError, Rounded, Settings};

use crate::board::address::{BoardAddress, PciPlace};
use crate::board::bus::Bus;
use crate::board::link::{BoardLink, SocketLink};
use crate::board::look::LookBus;
use crate::machine::built::Machine;
use crate::machine::description::Description;
use crate::machine::embedded::{Passage, Simulated};
use crate::ui::context::{Context, Failure};
use crate::ui::hurry::Hurry;
use mesa_pci::{PciDevice, PciOpenError};
use mesa_tools::Counted;
use mesa_tools::advice::told;
use mesa_tools::advice::with_advice;

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

/// Target board of a command: one on the network or on the PCI bus, or an embedded simulated one.
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
    sim: Option<Description>,
    /// A board on the PCI bus (5I25, 6I25): its address, as `mesa list --pci` prints it; without
    /// one the only board. With a folder in place of /sys (or FOLDER/ADDRESS), a board that `mesa
    /// sim --pci FOLDER` simulates
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "",
        conflicts_with_all = ["addr", "sim"])]
    pci: Option<PciPlace>,
}

/// Address of the target board, and the simulated machine behind it, if any.
#[derive(Debug)]
pub struct Found {
    /// Address of the board.
    pub address: BoardAddress,
    /// The board in sysfs, if it is on the PCI bus.
    device: Option<PciDevice>,
    /// The first board that answered at the address.
    who: OnceCell<Identity>,
    /// The end of the command by a signal.
    hurry: Hurry,
    /// That board said of itself that it is simulated.
    says_simulated: Cell<bool>,
    /// Simulated machine in place of a board.
    simulated: Option<Simulated>,
}

impl Target {
    /// Determines the address of the board; builds the simulated machine if that is the board.
    pub fn find(&self, context: &Context) -> Result<Found, Failure> {
        let hurry = context.hurry.clone();
        if let Some(place) = &self.pci {
            let device = find_on_pci(place)?;
            let address = BoardAddress::Pci(device.address());
            return Ok(Found::new(address, hurry, Some(device), None));
        }
        let (address, simulated) = match (&self.sim, self.addr) {
            (Some(described), _) => {
                let machine = Machine::new(described).map_err(Failure::refused)?;
                let address = if described.board.is_on_pci {
                    BoardAddress::Embedded
                } else {
                    SocketAddrV4::new(Ipv4Addr::LOCALHOST, lbp16::PORT).into()
                };
                (address, Some(Simulated::new(machine.board)))
            }
            (None, Some(address)) => (address.into(), None),
            (None, None) => (from_environment()?.into(), None),
        };
        Ok(Found::new(address, hurry, None, simulated))
    }
}

/// The board at a place on the PCI bus.
fn find_on_pci(place: &PciPlace) -> Result<PciDevice, Failure> {
    let root = place.root.display();
    if let Some(address) = place.address {
        return PciDevice::at(&place.root, address).map_err(|error| not_opened(&error));
    }
    let found = mesa_pci::search(&place.root)
        .map_err(|error| Failure::refused(format_args!("{root}: {error}")))?;
    match &found[..] {
        [device] => Ok(device.clone()),
        [] => {
            let advice = "`lspci -D -d 2718:` lists Mesa's boards; one that is missing there is not seated or \
                          has no power";
            let what = format_args!("no board of Mesa's on the PCI bus below {root}; {advice}");
            Err(Failure::refused(what).advising(advice))
        }
        several => {
            let all = several.iter();
            let all = all.map(|device| format!("{} ({})", device.address(), device.board().name));
            let all: Vec<_> = all.collect();
            let what = format_args!("which board? There are {}", all.join(", "));
            Err(Failure::usage(what).advising("give --pci ADDRESS"))
        }
    }
}

/// A board on the PCI bus is refused, with the advice.
fn not_opened(error: &PciOpenError) -> Failure {
    Failure::of(error, told(error))
}

impl Found {
    fn new(
        address: BoardAddress,
        hurry: Hurry,
        device: Option<PciDevice>,
        simulated: Option<Simulated>,
    ) -> Self {
        Self {
            address,
            device,
            who: OnceCell::new(),
            hurry,
            says_simulated: Cell::new(false),
            simulated,
        }
    }

    /// The board in sysfs, if it is on the PCI bus.
    pub const fn on_pci(&self) -> Option<&PciDevice> {
        self.device.as_ref()
    }

    /// Fails for a board on the PCI bus: the command is for the Ethernet side of a board.
    pub fn need_ethernet(&self, what: &str) -> Result<SocketAddrV4, Failure> {
        self.address.on_ethernet().ok_or_else(|| {
            Failure::refused(format_args!(
                "{}: {what} is for boards on Ethernet; this one is on the PCI bus",
                self.address
            ))
        })
    }

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

    /// The same board at another IP address; `None` for an embedded simulated one, which has none,
    /// and on the PCI bus.
    pub fn moved_to(&self, ip: Ipv4Addr) -> Option<Self> {
        let address = self.address.on_ethernet()?;
        let is_real = self.simulated.is_none();
        is_real.then(|| Self {
            who: self.who.clone(),
            says_simulated: self.says_simulated.clone(),
            ..Self::new(
                SocketAddrV4::new(ip, address.port()).into(),
                self.hurry.clone(),
                None,
                None,
            )
        })
    }

    /// A link to a board on Ethernet. Nothing is sent.
    pub fn link(&self) -> Result<BoardLink, Failure> {
        let address = self.need_ethernet("this command")?;
        Ok(self.link_to(address)?)
    }

    fn link_to(&self, address: SocketAddrV4) -> Result<BoardLink, LinkError> {
        if let Some(simulated) = &self.simulated {
            return Ok(BoardLink::Simulated(simulated.link()));
        }
        let socket = UdpLink::connect(address)?;
        let link = SocketLink::new(socket, self.hurry.clone());
        Ok(BoardLink::Socket(link))
    }

    /// A bus for a look at the board beside a program that drives it. Nothing is sent.
    pub fn look(&self) -> Result<LookBus, Failure> {
        let address = self.need_ethernet("a look beside a program that drives the board")?;
        let deadline = if self.is_on_this_host() {
            ON_THIS_HOST
        } else {
            LOOK
        };
        Ok(LookBus::new(self.link_to(address)?, deadline))
    }

    /// Opens the bus of the board. Fails if another program drives the board, which is not
    /// disturbed.
    pub fn open(&self) -> Result<Bus, Failure> {
        self.open_with(UdpConfig::default())
    }

    /// As [`open`](Self::open), with the deadlines of `config`; longer ones if the board is a
    /// program on this host.
    pub fn open_with(&self, config: UdpConfig) -> Result<Bus, Failure> {
        match (self.address, &self.device, &self.simulated) {
            (BoardAddress::Ethernet(address), ..) => self.open_on_ethernet(address, config),
            (_, Some(device), _) => {
                let bus = device.open().map_err(|error| not_opened(&error))?;
                Ok(Bus::Pci(bus.into()))
            }
            (_, None, Some(simulated)) => Ok(Bus::Embedded(simulated.on_pci())),
            (_, None, None) => Err(Failure::refused("no board")),
        }
    }

    fn open_on_ethernet(&self, address: SocketAddrV4, config: UdpConfig) -> Result<Bus, Failure> {
        let patient = self.patient(config);
        let mut bus = self.bus_to(address, patient)?;
        let mut board = EthernetBoard::new(&mut bus);
        self.check_same(board.identity()?)?;
        self.says_simulated.set(says_simulated(&mut board)?);
        if !self.is_simulated() && patient.cycle_deadline != config.cycle_deadline {
            // A real board behind a relay on this host: its cycle does not wait for that long.
            let setup_deadline = patient.setup_deadline;
            drop(bus);
            bus = self.bus_to(
                address,
                UdpConfig {
                    setup_deadline,
                    ..config
                },
            )?;
        }
        Ok(Bus::Ethernet(bus.into()))
    }

    fn bus_to(
        &self,
        address: SocketAddrV4,
        config: UdpConfig,
    ) -> Result<UdpBus<BoardLink>, Failure> {
        let link = self.link_to(address).map_err(BusError::from);
        let bus = link.and_then(|link| UdpBus::new(link, config));
        bus.map_err(|error| self.refuses(config.setup_tries, error))
    }

    /// True if the board is simulated, by what itself says; the address is no evidence, as a relay
    /// makes a real board answer anywhere. False on Ethernet until the board was opened.
    fn is_simulated(&self) -> bool {
        let on_pci = self.device.as_ref().is_some_and(PciDevice::is_simulated);
        self.simulated.is_some() || on_pci || self.says_simulated.get()
    }

    /// True if what answers is a program on this host: a simulated board, or a relay.
    fn is_on_this_host(&self) -> bool {
        match (self.address.ip(), &self.device) {
            (Some(ip), _) => ip.is_loopback(),
            (None, Some(device)) => device.is_simulated(),
            (None, None) => true,
        }
    }

    fn patient(&self, mut config: UdpConfig) -> UdpConfig {
        if self.is_on_this_host() {
            config.setup_deadline = config.setup_deadline.max(ON_THIS_HOST);
            config.cycle_deadline = config.cycle_deadline.max(ON_THIS_HOST);
        }
        config
    }

    /// Lengthens the times in `settings` after which a simulated board and its inputs are given up.
    /// Call it after the board was opened: until then, one on Ethernet counts as real.
    pub fn with_patience(&self, mut settings: Settings) -> Settings {
        if self.is_simulated() {
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
        // The lock of a board on the PCI bus is taken when it is opened.
        let Some(address) = self.address.on_ethernet() else {
            return Ok(());
        };
        let config = self.patient(UdpConfig::default());
        let link = self.link_to(address).map_err(BusError::from);
        let free = link.and_then(|link| UdpBus::check_free(link, config));
        free.map_err(|error| self.refuses(config.setup_tries, error))?;
        if self.who.get().is_none() || self.simulated.is_some() {
            return Ok(());
        }
        // Without opening a bus, which would clear counters that another program relies on.
        for _ in 0..config.setup_tries {
            let asked = search::ask(&[address], AGAIN)?;
            if let Some(AddressResult { found: Ok(is), .. }) = asked.into_iter().next() {
                return self.check_same(is);
            }
        }
        Err(Failure::refused(format_args!(
            "{address}: no board answers any more; nothing was done"
        )))
    }

    fn refuses(&self, tries: u32, error: BusError) -> Failure {
        let (said, tries) = (told(&error), Counted::of(tries as usize, "time"));
        let why = match error.kind() {
            _ if matches!(error, BusError::Foreign { .. }) => {
                format!("no board answers, asked {tries}, but another host does: {said}")
            }
            BusErrorKind::Lost if let BusError::GaveUp { tries, within, .. } = &error => {
                let tries = Counted::of(*tries as usize, "time");
                let facts = format!("no board answers, asked {tries} within {}", Rounded(within));
                with_advice(facts, error.advice())
            }
            BusErrorKind::Lost => format!("no board answers, asked {tries}: {said}"),
            _ => said,
        };
        Failure::of(&error, format_args!("{}: {why}", self.address))
    }
}

/// True if the board has the mark of a simulated one. A board that refuses the access has not.
fn says_simulated(board: &mut EthernetBoard<'_, UdpBus<BoardLink>>) -> Result<bool, EthernetError> {
    let mark = eeprom::SIMULATED_MARK.map(u32::from);
    let count = mark.len() as u16;
    match board.peek(Space::Eeprom, eeprom::SIMULATED, count) {
        Ok(words) => Ok(words == mark),
        Err(EthernetError::NoRegister { .. }) => Ok(false),
        Err(error) => Err(error),
    }
}

fn from_environment() -> Result<SocketAddrV4, Failure> {
    let Ok(text) = std::env::var(ADDRESS) else {
        let advice = "Give --addr IP, --pci, --sim MACHINE, or the environment variable MESA_ADDR";
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

#[cfg(test)]
mod tests;
