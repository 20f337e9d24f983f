//! A network that delivers packets again, and late: the port's data that the driver reads while it
//! is built are those it requested, not those of an earlier command.

use crate::common::chance::Chance;
use crate::common::ethernet::{SimLink, WIRE, connect};
use mesa_hal::discovery::RemoteDescriptor;
use mesa_hal::driver::RemarkKind;
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::sslbp::{Port, PortLayout};
use mesa_hal::{Board, RemoteId, Settings};
use mesa_hal_sim::machines;

#[test]
fn parameters_of_a_port_are_its_own_on_a_duplicating_network() {
    let mut expected = None;
    let mut known = 0;
    for seed in 0..400 {
        let mut bus = connect(SimLink::new(machines::i7i92_7i77()));
        let hostmot2 = HostMot2::identify(&mut bus).expect("a firmware");
        let layout = PortLayout::locate(&hostmot2, 0).expect("a port");
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

/// Process data that is laid out, or scaled, by a byte of another place would be a wrong value for
/// as long as the driver runs.
#[test]
fn remote_description_is_its_own_on_a_duplicating_network() {
    let discovered = |bus| {
        let board = Board::identify(bus, Settings::default()).ok()?;
        let board = board.discover().ok()?;
        let remotes = board.remotes();
        let found: Vec<_> = remotes
            .map(|(id, found)| (id, found.descriptor.clone()))
            .collect();
        let doubtful = board.remarks().iter();
        let doubtful = doubtful.filter(|remark| matches!(remark.kind, RemarkKind::Tables(_)));
        let doubtful: Vec<_> = doubtful.filter_map(|remark| remark.remote).collect();
        Some((found, board.missing().to_vec(), doubtful))
    };
    let clean = connect(SimLink::new(machines::i7i92_with_cards()));
    let (expected, absent, _) = discovered(clean).expect("a clean network");
    assert_eq!(expected.len(), 3, "{absent:?}");
    let mut complete = 0;
    for seed in 0..60 {
        let mut bus = connect(SimLink::new(machines::i7i92_with_cards()));
        let mut chance = Chance(seed);
        let one_in = [1, 2, 5, 20][seed as usize % 4];
        bus.link().to_board = Box::new(move |_, _| {
            let late = chance.one_in(one_in).then(|| WIRE + chance.below(500_000));
            [WIRE].into_iter().chain(late).collect()
        });
        // What fails is reported.
        let Some((mut found, missing, doubtful)) = discovered(bus) else {
            continue;
        };
        // So is a parameter whose record could not be read.
        found.retain(|(id, _)| doubtful.iter().all(|remote| remote != id));
        for (id, descriptor) in &found {
            let is_it =
                |(other, own): &(RemoteId, RemoteDescriptor)| other == id && own == descriptor;
            assert!(
                expected.iter().any(is_it),
                "seed {seed}, one in {one_in}: {id}"
            );
        }
        complete += usize::from(missing == absent && found.len() == expected.len());
    }
    assert!(complete > 30, "{complete}");
}
