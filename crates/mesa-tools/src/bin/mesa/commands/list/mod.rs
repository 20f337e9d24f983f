//! `mesa list`: search for boards on the network.

mod pci;
mod range;
mod why;

use std::fmt::{self, Display};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use mesa_hal::ethernet::{AddressSource, Identity};
use mesa_hal::lbp16;
use mesa_hal::transport::search::{self, AddressResult};
use mesa_tools::diagnosis::network::Network;
use serde::Serialize;

use crate::ui::context::{Context, Ending, Failure};
use crate::ui::output::complain;
use range::{MAX_ADDRESSES, Range};
use why::Why;

/// Timeout of an answer from an address.
const PATIENCE: Duration = Duration::from_millis(200);

const AFTER_HELP: &str = "\
Asks the two factory addresses of boards, 192.168.1.121 and 10.10.10.10, and those given: 1 to 1024
addresses in all, 128 at a time, each for 200 ms. Writes nothing to a board: one that is running is
not disturbed. If no board was found, and for each address that was given by itself, prints the
reason and what to type on this computer.

Exits with 0 if a board was found, with 1 if not.

Examples:
  mesa list 10.10.10.0/24 192.168.1.100-192.168.1.130
  mesa list --pci";

/// Find the boards on the network or on the PCI bus
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct List {
    /// Further addresses: one, a network, or a range
    #[arg(value_name = "IP|IP/BITS|IP-IP")]
    ranges: Vec<Range>,
    /// List the boards on the PCI bus instead, below /sys or below a FOLDER of `mesa sim --pci`.
    /// Nothing of them is accessed
    #[arg(long, value_name = "FOLDER", num_args = 0..=1, default_missing_value = mesa_pci::SYSFS,
        conflicts_with_all = ["ranges", "port"])]
    pci: Option<PathBuf>,
    /// UDP port of the boards, 1 to 65535
    #[arg(long, default_value_t = lbp16::PORT, value_parser = clap::value_parser!(u16).range(1..))]
    port: u16,
    /// Directory that contains this computer's /proc and /sys
    #[arg(long, value_name = "DIRECTORY", default_value = "/", hide = true)]
    root: PathBuf,
}

/// Result of the search.
#[derive(Debug, Serialize)]
struct SearchResult {
    boards: Vec<Board>,
    silent: Vec<Silent>,
    /// The addresses that were given one by one.
    #[serde(skip)]
    named: Vec<Ipv4Addr>,
}

/// A board that answers.
#[derive(Debug, Serialize)]
struct Board {
    address: Ipv4Addr,
    #[serde(flatten)]
    identity: Identity,
}

/// Addresses without a board, for the same reason.
#[derive(Debug, Serialize)]
struct Silent {
    addresses: Vec<Ipv4Addr>,
    reason: String,
    advice: String,
    /// This computer has the address.
    #[serde(skip)]
    is_own: bool,
}

impl List {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        if let Some(root) = &self.pci {
            return pci::run(root, context);
        }
        let addresses = self.addresses()?;
        let network = Network::below(&self.root)?;
        let mut found = SearchResult {
            boards: Vec::new(),
            silent: Vec::new(),
            named: self.named(),
        };
        for batch in addresses.chunks(search::MAX_PARALLEL) {
            if context.stop.signal().is_some() {
                complain("mesa: ended by a signal; not all addresses were asked");
                break;
            }
            for asked in search::ask(batch, PATIENCE)? {
                found.add(asked, &network);
            }
        }
        context.print(&found)?;
        Ok(match context.ending() {
            Ending::Done if found.boards.is_empty() => Ending::Refused,
            ending => ending,
        })
    }

    /// The addresses that were given one by one.
    fn named(&self) -> Vec<Ipv4Addr> {
        let named = self.ranges.iter().filter(|range| range.count() == 1);
        named.flat_map(|range| range.addresses()).collect()
    }

    /// Factory addresses, then the given ones, each once.
    fn addresses(&self) -> Result<Vec<SocketAddrV4>, Failure> {
        let factory = [AddressSource::FIXED, AddressSource::FACTORY_EEPROM].map(Range::from);
        let given: u32 = self.ranges.iter().map(|range| range.count()).sum();
        if given > MAX_ADDRESSES {
            return Err(Failure::usage(format_args!(
                "these are {given} addresses; at most {MAX_ADDRESSES} are asked"
            )));
        }
        let mut addresses: Vec<SocketAddrV4> = Vec::new();
        for ip in factory
            .iter()
            .chain(&self.ranges)
            .flat_map(|range| range.addresses())
        {
            let address = SocketAddrV4::new(ip, self.port);
            if !addresses.contains(&address) {
                addresses.push(address);
            }
        }
        Ok(addresses)
    }
}

impl SearchResult {
    /// The addresses of a group whose reason is of use. Where a board was found, nobody expects one
    /// at all other addresses of a range, or at the factory addresses. That this computer has an
    /// address of a range is no reason to change it.
    fn explained(&self, silent: &Silent) -> Vec<Ipv4Addr> {
        let is_expected = self.boards.is_empty() && !silent.is_own;
        let addresses = silent.addresses.iter().copied();
        addresses
            .filter(|address| is_expected || self.named.contains(address))
            .collect()
    }

    fn add(&mut self, asked: AddressResult, network: &Network) {
        let address = *asked.address.ip();
        let silence = match asked.found {
            Ok(identity) => return self.boards.push(Board { address, identity }),
            Err(silence) => silence,
        };
        let Why {
            reason,
            advice,
            is_own,
        } = why::of(network, address, silence);
        // Addresses with the same reason are kept apart if their advice differs.
        let mut known = self.silent.iter_mut();
        match known.find(|silent| (&silent.reason, &silent.advice) == (&reason, &advice)) {
            Some(silent) => silent.addresses.push(address),
            None => self.silent.push(Silent {
                addresses: vec![address],
                reason,
                advice,
                is_own,
            }),
        }
    }
}

impl Display for SearchResult {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Board { address, identity } in &self.boards {
            writeln!(
                f,
                "{:<15}  {:<8}  MAC {}  firmware {}, LBP {}  IP address {}",
                address.to_string(),
                identity.card,
                identity.mac,
                identity.firmware_version,
                identity.lbp_version,
                identity.address_from.of_card(&identity.card),
            )?;
        }
        if self.boards.is_empty() {
            writeln!(f, "no board answers")?;
        }
        for silent in &self.silent {
            let addresses = match &self.explained(silent)[..] {
                [] => continue,
                addresses => list(addresses),
            };
            writeln!(f, "{addresses:<15}  {}", silent.reason)?;
            writeln!(f, "{:<15}  -> {}", "", silent.advice)?;
        }
        Ok(())
    }
}

/// Formats addresses; consecutive ones as a range.
fn list(addresses: &[Ipv4Addr]) -> String {
    let mut ranges: Vec<(Ipv4Addr, Ipv4Addr)> = Vec::new();
    for &address in addresses {
        match ranges.last_mut() {
            Some((_, last)) if address.to_bits().checked_sub(1) == Some(last.to_bits()) => {
                *last = address;
            }
            _ => ranges.push((address, address)),
        }
    }
    let texts: Vec<String> = ranges
        .into_iter()
        .map(|(first, last)| {
            if first == last {
                first.to_string()
            } else {
                format!("{first}-{last}")
            }
        })
        .collect();
    texts.join(", ")
}
