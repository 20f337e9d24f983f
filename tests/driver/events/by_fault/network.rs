//! Events of a bad network, and of missed periods.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use super::{FAULTY, QUIET, Story, TIMES, all_is_as_written};
use crate::common::ethernet::{self, Fate, SimLink, WIRE, cut, good};
use crate::common::machine::{Machine, fpga, start};
use mesa_hal::bus::Clock;
use mesa_hal::driver::{EventKind, EventMask, Pace, Repeating};
use mesa_hal::transport::udp::UdpBus;
use mesa_hal_sim::{FaultKind, FaultPlace, Motor, machines};

/// A network that loses some of the packets.
struct Network {
    story: Story<UdpBus<SimLink>>,
    /// The fate of the next packets.
    losing: Rc<Cell<Losing>>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Losing {
    requests: u32,
    writes: u32,
    replies: u32,
    /// The packets arrive, but this much later.
    late: Option<u64>,
}

/// Selects the number that a packet counts down.
type Pick = for<'a> fn(&'a mut Losing, &[u8]) -> &'a mut u32;

fn fate(losing: &Rc<Cell<Losing>>, pick: Pick) -> Fate {
    let losing = Rc::clone(losing);
    Box::new(move |_, packet| {
        let mut plan = losing.get();
        let left = pick(&mut plan, packet);
        let is_hit = *left > 0;
        *left = left.saturating_sub(1);
        losing.set(plan);
        match (is_hit, plan.late) {
            (false, _) => vec![WIRE],
            (true, late) => late.into_iter().collect(),
        }
    })
}

impl Network {
    fn new() -> Self {
        let losing = Rc::new(Cell::new(Losing::default()));
        let mut story = Story::of(Machine::on(ethernet::bus(fpga()), |_| {}));
        let link = story.machine.driver.bus_mut().link();
        link.to_board = fate(&losing, |plan, packet| {
            if ethernet::is_request(packet) {
                &mut plan.requests
            } else {
                &mut plan.writes
            }
        });
        link.to_host = fate(&losing, |plan, _| &mut plan.replies);
        Self { story, losing }
    }

    /// Makes the network behave like that for a while.
    fn meanwhile(&mut self, to_board: Fate, to_host: Fate) {
        let link = self.story.machine.driver.bus_mut().link();
        (link.to_board, link.to_host) = (to_board, to_host);
        self.story.run(FAULTY);
        let link = self.story.machine.driver.bus_mut().link();
        (link.to_board, link.to_host) = (good(), good());
    }

    /// Repeats a loss several times, some cycles apart; checks that all packets were lost.
    fn times(&mut self, plan: Losing) {
        for _ in 0..TIMES {
            self.losing.set(plan);
            self.story.run(20);
            let Losing {
                requests,
                writes,
                replies,
                ..
            } = self.losing.get();
            assert_eq!([requests, writes, replies], [0; 3]);
        }
    }
}

#[test]
fn events_of_a_bad_network_are_what_happened_in_its_order() {
    all_is_as_written("network.txt", |place| place == FaultPlace::Network, tell);
}

fn tell(kind: FaultKind) -> Vec<EventKind> {
    let one = |requests, writes, replies, late| Losing {
        requests,
        writes,
        replies,
        late,
    };
    let mut network = Network::new();
    let mut counted = None;
    match kind {
        FaultKind::NetworkLostRequest => {
            network.times(one(1, 0, 0, None));
            network.times(one(0, 1, 0, None));
            counted = Some([TIMES, TIMES]);
        }
        FaultKind::NetworkLostReply => {
            network.times(one(0, 0, 1, None));
            counted = Some([TIMES, 0]);
        }
        FaultKind::NetworkLate => {
            network.times(one(0, 0, 1, Some(1_500_000)));
            counted = Some([TIMES, 0]);
        }
        FaultKind::NetworkDuplicate => {
            let twice = || -> Fate { Box::new(|_, _| vec![WIRE, WIRE + 3_000]) };
            network.meanwhile(twice(), twice());
        }
        _ => network.meanwhile(cut(), cut()),
    }
    let mut story = network.story;
    story.run(QUIET);
    story.check(kind);
    if let Some([reads, writes]) = counted {
        let sum = |what: Repeating, one: EventMask, count: fn(&EventKind) -> u32| {
            let told = story.told.iter().map(|kind| match kind {
                EventKind::Repeated {
                    what: of, count, ..
                } if *of == what => *count,
                kind if one.contains(kind.mask()) => count(kind),
                _ => 0,
            });
            // The count of a repetition includes those reported singly.
            told.max().unwrap_or(0)
        };
        let lost = |kind: &EventKind| match kind {
            EventKind::LostWrites { count } => *count,
            _ => 0,
        };
        let told = [
            sum(Repeating::FailedReads, EventMask::READ_FAILED, |_| 1),
            sum(Repeating::LostWrites, EventMask::LOST_WRITES, lost),
        ];
        assert_eq!(told, [reads, writes], "{kind}: {:?}", story.told);
    }
    story.rearm();
    story.told
}

#[test]
fn periods_missed_by_a_late_host_are_events_if_board_paces() {
    let fpga = machines::six_axes_7i97(Motor::default());
    let mut driver = start(ethernet::bus(fpga), |s| s.pace = Pace::Board).expect("a 7I97");
    let mut events = driver.events();
    let mut told = || {
        events
            .by_ref()
            .map(|event| event.kind.to_string())
            .collect::<Vec<_>>()
    };
    let _ = driver.read().expect("the board is there");
    let first = driver.bus_mut().link().journal.len();
    let mut cycle = |micros| {
        driver.bus_mut().wait(Duration::from_micros(micros));
        driver.write().expect("the board is there");
        driver.read().expect("the board is there").missed_periods
    };
    assert!((0..50).all(|_| cycle(300) == 0));
    assert_eq!(told(), [""; 0]);
    let missed = [1_500, 2_500, 3_500].map(|micros| {
        let missed = cycle(micros);
        assert!((0..20).all(|_| cycle(300) == 0));
        missed
    });
    assert_eq!(
        told(),
        [format!("periods without a good read: {}", missed[0])]
    );
    assert!((0..QUIET).all(|_| cycle(300) == 0));
    let [line] = &told()[..] else {
        panic!("one line");
    };
    // The board's own clock has started this number of periods without a request.
    let journal = &driver.bus_mut().link().journal[first..];
    let requests = journal.iter().filter(|sent| sent.is_request);
    let times: Vec<u64> = requests.flat_map(|sent| sent.executed.clone()).collect();
    let gaps = times
        .windows(2)
        .map(|pair| (pair[1] - pair[0] + 500_000) / 1_000_000 - 1);
    let all: u64 = gaps.sum();
    assert_eq!(missed.iter().sum::<u64>(), all, "{missed:?}");
    let begin = format!("{all} periods without a good read within 0.0");
    assert!(line.starts_with(&begin), "{line}");
}
