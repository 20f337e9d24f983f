//! Events of every fault that the simulator can produce: their order and texts. Their truth is
//! checked against the simulator's actions and outputs, not against the driver.

mod network;

use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};

use crate::common::machine::{ANALOG, FIELD, FieldRemote, Machine, OUTPUTS, World, device, fpga};
use mesa_hal::RemoteId;
use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::{EventKind, EventMask, Events};
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::devices::Outputs48;
use mesa_hal_sim::remote::{Cable, Toward, WireFault};
use mesa_hal_sim::{ChangeCause, Director, FaultKind, FaultPlace, SimFpga};

/// Number of cycles with a fault.
pub const FAULTY: usize = 60;
/// Number of quiet cycles after which the end of a row is reported.
const QUIET: usize = 11_000;
/// Number of occurrences of a sporadic fault.
const TIMES: u32 = 3;

/// The board's own losses.
#[derive(Clone, Debug, Default)]
pub struct Losses(Arc<Mutex<[u32; 2]>>);

impl Losses {
    /// Resets, and bites of the watchdog.
    fn seen(&self) -> [u32; 2] {
        *self.0.lock().expect("no thread panicked")
    }
}

impl Director for Losses {
    fn due(&self) -> Option<u64> {
        None
    }

    fn act(&mut self, _: &mut SimFpga) {}

    fn drives(&mut self, _: &SimFpga, cause: ChangeCause) {
        let [resets, bites] = &mut *self.0.lock().expect("no thread panicked");
        match cause {
            ChangeCause::Reset => *resets += 1,
            ChangeCause::Bite => *bites += 1,
            ChangeCause::Write => {}
        }
    }
}

/// A machine with an output of each card on, and its events.
pub struct Story<B: World> {
    pub machine: Machine<B>,
    events: Events,
    losses: Losses,
    pub told: Vec<EventKind>,
}

impl<B: World> Story<B> {
    pub fn of(mut machine: Machine<B>) -> Self {
        let losses = Losses::default();
        machine.fpga().set_director(Box::new(losses.clone()));
        machine.cards.set_one_of_each(machine.driver.pins_mut());
        let mut story = Self {
            events: machine.driver.events(),
            machine,
            losses,
            told: Vec::new(),
        };
        story.run(300);
        assert_eq!(story.told, [], "nothing has happened yet");
        assert_eq!(story.losses.seen(), [0, 0]);
        assert_eq!(story.on(), [true; 3]);
        story
    }

    /// Runs cycles, some of whose exchanges may fail.
    pub fn run(&mut self, cycles: usize) {
        for _ in 0..cycles {
            let _ = self.machine.driver.read();
            let _ = self.machine.driver.write();
            self.machine.rest();
        }
        self.told
            .extend(self.events.by_ref().map(|event| event.kind));
    }

    /// The cards that have their output on.
    pub fn on(&mut self) -> [bool; 3] {
        let fpga = self.machine.fpga();
        let world = |channel| device(fpga, channel).world();
        let volts = world(ANALOG).analog_output(1);
        [
            world(FIELD).output(3) == Some(true),
            volts.is_some_and(|volts| volts > 4.9),
            world(OUTPUTS).output(7) == Some(true),
        ]
    }

    /// Checks that events about the board, and about safe outputs, are true and complete.
    fn check(&mut self, kind: FaultKind) {
        let told = |kind| self.told.iter().filter(|told| **told == kind).count() as u32;
        let [resets, bites] = self.losses.seen();
        let is_down = told(EventKind::BusDown) > 0;
        // A board that was reset lets its watchdog bite with the next write, and the state of an
        // unreachable board is unknown.
        let expected = [resets, if resets > 0 || is_down { 0 } else { bites }];
        let found = [told(EventKind::BoardReset), told(EventKind::WatchdogBitten)];
        assert_eq!(found, expected, "{kind}: {:?}", self.told);
        let safe = |mask: EventMask| self.told.iter().any(|told| mask.contains(told.mask()));
        let board = EventMask::OUTPUTS_SAFE - EventMask::REMOTE_OFFLINE;
        let are_on = [FIELD, ANALOG, OUTPUTS].map(|channel| {
            let is_its = |told: &&EventKind| {
                told.remote()
                    .is_some_and(|remote| remote == RemoteId::new(0, channel as u8))
            };
            let mut its = self.told.iter().filter(is_its);
            !safe(board) && its.all(|told| told.mask() != EventMask::REMOTE_OFFLINE)
        });
        let told = self.told.clone();
        assert_eq!(self.on(), are_on, "{kind}: {told:?}");
    }

    /// Re-arms everything.
    pub fn rearm(&mut self) {
        self.machine.rearm_all(6000);
        self.machine
            .cards
            .set_one_of_each(self.machine.driver.pins_mut());
        self.run(5);
        assert_eq!(self.on(), [true; 3]);
    }

    /// Total of a count over the matching events, or the count of a repetition if that is larger.
    fn total(&self, count: impl Fn(&EventKind) -> u32, mask: EventMask) -> u32 {
        let of = |kind: &&EventKind| mask.contains(kind.mask());
        let told: u32 = self.told.iter().filter(of).map(count).sum();
        let all = self.told.iter().map(|kind| match kind {
            EventKind::Repeated { count, .. } => *count,
            _ => 0,
        });
        all.max().unwrap_or(0).max(told)
    }
}

/// Starts a fault, and ends it.
fn happen(story: &mut Story<Faulty<SimFpga>>, kind: FaultKind) {
    match kind.place() {
        FaultPlace::Bus => on_bus(story, kind),
        FaultPlace::Wire if spoiled(kind).is_some() => spoil(story, kind),
        _ => begin_and_end(story, kind, FAULTY),
    }
    story.run(QUIET);
}

/// Starts a fault of a remote, its wire, the FPGA or the host, and ends it after some cycles.
pub fn begin_and_end<B: World>(story: &mut Story<B>, kind: FaultKind, cycles: usize) {
    match kind {
        FaultKind::WireUnplugged | FaultKind::WireLow => {
            let cable = story.machine.cable(ANALOG);
            cable.set_low_when_unplugged(kind == FaultKind::WireLow);
            cable.unplug();
            story.run(cycles);
            story.machine.cable(ANALOG).replug();
        }
        FaultKind::WireSwapped => {
            let stranger = Cable::new(Box::new(Outputs48::i7i72().expect("a 7I72")), 3);
            let fpga = story.machine.fpga();
            let own = fpga.plug(0, FIELD, Some(Box::new(stranger)));
            story.run(20 * cycles);
            let _ = story.machine.fpga().plug(0, FIELD, own);
        }
        FaultKind::RemoteOverTemperature | FaultKind::RemoteOverCurrent => {
            for is_so in [true, false] {
                let device = story.machine.device_mut(FIELD);
                let done = if kind == FaultKind::RemoteOverCurrent {
                    device.set_over_current(3, is_so)
                } else {
                    device.set_over_temperature(3, is_so)
                };
                done.expect("an output");
                story.run(cycles);
            }
        }
        FaultKind::RemoteHighVoltage | FaultKind::RemoteLowVoltage => {
            let wrong = if kind == FaultKind::RemoteHighVoltage {
                36.0
            } else {
                3.0
            };
            for volts in [wrong, 24.0] {
                let now = story.machine.driver.bus_mut().now().as_nanos();
                let device = story.machine.device_mut(FIELD);
                device.set_field_volts(now, volts).expect("a supply");
                story.run(2 * cycles);
            }
        }
        FaultKind::RemoteWatchdog
        | FaultKind::RemoteNoEnable
        | FaultKind::RemoteIllegalMode
        | FaultKind::RemoteCommunication => {
            let bit = kind.fault_bit().expect("it has one");
            let remote = story.machine.fpga().device_mut::<FieldRemote>(0, FIELD);
            remote.expect("the field I/O").set_faults(bit);
        }
        FaultKind::RemotePowerOff | FaultKind::RemotePowerGlitch => {
            let now = story.machine.driver.bus_mut().now().as_nanos();
            story.machine.device_mut(FIELD).set_power(now, false);
            if kind == FaultKind::RemotePowerOff {
                story.run(cycles);
            }
            let now = story.machine.driver.bus_mut().now().as_nanos();
            story.machine.device_mut(FIELD).set_power(now, true);
        }
        FaultKind::FpgaReset => story.machine.driver.bus_mut().reset_for(0),
        FaultKind::FpgaResetLong => story.machine.driver.bus_mut().reset_for(2_500_000),
        // As it bites by itself: nothing is written for longer than its time.
        FaultKind::FpgaWatchdog => {
            for _ in 0..10 {
                let _ = story.machine.driver.read();
                story.machine.rest();
            }
        }
        FaultKind::FpgaPortStuck => story.machine.fpga().write_register(0x5B00, 0x3000),
        FaultKind::HostLate => story.machine.sleep(3),
        FaultKind::HostStall => story.machine.sleep(20),
        // No process is left to report anything.
        FaultKind::HostKilled => {}
        _ => unreachable!("it is a fault of another place: {kind}"),
    }
}

/// Repeats a fault of the bus several times, some cycles apart.
fn on_bus(story: &mut Story<Faulty<SimFpga>>, kind: FaultKind) {
    let next = story.machine.driver.bus().exchanges();
    let bus = story.machine.driver.bus_mut();
    for n in 0..u64::from(TIMES) {
        let (after, fault) = match kind {
            FaultKind::BusNoReply => (0, Fault::Executed(BusErrorKind::Late)),
            FaultKind::BusNotExecuted => (0, Fault::NotExecuted(BusErrorKind::Lost)),
            _ => (1, Fault::AckedButLost),
        };
        bus.fail_at(next + 20 * n + after, fault);
    }
}

/// The fault of a single reply.
pub const fn spoiled(kind: FaultKind) -> Option<WireFault> {
    Some(match kind {
        FaultKind::WireLost => WireFault::Lost,
        FaultKind::WireCorrupted => WireFault::Corrupted,
        FaultKind::WireShort => WireFault::Short(2),
        FaultKind::WireLong => WireFault::Long(2),
        FaultKind::WireLate => WireFault::Late(90_000),
        FaultKind::WireBreak => WireFault::Break,
        _ => return None,
    })
}

/// Spoils several replies, and looks at the number of failures.
fn spoil(story: &mut Story<Faulty<SimFpga>>, kind: FaultKind) {
    let fault = spoiled(kind).expect("a fault of a reply");
    spoil_replies(story, fault);
    let counts = story.machine.cable(ANALOG).counts(Toward::Fpga);
    assert_eq!(counts.bursts - counts.intact, u64::from(TIMES), "{fault:?}");
    story.run(QUIET);
    let failed = story.total(|_| 1, EventMask::TRANSFER_FAILED);
    // A late reply disturbs the following one.
    let each = 1 + u32::from(matches!(fault, WireFault::Late(_)));
    assert_eq!(failed, each * TIMES, "{fault:?}: {:?}", story.told);
}

/// Spoils several replies, some cycles apart.
pub fn spoil_replies<B: World>(story: &mut Story<B>, fault: WireFault) {
    for _ in 0..TIMES {
        let cable = story.machine.cable(ANALOG);
        assert!(cable.inject(Toward::Fpga, fault, 1));
        story.run(20);
    }
}

/// Compares all events of each fault, from its begin to the end of the re-arming, with the written
/// list. Every fault is checked, even after a failure of an earlier one.
fn all_is_as_written(
    list: &str,
    is_in: fn(FaultPlace) -> bool,
    tell: fn(FaultKind) -> Vec<EventKind>,
) {
    let kinds = FaultKind::ALL.iter().copied();
    let mut made = String::new();
    for kind in kinds.filter(|kind| is_in(kind.place())) {
        let told = std::panic::catch_unwind(|| tell(kind));
        made.extend([format!("# {kind}\n")]);
        let lines = match told {
            Ok(told) => told
                .iter()
                .map(|kind| kind.with_advice().to_string())
                .collect(),
            Err(_) => vec![String::from("not so: see above")],
        };
        made.extend(lines.iter().map(|line| format!("{line}\n")));
    }
    let written = Path::new(env!("CARGO_MANIFEST_DIR")).join("driver/events/by_fault");
    let written = fs::read_to_string(written.join(list)).unwrap_or_default();
    let other = Path::new(env!("CARGO_TARGET_TMPDIR")).join(list);
    fs::write(&other, &made).expect("a folder for it");
    assert_eq!(
        written,
        made,
        "{list} is another one than {}",
        other.display()
    );
}

#[test]
fn events_of_each_fault_are_what_happened_in_its_order() {
    let is_in = |place| place != FaultPlace::Network;
    all_is_as_written("faults.txt", is_in, |kind| {
        let mut story = Story::of(Machine::on(Faulty::new(fpga(), 7), |_| {}));
        happen(&mut story, kind);
        story.check(kind);
        let is_analog = kind.place() == FaultPlace::Wire && kind != FaultKind::WireSwapped;
        let target = RemoteId::new(0, if is_analog { ANALOG } else { FIELD } as u8);
        if matches!(kind.place(), FaultPlace::Wire | FaultPlace::Remote) {
            let mut of = story.told.iter().filter_map(EventKind::remote);
            assert!(of.all(|place| place == target), "{kind}: {:?}", story.told);
        }
        story.rearm();
        story.told
    });
}

#[test]
fn port_switched_off_and_on_has_events_for_each_remote() {
    let mut story = Story::of(Machine::on(Faulty::new(fpga(), 7), |_| {}));
    let run = story.machine.output::<bool>("sserial.port-0.run");
    let switch = |story: &mut Story<_>, on| {
        story.machine.driver.pins_mut().set(run, on);
        story.run(2 * FAULTY);
        let told = std::mem::take(&mut story.told);
        told.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let each =
        |what: &str| ["7i77.0.0", "7i77.0.1", "7i72.0.2"].map(|card| format!("{card}: {what}"));
    let off = each("card offline, outputs off until re-armed: the port is switched off");
    assert_eq!(switch(&mut story, false), off);
    assert_eq!(story.on(), [false; 3]);
    let back = each("card back, outputs off until re-armed");
    assert_eq!(switch(&mut story, true), back);
    assert_eq!(story.on(), [false; 3]);
    story.rearm();
}

#[test]
fn failures_not_reported_singly_are_an_event_at_driver_stop() {
    let mut story = Story::of(Machine::on(Faulty::new(fpga(), 7), |_| {}));
    assert!(
        story
            .machine
            .cable(ANALOG)
            .inject(Toward::Fpga, WireFault::Lost, 1)
    );
    story.run(20);
    assert!(
        story
            .machine
            .cable(ANALOG)
            .inject(Toward::Fpga, WireFault::Lost, 1)
    );
    story.run(20);
    assert_eq!(story.told.len(), 1, "{:?}", story.told);
    let Story {
        machine, events, ..
    } = story;
    let (driver, stopped) = machine.driver.stop();
    stopped.expect("the bus does not fail");
    assert_eq!(driver.board_state(), mesa_hal::BoardState::Running);
    let told: Vec<_> = events.map(|event| event.kind.to_string()).collect();
    let [told] = &told[..] else {
        panic!("{told:?}");
    };
    let said = "7i77.0.1: 2 failed transfers within 0.02";
    assert!(told.starts_with(said), "{told}");
}

/// For a minute, one packet in a hundred is lost, and replies of one remote are corrupted.
#[test]
fn one_percent_packet_loss_causes_few_events_with_all_counts() {
    let mut bus = Faulty::new(fpga(), 11);
    bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 0.0);
    let mut story = Story::of(Machine::on(bus, |s| s.bus_error_limit = 100));
    let bus = story.machine.driver.bus_mut();
    bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 0.01);
    bus.fail_randomly(Fault::AckedButLost, 0.01);
    let cable = story.machine.cable(OUTPUTS);
    assert!(cable.inject_by_chance(Toward::Fpga, WireFault::Corrupted, 0.005));
    story.run(60_000);
    let told: Vec<_> = story.told.iter().map(ToString::to_string).collect();
    assert!(told.len() < 12, "{told:#?}");
    story.machine.driver.bus_mut().heal();
    story.machine.cable(OUTPUTS).heal();
    story.run(QUIET);
    let counted = story.machine.driver.statistics();
    let of = |what: &str| {
        let sentences = story.told.iter().map(ToString::to_string);
        let mut lines = sentences.filter(|line| line.contains(what));
        let line = lines
            .next()
            .unwrap_or_else(|| panic!("{what}: {:#?}", story.told));
        assert_eq!(lines.next(), None, "{what}");
        let (before, _) = line.split_once(what).expect("a number before it");
        let number = before.trim_end().rsplit(' ').next();
        number.and_then(|n| n.parse::<u64>().ok())
    };
    assert_eq!(of("failed reads within"), Some(counted.read_errors));
    assert_eq!(of("failed writes within"), Some(counted.write_errors));
    assert_eq!(of("lost writes within"), Some(counted.lost_writes));
    assert!(
        counted.read_errors > 300 && counted.lost_writes > 300,
        "{counted:?}"
    );
    let damaged = story.machine.cable(OUTPUTS).counts(Toward::Fpga).corrupted;
    assert!(
        of("failed transfers within").is_some_and(|failed| failed >= damaged),
        "{damaged}"
    );
}
