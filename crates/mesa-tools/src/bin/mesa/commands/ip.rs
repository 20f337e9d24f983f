//! `mesa ip`: the addresses in a board's EEPROM.

use std::fmt::{self, Display};
use std::net::Ipv4Addr;

use clap::Args;
use mesa_hal::ethernet::{AddressSource, EthernetBoard, Identity};
use mesa_tools::diagnosis::network::{Network, NetworkPath};
use serde::Serialize;

use crate::board::bus::Bus;
use crate::board::changed::ChangedTarget;
use crate::board::consent::Plan;
use crate::ui::context::{Context, Ending, Failure};
use mesa_tools::advice::told;

const AFTER_HELP: &str = "\
Without IP and --netmask, prints the addresses and changes nothing. The board uses the address of
its EEPROM from its next start on, if its address jumpers select it.

Example:
  mesa ip 10.10.10.11 --netmask 255.255.255.0 --addr 10.10.10.10";

/// Show or set the IP address and netmask in a board's EEPROM
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Ip {
    #[command(flatten)]
    target: ChangedTarget,
    /// New address, valid for a single host
    #[arg(value_name = "IP")]
    address: Option<Ipv4Addr>,
    /// New netmask, 255.0.0.0 to 255.255.255.252. Needs firmware 16 or later
    #[arg(long, value_parser = parse_netmask)]
    netmask: Option<Ipv4Addr>,
}

/// Addresses in the EEPROM, or planned ones.
#[derive(Debug, Serialize)]
struct Addresses {
    board: String,
    /// Source of the board's address at start.
    address_from: AddressSource,
    eeprom_ip: Ipv4Addr,
    /// `None` if the firmware does not support it.
    eeprom_netmask: Option<Ipv4Addr>,
    /// True if the EEPROM was written.
    changed: bool,
    dry_run: bool,
    /// Remaining steps.
    next: Vec<String>,
}

impl Ip {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find(context)?;
        let own = *found.need_ethernet("an IP address")?.ip();
        let mut bus = found.open()?;
        let mut board = EthernetBoard::new(&mut bus);
        let before = board.identity()?;
        let netmask = self
            .netmask
            .filter(|&mask| before.eeprom_netmask != Some(mask));
        let ip = self.address.filter(|&ip| before.eeprom_ip != ip);
        let after = Identity {
            eeprom_ip: ip.unwrap_or(before.eeprom_ip),
            eeprom_netmask: netmask.or(before.eeprom_netmask),
            ..before.clone()
        };
        let is_change = ip.is_some() || netmask.is_some();
        if is_change || self.address.is_some() {
            check(after.eeprom_ip, after.eeprom_netmask).map_err(Failure::usage)?;
        }
        if self.netmask.is_some() && before.eeprom_netmask.is_none() {
            return Err(Failure::refused(format_args!(
                "{}: firmware {} has no netmask (16 and later have one); leave --netmask out",
                found.address, before.firmware_version
            )));
        }
        if is_change && !self.target.dry_run {
            let (new, old) = (pair(&after), pair(&before));
            let plan = Plan::at(
                found.address,
                format_args!("write {new} into the EEPROM, which holds {old}"),
            );
            self.target
                .asks
                .consent_to_change(context, &plan, Some(&found))?;
            write(&mut board, ip, netmask)?;
        }
        let shown = if self.target.dry_run {
            after
        } else {
            board.identity()?
        };
        context.print(&Addresses {
            next: next(&shown, own, is_change),
            board: shown.card,
            address_from: shown.address_from,
            eeprom_ip: shown.eeprom_ip,
            eeprom_netmask: shown.eeprom_netmask,
            changed: is_change && !self.target.dry_run,
            dry_run: self.target.dry_run,
        })?;
        Ok(context.ending())
    }
}

/// Writes the netmask, then the address: until that is written, the board stays at its old one.
fn write(
    board: &mut EthernetBoard<'_, Bus>,
    ip: Option<Ipv4Addr>,
    netmask: Option<Ipv4Addr>,
) -> Result<(), Failure> {
    if let Some(netmask) = netmask {
        board.set_eeprom_netmask(netmask)?;
    }
    let Some(ip) = ip else {
        return Ok(());
    };
    board.set_eeprom_ip(ip).map_err(|error| {
        let mask = netmask.map_or("", |_| "the netmask is written; ");
        let how = "`mesa ip` shows whether the address is";
        let error = told(&error);
        Failure::refused(format_args!("{error}; {mask}{how}"))
    })
}

/// Steps that remain until the board uses the address of its EEPROM.
fn next(board: &Identity, now: Ipv4Addr, is_change: bool) -> Vec<String> {
    let mut next = Vec::new();
    if board.address_from != AddressSource::Eeprom {
        next.push(format!(
            "its address is {}: set the address jumpers to {}, or the EEPROM's is not used",
            board.address_from.of_card(&board.card),
            AddressSource::Eeprom.of_card(&board.card)
        ));
    }
    if board.eeprom_ip == now && !is_change {
        return next;
    }
    next.push(format!(
        "restart it: `mesa reset --addr {now}`, or switch it off and on; then it is at --addr {}",
        board.eeprom_ip
    ));
    let mask = board
        .eeprom_netmask
        .unwrap_or(Ipv4Addr::new(255, 255, 255, 0));
    let is_beside = |here: Network| matches!(here.way_to(board.eeprom_ip), NetworkPath::Direct(_));
    if Network::here().is_ok_and(is_beside) {
        return next;
    }
    let network = board.eeprom_ip & mask;
    let host = [1, 2].map(|host| Ipv4Addr::from_bits(network.to_bits() | host));
    let [first, second] = host;
    let host = if first == board.eeprom_ip {
        second
    } else {
        first
    };
    next.push(format!(
        "the computer needs an address in the same network: `sudo ip addr add {host}/{} dev INTERFACE`",
        mask.to_bits().count_ones()
    ));
    next
}

fn pair(board: &Identity) -> String {
    match board.eeprom_netmask {
        Some(netmask) => format!("{} with netmask {netmask}", board.eeprom_ip),
        None => board.eeprom_ip.to_string(),
    }
}

/// Checks that a board can have an address.
fn check(ip: Ipv4Addr, netmask: Option<Ipv4Addr>) -> Result<(), String> {
    if ip.is_unspecified() || ip.is_broadcast() || ip.is_multicast() || ip.is_loopback() {
        return Err(format!("{ip} is no address of a single host on a network"));
    }
    let Some(netmask) = netmask else {
        return Ok(());
    };
    let host = ip.to_bits() & !netmask.to_bits();
    if host == 0 || host == !netmask.to_bits() {
        return Err(format!(
            "{ip} is the network itself, or its broadcast address, with netmask {netmask}; give --netmask \
             too, or another address"
        ));
    }
    Ok(())
}

fn parse_netmask(text: &str) -> Result<Ipv4Addr, String> {
    let mask = text.parse::<Ipv4Addr>().ok();
    let is_sound = |mask: &Ipv4Addr| {
        let bits = mask.to_bits();
        bits.leading_ones() + bits.trailing_zeros() == 32 && (8..=30).contains(&bits.leading_ones())
    };
    mask.filter(is_sound)
        .ok_or_else(|| format!("`{text}` is no netmask from 255.0.0.0 to 255.255.255.252"))
}

impl Display for Addresses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.dry_run {
            writeln!(f, "Planned; nothing was done:")?;
        }
        writeln!(f, "jumpers   {}", self.address_from.of_card(&self.board))?;
        writeln!(f, "EEPROM    {}", self.eeprom_ip)?;
        match self.eeprom_netmask {
            Some(netmask) => writeln!(f, "netmask   {netmask}")?,
            None => writeln!(f, "netmask   none before firmware 16")?,
        }
        for next in &self.next {
            writeln!(f, "- {next}")?;
        }
        Ok(())
    }
}
