// The expected values are represented exactly.
#![allow(clippy::float_cmp)]

use super::*;
use crate::hal::{Age, InOut, Output, Param, PinMaker, ShortName, Spec};
use core::time::Duration;

fn at(ms: u64) -> Instant {
    Instant::from_nanos(ms * 1_000_000)
}

/// A remote with a switch, a lamp and a drive of +-10 V.
pub struct Remote {
    pub pins: PinStore,
    pub group: GroupId,
    pub switch: Input<bool>,
    pub lamp: Output<bool>,
    pub drive: Output<f64>,
}

pub fn maker(pins: &mut PinStore, group: GroupId) -> PinMaker<'_> {
    PinMaker::new(pins, group, "")
}

pub fn remote() -> Remote {
    remote_with(|_, lamp, drive| (lamp, drive))
}

/// A remote whose lamp and drive are made by `change`, after its own pins.
pub fn remote_with(change: impl FnOnce(&mut PinMaker<'_>, Spec, Spec) -> (Spec, Spec)) -> Remote {
    let mut pins = PinStore::default();
    let group = pins.add_group();
    let mut make = maker(&mut pins, group);
    let limits = Some((-10.0, 10.0));
    let drive = Spec {
        limits,
        ..Spec::from("drive")
    };
    let (lamp, drive) = change(&mut make, Spec::from("lamp"), drive);
    let switch = make.input("switch").unwrap();
    let lamp = make.output(lamp, false).unwrap();
    let drive = make.output(drive, 0.0).unwrap();
    Remote {
        pins,
        group,
        switch,
        lamp,
        drive,
    }
}

#[test]
fn input_is_valid_from_a_good_transfer_and_ages_on_failure() {
    let Remote {
        mut pins,
        group,
        switch,
        ..
    } = remote();
    assert!(!pins.read(switch).valid);
    assert_eq!(pins.read(switch).age, Age::NEVER);

    pins.begin_cycle(at(1));
    pins.publish(switch, true);
    pins.group_good(group);
    let reading = pins.read(switch);
    assert_eq!((reading.value, reading.valid), (true, true));
    assert_eq!(reading.age.cycles, 0);

    for ms in 2..5 {
        pins.begin_cycle(at(ms));
        pins.invalidate(group);
    }
    let reading = pins.read(switch);
    assert_eq!((reading.value, reading.valid), (true, false));
    assert_eq!(reading.age.cycles, 3);
    assert_eq!(reading.age.time, Duration::from_millis(3));
    assert_eq!(reading.ok(), None);
}

#[test]
fn faulted_outputs_are_safe_until_rearmed_and_old_commands_gone() {
    let Remote {
        mut pins,
        group,
        lamp,
        drive,
        ..
    } = remote();
    pins.begin_cycle(at(1));
    pins.group_good(group);
    pins.set(lamp, true);
    pins.set(drive, 5.0);
    assert_eq!((pins.fetch(lamp), pins.fetch(drive)), (true, 5.0));

    pins.fault(group);
    assert_eq!((pins.fetch(lamp), pins.fetch(drive)), (false, 0.0));
    pins.set(drive, 7.0);
    assert_eq!(
        pins.fetch(drive),
        0.0,
        "not armed: what is set has no effect"
    );
    assert!(!pins.read_any(drive.into()).valid);
    let first = &pins.infos()[0].name;
    let refused = PinError::NotRunning {
        pin: ShortName::new(first),
    };
    assert_eq!(pins.rearm(group), Err(refused));

    pins.begin_cycle(at(2));
    pins.group_good(group);
    assert_eq!(pins.fetch(drive), 0.0, "running again is not armed again");
    assert!(!pins.read_any(drive.into()).valid && !pins.read_any(lamp.into()).valid);
    pins.set(drive, 8.0);
    assert_eq!(pins.rearm(group), Ok(()));
    assert_eq!(
        (pins.fetch(lamp), pins.fetch(drive)),
        (false, 0.0),
        "what was set before re-arming is forgotten, whenever it was"
    );
    assert_eq!(pins.commanded(drive), 0.0);
    assert!(pins.read_any(drive.into()).valid);
    pins.set(drive, 9.0);
    assert_eq!(pins.fetch(drive), 9.0);
    assert_eq!(pins.rearm(group), Ok(()), "armed already");
    assert_eq!(pins.fetch(drive), 9.0, "which forgets nothing");
    assert_eq!(pins.group_state(group).unwrap().faults, 1);
}

#[test]
fn driver_switch_outlives_faults() {
    let mut pins = PinStore::default();
    let group = pins.add_group();
    let run = maker(&mut pins, group).switch("run", true).unwrap();
    pins.fault(group);
    assert!(pins.fetch(run));
    pins.set(run, false);
    assert!(!pins.fetch(run));
}

#[test]
fn pin_of_both_sides_is_set_by_one_and_cleared_by_the_other() {
    let mut pins = PinStore::default();
    let group = pins.add_group();
    let index: InOut<bool> = maker(&mut pins, group).inout("index-enable").unwrap();
    pins.begin_cycle(at(1));
    pins.group_good(group);
    pins.set(index, true);
    assert!(pins.fetch(index));
    pins.publish(index, false);
    assert_eq!(pins.read(index).ok(), Some(false));
}

#[test]
fn number_that_is_none_is_not_published() {
    let mut pins = PinStore::default();
    let group = pins.add_group();
    let volts = maker(&mut pins, group).input::<f64>("volts").unwrap();
    pins.begin_cycle(at(1));
    pins.publish(volts, 2.5);
    pins.group_good(group);
    pins.publish(volts, f64::NAN);
    let reading = pins.read(volts);
    assert_eq!((reading.value, reading.valid), (2.5, false));
    assert_eq!(pins.rejections(volts).not_finite, 1);
    pins.publish(volts, 3.0);
    assert_eq!(pins.read(volts).ok(), Some(3.0));
}

#[test]
fn foreign_handle_reads_nothing_sets_nothing_and_is_counted() {
    let mut a = remote();
    let mut b = remote();
    a.pins.begin_cycle(at(1));
    a.pins.publish(a.switch, true);
    a.pins.group_good(a.group);
    assert!(!a.pins.read(b.switch).valid);
    b.pins.set(a.drive, 5.0);
    assert_eq!(b.pins.fetch(b.drive), 0.0);
    assert_eq!(b.pins.fetch(a.drive), 0.0);
    assert!(!a.pins.read(Input::<bool>::default()).valid);
    assert_eq!((a.pins.foreign_handles(), b.pins.foreign_handles()), (2, 2));
    assert_eq!(a.pins.rearm(b.group), Err(PinError::ForeignHandle));
}

#[test]
fn pins_are_found_by_name_only_as_what_they_are() {
    let Remote {
        pins,
        switch,
        drive,
        ..
    } = remote();
    assert_eq!(pins.input("switch"), Ok(switch));
    assert_eq!(pins.output("drive"), Ok(drive));
    for (error, said) in [
        (
            pins.input::<bool>("swatch").err(),
            "no pin or parameter `swatch`; the nearest is `switch`",
        ),
        (
            pins.input::<bool>("lamp").err(),
            "`lamp` is an output, not an input",
        ),
        (
            pins.input::<u32>("switch").err(),
            "`switch` is bit, not u32",
        ),
    ] {
        let error = error.expect("refused").to_string();
        assert!(error.starts_with(said), "{error}");
    }
}

#[test]
fn names_are_checked() {
    let mut pins = PinStore::default();
    let group = pins.add_group();
    let mut add = |name: &str| maker(&mut pins, group).input::<bool>(name).err();
    let bad = |name: &str| {
        let name = name.to_owned();
        Some(PinError::BadName { name })
    };
    assert_eq!(add("a"), None);
    let name = "a".to_owned();
    assert_eq!(add("a"), Some(PinError::NameTaken { name }));
    assert_eq!(add(""), bad(""));
    assert_eq!(add("a b"), bad("a b"));
    assert_eq!(add(&"x".repeat(47)), None);
    assert_eq!(add(&"x".repeat(48)), bad(&"x".repeat(48)));
}

#[test]
fn output_version_stays_only_while_its_dependencies_do() {
    let mut pins = PinStore::default();
    let (group, other) = (pins.add_group(), pins.add_group());
    let mut make = maker(&mut pins, group);
    let volts = make.output("volts", 0.0).unwrap();
    let index = make.bidirectional("index", false).unwrap();
    let limit = make.setting("limit", 10.0).unwrap();
    let input: Input<f64> = make.input("input").unwrap();
    let elsewhere = maker(&mut pins, other).output("elsewhere", false).unwrap();
    let mut last = pins.output_version(group);
    let mut has_changed = |pins: &PinStore| {
        let now = pins.output_version(group);
        core::mem::replace(&mut last, now) != now
    };
    assert!(!has_changed(&pins));
    for (what, step, expected) in [
        ("set", (|p, v, _, _| p.set(v, 1.0)) as Step, true),
        ("set to the same", |p, v, _, _| p.set(v, 1.0), false),
        ("taken", |p, v, _, _| assert!(p.fetch(v) > 0.0), false),
        ("inout set", |p, _, i, _| p.set(i, true), true),
        ("published", |p, _, i, _| p.publish(i, false), true),
        ("the same", |p, _, i, _| p.publish(i, false), false),
        ("param", |p, _, _, l| p.set_param(l, 9.0).unwrap(), true),
        ("no number", |p, v, _, _| p.set(v, f64::NAN), true),
        ("counted", |p, v, _, _| assert!(p.fetch(v) < 1.0), true),
        (
            "counted again",
            |p, v, _, _| assert!(p.fetch(v) < 1.0),
            true,
        ),
    ] {
        step(&mut pins, volts, index, limit);
        assert_eq!(has_changed(&pins), expected, "{what}");
    }
    pins.publish(input, 3.0);
    pins.group_good(group);
    pins.set(elsewhere, true);
    assert!(!has_changed(&pins), "no matter of its outputs");
    pins.fault(group);
    assert!(has_changed(&pins));
    pins.group_good(group);
    pins.rearm(group).unwrap();
    assert!(has_changed(&pins));
    assert_eq!(PinStore::default().output_version(group), None);
}

#[test]
fn part_notices_its_own_changes_and_fails_with_its_group() {
    let mut m = remote();
    let part = m.pins.add_part(m.group).unwrap();
    let spec = Spec {
        limits: Some((0.0, 9.0)),
        ..Spec::from("part-out")
    };
    let out = maker(&mut m.pins, part).output::<i32>(spec, 3).unwrap();
    let versions = |pins: &PinStore| [m.group, part].map(|part| pins.output_version(part));
    let before = versions(&m.pins);
    m.pins.set(out, 5);
    let after = versions(&m.pins);
    assert_eq!((before[0], before[1] == after[1]), (after[0], false));
    m.pins.set(m.drive, 5.0);
    let both = versions(&m.pins);
    assert_eq!((after[0] == both[0], after[1]), (false, both[1]));
    m.pins.fault(part);
    assert!(!m.pins.group_state(m.group).unwrap().armed);
    assert_eq!((m.pins.fetch(m.drive), m.pins.fetch(out)), (0.0, 3));
    let disarmed = versions(&m.pins);
    assert!(disarmed[0] != both[0] && disarmed[1] != both[1]);
    m.pins.group_good(part);
    assert_eq!(m.pins.rearm_all(), 1);
    m.pins.set(out, 5);
    m.pins.set(m.drive, 5.0);
    assert_eq!((m.pins.fetch(m.drive), m.pins.fetch(out)), (5.0, 5));
    assert_eq!(m.pins.info(out).unwrap().group, m.group);
    assert!(m.pins.groups().eq([m.group]));
    assert_eq!(
        PinStore::default().add_part(m.group),
        Err(PinError::ForeignHandle)
    );
}

type Step = fn(&mut PinStore, Output<f64>, InOut<bool>, Param<f64>);
