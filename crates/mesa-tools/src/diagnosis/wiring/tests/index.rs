//! Indexes, checked by their latches.

use super::*;

const INDEX: usize = 1;
const OTHER: usize = 2;

impl Cabinet {
    fn is_armed(&self) -> bool {
        self.store.read(self.latches[0]).value
    }

    /// The encoder passes its index: the driver latches it.
    fn index_comes(&mut self) {
        self.store.publish(self.latches[0], false);
        self.run(50);
    }
}

#[test]
fn index_is_in_order_when_its_encoder_was_turned_past_it() {
    for way in [1, -1] {
        let mut cabinet = Cabinet::new();
        assert!(!cabinet.is_armed(), "only when it is asked for");
        cabinet.run(HANDS_OFF.as_millis() as u64);
        cabinet.check.ask(INDEX);
        cabinet.run(50);
        assert!(cabinet.is_armed());
        assert_eq!(cabinet.said, [WiringMessage::Ready(true.into())]);
        cabinet.turn(0, 0, way * 300);
        assert_eq!(cabinet.found, None);
        cabinet.index_comes();
        let expected = WiringJudgement {
            verdict: WiringVerdict::Ok,
            others: Vec::new(),
            moved: Some((0.into(), (way * 300).into())),
        };
        assert_eq!(cabinet.found, Some(expected));
        assert!(!cabinet.is_armed(), "it is not requested again");
    }
}

#[test]
fn unwired_index_is_missing_however_far_its_encoder_turns() {
    let mut cabinet = Cabinet::new();
    cabinet.ask_for(INDEX);
    cabinet.turn(0, 0, 5000);
    cabinet.run(1000);
    cabinet.turn(0, 5000, 9000);
    cabinet.run(1000);
    let expected = [
        WiringMessage::Changed(25.into()),
        WiringMessage::NoIndex(0.into(), 5000.into()),
        WiringMessage::Changed(5025.into()),
        WiringMessage::NoIndex(0.into(), 9000.into()),
    ];
    assert_eq!(cabinet.said, expected);
    assert_eq!(cabinet.found, None, "it goes on waiting");
    // Giving up after the encoder was turned does not count as skipping.
    let found = cabinet.check.give_up(true).expect("asked");
    assert_eq!(found.verdict, WiringVerdict::NoChange);
    assert_eq!(found.moved, Some((0.into(), 9000.into())));
    cabinet.set_latches();
    assert!(!cabinet.is_armed(), "the request is taken back");
    // In the next requests the encoder is not turned.
    cabinet.ask_for(INDEX);
    let skipped = cabinet.check.give_up(true).map(|found| found.verdict);
    assert_eq!(skipped, Some(WiringVerdict::Skipped));
    cabinet.ask_for(INDEX);
    let found = cabinet.give_up();
    assert_eq!(
        (found.verdict, found.moved),
        (WiringVerdict::NoChange, None)
    );
    assert!(!cabinet.is_armed());
}

#[test]
fn index_that_comes_while_its_encoder_stands_is_noise() {
    let mut cabinet = Cabinet::new();
    cabinet.ask_for(INDEX);
    // Another encoder is turned, and this one stands on an edge.
    cabinet.turn(1, 0, 500);
    cabinet.store.publish(cabinet.encoders[0], 1);
    cabinet.index_comes();
    assert_eq!(cabinet.verdict(), WiringVerdict::Unstable);
}

#[test]
fn request_that_was_lost_is_made_again() {
    let mut cabinet = Cabinet::new();
    cabinet.run(HANDS_OFF.as_millis() as u64);
    cabinet.check.ask(INDEX);
    cabinet.run(5);
    cabinet.store.publish(cabinet.latches[0], false);
    cabinet.run(300);
    assert_eq!(cabinet.found, None, "it was never seen to be armed");
    assert_eq!(cabinet.said, []);
    cabinet.run(300);
    assert!(cabinet.is_armed());
    assert_eq!(cabinet.said, [WiringMessage::Ready(true.into())]);
    // While the board is lost the latch shows nothing.
    cabinet.store.fault(cabinet.board);
    cabinet.turn(0, 0, 500);
    cabinet.store.publish(cabinet.latches[0], false);
    cabinet.run(300);
    cabinet.store.group_good(cabinet.board);
    cabinet.run(300);
    assert_eq!(cabinet.found, None);
    let expected = [
        WiringMessage::Ready(true.into()),
        WiringMessage::NotValid,
        WiringMessage::Ready(true.into()),
    ];
    assert_eq!(cabinet.said, expected);
    cabinet.turn(0, 500, 1000);
    cabinet.index_comes();
    assert_eq!(cabinet.verdict(), WiringVerdict::Ok);
}

#[test]
fn index_is_no_change_of_another_input() {
    let mut cabinet = Cabinet::new();
    cabinet.ask_for(OTHER);
    cabinet.store.publish(cabinet.latches[0], true);
    cabinet.run(300);
    cabinet.store.publish(cabinet.latches[0], false);
    cabinet.run(300);
    cabinet.turn(1, 0, 500);
    cabinet.run(1000);
    let found = cabinet.found.take().expect("a judgement");
    assert_eq!(
        (found.verdict, found.others),
        (WiringVerdict::Ok, Vec::new())
    );
}
