mod absent;
mod age;

use alloc::vec;

use super::super::part::RemotePart;
use super::super::slot::RemoteSlot;
use super::super::{RemoteState, RemoteWatchdog};
use super::*;
use crate::bus::ImagePlan;
use crate::discovery::{PackingPlan, RemoteDescriptor};
use crate::events::EventSink;
use crate::hal::PinStore;
use crate::hostmot2::RemoteId;
use crate::remote::RemotePins;
use crate::sslbp::{
    COMMAND_IGNORED, Channel, ChannelRegisters, CsStatus, ProcessDataSizes, RemoteName,
    StartedRemote,
};

const RUNNING: u32 = 0x0042_0000;
const CHATTER: u32 = 0x003A_0000;
const STOPPED: u32 = 0x0000_C100;

/// FACTS 2.3.
const PARAMETERS: PortParameters = PortParameters {
    major: 1,
    minor: 43,
    variables_start: 0x70,
    variables_stride: 0x32,
    clock_hz: 100_000_000,
};

/// The interface registers of the remote on a channel after START.
fn told(channel: u8) -> [u32; 3] {
    [0x7700 + u32::from(channel), 0x3737_4937, 0x04A4_049A]
}

/// The remote as START leaves it.
fn started(channel: Channel) -> StartedRemote {
    let [unit_number, name, tables] = told(channel.index());
    StartedRemote {
        channel,
        software_mode: 0,
        unit_number,
        name: RemoteName::from_register(name),
        ptoc: tables as u16,
        gtoc: (tables >> 16) as u16,
        sizes: ProcessDataSizes { rx: 5, tx: 2 },
        cs: CsStatus(CHATTER),
    }
}

/// The registers that a machine reads.
#[derive(Default)]
struct Registers {
    command: u32,
    data: u32,
    cs: [u32; 8],
    start: [[u32; 3]; 8],
}

impl PortImage for Registers {
    fn command(&self) -> u32 {
        self.command
    }

    fn data(&self) -> u32 {
        self.data
    }

    fn cs(&self, channel: Channel) -> u32 {
        self.cs[usize::from(channel.index())]
    }

    fn interfaces(&self, channel: Channel) -> [u32; 3] {
        self.start[usize::from(channel.index())]
    }
}

/// A remote that runs, whose process data has no pins.
fn remote(started: StartedRemote) -> Remote {
    let (mut pins, mut image) = (PinStore::default(), ImagePlan::default());
    let group = pins.add_group();
    let (channel, descriptor) = (started.channel, RemoteDescriptor::default());
    let id = RemoteId::new(0, channel.index());
    let plan = PackingPlan::default();
    let found = RemotePart {
        pins: RemotePins::new(&mut pins, "hm2_7i92.0", id, &descriptor, &plan, None).unwrap(),
        started,
        descriptor,
        offline: None,
    };
    let (registers, at) = (ChannelRegisters::usual(channel), Instant::default());
    let slot = RemoteSlot::register(&mut image, &mut pins, group, found, registers, at).unwrap();
    Remote::new(
        started,
        RemoteWatchdog::Assumed,
        slot,
        &FaultPolicy::default(),
    )
}

/// A port with remotes on channels 0 and 1 that have just been started.
struct Rig {
    machine: PortMachine,
    remotes: Remotes,
    schedule: Schedule,
    seen: Registers,
    now: Instant,
}

impl Rig {
    fn new() -> Self {
        let [zero, one, ..] = Channel::ALL.map(started);
        Self::with(vec![remote(zero), remote(one)])
    }

    /// With these remotes, of which those that run have just been started.
    fn with(remotes: Vec<Remote>) -> Self {
        let now = Instant::default();
        let mut rig = Self {
            machine: PortMachine::new(ChannelMask::first(8)),
            remotes: Remotes::new(remotes, EventSink::new("", 31), FaultPolicy::default()),
            schedule: Schedule::new(PARAMETERS, &FaultPolicy::default(), now),
            seen: Registers {
                cs: [CHATTER; 8],
                start: [0, 1, 2, 3, 4, 5, 6, 7].map(told),
                ..Registers::default()
            },
            now,
        };
        rig.read();
        let running = rig.remotes.running();
        rig.machine
            .begin(PortOperation::Start(StartMode::Normal, running));
        rig.machine.written(rig.now, true);
        rig.read();
        rig.seen.cs = [RUNNING; 8];
        rig
    }

    fn read(&mut self) -> ReadOutcome {
        self.read_with(true)
    }

    fn read_with(&mut self, certain: bool) -> ReadOutcome {
        self.now = self.now.after(Duration::from_millis(1));
        let machine = &mut self.machine;
        let remotes = &mut self.remotes;
        self.schedule
            .observe(machine, remotes, self.now, &self.seen, certain)
    }

    fn write(&mut self) -> u32 {
        let next = self
            .schedule
            .next(&mut self.machine, &mut self.remotes, self.now, false);
        self.machine.written(self.now, true);
        next.map_or(COMMAND_IGNORED, |operation| operation.command())
    }

    fn state(&self, channel: Channel) -> RemoteState {
        let remote = self.remotes.get(channel).expect("a remote");
        remote.life.state()
    }

    /// Changes one remote.
    fn change(&mut self, channel: Channel, change: impl Fn(&mut Remote)) {
        self.remotes.change(channel.mask(), self.now, |remote, _| {
            change(remote);
            LifeChange::default()
        });
    }

    /// One cycle without faults. Returns the word that was written.
    fn cycle(&mut self) -> u32 {
        self.read();
        self.write()
    }

    fn channel_1_goes_offline(&mut self) {
        self.write();
        self.seen.cs[1] = STOPPED;
        let outcome = self.read();
        assert_eq!(outcome.offline.bits(), 2);
    }

    /// Runs cycles until another command than a DOIT is written.
    fn until_not_doit(&mut self) -> u32 {
        for _ in 0..10_000 {
            let word = self.cycle();
            if word & 0xF000 != 0x1000 {
                return word;
            }
        }
        panic!("only DOITs");
    }
}

#[test]
fn transfers_follow_each_other_and_their_data_is_taken_once() {
    let mut rig = Rig::new();
    assert_eq!(rig.write(), 0x1003);
    assert_eq!(rig.read().good.bits(), 3);
    assert_eq!(
        rig.read(),
        ReadOutcome::default(),
        "no new transfer, no news"
    );
    assert_eq!(rig.write(), 0x1003);
}

#[test]
fn no_command_is_written_while_command_is_busy_or_unknown() {
    let mut rig = Rig::new();
    rig.write();
    assert_eq!(rig.write(), 0x8000_0000, "written twice without a read");
    rig.seen.command = 0x1003;
    assert!(rig.read().too_short);
    assert_eq!(rig.write(), 0x8000_0000);
    rig.machine.not_observed();
    assert_eq!(rig.write(), 0x8000_0000, "the read failed");
    rig.seen.command = 0;
    assert_eq!(
        rig.read().good.bits(),
        3,
        "the same transfer, a little late"
    );
    assert_eq!(rig.schedule.statistics.too_short, 1);
    assert_eq!(rig.write(), 0x1003);
}

#[test]
fn old_data_is_not_taken_for_new_when_the_bus_lost_the_doit() {
    let mut rig = Rig::new();
    rig.write();
    let outcome = rig.read_with(false);
    assert_eq!((outcome.good, outcome.failed), Default::default());
    assert_eq!(rig.schedule.statistics.unknown, 1);
    rig.write();
    let outcome = rig.read();
    let nothing = (outcome.good, outcome.failed);
    assert_eq!(nothing, Default::default(), "the one after is discarded");
    rig.write();
    assert_eq!(rig.read().good.bits(), 3);
}

#[test]
fn transfer_that_was_in_doubt_while_busy_stays_so() {
    let mut rig = Rig::new();
    rig.write();
    rig.seen.command = 1;
    assert!(rig.read_with(false).too_short);
    rig.seen.command = 0;
    let outcome = rig.read();
    assert_eq!((outcome.good, outcome.failed), Default::default());
    assert_eq!(rig.schedule.statistics.unknown, 1);
}

#[test]
fn write_that_failed_is_treated_as_one_that_may_have_happened() {
    let mut rig = Rig::new();
    rig.schedule
        .next(&mut rig.machine, &mut rig.remotes, rig.now, false);
    rig.machine.written(rig.now, false);
    let outcome = rig.read();
    assert_eq!((outcome.good, outcome.failed), Default::default());
    assert_eq!(rig.schedule.statistics.unknown, 1);
}

#[test]
fn twenty_cycles_without_data_take_only_that_remote_offline() {
    let mut rig = Rig::new();
    rig.seen.data = 2;
    rig.seen.cs[1] = 0x0042_2008;
    for n in 1..=11 {
        assert_eq!(rig.write(), 0x1003);
        let outcome = rig.read();
        assert_eq!(outcome.good.bits(), 1);
        assert_eq!(outcome.offline.bits(), if n == 11 { 2 } else { 0 });
        assert_eq!(rig.write(), 0x1001, "its line has to be idle for a while");
        assert_eq!(rig.read().good.bits(), 1);
    }
    assert_eq!(rig.write(), 0x1001, "it is no longer asked");
    assert!(matches!(
        rig.state(Channel::ALL[1]),
        RemoteState::Offline {
            reason: OfflineReason::TooManyFailures(Failure::NoReply),
            next_attempt: Some(_)
        }
    ));
}

/// The outputs are safe from the call on; a good transfer could arm a valid group again.
#[test]
fn transfer_in_flight_is_no_news_of_a_remote_that_is_to_restart() {
    for trouble in [0, 1] {
        let mut rig = Rig::new();
        rig.change(Channel::ALL[0], |remote| remote.failures.set_count(trouble));
        rig.write();
        rig.remotes
            .change(Channel::ALL[1].mask(), rig.now, Remote::ask_for_restart);
        assert_eq!(rig.read().good.bits(), 1);
        assert_eq!(rig.write(), 0x0802);
    }
}

/// With a fault in that transfer, the outputs are off before the START that clears it. There is
/// only one START, because nothing else would try again.
#[test]
fn requested_restart_follows_any_result_of_the_current_transfer() {
    for (cs, at_least) in [(0x0842_2140, 60), (0x0142_2140, 0), (STOPPED, 60)] {
        let mut rig = Rig::new();
        rig.remotes.policy.automatic = false;
        rig.cycle();
        rig.cycle();
        rig.remotes
            .change(Channel::ALL[1].mask(), rig.now, Remote::ask_for_restart);
        rig.seen.cs[1] = cs;
        let asked = rig.now;
        assert_eq!(rig.until_not_doit(), 0x0802, "{cs:08X}");
        let took = rig.now.since(asked).as_millis();
        assert!((at_least..=62).contains(&took), "{cs:08X}: {took} ms");
    }
}

/// FACTS 5.7: 08NN, then 09NN; the other remote gets a transfer in between.
#[test]
fn remote_comes_back_in_small_steps() {
    let mut rig = Rig::new();
    rig.channel_1_goes_offline();
    assert_eq!(rig.until_not_doit(), 0x0802);
    assert_eq!(rig.cycle(), 0x1001, "the other is served before the START");
    rig.seen.cs[1] = STOPPED;
    rig.read();
    assert_eq!(rig.write(), 0x0902);
    assert!(rig.schedule.needs_start_data());
    rig.seen.command = 0x0902;
    for _ in 0..3 {
        assert_eq!(rig.cycle(), 0x8000_0000);
    }
    assert_eq!(
        rig.schedule.statistics.too_short, 0,
        "START may take that long"
    );
    rig.seen.command = 0;
    rig.seen.cs[1] = CHATTER;
    let outcome = rig.read();
    let started = ReadOutcome {
        started_anew: ChannelMask::from_bits(0b10),
        ..ReadOutcome::default()
    };
    assert_eq!(outcome, started, "unit numbers are not inputs");
    assert_eq!(rig.write(), 0x1003);
    rig.seen.cs[1] = RUNNING;
    assert_eq!(rig.read().good.bits(), 3);
}

#[test]
fn another_device_on_the_channel_is_not_taken_over() {
    for change in [0, 1, 2] {
        let mut rig = Rig::new();
        rig.channel_1_goes_offline();
        rig.until_not_doit();
        rig.seen.cs[1] = STOPPED;
        rig.cycle();
        assert_eq!(rig.cycle(), 0x0902);
        rig.seen.cs[1] = CHATTER;
        rig.seen.start[1][change] ^= 1;
        rig.read();
        let state = rig.state(Channel::ALL[1]);
        let RemoteState::Offline { reason, .. } = state else {
            panic!("{state:?}");
        };
        assert!(reason.is_about_identity(), "{reason}");
        assert_eq!(rig.write(), 0x1001);
    }
}

#[test]
fn absent_remote_is_tried_less_and_less_often() {
    let mut rig = Rig::new();
    rig.channel_1_goes_offline();
    let mut attempts = Vec::new();
    while rig.now < Instant::from_nanos(20_000_000_000) {
        rig.seen.cs[1] = STOPPED;
        if rig.cycle() == 0x0902 {
            attempts.push(rig.now.as_nanos() / 1_000_000);
            rig.seen.cs[1] = 0x0001_E188;
            rig.seen.data = 2;
            rig.cycle();
            rig.seen.data = 0;
        }
    }
    let waits: Vec<_> = attempts.windows(2).map(|w| (w[1] - w[0]) / 100).collect();
    assert_eq!(waits, [2, 4, 8, 16, 32, 50, 50]);
}

#[test]
fn bitten_watchdog_restarts_the_remote_at_once() {
    let mut rig = Rig::new();
    rig.write();
    rig.seen.cs[1] = 0x0142_2140;
    let outcome = rig.read();
    assert_eq!((outcome.good.bits(), outcome.offline.bits()), (1, 2));
    assert_eq!(rig.write(), 0x0802);
}

/// The outputs stay on as long as any frame reaches the remote; its watchdog takes 50 ms.
#[test]
fn remote_with_any_other_fault_gets_no_frame_for_60_ms() {
    for bit in 1..8 {
        let mut rig = Rig::new();
        rig.write();
        rig.seen.cs[1] = 0x0042_2140 | 1 << (24 + bit);
        let outcome = rig.read();
        assert_eq!((outcome.good.bits(), outcome.offline.bits()), (1, 2));
        let told = rig.now;
        assert_eq!(rig.write(), 0x1001);
        // A request of the application does not shorten the silence.
        rig.remotes
            .change(Channel::ALL[1].mask(), rig.now, Remote::ask_for_restart);
        assert_eq!(rig.until_not_doit(), 0x0802);
        assert_eq!(rig.now.since(told), Duration::from_millis(60), "bit {bit}");
    }
}

#[test]
fn silence_follows_the_watchdog_of_the_remote() {
    for (millis, silent) in [(0, 0), (20, 24), (50, 60), (200, 240), (1000, 1200)] {
        let mut rig = Rig::new();
        rig.change(Channel::ALL[1], |remote| {
            remote.watchdog = RemoteWatchdog::longer_of(millis, millis);
        });
        rig.write();
        rig.seen.cs[1] = 0x0842_2140;
        rig.read();
        let told = rig.now;
        let word = rig.write();
        let word = if word == 0x0802 {
            word
        } else {
            rig.until_not_doit()
        };
        assert_eq!(word, 0x0802);
        let waited = rig.now.since(told).as_millis();
        assert_eq!(waited, silent, "watchdog of {millis} ms");
    }
}

/// A remote that reports its fault again after each START is tried less and less often.
#[test]
fn remote_with_a_recurring_fault_is_restarted_ever_less_often() {
    let mut rig = Rig::new();
    let mut attempts = Vec::new();
    rig.seen.cs[1] = 0x0842_2140;
    while rig.now < Instant::from_nanos(60_000_000_000) {
        match rig.cycle() {
            0x0802 => rig.seen.cs[1] = STOPPED,
            0x0902 => {
                attempts.push(rig.now.as_nanos() / 1_000_000);
                rig.seen.cs[1] = CHATTER;
            }
            0x1003 => rig.seen.cs[1] = 0x0842_2140,
            _ => {}
        }
    }
    assert!(attempts.len() < 20, "{attempts:?}");
    assert_eq!(rig.schedule.statistics.starts, attempts.len() as u64);
}

#[test]
fn pauses_grow_also_for_a_remote_that_was_healthy_before() {
    let mut rig = Rig::new();
    for _ in 0..2000 {
        rig.cycle();
    }
    rig.channel_1_goes_offline();
    let offline = rig.now;
    let mut starts = 0;
    while rig.now.since(offline) < Duration::from_secs(60) {
        rig.seen.cs[1] = STOPPED;
        if rig.cycle() == 0x0902 {
            starts += 1;
            rig.seen.cs[1] = 0x0001_E188;
            rig.seen.data = 2;
            rig.cycle();
            rig.seen.data = 0;
        }
    }
    assert!((10..18).contains(&starts), "{starts}");
}

#[test]
fn inputs_without_field_power_are_dropped_and_remote_is_retried() {
    let mut rig = Rig::new();
    rig.write();
    rig.seen.cs[1] = 0x2042_2140;
    let outcome = rig.read();
    assert_eq!((outcome.good.bits(), outcome.offline.bits()), (1, 2));
    let before = rig.now;
    assert_eq!(rig.until_not_doit(), 0x0802);
    assert_eq!(rig.now.since(before), Duration::from_millis(100));
}

#[test]
fn stuck_command_is_freed_by_the_one_safe_way_out() {
    let mut rig = Rig::new();
    rig.write();
    rig.seen.command = 0x1003;
    let mut cycles = 0;
    while rig.cycle() == 0x8000_0000 {
        cycles += 1;
    }
    assert_eq!(cycles, 20);
    assert_eq!(rig.schedule.statistics.stuck, 1);
    rig.seen.command = 0;
    assert_eq!(
        rig.read().offline.bits(),
        3,
        "it is not known what was sent"
    );
    assert_eq!(rig.write(), 0x8000_0000);
    assert_eq!(
        rig.until_not_stopped(),
        0x0803,
        "both are restarted together"
    );
}

impl Rig {
    fn until_not_stopped(&mut self) -> u32 {
        for _ in 0..1000 {
            let word = self.cycle();
            if word != 0x8000_0000 {
                return word;
            }
        }
        panic!("nothing is written");
    }
}

#[test]
fn disabled_port_sends_safe_values_stops_and_starts_again() {
    let mut rig = Rig::new();
    rig.schedule.run = false;
    assert_eq!(rig.write(), 0x1003, "with safe values");
    rig.read();
    assert_eq!(rig.write(), 0x0803);
    rig.seen.cs = [STOPPED; 8];
    rig.read();
    assert_eq!(rig.write(), 0x8000_0000);
    rig.schedule.run = true;
    assert_eq!(rig.cycle(), 0x0803);
    assert_eq!(rig.cycle(), 0x0903);
}

/// A STOP after a lost transfer leaves outputs on until the remotes' own watchdogs bite.
#[test]
fn disabled_port_repeats_the_safe_values_until_they_arrive() {
    let mut rig = Rig::new();
    rig.schedule.run = false;
    assert_eq!(rig.write(), 0x1003, "with safe values");
    for _ in 0..3 {
        rig.read_with(false);
        assert_eq!(rig.write(), 0x1003, "once more, because it may be lost");
    }
    rig.read();
    assert_eq!(rig.write(), 0x0803);
}

#[test]
fn disabled_port_stops_even_if_every_transfer_is_in_doubt() {
    let mut rig = Rig::new();
    rig.schedule.run = false;
    let mut transfers = 0;
    while rig.write() == 0x1003 {
        transfers += 1;
        assert!(transfers < 20, "no end");
        rig.read_with(false);
    }
    assert_eq!(transfers, 10);
}
