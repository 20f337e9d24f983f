//! Reachability of a board over the network.

use core::net::Ipv4Addr;

use super::{FigureVerdict, Finding};
use mesa_hal::transport::network::{Interface, Network, NetworkPath, Route};

const CHECK: &str = "network route";

/// Judges the route to `address`, and the state of its interface.
pub fn way(network: &Network, address: Ipv4Addr) -> Finding {
    let bad =
        |figure: String, advice: String| Finding::new(FigureVerdict::Bad, CHECK, figure, advice);
    match network.way_to(address) {
        NetworkPath::Here => Finding::good(CHECK, format!("{address} is this computer")),
        NetworkPath::None => bad(
            format!("none to {address}"),
            format!(
                "give an interface an address in its network: {}",
                add(network, address)
            ),
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
                add(network, address)
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

/// Command that adds a suitable address to an interface.
fn add(network: &Network, address: Ipv4Addr) -> String {
    let own = Ipv4Addr::from_bits(match address.to_bits() {
        bits if bits & 0xFF == 1 => bits + 1,
        bits => bits & !0xFF | 1,
    });
    let name = network.likely().map_or("INTERFACE", |one| &one.name);
    format!("`sudo ip addr add {own}/24 dev {name}`")
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
    fn a_cable_of_its_own_is_good_and_everything_else_says_what_to_do() {
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
                "ip addr add 192.168.1.1/24 dev eth0",
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
}
