//! Each occurrence leads to exactly its event, in the first cycle that can detect it.

use std::time::Duration;

use crate::common::machine::{ANALOG, FIELD, FieldRemote, Machine, OUTPUTS, World, fpga, start};
use crate::remotes::optional::shop_and_its_valves;
use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::{EventKind, Events, Failure, OfflineReason, Positions, Repeating};
use mesa_hal::hal::Pins;
use mesa_hal::sslbp::RemoteName;
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal::{RemoteId, RemoteLabel};
use mesa_hal_sim::devices::Outputs48;
use mesa_hal_sim::remote::{Cable, Toward, WireFault};
use mesa_hal_sim::{FaultKind, SimFpga};

/// The cycle, counted from the last one before the cause, and the event in it.
type Told = (u64, EventKind);

/// A running machine with its events.
struct Rig<B: World> {
    machine: Machine<B>,
    events: Events,
    before: u64,
}

fn rig() -> Rig<Faulty<SimFpga>> {
    Rig::of(Machine::on(Faulty::new(fpga(), 7), |_| {}))
}

impl<B: World> Rig<B> {
    fn of(mut machine: Machine<B>) -> Self {
        let events = machine.driver.events();
        machine.cards.set_one_of_each(machine.driver.pins_mut());
        machine.cycles(5);
        let mut rig = Self {
            machine,
            events,
            before: 0,
        };
        rig.now();
        assert_eq!(rig.told(), [], "nothing has happened yet");
        rig
    }

    /// Cycles are counted from here.
    fn now(&mut self) {
        self.before = self.machine.driver.statistics().reads;
    }

    fn told(&mut self) -> Vec<Told> {
        let before = self.before;
        let told = self.events.by_ref().map(|event| {
            assert!(!event.kind.to_string().is_empty());
            (event.cycle - before, event.kind)
        });
        told.collect()
    }

    /// The events of this number of cycles, some of whose exchanges may fail.
    fn after(&mut self, cycles: usize) -> Vec<Told> {
        for _ in 0..cycles {
            let _ = self.machine.driver.read();
            let _ = self.machine.driver.write();
            self.machine.rest();
        }
        self.told()
    }

    fn first_fault(&self, channel: usize) -> Option<OfflineReason> {
        self.machine.status(channel).first_fault
    }

    /// Re-arms until nothing is waiting; returns the events on the way.
    fn rearm(&mut self) -> Vec<EventKind> {
        self.now();
        self.machine.rearm_all(6000);
        self.after(2).into_iter().map(|(_, kind)| kind).collect()
    }
}

const fn label(channel: usize) -> RemoteLabel {
    let name = if channel == OUTPUTS { b"7I72" } else { b"7I77" };
    RemoteLabel {
        id: RemoteId::new(0, channel as u8),
        name: Some(RemoteName(*name)),
    }
}

const fn failed(channel: usize, failure: Failure) -> EventKind {
    EventKind::TransferFailed {
        remote: label(channel),
        failure,
    }
}

const fn offline(channel: usize, reason: OfflineReason) -> EventKind {
    EventKind::RemoteOffline {
        remote: label(channel),
        reason,
    }
}

const fn back(channel: usize) -> EventKind {
    EventKind::RemoteBack {
        remote: label(channel),
    }
}

const fn rearmed(channel: usize) -> EventKind {
    EventKind::RemoteRearmed {
        remote: label(channel),
    }
}

const ARMED_ONE: EventKind = EventKind::Rearmed {
    armed: 1,
    waiting: 0,
};

#[test]
fn undisturbed_cycles_have_no_events() {
    assert_eq!(rig().after(2000), []);
}

#[test]
fn run_of_failures_is_one_event_until_10_s_after_its_last() {
    for channel in [FIELD, ANALOG, OUTPUTS] {
        for (fault, failure) in [
            (WireFault::Lost, Failure::NoReply),
            (WireFault::Corrupted, Failure::Crc),
            (WireFault::Short(1), Failure::NoReply),
            (WireFault::Break, Failure::Break),
        ] {
            let mut rig = rig();
            rig.machine.cable(channel).inject(Toward::Fpga, fault, 1);
            // The next read has the previous transfer, and the one after it this one.
            let told = (2, failed(channel, failure));
            assert_eq!(rig.after(5), [told], "{fault:?}");
            rig.machine.cable(channel).inject(Toward::Fpga, fault, 1);
            // The bits of CS are sticky, so that the kind of a second failure may be hidden: that
            // is reported.
            let again = rig.after(1000);
            let first = failed(channel, failure);
            assert!(again.iter().all(|(_, kind)| *kind != first), "{again:?}");
            assert!(again.len() <= 1, "{again:?}");
            rig.now();
            rig.machine.cable(channel).inject(Toward::Fpga, fault, 1);
            assert_eq!(rig.after(9_990), [], "{fault:?}");
            let [(_, over)] = rig.after(30)[..] else {
                panic!("{fault:?}: it is over");
            };
            let of_three = matches!(over, EventKind::Repeated { count: 3, .. });
            assert!(of_three && over.remote() == Some(label(channel)), "{over}");
            rig.now();
            rig.machine.cable(channel).inject(Toward::Fpga, fault, 1);
            let again = rig.after(30);
            let [(2, EventKind::TransferFailed { remote, .. })] = again[..] else {
                panic!("{fault:?}: {again:?}");
            };
            assert_eq!(usize::from(remote.id.channel), channel);
        }
    }
}

#[test]
fn reconnected_remote_has_an_event_for_each_change_of_state() {
    let mut rig = rig();
    rig.machine.cable(ANALOG).unplug();
    let told = rig.after(60);
    let [first, (_, repeated), (cycle, gone)] = told[..] else {
        panic!("{told:?}");
    };
    assert_eq!(first, (2, failed(ANALOG, Failure::NoReply)));
    let EventKind::Repeated { count, .. } = repeated else {
        panic!("{told:?}");
    };
    assert!((10..=20).contains(&count), "{repeated}");
    let reason = OfflineReason::TooManyFailures(Failure::NoReply);
    assert_eq!(gone, offline(ANALOG, reason));
    assert!((20..=40).contains(&cycle), "{cycle}");
    assert_eq!(rig.first_fault(ANALOG), Some(reason));

    // Attempts are repeated without a limit, and that is reported once.
    let told = rig.after(10_000);
    let [
        (
            _,
            EventKind::RemoteStaysOffline {
                remote,
                reason: still,
            },
        ),
    ] = told[..]
    else {
        panic!("{told:?}");
    };
    assert_eq!(usize::from(remote.id.channel), ANALOG);
    assert!(matches!(still, OfflineReason::DidNotStart(_)), "{still}");
    assert_eq!(
        rig.first_fault(ANALOG),
        Some(reason),
        "the first one is kept"
    );

    rig.machine.cable(ANALOG).replug();
    let told = rig.after(6000);
    let kinds: Vec<_> = told.iter().map(|(_, kind)| *kind).collect();
    assert_eq!(kinds, [back(ANALOG)]);
    assert_eq!(
        rig.first_fault(ANALOG),
        Some(reason),
        "until it is re-armed"
    );
    assert_eq!(rig.rearm(), [ARMED_ONE, rearmed(ANALOG)]);
    assert_eq!(rig.first_fault(ANALOG), None);
}

#[test]
fn reported_remote_fault_is_the_reason_of_its_event_in_cycle_2() {
    for kind in FaultKind::ALL {
        let Some(bit) = kind.fault_bit() else {
            continue;
        };
        let reason = match kind {
            FaultKind::RemoteWatchdog => OfflineReason::Watchdog,
            FaultKind::RemoteIllegalMode => OfflineReason::IllegalMode,
            FaultKind::RemoteHighVoltage | FaultKind::RemoteLowVoltage => {
                OfflineReason::FieldPower(bit)
            }
            _ => OfflineReason::Reported(bit),
        };
        let mut rig = rig();
        let remote = rig.machine.fpga().device_mut::<FieldRemote>(0, FIELD);
        remote.expect("the field I/O").set_faults(bit);
        assert_eq!(rig.after(3), [(2, offline(FIELD, reason))], "{kind}");
        assert_eq!(rig.first_fault(FIELD), Some(reason));
        let told = rig.rearm();
        assert_eq!(told, [back(FIELD), ARMED_ONE, rearmed(FIELD)], "{kind}");
    }
}

#[test]
fn swapped_card_has_a_failure_event_then_one_with_the_new_card() {
    let mut rig = rig();
    let stranger = Outputs48::i7i72().expect("a 7I72");
    let cable = Cable::new(Box::new(stranger), 3);
    let _ = rig.machine.fpga().plug(0, FIELD, Some(Box::new(cable)));
    let told = rig.after(3000);
    let kinds: Vec<_> = told.iter().map(|(_, kind)| *kind).collect();
    let went = kinds.iter().filter(
        |kind| matches!(kind, EventKind::RemoteOffline { remote, .. } if usize::from(remote.id.channel) == FIELD),
    );
    assert_eq!(went.count(), 1, "{told:?}");
    let [.., EventKind::RemoteStaysOffline { reason, .. }] = kinds[..] else {
        panic!("{told:?}");
    };
    let is_another =
        matches!(reason, OfflineReason::AnotherDevice { found, .. } if found.name.0 == *b"7I72");
    assert!(is_another, "{reason}");
}

#[test]
fn requested_restart_and_port_off_are_reasons_of_events() {
    let mut rig = rig();
    rig.machine.driver.restart((0, OUTPUTS as u8));
    let told = rig.after(100);
    assert_eq!(told[0], (0, offline(OUTPUTS, OfflineReason::Requested)));
    assert_eq!(told[1].1, back(OUTPUTS));
    assert_eq!(told.len(), 2, "{told:?}");
    assert_eq!(rig.rearm(), [ARMED_ONE, rearmed(OUTPUTS)]);
}

#[test]
fn bite_is_an_event_in_the_next_cycle_and_restored_set_up_too() {
    let mut rig = rig();
    // Before, no position of an encoder is one that was lost.
    assert_eq!(rig.after(100), []);
    rig.now();
    rig.machine.sleep(20);
    assert_eq!(rig.after(1), [(1, EventKind::WatchdogBitten)]);
    let told = rig.rearm();
    assert_eq!(told[0], EventKind::BoardSetUp, "{told:?}");
    assert!(matches!(told[1], EventKind::Rearmed { .. }), "{told:?}");
    let faults: Vec<_> = told.iter().filter(|kind| kind.is_fault()).collect();
    // The select line of its encoders was released.
    let unsure = EventKind::PositionUnsure {
        of: Positions::Encoders,
        first: 0,
        mask: 0b11_1111,
    };
    assert_eq!(faults, [&unsure]);
}

#[test]
fn reset_of_the_board_is_an_event_in_the_second_cycle_after_it() {
    let mut rig = rig();
    rig.machine.fpga().reload();
    let told = rig.after(5);
    let kinds: Vec<_> = told.iter().map(|(_, kind)| *kind).collect();
    assert!(told[0].0 <= 2, "{told:?}");
    assert_eq!(kinds[0], EventKind::BoardReset, "{told:?}");
    let others = kinds.iter().filter(|kind| kind.remote().is_none());
    assert_eq!(others.count(), 1, "{told:?}");
}

#[test]
fn events_of_lost_packets_contain_the_error_of_the_bus() {
    let lost = Fault::NotExecuted(BusErrorKind::Lost);
    let late = Fault::Executed(BusErrorKind::Late);
    for (fault, why) in [(lost, BusErrorKind::Lost), (late, BusErrorKind::Late)] {
        let mut rig = rig();
        let next = rig.machine.driver.bus().exchanges();
        rig.machine.driver.bus_mut().fail_at(next, fault);
        let told = (1, EventKind::ReadFailed { why });
        assert_eq!(rig.after(20), [told]);
    }

    let mut rig = rig();
    let next = rig.machine.driver.bus().exchanges();
    rig.machine.driver.bus_mut().fail_at(next + 1, lost);
    let why = BusErrorKind::Lost;
    let told = rig.after(20);
    assert_eq!(told[0], (1, EventKind::WriteFailed { why }), "{told:?}");

    let mut rig = self::rig();
    let next = rig.machine.driver.bus().exchanges();
    let bus = rig.machine.driver.bus_mut();
    bus.fail_at(next + 1, Fault::AckedButLost);
    let told = rig.after(20);
    assert_eq!(told, [(2, EventKind::LostWrites { count: 1 })]);
}

#[test]
fn bus_down_is_one_event_at_its_limit_after_the_first_failure() {
    let mut rig = rig();
    let next = rig.machine.driver.bus().exchanges();
    for exchange in next..next + 400 {
        let lost = Fault::NotExecuted(BusErrorKind::Unreachable);
        rig.machine.driver.bus_mut().fail_at(exchange, lost);
    }
    let why = BusErrorKind::Unreachable;
    let told = rig.after(100);
    let kinds: Vec<_> = told.iter().map(|(_, kind)| *kind).collect();
    let down = EventKind::BusDown;
    let (read, write) = (
        EventKind::ReadFailed { why },
        EventKind::WriteFailed { why },
    );
    assert_eq!(kinds, [read, write, down], "{told:?}");
    // Five failures, of reads and of writes.
    assert_eq!(told[2].0, 3);
    rig.machine.driver.bus_mut().heal();
    let told = rig.rearm();
    assert!(told.contains(&EventKind::BoardSetUp), "{told:?}");
    let (reads, writes) = {
        let counted = rig.machine.driver.statistics();
        (counted.read_errors as u32, counted.write_errors as u32)
    };
    let told = rig.after(11_000);
    let kinds: Vec<_> = told.iter().map(|(_, kind)| *kind).collect();
    for (what, all) in [
        (Repeating::FailedReads, reads),
        (Repeating::FailedWrites, writes),
    ] {
        let told = |kind: &&EventKind| matches!(kind, EventKind::Repeated { what: of, count, .. } if *of == what && *count == all);
        assert_eq!(
            kinds.iter().filter(told).count(),
            1,
            "{all} {what}: {kinds:?}"
        );
    }
}

#[test]
fn optional_remote_plugged_in_later_has_events_for_up_and_back() {
    let (mut shop, valves) = shop_and_its_valves();
    let mut events = shop.driver.events();
    shop.cycles(1000);
    assert_eq!(events.next(), None, "it is absent as it was at the start");
    let remote = shop.status(OUTPUTS).label;
    let _ = shop.fpga().plug(0, OUTPUTS, Some(valves));
    shop.cycles(6000);
    let up: Vec<_> = events.by_ref().map(|event| event.kind).collect();
    assert_eq!(up, [EventKind::RemoteUp { remote }]);
    shop.rearm_all(10);
    shop.cycles(1);
    shop.driver.restart(remote);
    shop.cycles(100);
    let kinds: Vec<_> = events.by_ref().map(|event| event.kind).collect();
    let reason = OfflineReason::Requested;
    let asked = EventKind::RemoteOffline { remote, reason };
    let armed = EventKind::RemoteRearmed { remote };
    let back = EventKind::RemoteBack { remote };
    assert_eq!(kinds, [ARMED_ONE, armed, asked, back]);
}

#[test]
fn one_group_can_be_re_armed_by_itself() {
    let mut rig = rig();
    rig.machine.driver.restart((0, FIELD as u8));
    let _ = rig.after(100);
    let group = rig.machine.status(FIELD).pins.group;
    let pins: &mut Pins = rig.machine.driver.pins_mut();
    pins.rearm(group).expect("a group of this machine");
    rig.now();
    assert_eq!(rig.after(2), [(1, rearmed(FIELD))]);
}

#[test]
fn full_queue_keeps_the_first_events_and_counts_the_rest() {
    let driver = start(fpga(), |s| s.event_room = 3).expect("the machine is complete");
    let mut rig = Rig::of(Machine::with(driver));
    for _ in 0..20 {
        rig.machine.driver.restart((0, FIELD as u8));
        rig.machine.cycles(200);
    }
    let asked = offline(FIELD, OfflineReason::Requested);
    let kinds: Vec<_> = rig.told().into_iter().map(|(_, kind)| kind).collect();
    let dropped = EventKind::Dropped { count: 36 };
    assert_eq!(kinds, [asked, back(FIELD), asked, back(FIELD), dropped]);
}

#[test]
fn events_contain_the_time_of_the_bus_and_the_next_step() {
    let mut rig = rig();
    let begin = rig.machine.now();
    rig.machine.sleep(20);
    let _ = rig.machine.driver.read();
    let event = rig.events.next().expect("an event");
    let late = Duration::from_nanos(event.at.as_nanos() - begin);
    assert!((20..21).contains(&late.as_millis()), "{late:?}");
    let text = event.with_advice().to_string();
    let cycle = format!("cycle {}, ", rig.before + 1);
    assert!(text.starts_with(&cycle), "{text}");
    assert!(text.contains("watchdog has bitten"), "{text}");
    assert!(text.contains("find out why the host was late"), "{text}");
}
