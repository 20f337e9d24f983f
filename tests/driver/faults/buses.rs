//! Every fault of a remote, of its wire, of the FPGA and of the host on an embedded bus, over UDP
//! and on PCI: the driver says the same of it on each bus, whether it is left alone, stopped or
//! re-armed.

use std::collections::BTreeMap;

use crate::common::ethernet;
use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, World, fpga};
use crate::events::by_fault::{Story, begin_and_end, spoil_replies, spoiled};
use mesa_hal::driver::{BoardState, EventMask, RemoteState};
use mesa_hal_sim::{BoardConfig, FaultKind, FaultPlace, SimBoard, SimFpga, SimPciBus};

/// What a fault is followed by.
#[derive(Clone, Copy, Debug)]
enum Ending {
    /// Nothing is done for a second and a half.
    LeftAlone,
    Stopped,
    Rearmed,
}

/// What the driver says of a fault.
#[derive(Debug, PartialEq)]
struct Account {
    /// Board and remotes, with the states of their groups, while the fault lasts.
    meanwhile: Vec<String>,
    /// After it.
    states: Vec<String>,
    /// The events of the board, and of each remote in their order.
    events: BTreeMap<String, Vec<String>>,
    /// Bites, resets, and buses that were down.
    counts: [u64; 3],
    /// The remotes that stopping has not reached.
    stopped: Vec<String>,
    on: [bool; 3],
}

/// Exchanges that fail, and transfers that fail for a while, depend on the bus.
const OF_THE_BUS: EventMask = EventMask::TRANSFER_FAILED
    .union(EventMask::REPEATED)
    .union(EventMask::READ_FAILED)
    .union(EventMask::NOT_THERE)
    .union(EventMask::LOST_WRITES);

fn states<B: World>(machine: &Machine<B>) -> Vec<String> {
    let pins = machine.driver.pins();
    let remotes = [FIELD, ANALOG, OUTPUTS].map(|channel| {
        let status = machine.status(channel);
        let group = pins.group_state(status.pins.group).expect("a group");
        let state = match status.state {
            RemoteState::Offline { reason, .. } | RemoteState::Restarting { reason } => {
                format!("offline: {reason}")
            }
            other => format!("{other:?}"),
        };
        let (valid, armed) = (group.valid, group.armed);
        format!("{channel}: {state}, valid {valid}, armed {armed}")
    });
    let board = format!("{:?}", machine.driver.board_state());
    [&[board][..], &remotes].concat()
}

/// The account of a fault on a bus; and the doubts of the bus while a board is left alone.
fn account<B: World>(bus: B, kind: FaultKind, ending: Ending) -> (Account, u64) {
    let mut story = Story::of(Machine::on(bus, |_| {}));
    match spoiled(kind) {
        Some(fault) => spoil_replies(&mut story, fault),
        None => begin_and_end(&mut story, kind, 100),
    }
    story.run(30);
    let meanwhile = states(&story.machine);
    let doubts = |story: &Story<B>| story.machine.driver.bus().statistics().doubts;
    let before = doubts(&story);
    match ending {
        Ending::LeftAlone => story.run(1_500),
        Ending::Stopped => {}
        Ending::Rearmed => story.rearm(),
    }
    let doubts = doubts(&story) - before;
    let states = states(&story.machine);
    let mut events: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for kind in &story.told {
        if !OF_THE_BUS.contains(kind.mask()) {
            let subject = kind.remote().map_or("board".into(), |id| id.to_string());
            events.entry(subject).or_default().push(kind.to_string());
        }
    }
    let statistics = story.machine.driver.statistics();
    let counts = [
        statistics.watchdog_bites,
        statistics.resets,
        statistics.bus_down,
    ];
    let on = story.on();
    let driver = story.machine.driver;
    let (_, stopped) = driver.shutdown();
    let not_reached = stopped.err().map(|error| error.not_reached);
    let not_reached = not_reached.into_iter().flatten();
    let account = Account {
        meanwhile,
        states,
        events,
        counts,
        stopped: not_reached.map(|one| one.to_string()).collect(),
        on,
    };
    (account, doubts)
}

fn pci() -> SimPciBus {
    SimPciBus::new(SimBoard::new(BoardConfig::new("5I25"), fpga()))
}

fn kinds() -> impl Iterator<Item = FaultKind> {
    let kinds = FaultKind::ALL.iter().copied();
    let is_bus = |place| matches!(place, FaultPlace::Network | FaultPlace::Bus);
    kinds.filter(move |kind| !is_bus(kind.place()) && *kind != FaultKind::HostKilled)
}

#[test]
fn each_fault_has_the_same_account_on_every_bus() {
    let mut wrong = Vec::new();
    for kind in kinds() {
        for ending in [Ending::LeftAlone, Ending::Stopped, Ending::Rearmed] {
            let (embedded, _) = account::<SimFpga>(fpga(), kind, ending);
            let (udp, _) = account(ethernet::bus(fpga()), kind, ending);
            let (pci, _) = account(pci(), kind, ending);
            for (bus, other) in [("UDP", udp), ("PCI", pci)] {
                if other != embedded {
                    let place = format!("{kind}, {ending:?}, {bus}");
                    wrong.push(format!("{place}: {other:#?}, and not {embedded:#?}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn remotes_of_a_bitten_board_go_offline_on_every_bus() {
    let ending = Ending::LeftAlone;
    let (udp, doubts) = account(ethernet::bus(fpga()), FaultKind::FpgaWatchdog, ending);
    let (embedded, _) = account::<SimFpga>(fpga(), FaultKind::FpgaWatchdog, ending);
    for account in [udp, embedded] {
        assert_eq!(
            account.states[0],
            format!("{:?}", BoardState::WatchdogBitten)
        );
        for remote in &account.states[1..] {
            assert!(
                remote.contains("offline: the board does not run"),
                "{remote}"
            );
        }
        assert_eq!(account.events.len(), 4, "{:?}", account.events);
        assert_eq!(account.stopped, [""; 0]);
    }
    assert!(doubts < 10, "{doubts} doubts of a sound network");
}
