//! Tests of the cycle alone: the words of reads are made up, and nothing is exchanged after the
//! start.

use super::*;
use crate::bus::{BusError, BusErrorKind, CycleWrites, Reply};
use crate::driver::{Driver, Settings};
use mesa_hal_sim::{Motor, SimFpga, machines};

const COOKIE: u16 = 0x0100;
const WATCHDOG_TIME: u16 = 0x0C00;
const WATCHDOG_STATUS: u16 = 0x0D00;
/// Watchdog time of a board that has just been set up.
const FRESH: u32 = 0x7FFF_FFFF;
const MS: u64 = 1_000_000;

/// A cycle and its time.
struct Bench {
    driver: Driver<SimFpga>,
    now: u64,
}

impl Bench {
    /// A cycle after a few reads and writes on a bus.
    fn new() -> Self {
        let fpga = machines::six_axes_7i92(Motor::default());
        let mut driver = Driver::start(fpga, Settings::default()).expect("it is well");
        for _ in 0..5 {
            let _ = driver.read().expect("the bus does not fail");
            driver.write().expect("the bus does not fail");
        }
        Self {
            now: 10_000 * MS,
            driver,
        }
    }

    fn cycle(&mut self) -> &mut BoardCycle {
        &mut self.driver.cycle
    }

    fn show(&mut self, address: u16, word: u32) {
        let place = self.driver.exchanges.place_read(address);
        self.cycle().words.show(place.expect("it is read"), word);
    }

    fn now(&mut self) -> Instant {
        self.now += MS;
        Instant::from_nanos(self.now)
    }

    /// A read of the words that were shown.
    fn read(&mut self, reply: Reply) -> Result<CycleReport, CycleError> {
        self.read_with(reply, Ok(()))
    }

    fn read_with(
        &mut self,
        reply: Reply,
        result: Result<(), BusError>,
    ) -> Result<CycleReport, CycleError> {
        let now = self.now();
        let cycle = self.cycle();
        let Next::Order(order) = cycle.begin_read() else {
            panic!("a read is an exchange");
        };
        let Exchange::Read { extra } = order.exchange() else {
            panic!("{order:?}");
        };
        if result.is_ok() {
            cycle.words.add_reply(reply);
        }
        let outcome = Outcome {
            extra,
            ..Outcome::new(now, result)
        };
        match cycle.after(order, outcome, now) {
            Next::End(result) => result.map(|()| cycle.report),
            Next::Order(order) => panic!("{order:?}"),
        }
    }

    /// The exchanges of a write, if none fails. A set-up restores the evidence.
    fn write(&mut self) -> Vec<Exchange> {
        let now = self.now();
        let mut next = self.cycle().begin_write(now);
        let mut exchanges = Vec::new();
        loop {
            let order = match next {
                Next::Order(order) => order,
                Next::End(result) => {
                    result.expect("no exchange fails");
                    return exchanges;
                }
            };
            exchanges.push(order.exchange());
            if order.exchange() == Exchange::Separate(Separate::SetUp) {
                self.show(WATCHDOG_STATUS, 0);
                self.show(WATCHDOG_TIME, FRESH);
            }
            next = self.cycle().after(order, Outcome::new(now, Ok(())), now);
        }
    }
}

/// The exchanges before the write of the cycle that sets the board up.
const SET_UP: [Exchange; 4] = [
    Exchange::Separate(Separate::Status),
    Exchange::Separate(Separate::Firmware),
    Exchange::Separate(Separate::Everything),
    Exchange::Separate(Separate::SetUp),
];

/// True if these exchanges are a single write of this form.
fn is_write(exchanges: &[Exchange], form: CycleWrites) -> bool {
    matches!(exchanges, [Exchange::Write(CycleWrite { writes, .. })] if *writes == form)
}

fn usual(orders: &[Exchange]) -> bool {
    is_write(orders, CycleWrites::Settings)
}

#[test]
fn usual_cycle_is_one_read_and_one_write() {
    let mut bench = Bench::new();
    for n in 0..10 {
        let report = bench.read(Reply::CERTAIN).expect("a board");
        assert_eq!(report.board, BoardState::Running, "{n}");
        assert!(usual(&bench.write()), "{n}");
    }
    // After an uncertain write, the next read includes the extra registers.
    let lost = Reply::UNKNOWN.with_lost_writes(1);
    assert_eq!(bench.read(lost).expect("a board").lost_writes, 1);
    let extra = Exchange::Write(CycleWrite {
        extra: true,
        writes: CycleWrites::Settings,
    });
    assert_eq!(bench.write(), [extra]);
}

#[test]
fn bite_is_kept_quiet_until_it_is_cleared() {
    let mut bench = Bench::new();
    bench.show(WATCHDOG_STATUS, 1);
    bench.show(WATCHDOG_TIME, u32::MAX);
    let report = bench.read(Reply::CERTAIN).expect("a board");
    assert_eq!(report.board, BoardState::WatchdogBitten);
    for _ in 0..5 {
        let orders = bench.write();
        assert!(is_write(&orders, CycleWrites::Inputs), "{orders:?}");
        let _ = bench.read(Reply::CERTAIN).expect("a board");
    }
    let pins = &mut bench.cycle().pins;
    let flag = pins.inout("hm2_7i92.0.watchdog.has_bit").expect("a pin");
    pins.set(flag, false);
    let orders = bench.write();
    assert_eq!(orders[..4], SET_UP);
    assert!(usual(&orders[4..]), "{orders:?}");
}

#[test]
fn set_up_that_a_pin_asks_for_leaves_time_for_late_packets() {
    // The writes between the fault and the pin, and those after it without a set-up.
    for (before, after) in [(0, 4), (1, 3), (4, 0), (9, 0)] {
        let mut bench = Bench::new();
        bench.show(WATCHDOG_STATUS, 1);
        bench.show(WATCHDOG_TIME, u32::MAX);
        let quiet = |bench: &mut Bench, writes| {
            for _ in 0..writes {
                let _ = bench.read(Reply::CERTAIN).expect("a board");
                let orders = bench.write();
                assert!(
                    is_write(&orders, CycleWrites::Inputs),
                    "{before}: {orders:?}"
                );
            }
            let _ = bench.read(Reply::CERTAIN).expect("a board");
        };
        quiet(&mut bench, before);
        let pins = &mut bench.cycle().pins;
        let flag = pins.inout("hm2_7i92.0.watchdog.has_bit").expect("a pin");
        pins.set(flag, false);
        quiet(&mut bench, after);
        assert_eq!(bench.write()[..4], SET_UP, "{before}");
    }
}

#[test]
fn flag_that_is_set_again_withdraws_the_set_up() {
    let mut bench = Bench::new();
    bench.show(WATCHDOG_STATUS, 1);
    bench.show(WATCHDOG_TIME, u32::MAX);
    let _ = bench.read(Reply::CERTAIN).expect("a board");
    let pins = &bench.cycle().pins;
    let flag = pins
        .inout::<bool>("hm2_7i92.0.watchdog.has_bit")
        .expect("a pin");
    // The call clears the flag, as an application does by itself.
    let now = bench.now();
    let _ = bench.cycle().rearm_when_running(now);
    assert!(!bench.cycle().pins.read(flag).value);
    assert!(
        is_write(&bench.write(), CycleWrites::Inputs),
        "late packets"
    );
    bench.cycle().pins.set(flag, true);
    for _ in 0..10 {
        let _ = bench.read(Reply::CERTAIN).expect("a board");
        let orders = bench.write();
        assert!(is_write(&orders, CycleWrites::Inputs), "{orders:?}");
    }
    bench.cycle().pins.set(flag, false);
    assert_eq!(bench.write()[..4], SET_UP);
}

#[test]
fn pin_settings_go_between_two_reads_and_a_reset_ends_the_write() {
    let mut bench = Bench::new();
    let pins = bench.driver.pins();
    let is_direction = |name: &str| name.ends_with(".is_output");
    let names = pins.infos().iter().map(|info| info.name.clone());
    let name = names.rev().find(|name| is_direction(name));
    let direction = pins.parameter::<bool>(&name.expect("a free pin"));
    let direction = direction.expect("a parameter");
    for (is_output, is_reset) in [(true, false), (false, false), (true, true)] {
        let _ = bench.read(Reply::CERTAIN).expect("a board");
        let set = bench.cycle().pins.set_param(direction, is_output);
        set.expect("it can be an output");
        if is_reset {
            bench.show(WATCHDOG_TIME, 1 << 31);
        }
        let orders = bench.write();
        let look = Exchange::Separate(Separate::Evidence);
        if is_reset {
            assert_eq!(orders, [look, Exchange::Separate(Separate::Quiesce)]);
            assert_eq!(bench.cycle().state(), BoardState::Reset);
        } else {
            let guarded = [look, Exchange::Separate(Separate::Guarded), look];
            assert_eq!(orders[..3], guarded);
            assert!(usual(&orders[3..]), "{orders:?}");
        }
    }
}

#[test]
fn failing_bus_is_down_at_the_limit_another_board_is_refused() {
    let mut bench = Bench::new();
    let limit = Settings::default().bus_error_limit;
    for n in 1..=limit {
        assert_eq!(bench.cycle().state(), BoardState::Running, "{n}");
        let source = BusError::custom(BusErrorKind::Lost, "nothing came");
        let failed = bench.read_with(Reply::UNKNOWN, Err(source));
        let expected = CycleError::Read {
            source,
            consecutive: n,
        };
        assert_eq!(failed, Err(expected));
        let _ = bench.write();
    }
    assert_eq!(bench.cycle().state(), BoardState::BusDown);
    let orders = bench.write();
    assert!(is_write(&orders, CycleWrites::Quiet), "{orders:?}");
    let mut bench = Bench::new();
    bench.show(COOKIE, 0xFFFF_FFFF);
    let expected = CycleError::NotThere {
        found: 0xFFFF_FFFF,
        consecutive: 1,
    };
    assert_eq!(bench.read(Reply::CERTAIN), Err(expected));
}
