//! Bouncing, pulsing and chattering inputs.

use super::*;

#[test]
fn bounce_is_one_change_and_a_spike_is_none() {
    let mut cabinet = Cabinet::new();
    cabinet.ask(0);
    cabinet.set(0, true);
    cabinet.run(10);
    cabinet.set(0, false);
    cabinet.run(1000);
    assert_eq!(cabinet.said.len(), 1, "{:?}", cabinet.said);
    for to in [true, false] {
        for level in [to, !to, to, !to, to] {
            cabinet.set(0, level);
            cabinet.run(10);
        }
        cabinet.run(300);
    }
    assert_eq!(cabinet.verdict(), WiringVerdict::Ok);
    assert_eq!(cabinet.said.len(), 2, "{:?}", cabinet.said);
}

#[test]
fn input_that_changes_by_itself_is_reported_and_does_not_count() {
    for period in [5, 10, 45, 500] {
        let mut cabinet = Cabinet::new();
        cabinet.pulsing = Some((2, period));
        // Another input is requested: the pulsing one is not reported as changed instead.
        cabinet.ask(0);
        cabinet.run(3000);
        let told = cabinet.said.clone();
        assert!(
            told.contains(&WiringMessage::Restless(SWITCH + 2)),
            "{period}: {told:?}"
        );
        assert!(
            !told.contains(&WiringMessage::Instead(SWITCH + 2)),
            "{period}: {told:?}"
        );
        cabinet.press(&[0]);
        assert_eq!(cabinet.verdict(), WiringVerdict::Ok);
        // The pulsing input itself is never ready.
        cabinet.said.clear();
        cabinet.check.ask(SWITCH + 2);
        cabinet.run(3000);
        assert_eq!(
            cabinet.said,
            [WiringMessage::Restless(SWITCH + 2)],
            "{period}"
        );
        assert_eq!(cabinet.found, None);
        assert_eq!(cabinet.give_up().verdict, WiringVerdict::Unstable);
        // After the repair the input is checked as usual.
        cabinet.pulsing = None;
        cabinet.set(2, false);
        cabinet.check.ask(SWITCH + 2);
        cabinet.run(4000);
        cabinet.press(&[2]);
        assert_eq!(
            cabinet.verdict(),
            WiringVerdict::Ok,
            "{period}: {:?}",
            cabinet.said
        );
    }
}

#[test]
fn input_that_begins_to_pulse_later_is_detected() {
    let mut cabinet = Cabinet::new();
    cabinet.ask(0);
    cabinet.pulsing = Some((2, 500));
    cabinet.run(10_000);
    assert!(cabinet.said.contains(&WiringMessage::Instead(SWITCH + 2)));
    assert!(cabinet.said.contains(&WiringMessage::Restless(SWITCH + 2)));
}

#[test]
fn chattering_input_is_unstable() {
    for period in [10, 45, 150] {
        let mut cabinet = Cabinet::new();
        cabinet.ask(2);
        cabinet.pulsing = Some((2, period));
        cabinet.run(4000);
        assert_eq!(cabinet.found, None, "{period}");
        assert_eq!(
            cabinet.give_up().verdict,
            WiringVerdict::Unstable,
            "{period}"
        );
    }
}
