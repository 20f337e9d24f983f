// The expected values are represented exactly.
#![allow(clippy::float_cmp)]

use super::*;
use crate::hal::store::tests::{Remote, maker, remote, remote_with};
use crate::hal::{FullScale, Invert, Output, Param, Spec};
use proptest::prelude::*;

#[test]
fn non_finite_is_safe_out_of_range_is_limited_and_both_counted() {
    let Remote {
        mut pins, drive, ..
    } = remote();
    for (set, expected) in [
        (f64::NAN, 0.0),
        (f64::INFINITY, 0.0),
        (f64::NEG_INFINITY, 0.0),
        (10.5, 10.0),
        (-1e300, -10.0),
        (10.0, 10.0),
    ] {
        pins.set(drive, set);
        assert_eq!(pins.fetch(drive), expected, "{set}");
    }
    let expected = Rejections {
        not_finite: 3,
        out_of_range: 2,
    };
    assert_eq!(pins.rejections(drive), expected);
    assert_eq!(pins.total_rejections(), expected);
}

/// A remote whose drive has the limit parameters `-maxlim` and `-minlim`.
fn limited() -> (Remote, Param<f64>, Param<f64>) {
    let mut limits = None;
    let remote = remote_with(|make, lamp, drive| {
        let max_limit = Some(make.setting("drive-maxlim", 10.0).unwrap());
        let min_limit = Some(make.setting("drive-minlim", -10.0).unwrap());
        limits = max_limit.zip(min_limit);
        let drive = Spec {
            max_limit,
            min_limit,
            ..drive
        };
        (lamp, drive)
    });
    let (max, min) = limits.unwrap();
    (remote, max, min)
}

#[test]
fn limit_parameters_narrow_an_output_but_never_widen_it() {
    let (remote, max, _) = limited();
    let Remote {
        mut pins, drive, ..
    } = remote;
    pins.set_param(max, 4.0).unwrap();
    pins.set(drive, 8.0);
    assert_eq!(pins.fetch(drive), 4.0);
    pins.set_param(max, 400.0).unwrap();
    pins.set(drive, 80.0);
    assert_eq!(pins.fetch(drive), 10.0);
    pins.set_param(max, -400.0).unwrap();
    assert_eq!(
        pins.fetch(drive),
        -10.0,
        "limits the wrong way round stay inside"
    );
    assert!(matches!(
        pins.set_param(max, f64::NAN),
        Err(PinError::BadValue { .. })
    ));
}

#[test]
fn inverted_output_is_inverted_when_safe_too() {
    let mut param = Param::default();
    let Remote {
        mut pins,
        group,
        lamp,
        ..
    } = remote_with(|make, lamp, drive| {
        param = make.setting("lamp-invert", false).unwrap();
        let invert = Some(Invert::Setting(param));
        (Spec { invert, ..lamp }, drive)
    });
    let invert = param;
    assert!(!pins.fetch(lamp));
    pins.set_param(invert, true).unwrap();
    assert!(pins.fetch(lamp));
    pins.set(lamp, true);
    assert!(!pins.fetch(lamp));
    pins.fault(group);
    assert!(
        pins.fetch(lamp),
        "safe is the lamp off, and off is 1 on this wire"
    );
}

#[test]
fn pin_inverts_an_output_like_a_parameter() {
    let mut invert = Output::default();
    let mut m = remote_with(|make, lamp, drive| {
        invert = make.switch("invert-00", false).unwrap();
        let invert = Some(Invert::Pin(invert));
        (Spec { invert, ..lamp }, drive)
    });
    m.pins.set(m.lamp, true);
    assert!(m.pins.fetch(m.lamp));
    m.pins.set(invert, true);
    assert!(!m.pins.fetch(m.lamp));
    m.pins.fault(m.group);
    assert!(m.pins.fetch(m.lamp), "how it is wired outlives a fault");
}

/// A drive with the range -1 to 1 on the wire, for which the application uses `scale` as full
/// scale.
fn scaled(scale: f64) -> (Remote, Param<f64>) {
    let mut param = Param::default();
    let remote = remote_with(|make, lamp, drive| {
        param = make.setting("scalemax", scale).unwrap();
        let full_scale = Some(wire(param, -1.0, 1.0));
        (
            lamp,
            Spec {
                full_scale,
                ..drive
            },
        )
    });
    (remote, param)
}

fn wire(scale: Param<f64>, min: f64, max: f64) -> FullScale {
    FullScale { scale, min, max }
}

#[test]
fn scaled_output_stays_in_the_wire_range_and_excess_counts_once() {
    let (mut m, scale) = scaled(5.0);
    for (set, expected) in [(5.0, 1.0), (-2.5, -0.5), (6.0, 1.0), (-11.0, -1.0)] {
        m.pins.set(m.drive, set);
        assert_eq!(m.pins.fetch(m.drive), expected, "{set}");
    }
    assert_eq!(m.pins.rejections(m.drive).out_of_range, 2);
    m.pins.set(m.drive, 0.5);
    m.pins.set_param(scale, 1.0).unwrap();
    assert_eq!(m.pins.fetch(m.drive), 0.5);
    m.pins.set_param(scale, -1.0).unwrap();
    assert_eq!(m.pins.fetch(m.drive), -0.5);
    m.pins.fault(m.group);
    assert_eq!(m.pins.fetch(m.drive), 0.0);
    assert_eq!(m.pins.total_rejections().not_finite, 0);
}

#[test]
fn scale_giving_no_number_makes_the_safe_value_and_is_counted() {
    let (mut m, scale) = scaled(0.0);
    for (set, scale_is) in [(5.0, 0.0), (0.0, 0.0), (5.0, -0.0), (5.0, 1e-320)] {
        m.pins.set_param(scale, scale_is).unwrap();
        m.pins.set(m.drive, set);
        assert_eq!(m.pins.fetch(m.drive), 0.0, "{set} of {scale_is}");
    }
    assert_eq!(m.pins.rejections(m.drive).not_finite, 4);
}

#[test]
fn only_a_real_number_has_a_full_scale() {
    let (mut m, scale) = scaled(5.0);
    let full_scale = |name: &str, max| Spec {
        full_scale: Some(wire(scale, 0.0, max)),
        ..Spec::from(name)
    };
    let mut make = maker(&mut m.pins, m.group);
    let is_refused = |error| matches!(error, Some(PinError::BadLimits { .. }));
    assert!(is_refused(make.output(full_scale("a", 1.0), false).err()));
    let infinite = full_scale("a", f64::INFINITY);
    assert!(is_refused(make.output(infinite, 0.0).err()));
    assert!(make.output(full_scale("a", 1.0), 0.0).is_ok());
    let mut other = remote();
    let mut make = maker(&mut other.pins, other.group);
    let foreign = make.output(full_scale("a", 1.0), 0.0);
    assert_eq!(foreign, Err(PinError::ForeignHandle));
}

proptest! {
    #[test]
    fn output_is_always_finite_and_within_its_limits(
        value in any::<f64>(), maxlim in any::<f64>(), minlim in any::<f64>(),
    ) {
        let (remote, max, min) = limited();
        let Remote { mut pins, drive, .. } = remote;
        let _ = pins.set_param(max, maxlim);
        let _ = pins.set_param(min, minlim);
        pins.set(drive, value);
        let fetched = pins.fetch(drive);
        prop_assert!((-10.0..=10.0).contains(&fetched));
    }
}
