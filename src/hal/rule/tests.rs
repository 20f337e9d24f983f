// Exact values are exact here.
#![allow(clippy::float_cmp)]

use super::*;
use crate::hal::cycle::tests::{Remote, remote};
use crate::hal::{PinStore, Spec};
use proptest::prelude::*;

#[test]
fn not_finite_becomes_safe_and_out_of_range_the_limit_and_both_are_counted() {
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

#[test]
fn an_output_that_asks_for_it_becomes_safe_when_out_of_range() {
    let mut pins = PinStore::new();
    let group = pins.add_group();
    let rule = OutputRule {
        out_of_range: OutOfRange::Safe,
        ..OutputRule::safe_at(3)
    };
    let pin = pins
        .add_output::<i32>(group, Spec::new("level").limits(0.0, 9.0), rule)
        .unwrap();
    pins.set(pin, 10);
    assert_eq!(pins.fetch(pin), 3);
    assert_eq!(pins.rejections(pin).out_of_range, 1);
}

#[test]
fn limit_parameters_narrow_an_output_but_never_widen_it() {
    let Remote {
        mut pins,
        group,
        drive,
        ..
    } = remote();
    let max = pins
        .add_setting(group, Spec::new("drive-maxlim"), 10.0)
        .unwrap();
    let min = pins
        .add_setting(group, Spec::new("drive-minlim"), -10.0)
        .unwrap();
    let modifiers = OutputModifiers {
        max_limit: Some(max),
        min_limit: Some(min),
        ..OutputModifiers::default()
    };
    pins.modify(drive, modifiers).unwrap();
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
    assert_eq!(pins.set_param(max, f64::NAN), Err(PinError::BadValue));
}

#[test]
fn an_inverted_output_is_inverted_when_safe_too() {
    let Remote {
        mut pins,
        group,
        lamp,
        ..
    } = remote();
    let invert = pins
        .add_setting(group, Spec::new("lamp-invert"), false)
        .unwrap();
    let modifiers = OutputModifiers {
        invert: Some(Invert::Setting(invert)),
        ..OutputModifiers::default()
    };
    pins.modify(lamp, modifiers).unwrap();
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
fn a_pin_inverts_an_output_like_a_parameter() {
    let mut m = remote();
    let invert: Output<bool> = m
        .pins
        .add_output(m.group, Spec::new("invert-00"), OutputRule::switch(false))
        .unwrap();
    let modifiers = OutputModifiers {
        invert: Some(Invert::Pin(invert)),
        ..OutputModifiers::default()
    };
    m.pins.modify(m.lamp, modifiers).unwrap();
    m.pins.set(m.lamp, true);
    assert!(m.pins.fetch(m.lamp));
    m.pins.set(invert, true);
    assert!(!m.pins.fetch(m.lamp));
    m.pins.fault(m.group);
    assert!(m.pins.fetch(m.lamp), "how it is wired outlives a fault");
}

/// A drive that goes out as -1 to 1, whose application has `scale` for 1.
fn scaled(scale: f64) -> (Remote, Param<f64>) {
    let mut m = remote();
    let scale = m
        .pins
        .add_setting(m.group, Spec::new("scalemax"), scale)
        .unwrap();
    let modifiers = OutputModifiers {
        full_scale: Some(FullScale {
            scale,
            min: -1.0,
            max: 1.0,
        }),
        ..OutputModifiers::default()
    };
    m.pins.modify(m.drive, modifiers).unwrap();
    (m, scale)
}

#[test]
fn a_scaled_output_goes_out_within_the_range_of_the_wire_and_what_does_not_fit_is_counted_once() {
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
fn a_scale_that_makes_no_number_makes_the_safe_value_and_is_counted() {
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
    let full_scale = |max| OutputModifiers {
        full_scale: Some(FullScale {
            scale,
            min: 0.0,
            max,
        }),
        ..OutputModifiers::default()
    };
    let refused = Err(PinError::BadLimits);
    assert_eq!(m.pins.modify(m.lamp, full_scale(1.0)), refused);
    assert_eq!(m.pins.modify(m.drive, full_scale(f64::INFINITY)), refused);
    assert_eq!(m.pins.modify(m.drive, full_scale(1.0)), Ok(()));
}

proptest! {
    #[test]
    fn an_output_is_always_finite_and_within_its_limits(
        value in any::<f64>(), maxlim in any::<f64>(), minlim in any::<f64>(),
    ) {
        let Remote { mut pins, group, drive, .. } = remote();
        let max = pins.add_setting(group, Spec::new("max"), 10.0).unwrap();
        let min = pins.add_setting(group, Spec::new("min"), -10.0).unwrap();
        let modifiers = OutputModifiers {
            max_limit: Some(max), min_limit: Some(min), ..OutputModifiers::default()
        };
        pins.modify(drive, modifiers).unwrap();
        let _ = pins.set_param(max, maxlim);
        let _ = pins.set_param(min, minlim);
        pins.set(drive, value);
        let fetched = pins.fetch(drive);
        prop_assert!((-10.0..=10.0).contains(&fetched));
    }
}
