//! Reasons why no board answers at an address, and commands for this computer.

use std::net::Ipv4Addr;

use mesa_hal::bus::BusAdvice;
use mesa_hal::transport::network::{Interface, Network, NetworkPath};
use mesa_hal::transport::search::Silence;

/// A reason with advice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Why {
    pub reason: String,
    /// Shell commands for this computer, or things to check.
    pub advice: String,
}

/// Determines why no board answers at an address.
pub fn of(network: &Network, address: Ipv4Addr, silence: Silence) -> Why {
    match (silence, network.way_to(address)) {
        (_, NetworkPath::Here) if !address.is_loopback() => Why {
            reason: "this computer itself has this address, and sends nothing to a board"
                .to_owned(),
            advice: format!(
                "give this computer another address, such as {}; `ip addr` shows which interface has \
                 this one",
                host_beside(address)
            ),
        },
        (_, NetworkPath::Discarded(route)) => Why {
            reason: format!("a route of this computer discards what is sent to {route}"),
            advice: format!("sudo ip route del {route}"),
        },
        (Silence::Blocked, _) => Why {
            reason: silence.to_string(),
            advice: BusAdvice::OpenFirewall.to_string(),
        },
        (Silence::Nothing | Silence::Refused, NetworkPath::Here) => Why {
            reason: "no simulated board listens there on this computer".to_owned(),
            advice: format!("mesa sim --board 7i97 --listen {address}"),
        },
        (Silence::Refused | Silence::Foreign, NetworkPath::Direct(_) | NetworkPath::Here) => Why {
            reason: silence.to_string(),
            advice: "another device has this address: change the address of one of the two"
                .to_owned(),
        },
        (_, NetworkPath::Here) => Why {
            reason: silence.to_string(),
            advice: "choose another address of 127.0.0.0/8".to_owned(),
        },
        (_, NetworkPath::Direct(route)) => {
            in_network(&route.interface, network.interface(&route.interface))
        }
        (_, NetworkPath::Gateway(route)) => {
            let (gateway, interface) = (route.gateway, &route.interface);
            let reason = format!(
                "no interface is in its network: packets leave by {interface} through the gateway \
                 {gateway}"
            );
            other_network(network, address, &reason)
        }
        (_, NetworkPath::None) => other_network(network, address, "no interface is in its network"),
    }
}

/// Reason if the interface is in the network of the board. Its state may be hidden, as in a
/// container.
fn in_network(name: &str, interface: Option<&Interface>) -> Why {
    if interface.is_some_and(|interface| !interface.is_up) {
        Why {
            reason: format!("the interface {name} is down"),
            advice: format!("sudo ip link set {name} up"),
        }
    } else if interface.is_some_and(|interface| !interface.has_link) {
        Why {
            reason: format!("the interface {name} has no link"),
            advice: "check the cable and the board's power".to_owned(),
        }
    } else {
        Why {
            reason: format!("no answer on {name}, which is in its network"),
            advice: "check the board's power and its address jumpers, or search its network: mesa \
                     list IP/BITS"
                .to_owned(),
        }
    }
}

/// Reason if no interface is in the network of the board, with the interface that should be.
fn other_network(network: &Network, address: Ipv4Addr, reason: &str) -> Why {
    let Some(interface) = network.likely() else {
        return Why {
            reason: format!("{reason}, and this computer has no Ethernet interface"),
            advice: "plug in a network adapter".to_owned(),
        };
    };
    let name = &interface.name;
    let host = host_beside(address);
    let add = format!("sudo ip addr add {host}/24 dev {name}");
    if interface.is_up {
        let link = if interface.has_link {
            ""
        } else {
            " (which has no link: check its cable)"
        };
        return Why {
            reason: reason.to_owned(),
            advice: format!("{add}{link}"),
        };
    }
    Why {
        reason: format!("{reason}, and the interface {name} is down"),
        advice: format!("{add} && sudo ip link set {name} up"),
    }
}

/// Address for this computer beside a board: the first of the /24 network that is not the board's.
fn host_beside(board: Ipv4Addr) -> Ipv4Addr {
    let [a, b, c, d] = board.octets();
    Ipv4Addr::new(a, b, c, if d == 1 { 2 } else { 1 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesa_hal::transport::network::Route;

    /// State of an interface.
    #[derive(Clone, Copy, PartialEq)]
    enum State {
        Ready,
        Down,
        NoLink,
    }
    use State::{Down, NoLink, Ready};

    fn interface(name: &str, state: State) -> Interface {
        let mut interface = Network::here().expect("Linux").interfaces.remove(0);
        interface.name = name.to_owned();
        interface.is_ethernet = true;
        interface.is_device = true;
        interface.is_wireless = false;
        interface.is_up = state != Down;
        interface.has_link = state == Ready;
        interface
    }

    fn route(interface: &str, network: [u8; 4], bits: u32, gateway: [u8; 4]) -> Route {
        Route {
            interface: interface.to_owned(),
            network: network.into(),
            mask: Ipv4Addr::from_bits(!u32::MAX.checked_shr(bits).unwrap_or(0)),
            gateway: gateway.into(),
            metric: 0,
        }
    }

    const BOARD: Ipv4Addr = Ipv4Addr::new(10, 10, 10, 10);

    fn why(interfaces: &[Interface], routes: &[Route]) -> (String, String) {
        let network = Network {
            interfaces: interfaces.to_vec(),
            routes: routes.to_vec(),
            own: Vec::new(),
        };
        let why = of(&network, BOARD, Silence::Nothing);
        (why.reason, why.advice)
    }

    #[test]
    fn each_reason_has_its_advice() {
        let beside = route("eth1", [10, 10, 10, 0], 24, [0; 4]);
        let default = route("eth0", [0; 4], 0, [192, 0, 2, 1]);
        for (interfaces, routes, reason, advice) in [
            (
                vec![interface("eth1", Ready)],
                vec![beside.clone()],
                "no answer on eth1, which is in its network",
                "check the board's power",
            ),
            (
                vec![interface("eth0", Ready)],
                vec![default.clone(), beside.clone()],
                "no answer on eth1, which is in its network",
                "check the board's power",
            ),
            (
                vec![interface("eth1", NoLink)],
                vec![beside.clone()],
                "eth1 has no link",
                "check the cable",
            ),
            (
                vec![interface("eth1", Down)],
                vec![beside],
                "eth1 is down",
                "sudo ip link set eth1 up",
            ),
            (
                vec![interface("eth0", Ready)],
                vec![default.clone()],
                "packets leave by eth0 through the gateway 192.0.2.1",
                "sudo ip addr add 10.10.10.1/24 dev eth0",
            ),
            (
                vec![interface("eth1", NoLink)],
                vec![],
                "no interface is in its network",
                "sudo ip addr add 10.10.10.1/24 dev eth1 (which has no link",
            ),
            (
                vec![interface("eth1", Down)],
                vec![],
                "the interface eth1 is down",
                "sudo ip addr add 10.10.10.1/24 dev eth1 && sudo ip link set eth1 up",
            ),
            (
                vec![interface("eth0", Ready)],
                vec![default.clone(), route("*", [10, 10, 0, 0], 16, [0; 4])],
                "discards what is sent to 10.10.0.0/16",
                "sudo ip route del 10.10.0.0/16",
            ),
            (
                vec![],
                vec![default],
                "this computer has no Ethernet interface",
                "plug in a network adapter",
            ),
        ] {
            let (why, how) = why(&interfaces, &routes);
            assert!(why.contains(reason), "{reason}: {why}");
            assert!(how.contains(advice), "{advice}: {how}");
        }
    }

    #[test]
    fn this_computer_gets_another_address_than_the_board() {
        assert_eq!(host_beside(BOARD), Ipv4Addr::new(10, 10, 10, 1));
        let first = Ipv4Addr::new(10, 1, 2, 1);
        assert_eq!(host_beside(first), Ipv4Addr::new(10, 1, 2, 2));
    }

    #[test]
    fn what_answers_and_is_no_board_is_another_device() {
        let network = Network {
            interfaces: vec![interface("eth1", Ready)],
            routes: vec![route("eth1", [10, 10, 10, 0], 24, [0; 4])],
            own: vec![(Ipv4Addr::new(10, 10, 10, 9), Ipv4Addr::BROADCAST)],
        };
        let own = of(&network, Ipv4Addr::new(10, 10, 10, 9), Silence::Refused);
        assert!(own.reason.contains("this computer itself has"), "{own:?}");
        assert!(own.advice.contains("such as 10.10.10.1"), "{own:?}");
        let why = of(&network, BOARD, Silence::Refused);
        assert!(why.reason.contains("no program listens"), "{why:?}");
        assert!(why.advice.contains("another device"), "{why:?}");
        // A gateway refuses on behalf of others.
        let through = Network {
            routes: vec![route("eth1", [0; 4], 0, [192, 0, 2, 1])],
            ..network
        };
        let why = of(&through, BOARD, Silence::Refused);
        assert!(why.advice.contains("ip addr add"), "{why:?}");
    }
}
