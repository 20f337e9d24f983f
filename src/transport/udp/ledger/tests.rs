use super::*;
use proptest::prelude::*;

/// A board that executes each packet that it receives.
#[derive(Default)]
struct Board {
    slots: [u16; SLOTS],
    last: u16,
    received: u16,
    sent: u16,
}

impl Board {
    fn write(&mut self, WriteNumber { number, slot }: WriteNumber) {
        self.received = self.received.wrapping_add(1);
        self.last = number as u16;
        self.slots[slot] = number as u16;
    }

    /// A cycle that is one packet, executed and answered.
    fn cycle(&mut self, ledger: &mut Ledger) -> WriteReport {
        let WriteNumber { number, slot } = ledger.open_write(WriteEvidence::Cycle);
        self.slots[slot] = number as u16;
        self.reply(ledger, None)
    }

    fn answer(&mut self, ledger: &mut Ledger) -> WriteReport {
        self.reply(ledger, Some(self.last))
    }

    fn reply(&mut self, ledger: &mut Ledger, last_write: Option<u16>) -> WriteReport {
        let asked = ledger.open_request();
        let detailed = ledger.wants_details();
        self.received = self.received.wrapping_add(1);
        let details = Details {
            slots: self.slots,
            sent: self.sent,
        };
        self.sent = self.sent.wrapping_add(1);
        let account = Account {
            last_write,
            received: self.received,
            details: detailed.then_some(details),
        };
        ledger.evaluate(account, asked)
    }
}

const DOUBT: WriteReport = WriteReport {
    lost: 0,
    found: 0,
    late: 0,
    repeated: 0,
    unconfirmed: 0,
    doubt: true,
};

/// A board that has executed a write and reported it.
fn pair() -> (Ledger, Board) {
    let mut ledger = Ledger::starting_after(u32::MAX - 2);
    let mut board = Board::default();
    board.write(ledger.open_write(WriteEvidence::Alone));
    // Earlier packets are unknown.
    assert_eq!(board.answer(&mut ledger), DOUBT);
    (ledger, board)
}

#[test]
fn no_request_for_details_and_no_doubt_without_a_loss() {
    let (mut ledger, mut board) = pair();
    for _ in 0..200_000 {
        board.write(ledger.open_write(WriteEvidence::Alone));
        assert_eq!(board.answer(&mut ledger), WriteReport::default());
        assert!(!ledger.wants_details() && ledger.is_executed());
    }
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
}

#[test]
fn cycle_acknowledges_its_own_write_and_leaves_no_open_doubt() {
    let (mut ledger, mut board) = pair();
    for _ in 0..3 * REMEMBERED {
        assert_eq!(board.cycle(&mut ledger), WriteReport::default());
    }
    assert!(!ledger.wants_details() && ledger.is_executed());
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
    board.write(ledger.open_write(WriteEvidence::Alone));
    assert_eq!(board.cycle(&mut ledger), DOUBT, "two writes, in some order");
    assert_eq!(board.cycle(&mut ledger), WriteReport::default());
    // An older write arrives a second time.
    board.received += 1;
    assert_eq!(board.cycle(&mut ledger), DOUBT);
}

#[test]
fn lost_cycle_is_reported_by_the_next_and_found_if_late() {
    let (mut ledger, mut board) = pair();
    for _ in 0..SLOTS {
        assert_eq!(board.cycle(&mut ledger), WriteReport::default());
    }
    let WriteNumber { number, slot } = ledger.open_write(WriteEvidence::Cycle);
    ledger.open_request();
    let said = WriteReport { lost: 1, ..DOUBT };
    assert_eq!(board.cycle(&mut ledger), said);
    // The write is executed after all, and answered.
    board.slots[slot] = number as u16;
    board.received += 1;
    board.sent += 1;
    let late = WriteReport {
        found: 1,
        late: 1,
        ..DOUBT
    };
    assert_eq!(board.cycle(&mut ledger), late);
    // A write that was executed and whose reply was lost is not lost.
    let WriteNumber { number, slot } = ledger.open_write(WriteEvidence::Cycle);
    ledger.open_request();
    board.slots[slot] = number as u16;
    board.received += 1;
    board.sent += 1;
    assert_eq!(board.cycle(&mut ledger), DOUBT);
    assert_eq!(board.cycle(&mut ledger), WriteReport::default());
}

#[test]
fn old_doubt_does_not_return_after_half_a_wrap_of_the_numbers() {
    let (mut ledger, mut board) = pair();
    assert_eq!(board.cycle(&mut ledger), WriteReport::default());
    board.received += 1;
    assert_eq!(board.cycle(&mut ledger), DOUBT);
    assert_eq!(board.cycle(&mut ledger).repeated, 1, "the details tell");
    assert_eq!(board.cycle(&mut ledger), WriteReport::default());
    // As after this many cycles without a fault: 25 days at 1 kHz.
    for number in [
        &mut ledger.newest,
        &mut ledger.newest_last,
        &mut ledger.settled,
    ] {
        *number = number.wrapping_add(0x8000_0000);
    }
    assert_eq!(board.cycle(&mut ledger), WriteReport::default());
}

#[test]
fn lost_write_is_reported_once_and_found_if_late() {
    let (mut ledger, mut board) = pair();
    let lost = ledger.open_write(WriteEvidence::Alone);
    let said = WriteReport { lost: 1, ..DOUBT };
    assert_eq!(board.answer(&mut ledger), said);
    assert!(!ledger.is_executed() && ledger.wants_details());
    assert_eq!(board.answer(&mut ledger), DOUBT, "until the next write");
    for _ in 0..KEPT - 1 {
        board.write(ledger.open_write(WriteEvidence::Alone));
        assert_eq!(board.answer(&mut ledger), WriteReport::default());
    }
    let newer = ledger.open_write(WriteEvidence::Alone);
    board.write(lost);
    board.write(newer);
    // An unexpected packet was counted; the next request asks for the details.
    assert_eq!(board.answer(&mut ledger), DOUBT);
    let late = WriteReport {
        found: 1,
        late: 1,
        ..DOUBT
    };
    assert_eq!(board.answer(&mut ledger), late);
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
}

#[test]
fn write_that_follows_a_request_is_no_matter_of_its_reply() {
    let (mut ledger, mut board) = pair();
    board.write(ledger.open_write(WriteEvidence::Alone));
    let asked = ledger.open_request();
    board.received += 1;
    let account = Account {
        last_write: Some(board.last),
        received: board.received,
        details: None,
    };
    board.sent += 1;
    let next = ledger.open_write(WriteEvidence::Alone);
    assert_eq!(ledger.evaluate(account, asked), WriteReport::default());
    assert!(!ledger.is_executed());
    board.write(next);
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
    assert!(ledger.is_executed());
}

#[test]
fn write_behind_a_newer_one_is_in_doubt_until_the_next() {
    let (mut ledger, mut board) = pair();
    let [first, second] = [(); 2].map(|()| ledger.open_write(WriteEvidence::Alone));
    board.write(second);
    board.write(first);
    let late = WriteReport { late: 1, ..DOUBT };
    assert_eq!(board.answer(&mut ledger), late);
    assert_eq!(board.answer(&mut ledger), DOUBT, "its values still stand");
    board.write(ledger.open_write(WriteEvidence::Alone));
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
}

#[test]
fn duplicate_write_is_doubted_at_once_and_counted_with_details() {
    let (mut ledger, mut board) = pair();
    let write = ledger.open_write(WriteEvidence::Alone);
    board.write(write);
    board.write(write);
    let said = board.answer(&mut ledger);
    assert_eq!((said.repeated, said.doubt), (0, true));
    let said = board.answer(&mut ledger);
    assert_eq!((said.repeated, said.doubt), (1, true));
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
}

#[test]
fn foreign_packets_are_doubted_at_any_request_and_never_counted() {
    let (mut ledger, mut board) = pair();
    for _ in 0..3 {
        board.write(ledger.open_write(WriteEvidence::Alone));
        board.received += 1;
        board.sent += 1;
        assert_eq!(board.answer(&mut ledger), DOUBT);
    }
    if ledger.wants_details() {
        assert_eq!(board.answer(&mut ledger), WriteReport::default());
    }
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
}

#[test]
fn packet_of_unknown_effect_causes_one_doubtful_reply() {
    let (mut ledger, mut board) = pair();
    board.write(ledger.open_write(WriteEvidence::Alone));
    ledger.lose_count();
    board.received += 1;
    assert_eq!(board.answer(&mut ledger), DOUBT);
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
}

#[test]
fn old_board_number_never_passes_for_a_new_one_without_doubt() {
    let (mut ledger, mut board) = pair();
    // Every write is lost, until the numbers wrap to the one that the board holds.
    for n in 1..0x2_0000_u32 {
        ledger.open_write(WriteEvidence::Alone);
        let said = board.answer(&mut ledger);
        assert!(said.doubt, "{n}: {said:?}");
    }
}

#[test]
fn last_number_of_long_ago_is_not_taken_for_that_of_a_cycle() {
    let (mut ledger, mut board) = pair();
    for n in 0..0x1_0100 {
        assert_eq!(board.cycle(&mut ledger), WriteReport::default(), "{n}");
        assert_eq!(board.answer(&mut ledger), WriteReport::default(), "{n}");
    }
    // Nor is a write that is lost among cycles taken as executed, whatever its number.
    for n in 0..0x1_0100 {
        let _ = board.cycle(&mut ledger);
        ledger.open_write(WriteEvidence::Alone);
        let said = board.answer(&mut ledger);
        assert!(said.doubt, "{n}: {said:?}");
    }
}

#[test]
fn counts_restart_and_open_writes_are_lost_after_a_reset() {
    let (mut ledger, _) = pair();
    ledger.open_write(WriteEvidence::Alone);
    let mut board = Board::default();
    let said = board.answer(&mut ledger);
    assert!(said.doubt && ledger.wants_details());
    let said = board.answer(&mut ledger);
    assert_eq!((said.lost, said.repeated, said.doubt), (1, 0, true));
    board.write(ledger.open_write(WriteEvidence::Alone));
    let _ = board.answer(&mut ledger);
    board.write(ledger.open_write(WriteEvidence::Alone));
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
}

#[test]
fn frozen_counts_are_ignored_and_losses_still_reported() {
    let (mut ledger, mut board) = pair();
    for n in 0..20 {
        let write = ledger.open_write(WriteEvidence::Alone);
        if n % 3 != 0 {
            board.write(write);
        }
        (board.received, board.sent) = (7, 7);
        let said = board.answer(&mut ledger);
        (board.received, board.sent) = (7, 7);
        let is_settled = n > 0;
        assert!(
            !is_settled || said.lost == u32::from(n % 3 == 0),
            "{n}: {said:?}"
        );
    }
}

#[test]
fn more_writes_than_are_remembered_are_unconfirmed_and_not_lost() {
    let (mut ledger, mut board) = pair();
    for _ in 0..100 {
        board.write(ledger.open_write(WriteEvidence::Alone));
    }
    let said = board.answer(&mut ledger);
    assert_eq!((said.lost, said.unconfirmed), (0, 100 - SLOTS as u32));
    assert_eq!(board.answer(&mut ledger), WriteReport::default());
}

proptest! {
    #[test]
    fn no_unsent_write_is_counted_for_any_account_of_the_board(
        steps in prop::collection::vec(
            (0..4_u32, any::<Option<u16>>(), any::<u16>(), prop::option::of(any::<[u16; SLOTS + 1]>())),
            0..80,
        ),
    ) {
        let mut ledger = Ledger::starting_after(5);
        let (mut sent, mut known) = (0, 0);
        for (writes, last_write, received, details) in steps {
            for n in 0..writes {
                let kinds = [WriteEvidence::Alone, WriteEvidence::Cycle, WriteEvidence::Acknowledged];
                ledger.open_write(kinds[n as usize % kinds.len()]);
            }
            sent += writes;
            let asked = ledger.open_request();
            let details = details.map(|[sent, slots @ ..]| Details { slots, sent });
            let said = ledger.evaluate(Account { last_write, received, details }, asked);
            known = known + said.lost + said.unconfirmed - said.found;
            prop_assert!(known <= sent, "{known} of {sent}");
        }
    }
}
