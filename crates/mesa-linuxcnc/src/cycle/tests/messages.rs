//! What LinuxCNC's user reads, and what follows without an act of the user.

use mesa_hal::driver::{EventKind, OfflineReason};
use mesa_hal::hal::Age;
use mesa_hal_sim::devices::{Device, Outputs48};

use super::*;
use crate::report::{Flags, OutputState, Report};

/// Characters of an error that LinuxCNC's screens show.
const SHOWN: usize = 250;

impl Bench {
    /// The errors since the last call.
    fn new_errors(&self) -> Vec<String> {
        let mut heard = self.heard.lock().expect("no panic");
        let heard = core::mem::take(&mut *heard).into_iter();
        let errors = heard.filter(|(level, _)| *level == Level::Error);
        errors.map(|(_, text)| text).collect()
    }

    /// The only error since the last call.
    fn new_error(&self) -> String {
        let errors = self.new_errors();
        let [error] = &errors[..] else {
            panic!("{errors:#?}");
        };
        assert!(error.len() <= SHOWN, "{} characters: {error}", error.len());
        error.clone()
    }
}

#[test]
fn pulled_card_is_reported_with_the_pin_that_rearms_it() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.pull(OUTPUTS);
    bench.run(200);
    assert_eq!(
        bench.new_error(),
        "hm2_7i97.0.7i72.0.2: card offline, outputs off: no reply; check its cable and power. It is started \
         again by itself; then set hm2_7i97.0.7i72.0.2.rearm to FALSE and TRUE to go on"
    );
    bench.put_back(OUTPUTS);
    bench.run(10_000);
    assert_eq!(
        bench.new_error(),
        "hm2_7i97.0.7i72.0.2: card back, outputs off: set hm2_7i97.0.7i72.0.2.rearm to FALSE and TRUE to go on"
    );
    bench.set("7i72.0.2.rearm", true);
    bench.run(10);
    let notes = bench.heard(Level::Note);
    assert_eq!(notes, ["hm2_7i97.0.7i72.0.2: card runs, outputs follow"]);
}

#[test]
fn board_fault_is_reported_with_the_pin_that_clears_it() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.wait(Duration::from_secs(2));
    bench.run(500);
    let error = bench.new_error();
    let end = ": all outputs off; set hm2_7i97.0.watchdog.has_bit to FALSE to go on";
    assert!(error.ends_with(end), "{error}");
    bench.set("watchdog.has_bit", false);
    bench.run(1_000);
    // The encoders of a 7I97 are multiplexed.
    let error = bench.new_error();
    assert!(
        error.starts_with("hm2_7i97.0: position unsure of encoders 00, 01"),
        "{error}"
    );
    let bus = bench.cycle.driver.bus_mut();
    bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
    bench.run(400);
    let error = bench.new_error();
    assert!(
        error.starts_with("hm2_7i97.0: connection lost for 0."),
        "{error}"
    );
    assert!(
        error.ends_with("set hm2_7i97.0.io_error to FALSE to go on"),
        "{error}"
    );
}

/// A reset stops the cards as well, which follow with the board.
#[test]
fn acknowledged_reset_is_no_fault_of_the_cards() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.fpga().reload();
    bench.run(100);
    let error = bench.new_error();
    assert!(
        error.starts_with("hm2_7i97.0: the board was reset"),
        "{error}"
    );
    bench.set("io_error", false);
    bench.run(1_000);
    assert_eq!(bench.outputs(), [true; 3]);
    let error = bench.new_error();
    assert!(
        error.starts_with("hm2_7i97.0: position unsure of encoders 00, 01"),
        "{error}"
    );
}

/// Two cards of a kind differ by their unit numbers.
#[test]
fn another_card_of_the_kind_is_an_error_once() {
    let mut bench = Bench::running();
    bench.switch_on();
    let mut description = Outputs48::description().expect("a 7I72");
    description.unit ^= 1;
    let unit = description.unit;
    let other = Device::remote(&description, Outputs48::default()).expect("a 7I72");
    let own = bench.fpga().plug(0, OUTPUTS, Some(Box::new(other)));
    assert!(own.is_some());
    bench.run(20_000);
    let errors = bench.new_errors();
    let about: Vec<_> = errors
        .iter()
        .filter(|error| error.contains("another card answers"))
        .collect();
    let [error] = about[..] else {
        panic!("{errors:#?}");
    };
    assert!(
        error.starts_with("hm2_7i97.0.7i72.0.2: 7I72 (unit 0x"),
        "{error}"
    );
    let found = format!(") expected, another card answers: 7I72 (unit 0x{unit:08X})");
    assert!(error.contains(&found), "{error}");
    assert!(!bench.is_on("7i72.0.2.valid"));
}

#[test]
fn card_that_fails_before_any_output_is_on_follows_by_itself() {
    for in_cycle in [1, 10, 100] {
        let mut bench = Bench::new();
        bench.run(in_cycle);
        for channel in [FIELD, OUTPUTS] {
            bench.pull(channel);
        }
        bench.run(300);
        let errors = bench.new_errors();
        let follows = |error: &String| error.ends_with("and its outputs follow then");
        assert!(
            !errors.is_empty() && errors.iter().all(follows),
            "{errors:#?}"
        );
        for channel in [FIELD, OUTPUTS] {
            bench.put_back(channel);
        }
        bench.run(10_000);
        assert_eq!(bench.new_errors(), [""; 0]);
        bench.switch_on();
    }
}

/// As a computer that is busy with LinuxCNC's start does it.
#[test]
fn stall_at_the_start_leaves_no_card_off() {
    for in_cycle in [1, 2, 10, 200] {
        let mut bench = Bench::new();
        bench.set("watchdog.timeout_ns", 100_000_000_u32);
        bench.run(in_cycle);
        bench.wait(Duration::from_millis(60));
        bench.run(1_000);
        bench.switch_on();
    }
}

#[test]
fn port_that_is_off_stays_off_before_the_machine_is_on() {
    let mut bench = Bench::running();
    bench.set("sserial.port-0.run", false);
    bench.run(500);
    bench.set("7i72.0.2.output-17", true);
    bench.run(500);
    assert_eq!(bench.outputs(), [false; 3]);
    assert_eq!(bench.new_errors(), [""; 0]);
    bench.set("sserial.port-0.run", true);
    bench.run(1_000);
    bench.switch_on();
}

#[test]
fn card_that_failed_before_the_first_machine_on_is_armed_by_it() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.pull(OUTPUTS);
    bench.run(300);
    bench.put_back(OUTPUTS);
    bench.run(10_000);
    assert_eq!(bench.outputs(), [true, false, true]);
    bench.new_errors();
    bench.set("pwmgen.00.enable", true);
    bench.run(10);
    assert_eq!(bench.outputs(), [true; 3]);
    assert_eq!(bench.new_errors(), [""; 0]);
    // The second time it has to be asked for.
    bench.set("pwmgen.00.enable", false);
    bench.pull(OUTPUTS);
    bench.run(300);
    bench.put_back(OUTPUTS);
    bench.run(10_000);
    bench.new_errors();
    bench.set("7i77.0.1.analogena", true);
    bench.run(10);
    assert_eq!(bench.outputs(), [true, false, true]);
    assert_eq!(
        bench.new_error(),
        "hm2_7i97.0.7i72.0.2: the machine is on, and the outputs of this card are off; set \
         hm2_7i97.0.7i72.0.2.rearm to FALSE and TRUE to go on"
    );
}

#[test]
fn machine_that_is_on_without_a_card_is_an_error() {
    let mut bench = Bench::running();
    bench.pull(FIELD);
    bench.run(2_000);
    bench.new_errors();
    bench.set("pwmgen.00.enable", true);
    bench.run(10);
    assert_eq!(
        bench.new_error(),
        "hm2_7i97.0.7i77.0.0: the machine is on, and this card is offline: its inputs are not valid, its \
         outputs are off"
    );
}

#[test]
fn board_that_was_not_read_is_armed_with_the_machine() {
    for is_used in [false, true] {
        let mut bench = Bench::running();
        if is_used {
            bench.switch_on();
        }
        for _ in 0..20 {
            bench.cycle.write(PERIOD);
            bench.wait(PERIOD);
        }
        let error = bench.new_errors().remove(0);
        let begin = "hm2_7i97.0: hm2_7i97.0.read is not called any more";
        assert!(error.starts_with(begin), "{error}");
        bench.run(1_000);
        assert!(!bench.is_on("armed"));
        // Nothing was on: the card follows as at the load.
        assert_eq!(bench.is_on("7i77.0.0.armed"), !is_used);
        bench.set("pwmgen.00.enable", true);
        bench.run(100);
        bench.switch_on();
    }
}

#[test]
fn machine_that_is_on_without_its_board_is_an_error() {
    let mut bench = Bench::running();
    bench.set("io_error", true);
    bench.run(10);
    bench.set("pwmgen.00.enable", true);
    bench.run(10);
    assert_eq!(
        bench.new_error(),
        "hm2_7i97.0: the machine is on, and all outputs are off; set hm2_7i97.0.io_error to FALSE to go on"
    );
}

#[test]
fn share_of_lost_packets_is_reported_once() {
    let mut bench = Bench::running();
    bench.set("packet-error-limit", 1_000_000_i32);
    let bus = bench.cycle.driver.bus_mut();
    bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 0.05);
    bench.run(3_000);
    let errors = bench.new_errors();
    let about = |error: &&String| error.contains(" % of the packets are lost or late");
    assert_eq!(errors.iter().filter(about).count(), 1, "{errors:#?}");
    bench.run(20_000);
    let errors = bench.new_errors();
    assert_eq!(errors.iter().filter(about).count(), 0, "{errors:#?}");
}

#[test]
fn generator_that_is_stopped_is_an_error_with_its_name() {
    let bench = Bench::running();
    let say = |kind| {
        let report = Report {
            kind,
            names: &bench.cycle.names,
            flags: Flags::default(),
            outputs: OutputState::Wait,
            silence: Age::NEVER,
        };
        (report.level(), report.to_string())
    };
    let (level, text) = say(EventKind::StepgenStalled {
        generator: 4,
        rate: 2_000,
    });
    assert_eq!(level, Some(Level::Error));
    assert!(text.starts_with("hm2_7i97.0.stepgen.04: stopped"), "{text}");
    let (level, text) = say(EventKind::StepRateLimited {
        generator: 0,
        asked: 9,
        limit: 5,
    });
    assert_eq!(level, Some(Level::Error));
    assert!(
        text.starts_with("hm2_7i97.0.stepgen.00: 9 steps/s"),
        "{text}"
    );
    let (level, _) = say(EventKind::LostWrites { count: 3 });
    assert_eq!(level, Some(Level::Note));
    // Without an instruction that would do nothing, after an act that has covered the reset.
    let (level, text) = say(EventKind::BoardReset);
    assert_eq!(level, Some(Level::Note));
    assert!(
        text.ends_with("they follow again as soon as it runs"),
        "{text}"
    );
    let found = mesa_hal::sslbp::RemoteIdentity {
        name: mesa_hal::sslbp::RemoteName(*b"7I77"),
        unit_number: 7,
    };
    let expected = mesa_hal::sslbp::RemoteIdentity::default();
    let reason = OfflineReason::AnotherDevice { found, expected };
    let remote = mesa_hal::RemoteLabel::new((0, 0), mesa_hal::sslbp::RemoteName(*b"7I77"));
    let (level, text) = say(EventKind::RemoteStaysOffline { remote, reason });
    assert_eq!(level, Some(Level::Error));
    assert!(
        text.starts_with("hm2_7i97.0.7i77.0.0: 7I77 (unit 0x"),
        "{text}"
    );
    assert!(
        text.contains(" expected, another card answers: 7I77 (unit 0x00000007)"),
        "{text}"
    );
    assert!(text.len() <= SHOWN, "{text}");
}

/// Each fault with its longest values, in all states of flags and outputs.
#[test]
fn error_fits_on_the_operators_screen() {
    use mesa_hal::sslbp::{CsStatus, Failure, ProcessDataSizes, RemoteFaults};

    let bench = Bench::new();
    let remote = mesa_hal::RemoteLabel::new((0, 0), mesa_hal::sslbp::RemoteName(*b"7I77"));
    let sizes = ProcessDataSizes::default();
    let [found, expected] = [u32::MAX; 2];
    let all = u32::MAX;
    let reasons = [
        OfflineReason::Absent,
        OfflineReason::TooManyFailures(Failure::Doubtful),
        OfflineReason::NotRunning(CsStatus(0xC100)),
        OfflineReason::Watchdog,
        OfflineReason::IllegalMode,
        OfflineReason::FieldPower(RemoteFaults::LOW_VOLTAGE),
        OfflineReason::Reported(RemoteFaults::OVER_CURRENT | RemoteFaults::OVER_TEMPERATURE),
        OfflineReason::OtherTables { found, expected },
        OfflineReason::OtherSizes {
            found: sizes,
            expected: sizes,
        },
        OfflineReason::PortStuck,
        OfflineReason::BoardDown,
    ];
    let offline = reasons.map(|reason| EventKind::RemoteOffline { remote, reason });
    let still = reasons.map(|reason| EventKind::RemoteStaysOffline { remote, reason });
    let others = [
        EventKind::RemoteBack { remote },
        EventKind::RemoteUp { remote },
        EventKind::RemoteRearmCancelled { remote },
        EventKind::ParameterNotWritten {
            remote,
            parameter: 0,
        },
        EventKind::WatchdogBitten,
        EventKind::BoardReset,
        EventKind::BusDown,
        EventKind::NotRead { writes: all },
        EventKind::OtherFirmware,
        EventKind::OtherMaster { packets: all },
        EventKind::StepRateLimited {
            generator: 31,
            asked: all,
            limit: all,
        },
        EventKind::StepTimeClipped {
            generator: 31,
            asked: all,
            longest: all,
        },
        EventKind::StepHoldShort {
            generator: 31,
            asked: all,
            left: all,
        },
        EventKind::StepgenStalled {
            generator: 31,
            rate: all,
        },
    ];
    for kind in offline.into_iter().chain(still).chain(others) {
        for (has_bit, io_error) in [(false, false), (true, false), (false, true)] {
            for outputs in [OutputState::Follow, OutputState::Wait] {
                let report = Report {
                    kind,
                    names: &bench.cycle.names,
                    flags: Flags { has_bit, io_error },
                    outputs,
                    silence: Age {
                        cycles: 9,
                        time: Duration::from_secs(99),
                    },
                };
                let text = report.to_string();
                assert!(text.starts_with("hm2_7i97.0"), "{text}");
                if report.level() == Some(Level::Error) {
                    assert!(text.len() <= SHOWN, "{}: {text}", text.len());
                }
            }
        }
    }
}
