//! Arbitrary calls in any order, on any network, beside any other client.

use super::*;
use crate::bus::BusError;

#[derive(Clone, Copy, Debug)]
enum Step {
    Read,
    Write,
    PacedRead,
    Start(usize),
    Finish(usize),
    Exchange,
    WriteAlone,
    Run,
    Send,
    Wait(u64),
    /// A packet of another client: a query, or a write to scratch registers.
    Other(Option<(u16, u16)>),
    Reset,
    /// The board has received this many packets more than any sender accounts for.
    Counts(u16),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        8 => Just(Step::Read),
        8 => Just(Step::Write),
        3 => Just(Step::PacedRead),
        4 => (0..4_usize).prop_map(Step::Start),
        4 => (0..4_usize).prop_map(Step::Finish),
        1 => Just(Step::Exchange),
        1 => Just(Step::WriteAlone),
        1 => Just(Step::Run),
        1 => Just(Step::Send),
        4 => (0..3_000_000_u64).prop_map(Step::Wait),
        1 => prop::option::of((0..6_u16, 0x5000..0xA000_u16)).prop_map(Step::Other),
        1 => Just(Step::Reset),
        1 => (0x100..0x1000_u16).prop_map(Step::Counts),
    ]
}

/// Independent knowledge, from the board's side, of the replies that were taken.
#[derive(Debug, Default)]
struct Witness {
    /// Executions up to here were covered by the reply that was taken last.
    heard: Option<usize>,
}

impl Witness {
    /// Records that a reply was taken. True if its board had executed the newest write last, and
    /// nothing else since the previous reply.
    fn is_certain(&mut self, network: &Network) -> bool {
        let taken = network.delivered.expect("a reply came");
        let request = network.executions[taken].request.expect("to a request");
        let asked = network.asked[&request];
        let until = &network.executions[..=taken];
        let last = until.iter().rev().find_map(|e| e.write);
        let Some(heard) = self.heard.replace(taken) else {
            return last == asked;
        };
        let since = until.get(heard + 1..).unwrap_or(&[]);
        let mut writes = since.iter().filter_map(|e| e.write);
        let is_alone = writes.next().is_none_or(|write| Some(write) == asked);
        let is_foreign = |e: &Execution| e.write.is_none() && e.request.is_none();
        last == asked && is_alone && writes.next().is_none() && !since.iter().any(is_foreign)
    }
}

/// Another client's packet.
fn packet_of_another(scratch: Option<(u16, u16)>) -> Vec<u8> {
    match scratch {
        // A read of the cookie.
        None => vec![0x81, 0x42, 0x00, 0x01],
        Some((at, value)) => {
            let [low, high] = value.to_le_bytes();
            vec![0x81, 0xD1, 0x10 + 2 * at as u8, 0x00, low, high]
        }
    }
}

/// Applies a disturbance from outside to the board.
fn disturb(network: &mut Network, step: Step, n: usize) {
    match step {
        Step::Other(scratch) => {
            network.execute(&packet_of_another(scratch));
            return;
        }
        Step::Reset => {
            network.scratch.clear();
            // The counts restart at a value of which none is by chance the one that was due: a
            // reset with the expected count could not be detected.
            (network.received, network.sent) = (0x400 * n as u16, 0);
        }
        Step::Counts(more) => network.received = network.received.wrapping_add(more),
        _ => {}
    }
    network.executions.push(Execution::default());
}

fn check(mut bus: UdpBus<Network>, steps: &[Step]) -> Result<(), TestCaseError> {
    let first = bus.link().newest.request.unwrap_or(0);
    let cycle = Cycle::new(&mut bus);
    let paced = bus
        .prepare(&[Access::read(0x3000, 0, 2)], Some(hold(0)))
        .unwrap();
    let accesses = [Access::write(0x2000, 2, 1), Access::read(0x1000, 0, 2)];
    let mixed = bus.prepare(&accesses, Some(hold(1))).unwrap();
    let lists = [&cycle.read, &paced, &cycle.write, &mixed];
    // Doubts that were reported, and whether the truth since then is certain. Reports before the
    // first list belong to no list.
    let (mut told, mut is_certain_since, mut is_cyclic) = (0, true, false);
    let mut witness = Witness::default();
    let (mut good, mut writes) = (0_u64, 0);
    for (n, step) in steps.iter().enumerate() {
        let value = 0xC0DE_0000 + n as u32;
        let mut words = [0, 0, value];
        let before = bus.statistics();
        let number = bus.link().newest.request;
        // Whether it is answered, and the earliest request that may have been.
        let (result, is_answered) = match *step {
            Step::Read => (bus.run(&cycle.read, &mut words).map(Some), true),
            Step::PacedRead => (bus.run(&paced, &mut words).map(Some), true),
            Step::Write => (bus.run(&cycle.write, &mut words).map(Some), false),
            Step::Start(n) => (bus.start(lists[n], &words).map(|()| None), false),
            Step::Finish(n) => (bus.finish(lists[n], &mut words).map(Some), n != 2),
            Step::Exchange => (bus.exchange(&accesses, &mut words).map(|()| None), true),
            Step::WriteAlone => (bus.write(0x2000, value).map(|()| None), true),
            Step::Run => {
                let mut reply = [0; 4];
                let result = bus.run_commands(&packet_of_another(None), &mut reply, MS);
                (result.map(|()| None), true)
            }
            Step::Send => {
                let result = Lbp16Board::send(&mut bus, &packet_of_another(None));
                (result.map(|()| None), false)
            }
            Step::Wait(nanos) => {
                bus.wait(Duration::from_nanos(nanos));
                (Ok(None), false)
            }
            Step::Other(_) | Step::Reset | Step::Counts(_) => {
                disturb(bus.link(), *step, n);
                (Ok(None), false)
            }
        };
        let after = bus.statistics();
        writes += u64::from(matches!(
            step,
            Step::Write | Step::WriteAlone | Step::Exchange | Step::Start(2 | 3)
        ));
        prop_assert_eq!(words[2], value);
        let is_read = !matches!(step, Step::WriteAlone | Step::Run | Step::Write);
        let network = bus.link();
        is_cyclic |= matches!(
            step,
            Step::Read | Step::PacedRead | Step::Write | Step::Start(_)
        );
        if let Err(error) = result {
            if error == BusError::NotStarted {
                continue;
            }
            prop_assert_eq!(&words[..2], &[0, 0], "{:?}", step);
            if matches!(step, Step::Exchange | Step::WriteAlone | Step::Run) {
                // A query in between may have been answered.
                witness.heard = None;
            }
        } else if let (Ok(reply), true) = (result, is_answered) {
            good += 1;
            if is_read {
                let since = number.unwrap_or(first)..;
                let mut answers = network.answers.range(since).flat_map(|(_, all)| all);
                let is_its = answers.any(|answer| answer[..] == words[..2]);
                prop_assert!(is_its, "{step:?} {words:?}");
            }
            let is_certain = witness.is_certain(network);
            let is_doubtful = after.doubts > before.doubts;
            prop_assert!(
                is_certain || is_doubtful,
                "step {n}, {step:?}: nothing said"
            );
            is_certain_since &= is_certain;
            if let Some(reply) = reply {
                prop_assert_eq!(reply.certain, told == after.doubts, "step {}", n);
                prop_assert!(!reply.certain || is_certain_since, "step {n}: {reply:?}");
                (told, is_certain_since) = (after.doubts, true);
            }
        }
        if !is_cyclic {
            (told, is_certain_since) = (after.doubts, true);
        }
        prop_assert!(
            after.doubts >= before.doubts && after.repeated_writes >= before.repeated_writes
        );
        let accounted = after.lost_writes + after.unconfirmed_writes;
        prop_assert!(accounted <= after.exchanges.max(writes), "{after:?}");
        prop_assert!(good + after.lost <= after.exchanges, "{good} {after:?}");
        prop_assert!(after.late + after.short <= 2 * after.exchanges, "{after:?}");
    }
    Ok(())
}

fn hold(before: usize) -> Hold {
    Hold { before, limit: MS }
}

fn bus_with(held: u64) -> UdpBus<Network> {
    let network = Network {
        held,
        ..Network::default()
    };
    let config = UdpConfig {
        setup_deadline: 2 * MS,
        setup_tries: 3,
        ..UdpConfig::default()
    };
    UdpBus::new(network, config).unwrap()
}

/// Mostly good, so that the sequences get far.
fn fates() -> impl Strategy<Value = Vec<Fate>> {
    let whole = fate().prop_filter("a board ignores a cut request", |fate| {
        !matches!(fate, Fate::Cut(..))
    });
    prop::collection::vec(prop_oneof![3 => Just(GOOD), 1 => whole], 0..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn words_match_requests_and_doubts_are_reported_in_any_order(
        steps in prop::collection::vec(step(), 1..60),
        requests in fates(),
        replies in prop::collection::vec(prop_oneof![3 => Just(GOOD), 1 => fate()], 0..60),
        refusals in prop::collection::vec(prop::bool::weighted(0.1), 0..60),
        held in 0..1_500_000_u64,
    ) {
        let mut bus = bus_with(held);
        let network = bus.link();
        (network.requests, network.replies, network.refusals) = (requests, replies, refusals);
        check(bus, &steps)?;
    }
}
