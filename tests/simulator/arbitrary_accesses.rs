//! Arbitrary writes of a driver at arbitrary times: the simulated FPGA goes on, and is
//! reproducible.

use mesa_hal::bus::{Access, BusError, BusErrorKind, RegisterBus};
use mesa_hal_sim::remote::{FixedData, SimRemote};
use mesa_hal_sim::{AxisWiring, DriveSource, Motor, SimFpga, machines};
use proptest::prelude::*;

#[derive(Clone, Debug)]
enum Step {
    Read(u16),
    Write(u16, u32),
    Wait(u32),
    Input(usize, bool),
    Drive(usize, Option<bool>),
    Turn(usize, f64),
    Unplug(usize),
}

/// Addresses near registers, mostly.
fn address() -> impl Strategy<Value = u16> {
    let bases: &[u16] = &[
        0x0C00, 0x0D00, 0x0E00, 0x1000, 0x1100, 0x1200, 0x1300, 0x1400, 0x3600, 0x3700, 0x3800,
        0x3A00, 0x4100, 0x4200, 0x4300, 0x4500, 0x5B00, 0x5C00, 0x5D00, 0x5E00, 0x6000, 0x7000,
        0x7200, 0x7300, 0x7600, 0x7D00, 0x7E00, 0x8000, 0x8100, 0x8400,
    ];
    prop_oneof![
        8 => (prop::sample::select(bases), 0u16..8).prop_map(|(base, n)| base + 4 * n),
        1 => any::<u16>().prop_map(|address| address & !3),
    ]
}

fn value() -> impl Strategy<Value = u32> {
    prop_oneof![
        any::<u32>(),
        (0u32..32).prop_map(|bit| 1 << bit),
        Just(0),
        Just(u32::MAX),
        (0u32..0x1_0000),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => address().prop_map(Step::Read),
        6 => (address(), value()).prop_map(|(address, value)| Step::Write(address, value)),
        2 => (0u32..3_000_000).prop_map(Step::Wait),
        1 => (0usize..40, any::<bool>()).prop_map(|(n, on)| Step::Input(n, on)),
        1 => (0usize..60, any::<Option<bool>>()).prop_map(|(n, level)| Step::Drive(n, level)),
        1 => (0usize..7, -1e7..1e7).prop_map(|(n, speed)| Step::Turn(n, speed)),
        1 => (0usize..9).prop_map(Step::Unplug),
    ]
}

fn machine() -> SimFpga {
    let mut fpga = machines::i7i97(3);
    for channel in 0..3 {
        let mut remote = SimRemote::<FixedData>::model();
        remote
            .apply("present=1 name=TEST unit=1 mode0=5,2,0,0")
            .expect("model");
        fpga.plug(0, channel, Some(Box::new(remote)));
    }
    for unit in 0..6 {
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Pwm { unit },
            encoder: unit,
            motor: Motor::default(),
        });
    }
    fpga
}

/// Plays the steps; returns the words read.
fn play(steps: &[Step]) -> Vec<u32> {
    let mut fpga = machine();
    let mut seen = Vec::new();
    for step in steps {
        match *step {
            Step::Read(address) => seen.push(fpga.read(address).expect("aligned")),
            Step::Write(address, value) => fpga.write(address, value).expect("aligned"),
            Step::Wait(nanos) => {
                let to = SimFpga::now(&fpga) + u64::from(nanos);
                fpga.advance_to(to);
            }
            Step::Input(n, on) => fpga.set_input(n, on),
            Step::Drive(n, level) => fpga.drive_pin(n, level),
            Step::Turn(axis, speed) => {
                if let Some(motor) = fpga.motor(axis) {
                    motor.turn_by_hand(Some(speed));
                }
            }
            Step::Unplug(channel) => drop(fpga.plug(0, channel, None)),
        }
    }
    for address in (0..=0xFFFC).step_by(4) {
        seen.push(fpga.read_register(address));
    }
    seen
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_sequence_ends_and_is_the_same_twice(steps in prop::collection::vec(step(), 1..80)) {
        prop_assert_eq!(play(&steps), play(&steps));
    }

    #[test]
    fn access_list_runs_whole_or_not_at_all(
        lists in prop::collection::vec((any::<u16>(), 0u16..40, 0u16..40, any::<bool>()), 1..4),
        len in 0usize..64,
    ) {
        let accesses: Vec<Access> = lists
            .iter()
            .map(|&(address, first, count, write)| if write {
                Access::write(address, first, count)
            } else {
                Access::read(address, first, count)
            })
            .collect();
        let mut fpga = machine();
        let before = vec![0x5555_5555; len];
        let mut words = before.clone();
        let sound = accesses.iter().all(|access| {
            access.address % 4 == 0
                && usize::from(access.address) + 4 * usize::from(access.count) <= 0x1_0000
                && access.words().end <= len
        });
        match fpga.exchange(&accesses, &mut words) {
            Ok(()) => prop_assert!(sound),
            Err(error) => {
                let kind = error.kind();
                prop_assert!(!sound);
                prop_assert_eq!(kind, BusErrorKind::Invalid);
                prop_assert_eq!(words, before);
                prop_assert_eq!(fpga.counters().reads + fpga.counters().writes, 0);
            }
        }
    }
}

#[test]
fn errors_name_the_access() {
    let mut fpga = machine();
    let beyond = [Access::read(0xFFFC, 0, 2)];
    let error = fpga.exchange(&beyond, &mut [0; 2]).expect_err("too long");
    assert_eq!(
        error,
        BusError::BadAccess {
            access: beyond[0],
            words: 2
        }
    );
    assert!(error.to_string().contains("0xFFFC"));
    let error = fpga.read(0x0102).expect_err("misaligned");
    assert_eq!(
        error,
        BusError::BadAccess {
            access: Access::read(0x0102, 0, 1),
            words: 1
        }
    );
}
