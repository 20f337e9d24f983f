//! Recorded failures are reproduced.

use super::*;
use mesa_hal::sslbp::{StartFailure, StartedRemote};

fn reason_of(name: &str, mode: StartMode, software_mode: u8) -> StartFailureReason {
    let mut bus = Replay::of(name);
    let mut port = identified(&mut bus);
    port.on(&mut bus).stop_all().unwrap();
    if let Some(&(rx, tx)) = size_replies(&recording(name)).first() {
        bus.set_sizes(0, rx, tx);
    }
    let report = port
        .on(&mut bus)
        .start(mode, &start_zero(software_mode))
        .unwrap();
    assert_eq!(started(&report), ChannelMask::NONE);
    assert_eq!(port.running(), ChannelMask::NONE);
    never_busy(&bus);
    report[0].unwrap_err().reason
}

/// FACTS 4.5, 5.6; transcripts t06d, t15d, t15f, t20.
#[test]
fn recorded_start_failures_are_distinguished() {
    assert_eq!(
        reason_of("t06d_badmode", StartMode::Normal, 5),
        StartFailureReason::IllegalMode(5)
    );
    assert_eq!(
        reason_of("t20_rxlow", StartMode::Normal, 0),
        StartFailureReason::LineLow
    );
    let limit = ProcessDataSizes { rx: 13, tx: 12 };
    for (name, rx, tx) in [("t15d_14_13", 14, 13), ("t15f_16_2", 16, 2)] {
        assert_eq!(
            reason_of(name, StartMode::Normal, 0),
            StartFailureReason::SizesTooLarge {
                sizes: ProcessDataSizes { rx, tx },
                limit
            }
        );
    }
}

/// Transcript t16: wrong cookie, bad CRC, and missing BC and BB in both modes.
#[test]
fn recorded_errors_during_start_end_as_recorded() {
    let mut bus = Replay::of("t16_start_errors");
    let mut port = identified(&mut bus);
    let mut run = |mode| {
        port.on(&mut bus).stop_all().unwrap();
        port.on(&mut bus).start(mode, &start_zero(0)).unwrap()
    };
    let reason = |report: &[Result<StartedRemote, StartFailure>]| report[0].unwrap_err().reason;

    let wrong_cookie = run(StartMode::Setup);
    assert_eq!(reason(&wrong_cookie), StartFailureReason::WrongCookie);
    let bad_crc = run(StartMode::Setup);
    assert_eq!(bad_crc[0].unwrap().unit_number, 0x77AA);
    let no_unit = run(StartMode::Setup);
    assert_eq!(no_unit[0].unwrap().unit_number, 0);
    let no_sizes = run(StartMode::Setup);
    assert_eq!(no_sizes[0].unwrap().ptoc, 0);
    let no_sizes = run(StartMode::Normal);
    assert_eq!(reason(&no_sizes), StartFailureReason::NoSizes);
    let no_unit = run(StartMode::Normal);
    assert_eq!(reason(&no_unit), StartFailureReason::NoUnitNumber);
    never_busy(&bus);
}

/// FACTS 4.3; transcript t04: one remote, seven absent.
#[test]
fn absent_channels_do_not_fail_the_others() {
    let bus = Replay::of("t04_setup_absent8").without(|segment| segment.command == 0x1003);
    let (mut bus, mut port) = stopped(bus, &[(5, 2)]);
    let all = Channel::ALL.map(|channel| (channel, 0));
    let report = port.on(&mut bus).start(StartMode::Setup, &all).unwrap();
    assert_eq!(started(&report).bits(), 0x01);
    for outcome in &report[1..] {
        assert_eq!(outcome.unwrap_err().reason, StartFailureReason::NoReply);
    }
    // The counters at B6..BC, as the transcript reads them.
    let counters: [u8; 7] = port
        .on(&mut bus)
        .read_variable(Channel::ALL[1], ChannelVariable::ErrorCounters)
        .unwrap();
    assert_eq!(counters, [0, 0, 0, 20, 0, 0, 0], "time-outs");
    never_busy(&bus);
}

/// FACTS 3.1; transcript t09c: STOPALL written while a DOIT ran, so that COMMAND stays 0800.
#[test]
fn port_that_is_stuck_is_freed_and_then_stopped() {
    let mut bus = Replay::of("t09c_stopall_doit")
        .without(|segment| segment.command == 0x1001 || segment.command == 0x0901);
    bus.begin_inside();
    let mut port = port();
    port.on(&mut bus).stop_all().unwrap();
    assert_eq!(bus.commands, [(0x08FF, true), (0x0800, false)]);
    assert_eq!(port.state(), PortState::Stopped);
}

/// Every wait is bounded, and its error contains the awaited condition.
#[test]
fn command_that_never_completes_is_an_error_with_the_registers() {
    let stuck = Segment {
        command: 0x0901,
        ..Segment::default()
    };
    let stop = Segment {
        command: 0x0800,
        cleared: Some(120_000),
        ..Segment::default()
    };
    let mut bus = Replay::new(vec![stop, stuck]);
    let mut port = identified(&mut bus);
    port.on(&mut bus).stop_all().unwrap();
    let error = port
        .on(&mut bus)
        .start(StartMode::Normal, &start_zero(0))
        .unwrap_err();
    let PortError::Timeout { waited, .. } = error else {
        panic!("expected a wait that ended, got {error}");
    };
    let longest = PortOperation::Start(StartMode::Normal, ZERO.mask()).longest_time();
    assert!(waited >= longest && waited < longest * 11 / 10);
    let text = error.to_string();
    let awaited = "COMMAND to be 0 after START of channels 0 (0901)";
    assert!(text.contains(awaited), "{text}");
    assert!(text.contains("COMMAND 0901, DATA"), "{text}");
}
