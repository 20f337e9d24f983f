//! Reasons why no board answers at an address, and commands for this computer.

use std::net::Ipv4Addr;

use mesa_hal::advice;
use mesa_hal::transport::search::Silence;
use mesa_tools::diagnosis::network::{Network, NetworkPath};
use mesa_tools::diagnosis::network::{Outside, host_beside, outside};

/// A reason with advice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Why {
    pub reason: String,
    /// Shell commands for this computer, or things to check.
    pub advice: String,
    /// True if this computer itself has the address.
    pub is_own: bool,
}

/// Determines why no board answers at an address.
pub fn of(network: &Network, address: Ipv4Addr, silence: Silence) -> Why {
    match (silence, network.way_to(address)) {
        (_, NetworkPath::Here) if !address.is_loopback() => Why {
            is_own: true,
            reason: "this computer itself has this address, and sends nothing to a board"
                .to_owned(),
            advice: format!(
                "give this computer another address, such as {}; `ip addr` shows which interface has \
                 this one",
                host_beside(address)
            ),
        },
        (_, NetworkPath::Discarded(route)) => Why {
            is_own: false,
            reason: format!("a route of this computer discards what is sent to {route}"),
            advice: format!("sudo ip route del {route}"),
        },
        (Silence::Blocked, _) => Why {
            is_own: false,
            reason: silence.to_string(),
            advice: advice::OPEN_FIREWALL.to_string(),
        },
        (Silence::Nothing | Silence::Refused, NetworkPath::Here) => Why {
            is_own: false,
            reason: "no simulated board listens there on this computer".to_owned(),
            advice: format!("mesa sim --board 7i97 --listen {address}"),
        },
        (Silence::Refused | Silence::Foreign, NetworkPath::Direct(_) | NetworkPath::Here) => Why {
            is_own: false,
            reason: silence.to_string(),
            advice: "another device has this address: change the address of one of the two"
                .to_owned(),
        },
        (_, NetworkPath::Here) => Why {
            is_own: false,
            reason: silence.to_string(),
            advice: "choose another address of 127.0.0.0/8".to_owned(),
        },
        (_, NetworkPath::Direct(route)) => in_network(network, &route.interface),
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
fn in_network(network: &Network, name: &str) -> Why {
    let interface = network.interface(name);
    if interface.is_some_and(|interface| !interface.is_up) {
        Why {
            is_own: false,
            reason: format!("the interface {name} is down"),
            advice: format!("sudo ip link set {name} up"),
        }
    } else if interface.is_some_and(|interface| !interface.has_link) {
        Why {
            is_own: false,
            reason: format!("the interface {name} has no link"),
            advice: "check the cable and the board's power".to_owned(),
        }
    } else {
        Why {
            is_own: false,
            reason: format!("no answer on {name}, which is in its network"),
            advice: format!(
                "check the board's power and its address jumpers, or search its network: mesa list \
                 IP/BITS{}",
                elsewhere(network)
            ),
        }
    }
}

/// The interfaces that are down: a board may be plugged into one of them, and another network have
/// the same addresses.
fn elsewhere(network: &Network) -> String {
    let free = network.free().into_iter();
    let down = free.filter(|one| !one.is_up);
    let commands = down.map(|one| format!("`sudo ip link set {} up`", one.name));
    let commands = commands.collect::<Vec<_>>().join(" or ");
    match commands.as_str() {
        "" => String::new(),
        commands => format!("; if the board is at an interface that is down, {commands}"),
    }
}

/// Reason if no interface is in the network of the board, with the state of those that may be its.
fn other_network(network: &Network, address: Ipv4Addr, reason: &str) -> Why {
    let Outside { interfaces, advice } = outside(network, address);
    Why {
        is_own: false,
        reason: format!("{reason}, and {interfaces}"),
        advice,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesa_tools::diagnosis::network::{Interface, Route};

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
                vec![interface("eth0", Down), interface("eth1", Ready)],
                vec![beside.clone()],
                "no answer on eth1, which is in its network",
                "if the board is at an interface that is down, `sudo ip link set eth0 up`",
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
                "packets leave by eth0 through the gateway 192.0.2.1, and the only interface, eth0, carries \
                 another network",
                "sudo ip addr add 10.10.10.1/24 dev INTERFACE",
            ),
            (
                vec![interface("eth0", Ready), interface("eth1", Down)],
                vec![default.clone()],
                "packets leave by eth0 through the gateway 192.0.2.1, and the interface eth1 is down",
                "sudo ip link set eth1 up",
            ),
            (
                vec![interface("eth1", NoLink)],
                vec![],
                "no interface is in its network, and the interface eth1 has no link",
                "check the cable and the board's power, then `sudo ip addr add 10.10.10.1/24 dev eth1`",
            ),
            (
                vec![interface("eth1", Down)],
                vec![],
                "the interface eth1 is down",
                "`sudo ip link set eth1 up`; if it has no address in that network then, `sudo ip addr add",
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
                "plug the board into a network card of its own",
            ),
        ] {
            let (why, how) = why(&interfaces, &routes);
            assert!(why.contains(reason), "{reason}: {why}");
            assert!(how.contains(advice), "{advice}: {how}");
        }
    }

    #[test]
    fn host_that_refuses_packets_is_reported_as_another_device() {
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
