//! Condition of a board and its remotes.

use core::time::Duration;

use super::{FigureVerdict, Finding, RoundTrips};
use crate::advice::told;
use mesa_hal::Rounded;
use mesa_hal::driver::{Remark, RemarkKind, RemoteState, RemoteStatus};
use mesa_hal::ethernet::{Counters, Identity};
use mesa_hal::lbp::RemoteFaults;
use mesa_hal::lbp16::registers::{eeprom, read_only};

/// Tolerance for lost or late replies: a machine runs with up to one in this number.
const LOSS: u32 = 200;

/// Judges the firmware of the Ethernet side.
pub fn firmware(identity: &Identity) -> Finding {
    let version = identity.firmware_version;
    let figure = format!("{}, network firmware {version}", identity.card);
    let lacks = if version < read_only::RELOAD_FIRMWARE {
        "it cannot be reloaded over the network"
    } else if version < eeprom::NETMASK_FIRMWARE {
        "it has no netmask"
    } else {
        return Finding::good("firmware", figure);
    };
    let advice = format!("{lacks}: ask Mesa for a newer one, `mesa flash write` writes it");
    Finding::new(FigureVerdict::Look, "firmware", figure, advice)
}

/// Judges the board's error counters.
pub fn errors(counters: &Counters) -> Finding {
    let check = "errors counted";
    let counted = [
        ("parse", counters.parse_errors),
        ("memory", counters.memory_errors),
        ("write", counters.write_errors),
        ("damaged packets", counters.received_bad),
        ("unsent packets", counters.sent_bad),
    ];
    let some: Vec<String> = counted
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    if some.is_empty() {
        return Finding::good(check, "none since it was reset");
    }
    let advice = if counters.received_bad > 0 || counters.sent_bad > 0 {
        "check the cable, its shield and where it runs beside motor cables"
    } else {
        "a program asks for what the board does not have, such as a wrong address by `mesa raw`"
    };
    Finding::new(FigureVerdict::Look, check, some.join(", "), advice)
}

/// Judges lost packets and response times.
pub fn round_trips(trips: &RoundTrips, period: Duration) -> [Finding; 2] {
    [loss(trips), latency(trips, period)]
}

fn loss(trips: &RoundTrips) -> Finding {
    let check = "packet loss";
    let figure = format!("{} of {} lost", trips.lost, trips.asked());
    let verdict = match trips.lost {
        _ if trips.asked() == 0 => FigureVerdict::Unknown,
        0 => return Finding::good(check, figure),
        lost if lost.saturating_mul(LOSS) <= trips.asked() => FigureVerdict::Look,
        _ => FigureVerdict::Bad,
    };
    let advice = "nothing may be lost on a direct cable: check cable and plugs, leave switches out, and \
                  look for other traffic";
    Finding::new(verdict, check, figure, advice)
}

fn latency(trips: &RoundTrips, period: Duration) -> Finding {
    let check = "latency against period";
    let [median, p99, max] = [0.5, 0.99, 1.0].map(|share| trips.quantile(share));
    let figure = format!(
        "median {}, 99 % {}, longest {}, {} longer than the period of {}",
        Rounded(&median),
        Rounded(&p99),
        Rounded(&max),
        trips.late,
        Rounded(&period)
    );
    // Deadline that the driver sets for a reply.
    let room = period * 4 / 5;
    let verdict = if trips.asked() == trips.lost {
        FigureVerdict::Unknown
    } else if trips.late == 0 && max <= room {
        return Finding::good(check, figure);
    } else if p99 <= room && trips.late.saturating_mul(LOSS) <= trips.asked() {
        FigureVerdict::Look
    } else {
        FigureVerdict::Bad
    };
    let advice = format!(
        "answers must come within {}: see what is said of kernel, CPUs and network card, or take a \
         longer --period",
        Rounded(&room)
    );
    Finding::new(verdict, check, figure, advice)
}

/// Judges a watchdog's time against the period that feeds it; `None`: it never bites. `whose` names
/// the watchdog.
pub fn watchdog(whose: &str, time: Option<Duration>, period: Duration) -> Finding {
    /// Longest acceptable time for a machine to move without control.
    const LONG: Duration = Duration::from_millis(200);
    let check = format!("{whose} against period");
    let Some(time) = time else {
        let advice =
            "outputs stay on when the cable breaks: set its time, and switch it off and on";
        let figure = "it never bites, or has not bitten in its time";
        return Finding::new(FigureVerdict::Bad, check, figure, advice);
    };
    let figure = format!("{}, period {}", Rounded(&time), Rounded(&period));
    if time < period * 2 {
        let advice = "one packet that is lost lets it bite: make it longer, or the period shorter";
        return Finding::new(FigureVerdict::Bad, check, figure, advice);
    }
    if time < period * 3 {
        let advice = "two packets that are lost let it bite: make it longer, or the period shorter";
        return Finding::new(FigureVerdict::Look, check, figure, advice);
    }
    if time > LONG {
        let advice = "outputs stay on for so long when the cable breaks: make it shorter";
        return Finding::new(FigureVerdict::Look, check, figure, advice);
    }
    Finding::good(check, figure)
}

/// Judges a remote: its state and faults, its field power, its watchdog. `place` names its place.
pub fn remote(place: &str, status: &RemoteStatus<'_>, period: Duration) -> [Finding; 3] {
    let name = &status.descriptor.name;
    let place = format!("{place}, {name}");
    let mut records = status.descriptor.process_data.iter();
    let is_measured = records.any(|record| record.is_named("FieldVoltage"));
    [
        state(&place, &status.state, status.faults),
        field_power(&place, status.faults, is_measured),
        watchdog(
            &format!("{place}: watchdog"),
            status.watchdog.time(),
            period,
        ),
    ]
}

fn state(place: &str, state: &RemoteState, faults: RemoteFaults) -> Finding {
    let check = format!("{place}: faults");
    match state {
        RemoteState::Running if faults.is_empty() => Finding::good(check, "none, it runs"),
        RemoteState::Running => {
            let advice = "check its loads and its supply";
            Finding::new(FigureVerdict::Look, check, faults.to_string(), advice)
        }
        RemoteState::Offline { reason, .. } | RemoteState::Restarting { reason } => {
            let figure = format!("offline: {}", told(reason));
            Finding::new(
                FigureVerdict::Bad,
                check,
                figure,
                "mend that; it comes back by itself",
            )
        }
        _ => {
            let figure = format!("{state:?}");
            Finding::new(
                FigureVerdict::Unknown,
                check,
                figure,
                "this program is too old for it",
            )
        }
    }
}

/// `is_measured`: the voltage is part of the process data. A remote that does not measure it
/// reports no fault of it.
fn field_power(place: &str, faults: RemoteFaults, is_measured: bool) -> Finding {
    let check = format!("{place}: field power");
    let (figure, advice) = if faults.contains(RemoteFaults::LOW_VOLTAGE) {
        ("missing or too low", "check its supply, fuse and wires")
    } else if faults.contains(RemoteFaults::HIGH_VOLTAGE) {
        ("too high", "switch it off, and check its supply")
    } else if is_measured {
        return Finding::good(check, "measured, and no fault reported");
    } else {
        let figure = "not measured in this software mode";
        let advice = "measure it at its terminals; a 7I77's field I/O measures it itself in software mode 2: \
                      `mesa pins fieldvoltage --mode PORT.CHANNEL=2`";
        return Finding::new(FigureVerdict::Unknown, check, figure, advice);
    };
    Finding::new(FigureVerdict::Bad, check, figure, advice)
}

/// Judges a channel without a participating remote. Silence alone is no fault: many boards have
/// unused channels.
pub fn missing(remark: &Remark) -> Finding {
    if let (true, Some(remote)) = (remark.is_silent(), remark.remote) {
        let check = remote.to_string();
        let advice = "nothing to do where no remote is plugged in; else check its cable and its power (field \
                      power too, where it is powered from there)";
        return Finding::new(FigureVerdict::Look, check, "nothing answers", advice);
    }
    let advice = "mend what it says; `mesa info` shows what is known of the remote";
    Finding::new(FigureVerdict::Bad, "missing remote", told(remark), advice)
}

/// Judges an anomaly of a running remote, or a module of the firmware that is not driven.
pub fn odd(remark: &Remark) -> Finding {
    if matches!(remark.kind, RemarkKind::Undriven(_)) {
        let advice = "nothing to do if nothing is connected to its pins; else load a firmware without it, or \
                      drive it with a module of your own";
        return Finding::new(
            FigureVerdict::Look,
            "module not driven",
            told(remark),
            advice,
        );
    }
    let advice =
        "the driver believes the remote; look whether its firmware is the one that you expect";
    Finding::new(FigureVerdict::Look, "remote's tables", told(remark), advice)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn trips(micros: &[u64], lost: u32, late: u32) -> RoundTrips {
        let times = micros.iter().map(|&us| Duration::from_micros(us)).collect();
        RoundTrips::new(times, lost, late)
    }

    #[test]
    fn a_watchdog_is_fed_by_three_periods_and_lets_nothing_run_on() {
        for (time, verdict) in [
            (None, FigureVerdict::Bad),
            (Some(1_999), FigureVerdict::Bad),
            (Some(2_000), FigureVerdict::Look),
            (Some(3_000), FigureVerdict::Ok),
            (Some(200_000), FigureVerdict::Ok),
            (Some(200_001), FigureVerdict::Look),
        ] {
            let finding = watchdog("watchdog", time.map(Duration::from_micros), MS);
            assert_eq!(finding.verdict, verdict, "{finding:?}");
        }
    }

    #[test]
    fn answers_are_judged_by_what_a_cycle_can_wait_for() {
        let usual = [100; 1000];
        let mut peak = usual;
        peak[7] = 900;
        for (trips, verdicts) in [
            (trips(&usual, 0, 0), [FigureVerdict::Ok, FigureVerdict::Ok]),
            (
                trips(&peak, 5, 0),
                [FigureVerdict::Look, FigureVerdict::Look],
            ),
            (
                trips(&usual, 6, 1),
                [FigureVerdict::Bad, FigureVerdict::Look],
            ),
            (trips(&usual, 0, 6), [FigureVerdict::Ok, FigureVerdict::Bad]),
            (
                trips(&[900; 1000], 0, 0),
                [FigureVerdict::Ok, FigureVerdict::Bad],
            ),
            (
                trips(&[], 10, 0),
                [FigureVerdict::Bad, FigureVerdict::Unknown],
            ),
            (
                trips(&[], 0, 0),
                [FigureVerdict::Unknown, FigureVerdict::Unknown],
            ),
        ] {
            let findings = round_trips(&trips, MS);
            let found = findings.each_ref().map(|finding| finding.verdict);
            assert_eq!(found, verdicts, "{findings:?}");
        }
    }

    #[test]
    fn a_remote_without_power_or_with_a_fault_is_bad() {
        let place = "port 0, channel 0";
        assert_eq!(
            field_power(place, RemoteFaults::empty(), true).verdict,
            FigureVerdict::Ok
        );
        let unknown = field_power(place, RemoteFaults::empty(), false);
        assert_eq!(unknown.verdict, FigureVerdict::Unknown, "{unknown:?}");
        let faults = RemoteFaults::LOW_VOLTAGE;
        assert_eq!(
            field_power(place, faults, false).verdict,
            FigureVerdict::Bad
        );
        assert_eq!(
            field_power(place, RemoteFaults::HIGH_VOLTAGE, true).verdict,
            FigureVerdict::Bad
        );
        let running = RemoteState::Running;
        assert_eq!(
            state(place, &running, RemoteFaults::empty()).verdict,
            FigureVerdict::Ok
        );
        assert_eq!(state(place, &running, faults).verdict, FigureVerdict::Look);
        let offline = RemoteState::Restarting {
            reason: mesa_hal::driver::OfflineReason::FieldPower(faults),
        };
        assert_eq!(state(place, &offline, faults).verdict, FigureVerdict::Bad);
    }
}
