//! Encoders and analog inputs.

use super::*;

impl Cabinet {
    pub(super) fn turn(&mut self, encoder: usize, from: i32, to: i32) {
        let step = if to > from { 25 } else { -25 };
        let mut count = from;
        while count != to {
            count += step;
            self.store.publish(self.encoders[encoder], count);
            self.run(5);
        }
    }

    pub(super) fn ask_for(&mut self, point: usize) {
        self.run(HANDS_OFF.as_millis() as u64);
        self.check.ask(point);
        self.run(50);
        self.said.clear();
    }
}

#[test]
fn encoder_is_ok_after_counting_up_to_a_stop_and_not_down() {
    for (to, verdict) in [
        (2000, WiringVerdict::Ok),
        (-2000, WiringVerdict::CountsDown),
    ] {
        let mut cabinet = Cabinet::new();
        // The encoder stands on an edge.
        for count in [1, 0, 1, 0] {
            cabinet.store.publish(cabinet.encoders[0], count);
            cabinet.run(300);
        }
        cabinet.ask_for(0);
        cabinet.turn(0, 0, to);
        assert_eq!(cabinet.found, None, "it still moves");
        // The way back is shorter than the way out.
        cabinet.turn(0, to, to / 2);
        // The axis passes its switches.
        cabinet.press(&[1]);
        let found = cabinet.found.take().expect("a judgement");
        assert_eq!(found.verdict, verdict);
        assert_eq!(found.moved, Some((0.into(), to.into())));
    }
}

#[test]
fn encoder_that_counts_instead_or_along_is_reported() {
    let mut cabinet = Cabinet::new();
    cabinet.ask_for(0);
    cabinet.turn(1, 0, 500);
    cabinet.run(1000);
    assert_eq!(cabinet.said, [WiringMessage::Instead(2)]);
    assert_eq!(cabinet.give_up().verdict, WiringVerdict::OtherChanged);
    cabinet.ask_for(0);
    for count in (0..500).step_by(10) {
        cabinet.store.publish(cabinet.encoders[0], count);
        cabinet.store.publish(cabinet.encoders[1], 500 - count);
        cabinet.run(5);
    }
    cabinet.run(1000);
    let found = cabinet.found.take().expect("a judgement");
    assert_eq!(
        (found.verdict, found.others),
        (WiringVerdict::Together, vec![2])
    );
}

#[test]
fn encoder_that_counts_by_itself_or_dithers_is_unstable() {
    let mut cabinet = Cabinet::new();
    cabinet.run(1000);
    cabinet.turn(0, 0, 20_000);
    cabinet.check.ask(0);
    cabinet.said.clear();
    cabinet.turn(0, 20_000, 40_000);
    assert_eq!(cabinet.said, [WiringMessage::Restless(0)]);
    assert_eq!(cabinet.give_up().verdict, WiringVerdict::Unstable);
    // B does not arrive: each edge of A counts to and fro.
    let mut cabinet = Cabinet::new();
    cabinet.ask_for(0);
    for n in 0..60 {
        cabinet.store.publish(cabinet.encoders[0], n % 2);
        cabinet.run(5);
    }
    assert_eq!(cabinet.said, [WiringMessage::Dithers]);
    assert_eq!(cabinet.give_up().verdict, WiringVerdict::Unstable);
}

#[test]
fn analog_input_is_ok_after_moving_by_part_of_its_range() {
    let mut cabinet = Cabinet::new();
    let (first, second) = (VOLTS, VOLTS + 1);
    cabinet.store.publish(cabinet.volts[0], 5.0);
    cabinet.ask_for(first);
    for volts in [5.1, 5.0, 4.9, 5.0] {
        cabinet.store.publish(cabinet.volts[0], volts);
        cabinet.run(200);
    }
    assert_eq!((&cabinet.said[..], &cabinet.found), (&[][..], &None));
    cabinet.store.publish(cabinet.volts[0], 12.0);
    cabinet.run(1000);
    let found = cabinet.found.take().expect("a judgement");
    assert_eq!(found.verdict, WiringVerdict::Ok);
    assert_eq!(found.moved, Some((5.0.into(), 12.0.into())));
    cabinet.ask_for(first);
    cabinet.store.publish(cabinet.volts[1], 12.0);
    cabinet.run(1000);
    assert_eq!(cabinet.said, [WiringMessage::Instead(second)]);
}
