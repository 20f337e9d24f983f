//! The board paces the cycle: it holds the reads back until its own clock begins the next period.

mod disturbed;
mod dt;

use crate::boards::board_7i97::follow;
use crate::common::machine::{self, start};
use std::time::Duration;

use crate::common::ethernet::{self, SimLink, WIRE, cut, good};
use mesa_hal::MesaError;
use mesa_hal::Settings;
use mesa_hal::boards::I7i97;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{BoardState, CycleReport, Driver, DriverError, Pace};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::transport::udp::UdpBus;
use mesa_hal_sim::{Motor, machines};

const PERIOD: Duration = Duration::from_millis(1);

type Machine = Driver<UdpBus<SimLink>>;

fn bus() -> UdpBus<SimLink> {
    ethernet::bus(machines::six_axes_7i97(Motor::default()))
}

fn machine(pace: Pace) -> Machine {
    start(bus(), |s| s.pace = pace).expect("the board is complete")
}

/// A machine paced by the board, after its first read, which waits for the clock as well.
fn paced() -> Machine {
    let mut driver = machine(Pace::Board);
    let _ = driver.read().expect("the board is there");
    driver
}

/// The host uses some of the period, writes, and reads the data of the board's next period.
fn cycle(driver: &mut Machine, work: Duration) -> CycleReport {
    driver.bus_mut().wait(work);
    driver.write().expect("the board is there");
    driver.read().expect("the board is there")
}

/// Times at which the board answered the requests of the cycle, from the packet `first` on.
fn answered(driver: &mut Machine, first: usize) -> Vec<u64> {
    let journal = &driver.bus_mut().link().journal;
    let requests = journal.iter().skip(first).filter(|sent| sent.is_request);
    requests.flat_map(|sent| sent.executed.clone()).collect()
}

#[test]
fn reads_follow_the_board_period_for_any_work_of_the_host() {
    let mut driver = machine(Pace::Board);
    let first = driver.bus_mut().link().journal.len();
    let _ = driver
        .read()
        .expect("the first waits for the clock as well");
    for n in 0..500_u64 {
        // The host uses varying parts of the period.
        let work = Duration::from_micros(50 + n * 7919 % 700);
        let report = cycle(&mut driver, work);
        assert_eq!((report.missed_periods, report.is_good()), (0, true), "{n}");
        let slack = report.slack.expect("the board waited");
        let taken = work + 4 * Duration::from_nanos(WIRE);
        let expected = PERIOD.saturating_sub(taken);
        let differs = slack.abs_diff(expected);
        assert!(
            differs < Duration::from_micros(60),
            "{slack:?}, {expected:?}"
        );
    }
    let times = answered(&mut driver, first);
    assert_eq!(times.len(), 501);
    for pair in times.windows(2) {
        let period = pair[1] - pair[0];
        // The loop still corrects the phase that it has from the start.
        assert!(period.abs_diff(1_000_000) < 2_000, "{period} ns");
    }
}

#[test]
fn board_that_paces_is_locked_after_the_host_has_kept_pace() {
    let mut driver = paced();
    let mut cycle = |work| cycle(&mut driver, Duration::from_micros(work)).locked;
    let locked: Vec<bool> = (0..150).map(|n| cycle(100 + n * 37 % 500)).collect();
    let first = locked.iter().position(|&locked| locked);
    assert!(first.is_some_and(|n| (118..=121).contains(&n)), "{first:?}");
    assert!(locked[121..].iter().all(|&locked| locked));
    assert!(!cycle(1_500), "a period was missed");
    assert!((0..118).all(|_| !cycle(300)));
    assert!((0..3).any(|_| cycle(300)));
}

#[test]
fn paced_cycle_is_one_packet_each_way_and_smaller_than_linuxcnc() {
    let mut driver = machine(Pace::Board);
    let sync = 0x7600;
    let image = driver.lists().read.as_ref();
    assert!(
        image.iter().all(|access| access.address != sync),
        "it runs free"
    );
    for _ in 0..10 {
        let _ = cycle(&mut driver, Duration::ZERO);
    }
    let before = driver.bus().statistics();
    for _ in 0..100 {
        let _ = cycle(&mut driver, Duration::ZERO);
    }
    let after = driver.bus().statistics();
    assert_eq!(after.exchanges - before.exchanges, 100);
    let mut journal = driver.bus_mut().link().journal.iter();
    let request = journal.next_back().expect("a packet").bytes;
    let reply = (after.bytes_received - before.bytes_received) / 100;
    println!("request {request}, reply {reply} bytes");
    // Eight bytes are the evidence that the board was not reset, which LinuxCNC does not read. In
    // two packets it would be 78 + 116 bytes out.
    assert!(request <= 192 && reply - 4 < 122, "{request}, {reply}");
}

#[test]
fn late_host_misses_a_period_and_gets_the_next() {
    let mut driver = paced();
    for work in [300, 1_400, 300, 3_300, 300_u64] {
        let report = cycle(&mut driver, Duration::from_micros(work));
        assert_eq!(report.missed_periods, work / 1000, "{work} us");
    }
    assert_eq!(driver.statistics().missed_periods, 4);
}

#[test]
fn loop_keeps_its_period_without_a_board() {
    let lost = |link: &mut SimLink| link.to_board = cut();
    let unreachable = |link: &mut SimLink| link.is_unreachable = true;
    for cut in [lost as fn(&mut SimLink), unreachable] {
        let mut driver = paced();
        cut(driver.bus_mut().link());
        for n in 0..20 {
            let before = driver.bus_mut().now();
            let _ = driver.write();
            assert!(driver.read().is_err(), "{n}");
            let took = driver.bus_mut().now().since(before);
            assert!(took >= PERIOD * 9 / 10 && took < PERIOD * 3, "{took:?}");
        }
        assert_eq!(driver.board_state(), BoardState::BusDown);
        let link = driver.bus_mut().link();
        link.to_board = good();
        link.is_unreachable = false;
        for _ in 0..300 {
            let _ = driver.rearm();
            let _ = driver.write();
            let _ = driver.read();
        }
        let report = driver.read().expect("it is back");
        assert_eq!(report.board, BoardState::Running);
    }
}

#[test]
fn board_paces_again_when_set_up_after_a_reset() {
    let mut driver = machine(Pace::Board);
    for _ in 0..50 {
        let _ = driver.read().expect("the board is there");
        driver.write().expect("the board is there");
    }
    driver.bus_mut().link().board.gateware_mut().reload();
    let mut states = Vec::new();
    for _ in 0..20 {
        let before = driver.bus_mut().now();
        let _ = driver.read();
        let _ = driver.write();
        states.push(driver.board_state());
        let took = driver.bus_mut().now().since(before);
        assert!(took > PERIOD / 2, "its clock stands still: {took:?}");
    }
    assert_ne!(states.last(), Some(&BoardState::Running));
    for _ in 0..100 {
        let _ = driver.rearm();
        let _ = driver.read();
        let _ = driver.write();
    }
    let report = driver.read().expect("it is set up again");
    assert_eq!(
        (report.board, report.missed_periods),
        (BoardState::Running, 0)
    );
}

#[test]
fn six_position_loops_are_closed_at_the_boards_pace() {
    let mut machine = machine::Machine::<_, I7i97>::of(machine(Pace::Board));
    machine.pace = Pace::Board;
    let worst = follow(&mut machine);
    assert!(worst < 0.1, "{worst}");
    for axis in 0..6 {
        let position = machine.fpga().motor(axis).expect("an axis").position();
        assert!(position.abs() > 0.05, "axis {axis} has moved: {position}");
    }
}

#[test]
fn pace_has_a_name() {
    assert_eq!(
        ("host".parse(), "board".parse()),
        (Ok(Pace::Host), Ok(Pace::Board))
    );
    let error = "Board".parse::<Pace>().unwrap_err();
    assert!(error.to_string().contains("'host' or 'board'"), "{error}");
}

#[test]
fn board_that_cannot_pace_is_an_error_when_the_driver_is_built() {
    let by_board = |s: &mut Settings| s.pace = Pace::Board;
    let without_dpll = start(
        ethernet::bus(machines::six_axes_7i80_of_2016(Motor::default())),
        by_board,
    );
    let left_alone = start(bus(), |s| {
        by_board(s);
        s.instances = [(Gtag::HM2DPLL, 0)].into();
    });
    let embedded = start(machines::six_axes_7i97(Motor::default()), by_board);
    for (is_refused, text) in [
        refusal(without_dpll),
        refusal(left_alone),
        refusal(embedded),
    ] {
        assert!(is_refused, "{text}");
        assert!(text.contains("let the host pace it"), "{text}");
    }
}

/// True if the error is that of a machine that cannot be paced, and its text.
fn refusal<B: RegisterBus + Clock>(started: Result<Driver<B>, DriverError>) -> (bool, String) {
    let error = started.err().expect("this bus cannot pace");
    let is_refused = matches!(error, DriverError::NotPaced { .. });
    let text = error.with_advice().to_string();
    (is_refused, text)
}

#[test]
fn request_ahead_samples_at_once_and_the_read_takes_its_reply() {
    let mut driver = machine(Pace::Host);
    for _ in 0..20 {
        let _ = driver.read().expect("the board is there");
        driver.write().expect("the board is there");
        driver.bus_mut().wait(PERIOD * 4 / 5);
    }
    let first = driver.bus_mut().link().journal.len();
    for _ in 0..10 {
        let before = driver.bus_mut().now();
        driver.request_read();
        // Time in which other boards are asked.
        driver.bus_mut().wait(PERIOD / 5);
        let asked = driver.bus_mut().now();
        let _ = driver.read().expect("the board is there");
        assert_eq!(driver.bus_mut().now(), asked, "the reply was there");
        let sampled = answered(&mut driver, first).pop().expect("a request");
        assert!(sampled < before.as_nanos() + 2 * WIRE + 50_000);
        driver.write().expect("the board is there");
        driver.bus_mut().wait(PERIOD * 3 / 5);
    }
    assert_eq!(
        answered(&mut driver, first).len(),
        10,
        "each was asked once"
    );
    // A request whose reply is not taken counts as lost, and as late when the reply arrives.
    driver.request_read();
    driver.request_read();
    let _ = driver.read().expect("the board is there");
    let counted = driver.bus().statistics();
    assert_eq!((counted.lost, counted.late), (0, 1));
}

/// A network that holds everything back for a while and then delivers it at once must not leave a
/// row of requests in the board, each waiting for a period of its own, with the writes between
/// them: outputs would be that much later from then on.
#[test]
fn board_is_not_periods_behind_after_a_network_stall() {
    let mut driver = machine(Pace::Board);
    let cycle = |driver: &mut Machine| {
        let _ = driver.write();
        driver.read().is_ok()
    };
    for _ in 0..20 {
        assert!(cycle(&mut driver));
    }
    let end = driver.bus_mut().now().after(PERIOD * 40).as_nanos();
    let clock = std::rc::Rc::new(std::cell::Cell::new(0));
    let now = std::rc::Rc::clone(&clock);
    driver.bus_mut().link().to_board =
        Box::new(move |_, _| vec![WIRE.max(end.saturating_sub(now.get()))]);
    while driver.bus_mut().now().as_nanos() < end {
        clock.set(driver.bus_mut().now().as_nanos());
        let _ = cycle(&mut driver);
    }
    clock.set(end);
    let first = driver.bus_mut().link().journal.len();
    let failed = (0..100).filter(|_| !cycle(&mut driver)).count();
    assert!(failed <= 5, "{failed} reads failed after it");
    let link = driver.bus_mut().link();
    for sent in link
        .journal
        .iter()
        .skip(first + 12)
        .filter(|sent| !sent.is_request)
    {
        let late = sent.executed.first().map_or(u64::MAX, |at| at - sent.at);
        assert!(late < 200_000, "executed {late} ns after it was sent");
    }
}

/// Where a cycle is stretched because inputs arrive too soon after the previous ones, they have
/// been waiting for that long.
#[test]
fn inputs_that_wait_for_their_cycle_are_as_old_as_that() {
    let mut driver = machine(Pace::Board);
    let card: I7i97 = driver.attach_board().expect("a 7I97");
    let mut cycle = |delay: u64| {
        driver.bus_mut().link().to_host = Box::new(move |_, _| vec![WIRE + delay]);
        let _ = super::by_board::cycle(&mut driver, Duration::ZERO);
        let link = driver.bus_mut().link();
        let (arrived, _) = link.journal.last().expect("it was asked").replies[0];
        let now = driver.bus_mut().now().as_nanos();
        let position = driver.pins().read(card.encoders[0].position);
        assert!(position.valid);
        (position.age.time.as_nanos() as u64, now - arrived)
    };
    for _ in 0..5 {
        assert_eq!(cycle(0), (0, 0));
    }
    assert_eq!(cycle(700_000), (0, 0), "a late one, in time");
    let (age, waited) = cycle(0);
    assert!(
        waited > 100_000,
        "the next comes soon, and the cycle waits: {waited} ns"
    );
    assert_eq!(age, waited);
}
