//! IPv4 addresses on the command line: one, a network, or a range.

use std::net::Ipv4Addr;
use std::str::FromStr;

/// Maximum number of addresses in a search.
pub const MAX_ADDRESSES: u32 = 1024;

/// Consecutive addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    first: u32,
    last: u32,
}

impl Range {
    /// Number of addresses.
    pub fn count(self) -> u32 {
        self.last - self.first + 1
    }

    /// All addresses of the range.
    pub fn addresses(self) -> impl Iterator<Item = Ipv4Addr> {
        (self.first..=self.last).map(Ipv4Addr::from_bits)
    }
}

impl From<Ipv4Addr> for Range {
    fn from(address: Ipv4Addr) -> Self {
        let (first, last) = (address.to_bits(), address.to_bits());
        Self { first, last }
    }
}

impl FromStr for Range {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("`{text}`: expected IP, IP/BITS or IP-IP, as 10.10.10.0/24");
        let ip = |text: &str| text.trim().parse::<Ipv4Addr>().map_err(|_| form());
        let range = if let Some((network, bits)) = text.split_once('/') {
            let bits = bits.parse().ok().filter(|bits| (0..=32).contains(bits));
            of_network(ip(network)?, bits.ok_or_else(form)?)
        } else if let Some((first, last)) = text.split_once('-') {
            let (first, last) = (ip(first)?.to_bits(), ip(last)?.to_bits());
            if last < first {
                return Err(format!("`{text}` begins behind its end"));
            }
            Self { first, last }
        } else {
            ip(text)?.into()
        };
        match range.last - range.first {
            0..MAX_ADDRESSES => Ok(range),
            more => Err(format!(
                "`{text}` has {} addresses; at most {MAX_ADDRESSES} are asked",
                u64::from(more) + 1
            )),
        }
    }
}

/// Hosts of a network: all of its addresses except its own and the broadcast address. With 31 or 32
/// bits, all of its addresses.
fn of_network(address: Ipv4Addr, bits: u32) -> Range {
    let hosts = u32::MAX.checked_shr(bits).unwrap_or(0);
    let (first, last) = (address.to_bits() & !hosts, address.to_bits() | hosts);
    if bits >= 31 {
        return Range { first, last };
    }
    Range {
        first: first + 1,
        last: last - 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends(text: &str) -> Result<(String, String, u32), String> {
        let range: Range = text.parse()?;
        let [first, last] = [range.first, range.last].map(|ip| Ipv4Addr::from_bits(ip).to_string());
        Ok((first, last, range.count()))
    }

    #[test]
    fn addresses_networks_and_ranges_are_understood() {
        for (text, first, last, count) in [
            ("10.10.10.10", "10.10.10.10", "10.10.10.10", 1),
            ("10.10.10.77/24", "10.10.10.1", "10.10.10.254", 254),
            ("10.0.0.0/22", "10.0.0.1", "10.0.3.254", 1022),
            ("10.0.0.4/31", "10.0.0.4", "10.0.0.5", 2),
            ("10.0.0.4/32", "10.0.0.4", "10.0.0.4", 1),
            ("10.0.0.9-10.0.0.11", "10.0.0.9", "10.0.0.11", 3),
            ("0.0.0.0-0.0.3.255", "0.0.0.0", "0.0.3.255", 1024),
        ] {
            assert_eq!(ends(text), Ok((first.into(), last.into(), count)), "{text}");
        }
    }

    #[test]
    fn invalid_or_too_large_ranges_are_refused_with_the_reason() {
        for (text, said) in [
            ("board", "expected IP"),
            ("10.0.0.1/33", "expected IP"),
            ("10.0.0.1/-1", "expected IP"),
            ("10.0.0.1-", "expected IP"),
            ("10.0.0.2-10.0.0.1", "begins behind its end"),
            ("10.0.0.0/21", "has 2046 addresses; at most 1024"),
            ("0.0.0.0/0", "at most 1024"),
            ("0.0.0.0-255.255.255.255", "4294967296 addresses"),
        ] {
            let error = ends(text).unwrap_err();
            assert!(error.contains(said), "{text}: {error}");
        }
    }
}
