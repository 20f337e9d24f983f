use super::*;
use proptest::prelude::*;

fn modes(text: &str) -> Result<[Option<u8>; 8], ParseError> {
    let config: SerialConfig = text.parse()?;
    Ok([0, 1, 2, 3, 4, 5, 6, 7].map(|n| config.channels.get(&n).map(|remote| remote.mode)))
}

#[test]
fn digits_are_modes_and_x_is_not_used() {
    let z = Some(0);
    assert_eq!(
        modes("02xX9"),
        Ok([z, Some(2), None, None, Some(9), z, z, z])
    );
    assert_eq!(modes(""), Ok([z; 8]));
}

#[test]
fn what_means_nothing_is_refused() {
    for text in ["0-", "000000000", "xxxxxxxxx"] {
        let error = modes(text).unwrap_err();
        assert_eq!(error.found, text);
    }
}

#[test]
fn numbers_that_mean_nothing_are_refused_and_named() {
    type Change = fn(&mut Settings);
    let with = |change: Change| {
        let mut settings = Settings::default();
        change(&mut settings);
        settings.check().map_err(|error| {
            let advice = error.advice().expect("the setting");
            format!("{error}; {advice}")
        })
    };
    assert_eq!(with(|_| {}), Ok(()));
    assert_eq!(with(|s| s.fault_policy.fault_lim = u32::MAX), Ok(()));
    assert_eq!(with(|s| s.fault_policy.stale_after = 1_000), Ok(()));
    let wrong: [(Change, &str); 8] = [
        (|s| s.bus_error_limit = 0, "Settings::bus_error_limit"),
        (|s| s.fault_policy.fault_lim = 0, "fault_lim 0"),
        (|s| s.fault_policy.fault_inc = 0, "fault_inc 0"),
        (|s| s.fault_policy.stale_after = 0, "1 to 1000"),
        (|s| s.fault_policy.stale_after = u32::MAX, "4294967295"),
        (|s| s.watchdog = Some(Duration::from_secs(5)), "4.29 s"),
        (|s| spindle(s, 0.0), "Settings::pwm"),
        (|s| spindle(s, f64::NAN), "NaN"),
    ];
    for (change, named) in wrong {
        let refused = with(change).unwrap_err();
        assert!(refused.contains(named), "{refused}");
    }
}

fn spindle(settings: &mut Settings, scale: f64) {
    let config = PwmConfig {
        scale: Some(scale),
        ..PwmConfig::default()
    };
    settings.pwm.insert(6, config);
}

proptest! {
    #[test]
    fn any_text_is_parsed_or_refused(text in ".{0,12}") {
        let _ = text.parse::<SerialConfig>();
    }
}
