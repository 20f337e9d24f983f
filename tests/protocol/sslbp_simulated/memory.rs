//! The memory of simulated remotes, over the wire.

use super::*;
use mesa_hal::lbp::RemoteLinkErrorKind;
use mesa_hal::{MesaError, advice};

/// Manual: 7I77, "DISCOVERY SEQUENCE"; the memory of transcript t03 in all four modes.
#[test]
fn discovery_over_the_wire_is_the_same_as_from_the_image() {
    let (mut fpga, mut port) = machine();
    for mode in 0..4 {
        let before = fpga.counters();
        let found = found(&mut port, &mut fpga, start(ZERO, mode));
        let mut image = Image::recorded("t03_setup_one", 0);
        let expected = discover(&mut image, &found.started, 3, &DiscoveryOptions::default());
        assert_eq!(found, expected);
        assert_eq!(found.problems, []);
        let after = fpga.counters();
        println!(
            "mode {mode}: {} accesses to the remote, {} register reads and {} writes in all",
            found.accesses,
            after.reads - before.reads,
            after.writes - before.writes,
        );
    }
}

#[test]
fn absent_or_broken_remotes_do_not_hide_the_others() {
    let (mut fpga, mut port) = machine();
    fpga.plug(
        0,
        2,
        Some(Box::new(model("present=1 name=NONE unit=3 cookie=0xA5"))),
    );
    let starts = [0, 1, 2].map(|n| start(Channel::ALL[n], 0));
    let options = DiscoveryOptions::default();
    let found = discover_port(&mut port, &mut fpga, &starts, &options).unwrap();
    let outcomes: Vec<_> = found
        .iter()
        .map(|found| match found {
            Ok(found) => (found.started.channel, None),
            Err(failure) => (failure.channel, Some(failure.reason)),
        })
        .collect();
    assert_eq!(
        outcomes,
        [
            (ZERO, None),
            (ONE, Some(StartFailureReason::NoReply)),
            (Channel::ALL[2], Some(StartFailureReason::WrongCookie)),
        ]
    );
}

/// A lost reply costs time and nothing else; one that never arrives ends the walk.
#[test]
fn lost_replies_during_discovery_are_asked_for_again() {
    let (mut fpga, mut port) = machine();
    port.on(&mut fpga).stop_all().unwrap();
    let report = port
        .on(&mut fpga)
        .start(StartMode::Setup, &[start(ZERO, 1)])
        .unwrap();
    let started = report[0].unwrap();
    let options = DiscoveryOptions::default();
    for fault in ["drop=1", "badcrc=1", "extra=1", "short=1"] {
        remote(&mut fpga).apply(fault).unwrap();
        let found = discover(&mut memory(&mut port, &mut fpga), &started, 3, &options);
        assert_eq!(found.problems, [], "{fault}");
        assert_eq!(found.descriptor.process_data.len(), 6, "{fault}");
    }
    remote(&mut fpga).apply("drop=100000").unwrap();
    let found = discover(&mut memory(&mut port, &mut fpga), &started, 3, &options);
    assert!(matches!(
        found.problems[0].kind,
        ProblemKind::ReadFailed { address: 0x5C0 }
    ));
    let error = found.read_error.unwrap();
    assert!(
        error.contains("channel 0: read of 1 byte at 0x05"),
        "{error}"
    );
}

/// FACTS 6.3, 8.2: a parameter by name, kept over a power cycle.
#[test]
fn nonvolatile_parameter_survives_a_power_cycle() {
    let (mut fpga, mut port) = machine();
    let descriptor = found(&mut port, &mut fpga, start(ZERO, 0)).descriptor;
    let watchdog = descriptor.parameter("NVWatchDogTime").unwrap();
    let read = |port: &mut Port, fpga: &mut SimFpga| {
        watchdog.read_parameter(&mut memory(port, fpga)).unwrap()
    };
    assert_eq!(read(&mut port, &mut fpga).raw, 50);
    let written = watchdog.write_parameter(&mut memory(&mut port, &mut fpga), 120.0);
    assert_eq!(written, Ok(()));
    for value in [1e6, f64::NAN] {
        let refused = watchdog.write_parameter(&mut memory(&mut port, &mut fpga), value);
        assert!(refused.is_err(), "{value}");
    }
    assert_eq!(read(&mut port, &mut fpga).raw, 120);

    let now = fpga.now();
    remote(&mut fpga).set_power(now, false);
    fpga.wait(Duration::from_millis(500));
    let now = fpga.now();
    remote(&mut fpga).set_power(now, true);
    fpga.wait(Duration::from_millis(500));
    let _ = found(&mut port, &mut fpga, start(ZERO, 0));
    assert_eq!(read(&mut port, &mut fpga).raw, 120);

    let unit = descriptor.parameter("UnitNumber").unwrap();
    let mut memory = memory(&mut port, &mut fpga);
    assert_eq!(unit.read_parameter(&mut memory).unwrap().raw, 0x77AA);
    assert!(unit.write_parameter(&mut memory, 1.0).is_err());
}

/// A remote that dies in the middle of a non-volatile access: the error reports that the selection
/// could not be reverted.
#[test]
fn selection_of_nonvolatile_memory_that_stays_is_an_error() {
    let (mut fpga, mut port) = machine();
    port.on(&mut fpga)
        .start(StartMode::Setup, &[start(ZERO, 0)])
        .unwrap();
    remote(&mut fpga).apply("drop=100000").unwrap();
    let memory = NonvolatileMemory::Eeprom;
    let result = super::memory(&mut port, &mut fpga).access(
        Some(memory),
        RemoteAccess::Read {
            address: 0x24,
            size: AccessSize::Word,
        },
    );
    let error = result.unwrap_err();
    assert_eq!(error.kind(), RemoteLinkErrorKind::StillSelected);
    assert_eq!(error.advice(), Some(advice::POWER_CYCLE_BEFORE_WRITING));
    assert!(error.to_string().contains("channel 0"), "{error}");
}
