//! Packets that were lost or late, and on which way.

use core::fmt::{self, Display};
use core::time::Duration;

use mesa_hal::bus::{BusStatistics, Clock, RegisterBus};
use mesa_hal::driver::Pace;
use mesa_hal::ethernet::{EthernetBoard, Lbp16Board};

use crate::Counted;

/// Time in which a reply that is not lost arrives, however late.
const SETTLE: Duration = Duration::from_millis(50);

/// The counts of a bus and of its board at a point in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketMark {
    /// Counts of the bus.
    pub bus: BusStatistics,
    /// Counts of the board; `None` if they could not be read.
    pub board: Option<BoardCounts>,
}

/// Packet counts of a board, of 16 bits (manual: 7I97, "MEMORY SPACE 6 LAYOUT").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardCounts {
    /// UDP packets received.
    pub received: u16,
    /// Damaged packets received, which the board discarded.
    pub damaged: u16,
}

impl PacketMark {
    /// The present counts. Sends one request.
    pub fn take<B: RegisterBus + Lbp16Board>(bus: &mut B) -> Self {
        let counters = EthernetBoard::new(bus).counters().ok();
        Self {
            board: counters.map(|counters| BoardCounts {
                received: counters.received_udp,
                damaged: counters.received_bad,
            }),
            bus: bus.statistics(),
        }
    }

    /// The packets since this mark. `pace` is that of the cycles in between.
    ///
    /// # Real time
    /// Not for the cycle. If a reply is missing, waits 50 ms first: until then it is late, and not
    /// lost.
    pub fn packets_since<B: RegisterBus + Clock + Lbp16Board>(
        &self,
        bus: &mut B,
        pace: Pace,
    ) -> Packets {
        if bus.statistics().lost > self.bus.lost {
            bus.wait(SETTLE);
        }
        Packets::between(self, &Self::take(bus), pace)
    }
}

/// Packets sent in a time, and those of them and of the replies to them that were lost or late.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Packets {
    /// Packets sent to the board.
    pub sent: u64,
    /// Packets that did not reach the board, and replies that did not come back.
    pub lost: u64,
    /// Those of the lost packets that the board did not receive; `None` if its counters do not show
    /// it: packets were doubled, another program sent some, or the board was restarted.
    pub lost_to_board: Option<u64>,
    /// Packets that the board received damaged, and discarded.
    pub damaged: u64,
    /// Replies that came after their deadline.
    pub late: u64,
}

impl Packets {
    /// The packets between two marks. `pace` is that of the cycles in between: at the host's pace
    /// the writes of a cycle are a packet of their own, whose loss no missing reply shows.
    pub fn between(begin: &PacketMark, end: &PacketMark, pace: Pace) -> Self {
        let counted = |of: fn(&BusStatistics) -> u64| of(&end.bus).saturating_sub(of(&begin.bus));
        let sent = counted(|bus| bus.exchanges);
        let unanswered = counted(|bus| bus.lost);
        let lost = match pace {
            Pace::Host => unanswered + counted(|bus| bus.lost_writes),
            Pace::Board => unanswered,
        };
        let doubled = counted(|bus| bus.duplicate + bus.stale + bus.repeated_writes);
        let blurred = doubled + counted(|bus| bus.foreign_packets);
        let boards = begin.board.zip(end.board);
        let arrived = |(begin, end): (BoardCounts, BoardCounts)| {
            let received = end.received.wrapping_sub(begin.received);
            // The counters have 16 bits.
            let missing = (sent as u16).wrapping_sub(received);
            Some(u64::from(missing)).filter(|missing| *missing <= lost)
        };
        let damaged = boards.map_or(0, |(begin, end)| end.damaged.wrapping_sub(begin.damaged));
        Self {
            sent,
            lost,
            lost_to_board: boards.and_then(arrived).filter(|_| blurred == 0),
            damaged: damaged.into(),
            late: counted(|bus| bus.late),
        }
    }

    /// The lost packets and the late replies in words; `None` without any.
    pub fn trouble(&self) -> Option<String> {
        let late = Counted(self.late, "reply");
        let late = format_args!("{late} late: the computer or the network delays them");
        match (self.lost, self.late) {
            (0, 0) => None,
            (0, _) => Some(late.to_string()),
            (_, 0) => Some(self.loss().to_string()),
            _ => Some(format!("{}; {late}", self.loss())),
        }
    }

    /// The lost packets in words: how many of how many, and on which way.
    pub fn loss(&self) -> impl Display + '_ {
        Loss(self)
    }
}

struct Loss<'a>(&'a Packets);

impl Display for Loss<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let &Packets {
            sent,
            lost,
            lost_to_board,
            damaged,
            ..
        } = self.0;
        let sent = Counted(sent, "packet");
        if lost == 0 {
            return write!(f, "none of {sent} lost");
        }
        write!(f, "{lost} of {sent} lost")?;
        match lost_to_board {
            Some(to) if to == lost => f.write_str(", all on the way to the board")?,
            Some(0) => f.write_str(", all on the way back from the board")?,
            Some(to) => write!(
                f,
                ", {to} on the way to the board and {} on the way back",
                lost - to
            )?,
            None => f.write_str("; the board's counters do not show on which way")?,
        }
        match damaged {
            0 => Ok(()),
            damaged => write!(f, "; the board received {damaged} damaged"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mark of a bus with these counts: packets sent, requests without a reply, lost writes.
    fn mark(sent: u64, lost: u64, lost_writes: u64, received: u16) -> PacketMark {
        let mut bus = BusStatistics::of_exchanges(sent);
        (bus.lost, bus.lost_writes) = (lost, lost_writes);
        let damaged = 0;
        let board = Some(BoardCounts { received, damaged });
        PacketMark { bus, board }
    }

    fn told(end: PacketMark, pace: Pace) -> String {
        // The board's counter wraps around.
        let begin = mark(100, 2, 1, 65_000);
        Packets::between(&begin, &end, pace).loss().to_string()
    }

    #[test]
    fn boards_counter_shows_on_which_way_packets_were_lost() {
        let received = |count: u16| 65_000_u16.wrapping_add(count);
        for (end, said) in [
            (
                mark(1100, 2, 1, received(1000)),
                "none of 1000 packets lost",
            ),
            (
                mark(1100, 5, 3, received(996)),
                "5 of 1000 packets lost, 4 on the way to the board and 1 on the way back",
            ),
            (
                mark(1100, 5, 1, received(997)),
                "3 of 1000 packets lost, all on the way to the board",
            ),
            (
                mark(1100, 3, 1, received(1000)),
                "1 of 1000 packets lost, all on the way back from the board",
            ),
            (
                mark(101, 3, 1, received(1)),
                "1 of 1 packet lost, all on the way back from the board",
            ),
            // A restarted counter, or packets of another program.
            (
                mark(1100, 5, 1, received(1001)),
                "3 of 1000 packets lost; the board's counters do not show on which way",
            ),
        ] {
            assert_eq!(told(end, Pace::Host), said);
        }
    }

    #[test]
    fn run_without_trouble_has_no_words() {
        let mut packets = Packets {
            sent: 10,
            ..Packets::default()
        };
        assert_eq!(packets.trouble(), None);
        packets.late = 1;
        let late = "1 reply late: the computer or the network delays them";
        assert_eq!(packets.trouble().as_deref(), Some(late));
        packets.lost = 2;
        packets.lost_to_board = Some(2);
        let both = format!("2 of 10 packets lost, all on the way to the board; {late}");
        assert_eq!(packets.trouble(), Some(both));
    }

    #[test]
    fn lost_exchange_of_the_boards_pace_is_one_packet() {
        let end = mark(1100, 5, 4, 65_000_u16.wrapping_add(997));
        assert!(told(end, Pace::Board).starts_with("3 of 1000 packets lost"));
    }

    #[test]
    fn duplicates_hide_the_direction_of_losses_and_damage_is_shown() {
        let mut end = mark(1100, 4, 1, 65_000_u16.wrapping_add(998));
        if let Some(board) = &mut end.board {
            board.damaged = 2;
        }
        let said = told(end, Pace::Host);
        assert!(
            said.ends_with("to the board; the board received 2 damaged"),
            "{said}"
        );
        end.bus.duplicate = 1;
        assert!(told(end, Pace::Host).contains("do not show on which way"));
    }
}
