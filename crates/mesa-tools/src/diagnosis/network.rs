//! Reachability of a board over the network.

use core::net::Ipv4Addr;

use super::{FigureVerdict, Finding};

pub use super::routes::{Interface, Network, NetworkPath, Route};

const CHECK: &str = "network route";

/// Judges the route to `address`, and the state of its interface.
pub fn way(network: &Network, address: Ipv4Addr) -> Finding {
    let bad =
        |figure: String, advice: String| Finding::new(FigureVerdict::Bad, CHECK, figure, advice);
    match network.way_to(address) {
        NetworkPath::Here => Finding::good(CHECK, format!("{address} is this computer")),
        NetworkPath::None => bad(
            format!("none to {address}"),
            outside(network, address).told(),
        ),
        NetworkPath::Discarded(route) => bad(
            format!("a route of this computer discards what is sent to {address}"),
            format!("`sudo ip route del {route}`"),
        ),
        NetworkPath::Gateway(route) => Finding::new(
            FigureVerdict::Look,
            CHECK,
            format!(
                "{address} is in no network of this computer, but behind {}",
                route.gateway
            ),
            format!(
                "boards are made for a direct cable: {}",
                outside(network, address).told()
            ),
        ),
        NetworkPath::Direct(route) => direct(network, route),
    }
}

/// Returns the interface of the route to an address.
pub fn interface(network: &Network, address: Ipv4Addr) -> Option<&str> {
    match network.way_to(address) {
        NetworkPath::Direct(route) | NetworkPath::Gateway(route) => Some(&route.interface),
        NetworkPath::Here | NetworkPath::Discarded(_) | NetworkPath::None => None,
    }
}

/// Judges a route to a network of this computer, and the state of its interface.
fn direct(network: &Network, route: &Route) -> Finding {
    let bad =
        |figure: String, advice: String| Finding::new(FigureVerdict::Bad, CHECK, figure, advice);
    let name = &route.interface;
    let figure = format!("{name}, {route}");
    let is_default = |one: &Route| one.is_default() && one.interface == *name;
    match network.interface(name) {
        Some(Interface { is_up: false, .. }) => {
            let advice = format!("`sudo ip link set {name} up`");
            bad(format!("{figure}, switched off"), advice)
        }
        Some(Interface {
            has_link: false, ..
        }) => bad(
            format!("{figure}, no link"),
            "check the cable and the board's power".to_owned(),
        ),
        Some(Interface {
            is_wireless: true, ..
        }) => bad(
            format!("{figure}, wireless"),
            "use a cable: no period can be kept over radio".to_owned(),
        ),
        _ if network.routes.iter().any(is_default) => Finding::new(
            FigureVerdict::Look,
            CHECK,
            format!("{figure}, shared with the rest of the network"),
            "use a network card for the board alone: other traffic delays its packets",
        ),
        _ => Finding::good(CHECK, figure),
    }
}

/// The interfaces of a computer that is not in a board's network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outside {
    /// State of the interfaces that the board may be plugged into.
    pub interfaces: String,
    /// What to do.
    pub advice: String,
}

impl Outside {
    fn told(&self) -> String {
        format!("{}; {}", self.interfaces, self.advice)
    }
}

/// Looks for the interface that a board at `address` may be plugged into, if no interface is in its
/// network. An interface that carries another network is never meant.
pub fn outside(network: &Network, address: Ipv4Addr) -> Outside {
    let free = network.free();
    let Some(first) = free.first() else {
        return Outside {
            interfaces: in_use(network),
            advice: format!(
                "plug the board into a network card of its own, then {}",
                add(address, "INTERFACE")
            ),
        };
    };
    let name = &first.name;
    let states: Vec<String> = free.iter().map(|one| state(one)).collect();
    let interface = if states.len() == 1 {
        "the interface"
    } else {
        "the interfaces:"
    };
    Outside {
        interfaces: format!("{interface} {}", states.join(", ")),
        advice: match first {
            Interface { has_link: true, .. } => add(address, name),
            Interface { is_up: false, .. } => format!(
                "`sudo ip link set {name} up`; if it has no address in that network then, {}",
                add(address, name)
            ),
            _ => format!(
                "check the cable and the board's power, then {}",
                add(address, name)
            ),
        },
    }
}

/// State of an interface without a network.
fn state(interface: &Interface) -> String {
    let state = match interface {
        Interface { is_up: false, .. } => "is down",
        Interface {
            has_link: false, ..
        } => "has no link",
        _ => "has a link and no address",
    };
    format!("{} {state}", interface.name)
}

/// The wired interfaces of a computer none of which is free.
fn in_use(network: &Network) -> String {
    let wired = network.interfaces.iter();
    let wired = wired.filter(|one| one.is_ethernet && !one.is_wireless && one.has_link);
    let names: Vec<&str> = wired.map(|one| one.name.as_str()).collect();
    match names[..] {
        [] => "this computer has no Ethernet interface".to_owned(),
        [name] => format!("the only interface, {name}, carries another network"),
        _ => format!("the interfaces {} carry other networks", names.join(", ")),
    }
}

/// Command that adds a suitable address to an interface.
fn add(address: Ipv4Addr, interface: &str) -> String {
    let own = host_beside(address);
    format!("`sudo ip addr add {own}/24 dev {interface}`")
}

/// Address for this computer beside a board: the first of the /24 network that is not the board's.
pub fn host_beside(board: Ipv4Addr) -> Ipv4Addr {
    let [a, b, c, d] = board.octets();
    Ipv4Addr::new(a, b, c, if d == 1 { 2 } else { 1 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// State of an interface.
    #[derive(Clone, Copy, PartialEq)]
    enum State {
        Ready,
        Down,
        NoLink,
        Wireless,
    }
    use State::{Down, NoLink, Ready, Wireless};

    fn network(state: State, default: &str) -> Network {
        let route = |interface: &str, network, mask, gateway| Route {
            interface: interface.to_owned(),
            network: Ipv4Addr::from_bits(network),
            mask: Ipv4Addr::from_bits(mask),
            gateway: Ipv4Addr::from_bits(gateway),
            metric: 0,
        };
        Network {
            interfaces: vec![Interface {
                name: "eth0".to_owned(),
                is_ethernet: true,
                is_device: true,
                is_wireless: state == Wireless,
                is_up: state != Down,
                has_link: matches!(state, Ready | Wireless),
            }],
            routes: vec![
                route("eth0", 0x0A0A_0A00, 0xFFFF_FF00, 0),
                route(default, 0, 0, 0xC0A8_0001),
                route("*", 0x0A0B_0000, 0xFFFF_0000, 0),
            ],
            own: Vec::new(),
        }
    }

    #[test]
    fn dedicated_cable_is_good_and_every_other_route_has_advice() {
        let board = Ipv4Addr::new(10, 10, 10, 10);
        let finding = way(&network(Ready, "eth1"), board);
        assert_eq!(
            finding,
            Finding::good("network route", "eth0, 10.10.10.0/24")
        );
        for (network, to, verdict, figure, advice) in [
            (
                network(Down, "eth1"),
                board,
                FigureVerdict::Bad,
                "switched off",
                "link set",
            ),
            (
                network(NoLink, "eth1"),
                board,
                FigureVerdict::Bad,
                "no link",
                "cable",
            ),
            (
                network(Wireless, "eth1"),
                board,
                FigureVerdict::Bad,
                "wireless",
                "cable",
            ),
            (
                network(Ready, "eth0"),
                board,
                FigureVerdict::Look,
                "shared",
                "board alone",
            ),
            (
                network(Ready, "eth1"),
                Ipv4Addr::new(192, 168, 1, 121),
                FigureVerdict::Look,
                "behind 192.168.0.1",
                "ip addr add 192.168.1.1/24 dev INTERFACE",
            ),
            (
                network(Ready, "eth1"),
                Ipv4Addr::new(10, 11, 1, 2),
                FigureVerdict::Bad,
                "discards",
                "ip route del 10.11.0.0/16",
            ),
            (
                Network::default(),
                Ipv4Addr::new(10, 10, 10, 1),
                FigureVerdict::Bad,
                "none to 10.10.10.1",
                "ip addr add 10.10.10.2/24 dev INTERFACE",
            ),
        ] {
            let finding = way(&network, to);
            assert_eq!(finding.verdict, verdict, "{finding:?}");
            assert!(finding.figure.contains(figure), "{finding:?}");
            assert!(
                finding
                    .advice
                    .as_ref()
                    .is_some_and(|told| told.contains(advice)),
                "{finding:?}"
            );
        }
        let here = way(&Network::default(), Ipv4Addr::LOCALHOST);
        assert_eq!(here.verdict, FigureVerdict::Ok);
        assert_eq!(interface(&Network::default(), board), None);
        assert_eq!(interface(&network(Ready, "eth1"), board), Some("eth0"));
    }

    /// An interface `eth1` beside `eth0`, which leads to the office and to the internet.
    fn beside_the_office(state: State) -> Network {
        let mut network = network(Ready, "eth0");
        network.routes.remove(0);
        network.interfaces.push(Interface {
            name: "eth1".to_owned(),
            is_up: state != Down,
            has_link: state == Ready,
            ..network.interfaces[0].clone()
        });
        network
    }

    #[test]
    fn interface_that_is_down_is_named_and_never_that_of_the_office() {
        let board = Ipv4Addr::new(10, 10, 10, 10);
        for (state, interfaces, advice) in [
            (
                Down,
                "the interface eth1 is down",
                "`sudo ip link set eth1 up`; if it has no address in that network then, `sudo ip addr add \
                 10.10.10.1/24 dev eth1`",
            ),
            (
                NoLink,
                "the interface eth1 has no link",
                "check the cable and the board's power, then `sudo ip addr add 10.10.10.1/24 dev eth1`",
            ),
            (
                Ready,
                "the interface eth1 has a link and no address",
                "`sudo ip addr add 10.10.10.1/24 dev eth1`",
            ),
        ] {
            let network = beside_the_office(state);
            let found = outside(&network, board);
            assert_eq!((&*found.interfaces, &*found.advice), (interfaces, advice));
            let way = way(&network, board);
            assert!(!way.advice.expect("advice").contains("eth0"));
        }
        let mut alone = beside_the_office(Down);
        alone.interfaces.truncate(1);
        let found = outside(&alone, board);
        assert_eq!(
            found.interfaces,
            "the only interface, eth0, carries another network"
        );
        assert!(found.advice.ends_with("dev INTERFACE`"), "{found:?}");
    }

    #[test]
    fn this_computer_gets_another_address_than_the_board() {
        let [board, first] = [[10, 10, 10, 10], [10, 1, 2, 1]].map(Ipv4Addr::from);
        assert_eq!(host_beside(board), Ipv4Addr::new(10, 10, 10, 1));
        assert_eq!(host_beside(first), Ipv4Addr::new(10, 1, 2, 2));
    }
}
