//! The route that packets of this computer take to an address, from the files of Linux.

use core::cmp::Reverse;
use core::fmt;
use std::fs;
use std::io;
use std::net::Ipv4Addr;
use std::path::Path;

/// The network interfaces of this computer and its routes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Network {
    /// Sorted by name.
    pub interfaces: Vec<Interface>,
    /// In the order of the kernel's list.
    pub routes: Vec<Route>,
    /// The computer's own addresses, each with its mask: all bits set, except for loopbacks.
    /// Source: `/proc/net/fib_trie`.
    pub own: Vec<(Ipv4Addr, Ipv4Addr)>,
}

/// A network interface. Source: `/sys/class/net`.
#[derive(Clone, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
pub struct Interface {
    /// Its name, e.g. `eth0`.
    pub name: String,
    /// Carries Ethernet frames; a loopback does not.
    pub is_ethernet: bool,
    /// Backed by a device, not only by a program or kernel module.
    pub is_device: bool,
    /// A wireless interface.
    pub is_wireless: bool,
    /// Switched on.
    pub is_up: bool,
    /// The cable leads to a device that is switched on.
    pub has_link: bool,
}

/// A route of the main table. Source: `/proc/net/route`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route {
    /// The outgoing interface; `*` for a route that discards packets.
    pub interface: String,
    /// The destination network.
    pub network: Ipv4Addr,
    /// Its netmask.
    pub mask: Ipv4Addr,
    /// The router that forwards the packets; unspecified where none is needed.
    pub gateway: Ipv4Addr,
    /// Of two equal routes, the one with the smaller metric is taken.
    pub metric: u32,
}

/// The way to an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NetworkPath<'a> {
    /// The address is this computer's own.
    Here,
    /// Through an interface in the same network: the only way that boards are meant for.
    Direct(&'a Route),
    /// Through a gateway.
    Gateway(&'a Route),
    /// Packets to this address are discarded: the route is of type `unreachable`, `prohibit`,
    /// `blackhole` or `throw`.
    Discarded(&'a Route),
    /// No route exists.
    None,
}

impl Network {
    /// The current network of this computer.
    ///
    /// # Errors
    /// `/proc/net/route` or `/sys/class/net` cannot be read: not a Linux system.
    pub fn here() -> io::Result<Self> {
        Self::below(Path::new("/"))
    }

    /// The network of a computer whose files are below the directory `root`.
    ///
    /// # Errors
    /// As [`here`](Self::here).
    pub fn below(root: &Path) -> io::Result<Self> {
        let mut interfaces = fs::read_dir(root.join("sys/class/net"))?
            .filter_map(Result::ok)
            .filter_map(|entry| Interface::read(&entry.path()))
            .collect::<Vec<_>>();
        interfaces.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(Self {
            interfaces,
            routes: Route::parse(&fs::read_to_string(root.join("proc/net/route"))?),
            own: fs::read_to_string(root.join("proc/net/fib_trie"))
                .map(|text| own(&text))
                .unwrap_or_default(),
        })
    }

    /// The interface with this name.
    pub fn interface(&self, name: &str) -> Option<&Interface> {
        self.interfaces.iter().find(|one| one.name == name)
    }

    /// The way to an address: the narrowest route is taken, and of equal ones the one with the
    /// lowest metric.
    pub fn way_to(&self, address: Ipv4Addr) -> NetworkPath<'_> {
        let mut own = self.own.iter();
        if address.is_loopback() || own.any(|(own, mask)| address & mask == *own) {
            return NetworkPath::Here;
        }
        let routes = self.routes.iter().filter(|route| route.leads_to(address));
        let best = routes.max_by_key(|route| (route.mask.to_bits(), Reverse(route.metric)));
        match best {
            None => NetworkPath::None,
            Some(route) if route.discards() => NetworkPath::Discarded(route),
            Some(route) if route.gateway.is_unspecified() => NetworkPath::Direct(route),
            Some(route) => NetworkPath::Gateway(route),
        }
    }

    /// The wired interfaces that carry no other network, so that a board may be plugged into them:
    /// those with a link first, then those that are down, whose link is not known, then those
    /// without a link.
    pub fn free(&self) -> Vec<&Interface> {
        let wired = |one: &&Interface| one.is_ethernet && !one.is_wireless;
        // In a container, no interface has a device.
        let has_device = self
            .interfaces
            .iter()
            .filter(wired)
            .any(|one| one.is_device);
        let all = self.interfaces.iter().filter(wired);
        let all = all.filter(|one| one.is_device || !has_device);
        let mut free: Vec<_> = all.filter(|one| !self.is_used(one)).collect();
        free.sort_by_key(|one| (!one.has_link, one.is_up, &one.name));
        free
    }

    /// True if an interface with a link leads to a network.
    fn is_used(&self, interface: &Interface) -> bool {
        let mut routes = self.routes.iter();
        interface.has_link && routes.any(|route| route.interface == interface.name)
    }
}

/// `ARPHRD_ETHER` and `IFF_UP` of the kernel.
const ETHERNET: u32 = 1;
const UP: u32 = 1;

impl Interface {
    fn read(directory: &Path) -> Option<Self> {
        let text = |name: &str| fs::read_to_string(directory.join(name)).ok();
        let number = |name: &str| {
            let text = text(name)?;
            let text = text.trim();
            match text.strip_prefix("0x") {
                Some(hex) => u32::from_str_radix(hex, 16).ok(),
                None => text.parse().ok(),
            }
        };
        Some(Self {
            name: directory.file_name()?.to_str()?.to_owned(),
            is_ethernet: number("type") == Some(ETHERNET),
            is_device: directory.join("device").exists(),
            is_wireless: directory.join("wireless").exists(),
            is_up: number("flags").is_some_and(|flags| flags & UP != 0),
            // Cannot be read while the interface is down.
            has_link: number("carrier") == Some(1),
        })
    }
}

impl Route {
    /// The routes of a text like `/proc/net/route`, without the lines that cannot be parsed.
    pub fn parse(text: &str) -> Vec<Self> {
        text.lines().skip(1).filter_map(Self::parse_line).collect()
    }

    fn parse_line(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let interface = words.next()?.to_owned();
        // In the byte order of the host's memory.
        let address = |word: &str| {
            let bits = u32::from_str_radix(word, 16).ok()?;
            Some(Ipv4Addr::from(bits.to_ne_bytes()))
        };
        let network = address(words.next()?)?;
        let gateway = address(words.next()?)?;
        // Flags, reference count, use.
        let metric = words.nth(3)?.parse().ok()?;
        let mask = address(words.next()?)?;
        Some(Self {
            interface,
            network,
            mask,
            gateway,
            metric,
        })
    }

    /// True if the route covers `address`.
    pub fn leads_to(&self, address: Ipv4Addr) -> bool {
        address & self.mask == self.network
    }

    /// True if the route discards its packets.
    pub fn discards(&self) -> bool {
        self.interface == "*"
    }

    /// True if the route covers every address.
    pub fn is_default(&self) -> bool {
        self.mask.is_unspecified()
    }
}

/// The destination network: `10.10.10.0/24`.
impl fmt::Display for Route {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.network, self.mask.to_bits().count_ones())
    }
}

/// The addresses of type LOCAL of a text like `/proc/net/fib_trie`, without the lines that cannot
/// be parsed. The file lists each of them twice.
fn own(text: &str) -> Vec<(Ipv4Addr, Ipv4Addr)> {
    let mut all = Vec::new();
    let mut leaf = None;
    for line in text.lines().map(str::trim) {
        if let Some(address) = line.strip_prefix("|-- ") {
            leaf = address.parse::<Ipv4Addr>().ok();
        } else if let Some(bits) = line.strip_suffix(" host LOCAL")
            && let Some(bits) = bits.strip_prefix('/').and_then(|bits| bits.parse().ok())
            && let Some(address) = leaf
        {
            let mask = Ipv4Addr::from_bits(!u32::MAX.checked_shr(bits).unwrap_or(0));
            if !all.contains(&(address, mask)) {
                all.push((address, mask));
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROUTES: &str = "\
Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT
eth0\t00000000\t010200C0\t0003\t0\t0\t100\t00000000\t0\t0\t0
eth0\t000200C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0
eth1\t000A0A0A\t00000000\t0001\t0\t0\t50\t00FFFFFF\t0\t0\t0
eth2\t000A0A0A\t00000000\t0001\t0\t0\t20\t00FFFFFF\t0\t0\t0
*\t0000600A\t00000000\t0001\t0\t0\t0\t0000FFFF\t0\t0\t0
*\t0100610A\t00000000\t0205\t0\t0\t0\tFFFFFFFF\t0\t0\t0
*\t0000620A\t00000000\t0201\t0\t0\t0\t00FFFFFF\t0\t0\t0
*\t0000630A\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0
nonsense
";

    /// Excerpt of `/proc/net/fib_trie`. The last four of the routes above are those of `ip route
    /// add throw 10.96.0.0/16`, `prohibit 10.97.0.1`, `unreachable 10.98.0.0/24` and `blackhole
    /// 10.99.0.0/24`, as Linux 6 shows them.
    const ADDRESSES: &str = "\
Main:
  +-- 0.0.0.0/0 3 0 5
     +-- 10.96.0.0/14 3 0 4
        |-- 10.99.0.0
           /24 universe BLACKHOLE
     +-- 127.0.0.0/8 2 0 2
        +-- 127.0.0.0/31 1 0 0
           |-- 127.0.0.0
              /8 host LOCAL
           |-- 127.0.0.1
              /32 host LOCAL
        |-- 127.255.255.255
           /32 link BROADCAST
     +-- 192.0.2.0/24 2 0 2
        +-- 192.0.2.0/30 2 0 2
           |-- 192.0.2.0
              /24 link UNICAST
           |-- 192.0.2.2
              /32 host LOCAL
        |-- 192.0.2.255
           /32 link BROADCAST
Local:
  +-- 0.0.0.0/0 3 0 5
     +-- 192.0.2.0/24 2 0 2
        +-- 192.0.2.0/30 2 0 2
           |-- 192.0.2.2
              /32 host LOCAL
";

    fn interface(name: &str, is_up: bool) -> Interface {
        Interface {
            name: name.to_owned(),
            is_ethernet: name != "lo",
            is_device: name != "lo",
            is_wireless: name.starts_with('w'),
            is_up,
            has_link: is_up,
        }
    }

    fn network() -> Network {
        Network {
            interfaces: vec![
                interface("eth0", true),
                interface("eth1", true),
                interface("eth2", false),
                interface("lo", true),
                interface("wlan0", true),
            ],
            routes: Route::parse(if cfg!(target_endian = "little") {
                ROUTES
            } else {
                ""
            }),
            own: own(ADDRESSES),
        }
    }

    #[test]
    fn narrowest_route_counts_and_then_the_metric() {
        let network = network();
        assert_eq!(network.routes.len(), 8);
        let way = |a, b, c, d| network.way_to(Ipv4Addr::new(a, b, c, d));
        assert_eq!(way(127, 1, 2, 3), NetworkPath::Here);
        let NetworkPath::Gateway(route) = way(192, 168, 1, 121) else {
            panic!("through the gateway");
        };
        assert_eq!(route.gateway, Ipv4Addr::new(192, 0, 2, 1));
        assert!(
            matches!(way(192, 0, 2, 9), NetworkPath::Direct(route) if route.interface == "eth0")
        );
        assert!(
            matches!(way(10, 10, 10, 10), NetworkPath::Direct(route) if route.interface == "eth2")
        );
        for discarded in [
            way(10, 96, 200, 1),
            way(10, 97, 0, 1),
            way(10, 98, 0, 9),
            way(10, 99, 0, 9),
        ] {
            assert!(
                matches!(discarded, NetworkPath::Discarded(_)),
                "{discarded:?}"
            );
        }
        assert!(matches!(way(10, 97, 0, 2), NetworkPath::Gateway(_)));
        assert_eq!(way(192, 0, 2, 2), NetworkPath::Here);
        assert_eq!(
            Network::default().way_to(Ipv4Addr::new(10, 0, 0, 1)),
            NetworkPath::None
        );
    }

    #[test]
    fn interface_with_another_network_is_not_free_for_a_board() {
        let mut network = network();
        let names = |network: &Network| -> Vec<_> {
            let free = network.free();
            free.iter().map(|one| one.name.clone()).collect()
        };
        // Of eth0 and eth1 with their networks, and eth2, which is down.
        assert_eq!(names(&network), ["eth2"]);
        network.interfaces.push(interface("eth3", true));
        assert_eq!(names(&network), ["eth3", "eth2"]);
        // A cable that is not plugged in leads nowhere, whatever the routes.
        network.interfaces[0].has_link = false;
        assert_eq!(names(&network), ["eth3", "eth2", "eth0"]);
        network.interfaces.retain(|one| one.name == "lo");
        assert!(network.free().is_empty());
    }

    #[test]
    fn this_computer_has_a_loopback() {
        let network = Network::here().unwrap();
        let own = Ipv4Addr::LOCALHOST;
        assert!(
            network.own.contains(&(own, Ipv4Addr::BROADCAST)),
            "{network:?}"
        );
        let loopback = network.interface("lo").expect("a loopback");
        assert!(!loopback.is_ethernet && !loopback.is_wireless);
    }
}
