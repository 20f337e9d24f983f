//! Statistics, settings and events in the form that external programs read: JSON files in the
//! repository.

#[path = "../common/mod.rs"]
mod common;

use std::fs;
use std::path::Path;
use std::time::Duration;

use crate::common::machine::{Machine, OUTPUTS, fpga, start};
use mesa_hal::boards::i7i77;
use mesa_hal::bus::{BusErrorKind, BusStatistics};
use mesa_hal::driver::{
    CorrectedValue, Defaults, Event, EventKind, EventMask, Failure, OfflineReason, Positions,
    Repeating,
};
use mesa_hal::hal::{Age, AnyValue, PinMaker, PinStore, Spec};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::lbp::RemoteFaults;
use mesa_hal::runner::{RunStatistics, Runner, SnapshotWriter};
use mesa_hal::sslbp::RemoteName;
use mesa_hal::{Pace, Presence, RemoteConfig, RemoteLabel, SerialConfig, Settings};
use serde_json::{Value, from_str, from_value, json, to_value};

/// Compares a value with the file in `tests/serial_form`.
fn is_as_written(name: &str, made: &Value) {
    let file = format!("{name}.json");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("serial_form");
    let text = fs::read_to_string(folder.join(&file)).unwrap_or_default();
    if from_str::<Value>(&text).ok().as_ref() == Some(made) {
        return;
    }
    let other = Path::new(env!("CARGO_TARGET_TMPDIR")).join(&file);
    let text = serde_json::to_string_pretty(made).expect("JSON");
    fs::write(&other, text + "\n").expect("a folder for it");
    panic!(
        "tests/serial_form/{file} is another one than {}",
        other.display()
    );
}

#[test]
fn settings_are_as_they_are_written_and_come_back() {
    let mut port: SerialConfig = "20xxxxxx".parse().expect("modes");
    let analog = RemoteConfig {
        kind: Some(&i7i77::ANALOG),
        presence: Presence::Optional,
        ..RemoteConfig::default()
    };
    port.channels.insert(1, analog);
    let settings = Settings {
        period: Duration::from_micros(250),
        pace: Pace::Board,
        watchdog: Some(Duration::from_millis(7)),
        serial_ports: [(0, port)].into(),
        defaults: Defaults::LinuxCnc,
        instances: [(Gtag::ENCODER, 4), (Gtag::HM2DPLL, 1)].into(),
        ..Settings::default()
    };
    let made = json!({
        "default": to_value(Settings::default()).expect("JSON"),
        "other": to_value(&settings).expect("JSON"),
    });
    is_as_written("settings", &made);
    let back: Settings = from_value(made["other"].clone()).expect("settings");
    assert_eq!(format!("{back:?}"), format!("{settings:?}"));
}

#[expect(clippy::too_many_lines, reason = "one event of each kind")]
#[test]
fn events_are_as_they_are_written_and_come_back() {
    let remote = RemoteLabel::new((0, 2), RemoteName(*b"7I72"));
    let why = BusErrorKind::Lost;
    let kinds = [
        EventKind::TransferFailed {
            remote,
            failure: Failure::NoReply,
        },
        EventKind::RemoteOffline {
            remote,
            reason: OfflineReason::FieldPower(RemoteFaults::LOW_VOLTAGE),
        },
        EventKind::RemoteStaysOffline {
            remote,
            reason: OfflineReason::OtherTables {
                found: 1,
                expected: 2,
            },
        },
        EventKind::RemoteBack { remote },
        EventKind::RemoteUp { remote },
        EventKind::RemoteRearmed { remote },
        EventKind::WatchdogBitten,
        EventKind::BoardReset,
        EventKind::BusDown,
        EventKind::BoardSetUp,
        EventKind::OtherFirmware,
        EventKind::Rearmed {
            armed: 3,
            waiting: 1,
        },
        EventKind::RearmCancelled { groups: 2 },
        EventKind::RemoteRearmCancelled { remote },
        EventKind::ReadFailed { why },
        EventKind::NotThere { found: 0xFFFF_FFFF },
        EventKind::Repeated {
            what: Repeating::FailedTransfers { remote },
            count: 12,
            lasted: Duration::from_millis(1_500),
        },
        EventKind::Repeated {
            what: Repeating::LostWrites,
            count: 2,
            lasted: Duration::from_secs(1),
        },
        EventKind::WriteFailed { why },
        EventKind::LostWrites { count: 1 },
        EventKind::MissedPeriods { count: 2 },
        EventKind::Dropped { count: 9 },
        EventKind::OtherMaster { packets: 5 },
        EventKind::NotRead { writes: 6 },
        EventKind::ParameterNotWritten {
            remote,
            parameter: 3,
        },
        EventKind::StepRateLimited {
            generator: 2,
            asked: 60_000,
            limit: 40_000,
        },
        EventKind::StepTimeClipped {
            generator: 2,
            asked: 200_000,
            longest: 163_830,
        },
        EventKind::StepHoldShort {
            generator: 2,
            asked: 20_000,
            left: 3_830,
        },
        EventKind::StepgenStalled {
            generator: 2,
            rate: 5_000,
        },
        EventKind::ValueCorrected {
            setting: CorrectedValue::OutputType,
            number: 3,
            asked: -5,
            used: 1,
            lowest: 1,
            highest: 4,
        },
        EventKind::PositionUnsure {
            of: Positions::StepGenerators,
            first: 0,
            mask: 0b101,
        },
        EventKind::OfModule {
            module: 0x9A,
            code: 7,
            value: 1,
        },
    ];
    let all = kinds
        .iter()
        .fold(EventMask::empty(), |all, kind| all | kind.mask());
    assert_eq!(all, EventMask::all(), "one of each");
    let events = kinds.map(|kind| {
        let mut event = to_value(kind).expect("JSON");
        event["at"] = json!(5_020_113_000_u64);
        event["cycle"] = json!(5021);
        let back: Event = from_value(event.clone()).expect("an event");
        assert_eq!(back.kind, kind);
        assert_eq!(to_value(back).expect("JSON"), event);
        event
    });
    is_as_written("events", &Value::from(events.to_vec()));
}

/// All statistics, and those of a remote that is offline.
#[test]
fn statistics_are_as_they_are_written() {
    let mut machine = Machine::with(start(fpga(), |_| {}).expect("the machine is complete"));
    machine.cycles(5);
    machine.driver.restart((0, OUTPUTS as u8));
    let report = machine.cycle();
    let remote = to_value(machine.status(OUTPUTS)).expect("JSON");
    let mut runner = Runner::new(machine.driver);
    let (snapshots, commands) = (runner.snapshot(), runner.commands(4));
    commands.rearm().expect("there is room");
    let ended = runner.run(|cycle| match cycle.number {
        0..10 => std::ops::ControlFlow::Continue(()),
        _ => std::ops::ControlFlow::Break(()),
    });
    ended.stopped.expect("the bus does not fail");
    let shown = snapshots.read().expect("cycles");
    let ports = ended
        .driver
        .ports()
        .iter()
        .map(mesa_hal::driver::SerialPort::statistics);
    let made = json!({
        "cycle_report": report,
        "driver": ended.driver.statistics(),
        "run": RunStatistics::default(),
        "commands": commands.statistics(),
        "bus": BusStatistics::default(),
        "ports": ports.collect::<Vec<_>>(),
        "rejections": ended.driver.pins().total_rejections(),
        "remote": remote,
        "remotes_of_snapshot": shown.remotes().collect::<Vec<_>>(),
    });
    is_as_written("statistics", &made);
}

#[test]
fn values_are_plain_numbers_and_descriptions_are_words() {
    let values: [AnyValue; 4] = [true.into(), 1.5.into(), (-7).into(), u64::MAX.into()];
    let made = to_value(values).expect("JSON");
    assert_eq!(made, json!([true, 1.5, -7, u64::MAX]));
    assert_eq!(to_value(Age::NEVER).expect("JSON"), Value::Null);

    let mut store = PinStore::default();
    let group = store.add_group();
    let spec = Spec {
        unit: "V".into(),
        limits: Some((-10.0, 10.0)),
        ..Spec::from("drive")
    };
    let mut make = PinMaker::new(&mut store, group, "card.");
    let drive = make.output(spec, 0.0).expect("made");
    let enable = make.output("enable", false).expect("made");
    store.enabled_by(drive, enable);
    let made = to_value(&store.infos()[0]).expect("JSON");
    let expected = json!({
        "name": "card.drive",
        "hal_type": "float",
        "role": "output",
        "place": { "terminal": "", "signal": "" },
        "unit": "V",
        "limits": [-10.0, 10.0],
        "is_scale": false,
        "group": 0,
        "enabled_by": 1,
    });
    assert_eq!(made, expected);
}

#[test]
fn snapshot_has_groups_by_number_and_pins_by_name() {
    let mut machine = Machine::with(start(fpga(), |_| {}).expect("the machine is complete"));
    machine.cycles(5);
    let mut writer = SnapshotWriter::new(&machine.driver);
    writer.publish(&machine.driver).expect("published");
    let shown = writer.reader().read().expect("published");
    let made = to_value(&shown).expect("JSON");
    assert_eq!(made["cycle"], machine.driver.pins().cycle());
    assert_eq!(made["board"], "running");
    assert_eq!(
        made["remotes"].as_array().map(Vec::len),
        Some(shown.remotes().count())
    );
    let pins = made["pins"].as_object().expect("pins by their names");
    assert_eq!(pins.len(), shown.infos().len());
    for (info, reading) in shown.pins() {
        assert_eq!(pins[&info.name], to_value(reading).expect("JSON"));
        let group = to_value(info.group).expect("JSON");
        let groups = made["groups"].as_array().expect("groups");
        assert!(groups.iter().any(|state| state["group"] == group));
    }
}
