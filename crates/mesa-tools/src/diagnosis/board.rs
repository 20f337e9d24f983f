//! Condition of a board and its remotes.

use core::time::Duration;

use super::{FigureVerdict, Finding, Packets, RoundTrips};
use crate::Counted;
use crate::advice::told;
use mesa_hal::Rounded;
use mesa_hal::boards::{REMOTES, i7i77};
use mesa_hal::discovery::{DataDirection, RemoteDescriptor};
use mesa_hal::driver::{OfflineReason, Remark, RemarkKind, RemoteState, RemoteStatus};
use mesa_hal::ethernet::{Counters, Identity};
use mesa_hal::hostmot2::Idrom;
use mesa_hal::lbp::RemoteFaults;
use mesa_hal::lbp16::registers::{eeprom, read_only};

/// Tolerance for lost or late replies: a machine runs with up to one in this number.
const LOSS: u64 = 200;

/// An EEPROM of which Mesa's part, with card name and MAC address, was never written, and what to
/// do; `None` for a sound one.
pub fn unwritten_eeprom(identity: &Identity) -> Option<(String, &'static str)> {
    // A multicast address is no board's own, and an erased one is FF:FF:FF:FF:FF:FF.
    let has_mac = identity.mac.0[0] & 1 == 0 && identity.mac.0 != [0; 6];
    let lacks = match (has_name(&identity.card), has_mac) {
        (true, true) => return None,
        (true, false) => "no MAC address",
        (false, true) => "no card name",
        (false, false) => "neither card name nor MAC address",
    };
    Some((
        format!("the EEPROM of the network side has {lacks}"),
        "it was never written, or is erased. Other programs refuse such a board, and its flash memory cannot be \
         written: ask Mesa how to write the EEPROM",
    ))
}

/// True for a card name that a board can have: an EEPROM that was never written has other
/// characters.
pub fn has_name(card: &str) -> bool {
    card.starts_with(|first: char| first.is_ascii_alphanumeric())
}

/// Judges the firmware of the Ethernet side, and its EEPROM.
pub fn firmware(identity: &Identity) -> Finding {
    let version = identity.firmware_version;
    if let Some((figure, advice)) = unwritten_eeprom(identity) {
        return Finding::new(FigureVerdict::Bad, "EEPROM", figure, advice);
    }
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

/// Names a board of the T generation, by its card's name or its FPGA: the difference matters for
/// programs that write its flash memory, and for LinuxCNC.
pub fn generation(card: &str, idrom: &Idrom) -> Option<Finding> {
    let t_board = t_board(card, idrom)?;
    let advice = "nothing to do to drive it; LinuxCNC drives its PWM from 2.9.2 on, and its configurations \
                  are .bin files, which Mesa's mesaflash writes";
    Some(Finding::new(
        FigureVerdict::Look,
        "board generation",
        t_board,
        advice,
    ))
}

/// Description of a board of the T generation (FACTS 9.6); `None` for any other.
pub fn t_board(card: &str, idrom: &Idrom) -> Option<String> {
    let is_t = card.len() > 1 && card.ends_with('T') || idrom.is_7i97t();
    is_t.then(|| {
        format!(
            "{card} is a T board: an Efinix FPGA ({} kgates, ClockHigh {} MHz) and another layout of its flash \
             memory than the board without the T",
            idrom.fpga_size,
            idrom.clock_high_hz / 1_000_000
        )
    })
}

/// Causes of the errors that a board counts.
const CABLE: &str = "check the cable, its shield and where it runs beside motor cables";
const PROGRAM: &str =
    "a program asked for what the board does not have, such as a wrong address by `mesa raw`";

/// What to look for if packets were damaged, or accesses refused.
fn causes(is_damaged: bool, is_refused: bool) -> String {
    match (is_damaged, is_refused) {
        (true, true) => format!("packets: {CABLE}; errors: {PROGRAM}"),
        (true, false) => CABLE.to_owned(),
        (false, _) => PROGRAM.to_owned(),
    }
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
    let is_damaged = counters.received_bad > 0 || counters.sent_bad > 0;
    let is_refused =
        counters.parse_errors > 0 || counters.memory_errors > 0 || counters.write_errors > 0;
    let advice = causes(is_damaged, is_refused);
    Finding::new(FigureVerdict::Look, check, some.join(", "), advice)
}

/// Judges the packets that were lost.
pub fn loss(packets: &Packets) -> Finding {
    let check = "packet loss";
    let figure = packets.loss().to_string();
    let verdict = match packets.lost {
        _ if packets.sent == 0 => FigureVerdict::Unknown,
        0 => return Finding::good(check, figure),
        lost if lost.saturating_mul(LOSS) <= packets.sent => FigureVerdict::Look,
        _ => FigureVerdict::Bad,
    };
    let advice = if packets.damaged > 0 {
        "check the cable, its plugs and its shield, and where it runs beside motor cables"
    } else {
        "nothing may be lost on a direct cable: check cable and plugs, leave switches out, and look for \
         other traffic"
    };
    Finding::new(verdict, check, figure, advice)
}

/// Judges the response times. A late reply is one that a cycle would not have waited for: not lost,
/// but as good as lost.
pub fn latency(trips: &RoundTrips, period: Duration) -> Finding {
    let check = "latency against period";
    // Deadline that the driver sets for a reply.
    let room = period * 4 / 5;
    let late = trips.longer_than(room) as u64;
    let [median, p99, max] = [0.5, 0.99, 1.0].map(|share| trips.quantile(share));
    if max.is_zero() {
        let advice = "see packet loss";
        return Finding::new(FigureVerdict::Unknown, check, "no reply came", advice);
    }
    let figure = format!(
        "{} of {} late: median {}, 99 % {}, longest {}, and a period of {} waits for {}",
        match late {
            0 => "none".to_owned(),
            late => late.to_string(),
        },
        Counted((trips.asked() - trips.lost).into(), "reply"),
        Rounded(&median),
        Rounded(&p99),
        Rounded(&max),
        Rounded(&period),
        Rounded(&room)
    );
    let verdict = if late == 0 {
        return Finding::good(check, figure);
    } else if late.saturating_mul(LOSS) <= trips.asked().into() {
        FigureVerdict::Look
    } else {
        FigureVerdict::Bad
    };
    Finding::new(verdict, check, figure, cause(trips, room))
}

/// Names the cause of late replies.
fn cause(trips: &RoundTrips, room: Duration) -> String {
    let woken = Rounded(&trips.woken_late);
    let cause = if trips.quantile(0.5) > room {
        return "even the usual reply takes too long: leave switches and routers out, see the network \
                card's interrupts, or take a longer --period"
            .to_owned();
    } else if trips.woken_late >= room / 2 {
        format!(
            "this computer ran the program up to {woken} late meanwhile, which delays replies as well: see \
             kernel, priority and CPUs"
        )
    } else {
        format!(
            "this computer ran the program at most {woken} late meanwhile, so the network delays them: see \
             the network card, its driver and interrupts, and leave switches out"
        )
    };
    format!("{cause}; the cable is not the cause, as late packets are not lost")
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

/// Judges a remote: its state and faults, its field power, its watchdog.
pub fn remote(status: &RemoteStatus<'_>, period: Duration) -> [Finding; 3] {
    let place = status.label.to_string();
    let mut records = status.descriptor.process_data.iter();
    let is_measured = records.any(|record| record.is_named("FieldVoltage"));
    let unmeasured = (!is_measured).then(|| unmeasured(status.descriptor));
    [
        state(&place, &status.state, status.faults),
        field_power(&place, status.faults, unmeasured),
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
            let advice = if reason.is_about_identity() {
                "mend that; nothing brings another card or firmware back while a program runs"
            } else {
                "mend that; it comes back by itself"
            };
            Finding::new(FigureVerdict::Bad, check, figure, advice)
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

/// Advice for missing field power, with the rule whose breach destroys outputs (manual: 7I77, "VIN
/// AND FIELD POWER SUPPLY").
const SUPPLY: &str = "check its supply, fuse and wires; never switch field power on by a switch or relay at the \
                      card: it must rise slower than 10 V/ms (manuals of 7I77 and 7I72)";

/// Figure and advice for a remote that does not measure its field power: what this card can do.
fn unmeasured(descriptor: &RemoteDescriptor) -> (&'static str, String) {
    let mut tables = REMOTES.iter();
    let table = tables.find(|table| table.matches(descriptor));
    if table.is_some_and(|table| **table == i7i77::ANALOG) {
        let advice = "nothing to do: the field I/O of the same 7I77 has the same supply, and measures it in \
                      software mode 2";
        return ("not measured by this part of the card", advice.to_owned());
    }
    let element = table.and_then(|table| table.element("FieldVoltage", DataDirection::Input));
    let Some(element) = element else {
        return (
            "not measured by this card",
            "measure it at its terminals".to_owned(),
        );
    };
    let mode = element.modes.trailing_zeros();
    let advice = format!(
        "measure it at its terminals, or let the card do it, in software mode {mode}: `mesa pins fieldvoltage \
         --mode PORT.CHANNEL={mode}`"
    );
    ("not measured in this software mode", advice)
}

/// `unmeasured`: figure and advice for a remote whose process data do not have the voltage. Such a
/// remote reports no fault of it.
fn field_power(place: &str, faults: RemoteFaults, unmeasured: Option<(&str, String)>) -> Finding {
    let check = format!("{place}: field power");
    let (figure, advice) = if faults.contains(RemoteFaults::LOW_VOLTAGE) {
        ("missing or too low", SUPPLY)
    } else if faults.contains(RemoteFaults::HIGH_VOLTAGE) {
        (
            "too high",
            "switch it off, and check its supply: cards take 32 V at most",
        )
    } else if let Some((figure, advice)) = unmeasured {
        return Finding::new(FigureVerdict::Unknown, check, figure, advice);
    } else {
        return Finding::good(check, "measured, and no fault reported");
    };
    Finding::new(FigureVerdict::Bad, check, figure, advice)
}

/// Judges a channel without a participating remote. Silence alone is no fault: many boards have
/// unused channels.
pub fn missing(remark: &Remark) -> Finding {
    if let (true, Some(remote)) = (remark.is_silent(), remark.remote) {
        let check = remote.to_string();
        let advice = "nothing to do where no remote is plugged in; else check its cable and its power: without \
                      VIN, which a jumper may take from field power, no remote is found (manual: 7I77, \"VIN AND \
                      FIELD POWER SUPPLY\")";
        return Finding::new(FigureVerdict::Look, check, "nothing answers", advice);
    }
    Finding::new(FigureVerdict::Bad, "missing remote", told(remark), MEND)
}

const MEND: &str = "mend what it says; `mesa info` shows what is known of the remote";

/// True if a remote does not run because its field power is missing or too low.
fn lacks_field_power(remark: &Remark) -> bool {
    let low = RemoteFaults::LOW_VOLTAGE;
    matches!(
        remark.kind,
        RemarkKind::Offline { reason: OfflineReason::FieldPower(faults) } if faults.contains(low)
    )
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
    if matches!(remark.kind, RemarkKind::Offline { .. }) {
        let advice = if lacks_field_power(remark) {
            SUPPLY
        } else {
            MEND
        };
        return Finding::new(FigureVerdict::Bad, "remote offline", told(remark), advice);
    }
    let (check, advice) = match remark.kind {
        RemarkKind::Tables(_) | RemarkKind::Table { .. } | RemarkKind::UnknownPart { .. } => (
            "remote's tables",
            "the driver believes the remote; look whether its firmware is the one that you expect",
        ),
        _ => ("board and remotes", MEND),
    };
    Finding::new(FigureVerdict::Look, check, told(remark), advice)
}

#[cfg(test)]
mod tests {
    use mesa_hal::ethernet::{AddressSource, MacAddress};

    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn advice_on_counted_errors_has_each_of_their_causes() {
        for (damaged, refused) in [(true, false), (false, true), (true, true)] {
            let advice = causes(damaged, refused);
            assert_eq!(advice.contains("cable"), damaged, "{advice}");
            assert_eq!(advice.contains("a program asked"), refused, "{advice}");
        }
    }

    #[test]
    fn advice_for_another_card_does_not_promise_automatic_return() {
        let identity = |unit_number| mesa_hal::sslbp::RemoteIdentity {
            name: mesa_hal::sslbp::RemoteName(*b"7I77"),
            unit_number,
        };
        let [found, expected] = [1, 2].map(identity);
        for (reason, returns) in [
            (OfflineReason::Watchdog, true),
            (OfflineReason::AnotherDevice { found, expected }, false),
        ] {
            let offline = RemoteState::Restarting { reason };
            let advice = state("7i77", &offline, RemoteFaults::empty()).advice;
            let advice = advice.expect("advice");
            assert_eq!(advice.contains("by itself"), returns, "{advice}");
        }
    }

    #[test]
    fn unwritten_eeprom_is_bad_and_no_firmware_is_advised() {
        let identity = |card: &str, mac| Identity {
            card: card.into(),
            mac: MacAddress(mac),
            lbp_version: 3,
            firmware_version: 16,
            jumpers: 1,
            address_from: AddressSource::Eeprom,
            eeprom_ip: [10, 10, 10, 10].into(),
            eeprom_netmask: None,
        };
        let mac = [0x00, 0x60, 0x1B, 0x10, 0x20, 0x30];
        assert_eq!(firmware(&identity("7I97", mac)).verdict, FigureVerdict::Ok);
        for (card, mac) in [("?", mac), ("", mac), ("7I97", [0xFF; 6]), ("7I97", [0; 6])] {
            let finding = firmware(&identity(card, mac));
            assert_eq!(finding.verdict, FigureVerdict::Bad, "{finding:?}");
            let advice = finding.advice.clone().expect("advice");
            assert!(
                advice.contains("ask Mesa") && !advice.contains("mesaflash"),
                "{advice}"
            );
        }
    }

    #[test]
    fn watchdog_is_fed_by_three_periods_and_lets_nothing_run_on() {
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

    fn trips(micros: &[u64], woken_late: u64) -> RoundTrips {
        let times = micros.iter().map(|&us| Duration::from_micros(us)).collect();
        RoundTrips::new(times, 0, Duration::from_micros(woken_late))
    }

    /// 1000 replies that take 100 us, but the first ones these times.
    fn with(first: &[u64]) -> Vec<u64> {
        [first, &[100; 1000][first.len()..]].concat()
    }

    #[test]
    fn late_replies_are_judged_by_what_a_cycle_can_wait_for() {
        for (times, verdict, figure) in [
            (
                with(&[800]),
                FigureVerdict::Ok,
                "none of 1000 replies late: ",
            ),
            (
                with(&[951; 5]),
                FigureVerdict::Look,
                "5 of 1000 replies late: ",
            ),
            (
                with(&[951; 6]),
                FigureVerdict::Bad,
                "6 of 1000 replies late: ",
            ),
            (vec![900; 1], FigureVerdict::Bad, "1 of 1 reply late: "),
            (vec![], FigureVerdict::Unknown, "no reply came"),
        ] {
            let finding = latency(&trips(&times, 0), MS);
            assert_eq!(finding.verdict, verdict, "{finding:?}");
            assert!(finding.figure.starts_with(figure), "{finding:?}");
        }
        // One number for all of them: the longest is one of those that are late.
        let figure = latency(&trips(&with(&[951, 2000]), 0), MS).figure;
        let said = "2 of 1000 replies late: median 100 us, 99 % 100 us, longest 2 ms, and a period of 1 ms \
                    waits for 800 us";
        assert_eq!(figure, said);
    }

    #[test]
    fn late_replies_have_a_cause_and_it_is_not_the_cable() {
        for (times, woken_late, cause) in [
            (
                with(&[900; 9]),
                900,
                "this computer ran the program up to 900 us late",
            ),
            (with(&[900; 9]), 30, "so the network delays them"),
            (vec![900; 9], 900, "even the usual reply takes too long"),
        ] {
            let advice = latency(&trips(&times, woken_late), MS)
                .advice
                .expect("advice");
            assert!(
                advice.starts_with(cause) || advice.contains(cause),
                "{advice}"
            );
            assert!(!advice.contains("check"), "{advice}");
        }
    }

    #[test]
    fn lost_packets_are_judged_and_the_cable_is_named() {
        for (lost, sent, verdict) in [
            (0, 1000, FigureVerdict::Ok),
            (5, 1000, FigureVerdict::Look),
            (6, 1000, FigureVerdict::Bad),
            (0, 0, FigureVerdict::Unknown),
        ] {
            let packets = Packets {
                sent,
                lost,
                ..Packets::default()
            };
            let finding = loss(&packets);
            assert_eq!(finding.verdict, verdict, "{finding:?}");
            let advice = finding.advice.unwrap_or_default();
            assert_eq!(advice.contains("cable"), verdict != FigureVerdict::Ok);
        }
    }

    #[test]
    fn remote_without_power_or_with_a_fault_is_bad() {
        let place = "7i77.0.0";
        let unmeasured = || Some(("not measured", String::from("measure it")));
        assert_eq!(
            field_power(place, RemoteFaults::empty(), None).verdict,
            FigureVerdict::Ok
        );
        let unknown = field_power(place, RemoteFaults::empty(), unmeasured());
        assert_eq!(unknown.verdict, FigureVerdict::Unknown, "{unknown:?}");
        let faults = RemoteFaults::LOW_VOLTAGE;
        assert_eq!(
            field_power(place, faults, unmeasured()).verdict,
            FigureVerdict::Bad
        );
        assert_eq!(
            field_power(place, RemoteFaults::HIGH_VOLTAGE, None).verdict,
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
