//! Remotes that were absent at the start.

use super::*;

const TWO: Channel = Channel::ALL[2];
const SIZES: ProcessDataSizes = ProcessDataSizes { rx: 5, tx: 2 };

impl Rig {
    /// With a third remote that is absent at the start, of a known kind.
    fn with_absent() -> Self {
        let [unit_number, name, tables] = told(2);
        let kind = StartedRemote {
            unit_number: unit_number & 0xFF00_0000 | 0x1200_0000,
            ..started(TWO)
        };
        let mut absent = remote(kind);
        let at = ChangeContext {
            now: Instant::default(),
            policy: &FaultPolicy::default(),
            events: &EventSink::new("", 1),
        };
        let _ = absent.not_started(at, OfflineReason::Absent);
        let [zero, one, ..] = Channel::ALL.map(started);
        let mut rig = Self::with(vec![remote(zero), remote(one), absent]);
        rig.machine.set_sizes(&kind);
        rig.seen.cs[2] = STOPPED;
        rig.seen.start[2] = [0x1200_0000 | unit_number, name, tables];
        rig
    }

    /// Runs cycles until the START of channel 2, which finds `cs` and `sizes`; returns the state
    /// afterwards.
    fn attempt(&mut self, cs: u32, sizes: ProcessDataSizes) -> RemoteState {
        while self.cycle() != 0x0904 {}
        self.seen.cs[2] = cs;
        let mut asked = Vec::new();
        loop {
            let word = self.cycle();
            match word {
                // The channel variables of channel 2 begin at 0x70 + 2 * 0x32 (FACTS 2.4).
                0x2102 => self.seen.data = sizes.rx.into(),
                0x2103 => self.seen.data = sizes.tx.into(),
                _ => break,
            }
            asked.push(word);
        }
        self.seen.data = 0;
        let is_there = cs == CHATTER;
        assert!(asked.is_empty() || is_there && asked == [0x2102, 0x2103]);
        self.seen.cs[2] = RUNNING;
        self.state(TWO)
    }
}

/// A remote that was absent at the start runs when it is plugged in, with its next attempt.
#[test]
fn remote_absent_at_start_runs_when_plugged_in() {
    let mut rig = Rig::with_absent();
    for _ in 0..3 {
        let state = rig.attempt(0x0001_E188, SIZES);
        let absent = matches!(
            state,
            RemoteState::Offline {
                reason: OfflineReason::Absent,
                next_attempt: Some(_)
            }
        );
        assert!(absent, "{state:?}");
        rig.seen.cs[2] = STOPPED;
    }
    assert_eq!(rig.attempt(CHATTER, SIZES), RemoteState::Running);
    rig.write();
    assert_eq!(rig.read().good.bits(), 7);
    // The identity is now fixed: another remote of its kind is another device.
    rig.seen.cs[2] = STOPPED;
    rig.write();
    rig.read();
    let state = rig.state(TWO);
    let is_new = matches!(
        state,
        RemoteState::Offline {
            reason: OfflineReason::NotRunning(_),
            ..
        }
    );
    assert!(is_new, "it is absent no more: {state:?}");
    rig.seen.start[2][0] ^= 1;
    let state = rig.attempt(CHATTER, SIZES);
    assert!(
        matches!(
            state,
            RemoteState::Offline {
                reason: OfflineReason::AnotherDevice { .. },
                ..
            }
        ),
        "{state:?}"
    );
}

#[test]
fn other_device_in_place_of_an_absent_remote_is_not_adopted() {
    let larger = ProcessDataSizes { rx: 9, tx: 2 };
    let changes: [(usize, u32, ProcessDataSizes); 4] = [
        (0, 0x0100_0000, SIZES),
        (1, 1, SIZES),
        (2, 0x0002_0000, SIZES),
        (0, 0, larger),
    ];
    for (register, bits, sizes) in changes {
        let mut rig = Rig::with_absent();
        rig.seen.start[2][register] ^= bits;
        let state = rig.attempt(CHATTER, sizes);
        let RemoteState::Offline { reason, .. } = state else {
            panic!("{state:?}");
        };
        assert!(reason.is_about_identity(), "{reason}");
        rig.read();
        assert_eq!(rig.write(), 0x1003, "it gets no transfer");
    }
    let mut rig = Rig::with_absent();
    rig.seen.start[2][0] ^= 0x0012_3456;
    assert_eq!(
        rig.attempt(CHATTER, SIZES),
        RemoteState::Running,
        "any one of its class"
    );
}

/// The sizes are read again when the reply may belong to another read.
#[test]
fn size_is_not_taken_from_a_read_that_may_be_lost() {
    let mut rig = Rig::with_absent();
    while rig.cycle() != 0x0904 {}
    rig.seen.cs[2] = CHATTER;
    assert_eq!(rig.cycle(), 0x2102);
    rig.seen.data = 0xAA;
    rig.read_with(false);
    assert_eq!(rig.write(), 0x2102, "once more");
    rig.seen.data = SIZES.rx.into();
    assert_eq!(rig.cycle(), 0x2103);
    rig.seen.data = SIZES.tx.into();
    rig.read();
    assert!(rig.state(TWO) == RemoteState::Running);
}

#[test]
fn reset_is_detected_by_the_remotes_that_have_run() {
    let mut rig = Rig::with_absent();
    assert_eq!(rig.schedule.appears_reset(&rig.remotes), Some(false));
    rig.write();
    rig.seen.cs = [STOPPED; 8];
    rig.read();
    assert_eq!(rig.schedule.appears_reset(&rig.remotes), Some(true));
    let none = Remotes::new(Vec::new(), EventSink::new("", 1), FaultPolicy::default());
    assert_eq!(rig.schedule.appears_reset(&none), None);
}
