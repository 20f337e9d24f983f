//! A network that delivers packets again, and late: the port's data that the driver reads while it
//! is built are those it requested, not those of an earlier command.

use crate::common::chance::Chance;
use crate::common::ethernet::{SimLink, WIRE, connect};
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::sslbp::{Layout, Port};
use mesa_hal_sim::machines;

#[test]
fn the_parameters_of_a_port_are_its_own_on_a_network_that_duplicates() {
    let mut expected = None;
    let mut known = 0;
    for seed in 0..400 {
        let mut bus = connect(SimLink::new(machines::i7i92_7i77()));
        let hostmot2 = HostMot2::identify(&mut bus).expect("a firmware");
        let layout = Layout::locate(&hostmot2, 0).expect("a port");
        let mut chance = Chance(seed);
        let one_in = [1, 2, 5, 20][seed as usize % 4];
        bus.link().to_board = Box::new(move |_, _| {
            let late = (seed > 0 && chance.one_in(one_in)).then(|| WIRE + chance.below(500_000));
            [WIRE].into_iter().chain(late).collect()
        });
        let mut port = Port::new(layout);
        // Failures are reported.
        let Ok(found) = port.on(&mut bus).reset() else {
            continue;
        };
        let expected = *expected.get_or_insert(found);
        assert_eq!(found, expected, "seed {seed}, one in {one_in}");
        known += 1;
    }
    assert!(known > 200, "{known}");
}
