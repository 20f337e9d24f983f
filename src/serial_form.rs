//! Flag words and times as text and numbers, where they are kept in files.

/// Flags by their names, as `WATCHDOG | LOW_VOLTAGE`; those without a name in hexadecimal.
pub(crate) mod flags {
    use alloc::string::String;
    use bitflags::parser::{ParseHex, WriteHex, from_str, to_writer};
    use serde::{Deserialize, Deserializer, Serializer, de::Error as _, ser::Error as _};

    pub fn serialize<F, S>(flags: &F, serializer: S) -> Result<S::Ok, S::Error>
    where
        F: bitflags::Flags<Bits: WriteHex>,
        S: Serializer,
    {
        let mut text = String::new();
        to_writer(flags, &mut text).map_err(S::Error::custom)?;
        serializer.serialize_str(&text)
    }

    pub fn deserialize<'de, F, D>(deserializer: D) -> Result<F, D::Error>
    where
        F: bitflags::Flags<Bits: ParseHex>,
        D: Deserializer<'de>,
    {
        let text = String::deserialize(deserializer)?;
        from_str(&text).map_err(D::Error::custom)
    }
}

/// Pins by what their names begin with.
pub(crate) fn prefix<S: serde::Serializer>(
    pins: &crate::remote::RemotePins,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&pins.prefix)
}

/// Times in seconds.
pub(crate) mod seconds {
    use core::time::Duration;
    use serde::{Deserialize, Deserializer, Serializer, de::Error as _};

    pub fn serialize<S: Serializer>(time: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(time.as_secs_f64())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
        let seconds = f64::deserialize(deserializer)?;
        Duration::try_from_secs_f64(seconds).map_err(D::Error::custom)
    }
}

/// Times in seconds, or none.
pub(crate) mod some_seconds {
    use core::time::Duration;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

    pub fn serialize<S: Serializer>(
        time: &(impl Copy + Into<Option<Duration>>),
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let time: Option<Duration> = (*time).into();
        time.map(|time| time.as_secs_f64()).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Duration>, D::Error> {
        let seconds = Option::<f64>::deserialize(deserializer)?;
        let time = seconds.map(Duration::try_from_secs_f64).transpose();
        time.map_err(D::Error::custom)
    }
}

/// Numbers of instances by LinuxCNC's names of the kinds of modules.
pub(crate) mod instances {
    use alloc::collections::BTreeMap;
    use alloc::format;
    use alloc::string::String;
    use serde::{Deserialize, Deserializer, Serializer, de::Error as _, ser::Error as _};

    use crate::hostmot2::CountedKind;
    use crate::hostmot2::Gtag;

    pub fn serialize<S: Serializer>(
        instances: &BTreeMap<Gtag, u8>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let named = instances.iter().map(|(&gtag, &count)| {
            let kind = CountedKind::of(gtag);
            let kind = kind.ok_or_else(|| S::Error::custom(format!("{gtag} is not counted")))?;
            Ok((kind.name, count))
        });
        let named: BTreeMap<_, _> = named.collect::<Result<_, S::Error>>()?;
        serializer.collect_map(named)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<BTreeMap<Gtag, u8>, D::Error> {
        let named = BTreeMap::<String, u8>::deserialize(deserializer)?;
        let instances = named.into_iter().map(|(name, count)| {
            let kind = CountedKind::named(&name).ok_or_else(|| {
                let known = CountedKind::ALL.map(|kind| kind.name).join("', '");
                D::Error::custom(format!("no module is '{name}'; known: '{known}'"))
            })?;
            Ok((kind.key(), count))
        });
        instances.collect()
    }
}

/// Kinds of remotes by the titles of their tables. Only those that are built in can be read.
pub(crate) mod kind {
    use alloc::format;
    use alloc::string::String;
    use alloc::vec::Vec;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

    use crate::boards::REMOTES;
    use crate::discovery::RemoteTable;

    impl Serialize for RemoteTable {
        fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            serializer.serialize_str(self.title)
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<&'static RemoteTable>, D::Error> {
        let Some(title) = Option::<String>::deserialize(deserializer)? else {
            return Ok(None);
        };
        let known = REMOTES.into_iter().find(|table| table.title == title);
        known.map(Some).ok_or_else(|| {
            let titles: Vec<_> = REMOTES.iter().map(|table| table.title).collect();
            let titles = titles.join("', '");
            D::Error::custom(format!("no kind of remote is '{title}'; known: '{titles}'"))
        })
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;
    use core::time::Duration;
    use serde_json::{from_str, json, to_value};

    use crate::bus::{BusErrorKind, BusStatistics, Instant};
    use crate::driver::{DriverStatistics, Event, EventKind, OfflineReason, RemoteState};
    use crate::driver::{PortStatistics, TimeHistogram};
    use crate::events::tests::event;
    use crate::lbp::RemoteFaults;
    use crate::sslbp::RemoteName;
    use crate::{Pace, RemoteLabel, Settings};

    #[test]
    fn settings_file_holds_differences_and_refuses_unknown_names() {
        let some = r#"{"period": 0.0005, "fault_policy": {"fault_lim": 50}}"#;
        let settings: Settings = from_str(some).expect("settings");
        assert_eq!(settings.period, Duration::from_micros(500));
        assert_eq!(settings.fault_policy.fault_lim, 50);
        assert_eq!(settings.fault_policy.fault_inc, 10);
        assert_eq!(settings.pace, Pace::Host);
        for (bad, said) in [
            (r#"{"perod": 1}"#, "unknown field `perod`"),
            (r#"{"period": -1}"#, "negative"),
            (r#"{"pace": "nobody"}"#, "unknown variant `nobody`"),
            (r#"{"defaults": "mach3"}"#, "unknown variant `mach3`"),
            (
                r#"{"instances": {"resolver": 0}}"#,
                "no module is 'resolver'; known: 'encoder', 'pwmgen', 'stepgen', ",
            ),
            (
                r#"{"serial_ports": {"0": {"channels": {"1": {"kind": "7I99"}}}}}"#,
                "no kind of remote is '7I99'; known: '7I77",
            ),
        ] {
            let error = from_str::<Settings>(bad).expect_err(bad).to_string();
            assert!(error.contains(said), "{bad}: {error}");
        }
    }

    #[test]
    fn event_is_flat_and_comes_back() {
        let reason = OfflineReason::FieldPower(RemoteFaults::LOW_VOLTAGE);
        let kind = EventKind::RemoteOffline {
            remote: RemoteLabel::new((0, 2), RemoteName(*b"7I72")),
            reason,
        };
        let event = event(Instant::from_nanos(5_000_001), 7, kind);
        let expected = json!({
            "at": 5_000_001, "cycle": 7, "event": "remote-offline", "port": 0, "channel": 2,
            "name": "7I72",
            "reason": { "field-power": "LOW_VOLTAGE" },
        });
        assert_eq!(to_value(event).expect("JSON"), expected);
        let back: Event = from_str(&expected.to_string()).expect("an event");
        assert_eq!(back, event);
        let why = BusErrorKind::Unreachable;
        let read = to_value(EventKind::ReadFailed { why }).expect("JSON");
        assert_eq!(
            read,
            json!({ "event": "read-failed", "why": "unreachable" })
        );
    }

    #[test]
    fn statistics_and_states_have_their_names() {
        let mut times = TimeHistogram::default();
        times.record(Duration::from_micros(60));
        let expected = json!({
            "count": 1, "shortest": 0.00006, "median": 0.00006, "percentile_99": 0.00006,
            "longest": 0.00006,
        });
        assert_eq!(to_value(&times).expect("JSON"), expected);
        let driver = to_value(DriverStatistics::default()).expect("JSON");
        assert_eq!(driver["watchdog_bites"], 0);
        let port = to_value(PortStatistics::default()).expect("JSON");
        assert_eq!(port["doit"]["count"], 0);
        assert_eq!(port["doit"]["median"], json!(null));
        let bus = to_value(BusStatistics::default()).expect("JSON");
        assert_eq!(bus["late_writes"], 0);
        let state = RemoteState::Offline {
            reason: OfflineReason::Watchdog,
            next_attempt: None,
        };
        let expected = json!({ "state": "offline", "reason": "watchdog", "next_attempt": null });
        assert_eq!(to_value(state).expect("JSON"), expected);
    }
}
