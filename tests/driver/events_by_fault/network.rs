//! The same of a bad network, and of periods that are missed.

use std::cell::Cell;
use std::rc::Rc;

use super::{FAULTY, QUIET, Story, TIMES, differences};
use crate::common::ethernet::{self, Fate, SimLink, WIRE, cut, good};
use crate::common::machine::{Machine, fpga};
use mesa_hal::driver::{EventKind, EventMask, Pace};
use mesa_hal::sim::{FaultKind, MotorConfig, Place, machines};
use mesa_hal::transport::udp::UdpBus;

/// A network that loses some of the packets.
struct Network {
    story: Story<UdpBus<SimLink>>,
    /// What becomes of the next packets.
    losing: Rc<Cell<Losing>>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Losing {
    requests: u32,
    writes: u32,
    replies: u32,
    /// They come, but so much later.
    late: Option<u64>,
}

/// Which of the numbers a packet counts down.
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

    /// The same some times, some cycles apart; all of it was lost.
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
fn what_is_told_of_a_bad_network_is_what_happened_in_its_order() {
    let one = |requests, writes, replies, late| Losing {
        requests,
        writes,
        replies,
        late,
    };
    let mut wrong = String::new();
    let kinds = FaultKind::ALL.iter().copied();
    for kind in kinds.filter(|kind| kind.place() == Place::Network) {
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
                let link = network.story.machine.driver.bus_mut().link();
                link.to_board = Box::new(|_, _| vec![WIRE, WIRE + 3_000]);
                link.to_host = Box::new(|_, _| vec![WIRE, WIRE + 3_000]);
                network.story.run(FAULTY);
                let link = network.story.machine.driver.bus_mut().link();
                (link.to_board, link.to_host) = (good(), good());
            }
            _ => {
                let link = network.story.machine.driver.bus_mut().link();
                (link.to_board, link.to_host) = (cut(), cut());
                network.story.run(FAULTY);
                let link = network.story.machine.driver.bus_mut().link();
                (link.to_board, link.to_host) = (good(), good());
            }
        }
        let story = &mut network.story;
        story.run(QUIET);
        story.check(kind);
        if let Some(counted) = counted {
            let reads = story.total(|_| 1, EventMask::READ_FAILED);
            let lost = |kind: &EventKind| match kind {
                EventKind::LostWrites { count } => *count,
                _ => 0,
            };
            let writes = match counted {
                [_, 0] => story.told.iter().map(lost).sum(),
                _ => story.total(lost, EventMask::LOST_WRITES),
            };
            assert_eq!([reads, writes], counted, "{kind}: {:?}", story.told);
        }
        story.rearm();
        wrong.extend(differences(kind, &story.told));
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn periods_that_a_late_host_misses_are_told_where_the_board_paces() {
    let fpga = machines::six_axes_7i97(MotorConfig::default());
    let mut machine: Machine<_, ()> = Machine::on(ethernet::bus(fpga), |s| s.pace = Pace::Board);
    machine.pace = Pace::Board;
    let mut events = machine.driver.events();
    machine.cycles(50);
    assert_eq!(events.next(), None);
    let mut missed = 0;
    for late in [2, 1, 3] {
        machine.sleep(late);
        let report = machine.cycle();
        missed += report.missed_periods as u32;
        assert_eq!(report.missed_periods, late, "{report:?}");
        machine.cycles(20);
    }
    let told: Vec<_> = events
        .by_ref()
        .map(|event| event.kind.to_string())
        .collect();
    assert_eq!(told, ["periods without a good read: 2"]);
    machine.cycles(QUIET);
    let told: Vec<_> = events
        .by_ref()
        .map(|event| event.kind.to_string())
        .collect();
    let [told] = &told[..] else {
        panic!("{told:?}");
    };
    let all = format!("in all {missed} periods went by without a good read within 0.0");
    assert!(told.starts_with(&all), "{told}");
}
