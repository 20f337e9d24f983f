//! The pins that show if values are fresh, and outputs follow: also when functions are not called.

use proptest::prelude::*;

use super::*;

/// All pins `valid` and `armed`.
fn shown(bench: &Bench) -> Vec<&str> {
    let names = bench.numbers.iter();
    let of_component = |name: &str| {
        let last = name.rsplit('.').next();
        last.is_some_and(|last| ["valid", "armed"].contains(&last))
    };
    let on =
        names.filter(|(name, number)| of_component(name) && bench.cycle.memory.load(**number) != 0);
    on.map(|(name, _)| name.as_str()).collect()
}

#[test]
fn valid_and_armed_are_false_until_read_has_run() {
    let mut bench = Bench::new();
    assert_eq!(shown(&bench), [""; 0]);
    for _ in 0..20 {
        bench.cycle.request_read(PERIOD);
        bench.cycle.write(PERIOD);
        assert_eq!(shown(&bench), [""; 0]);
        bench.wait(PERIOD);
    }
}

#[test]
fn valid_and_armed_end_with_the_calls_of_read() {
    type Call = fn(&mut Bench);
    let write: Call = |bench| bench.cycle.write(PERIOD);
    let request: Call = |bench| bench.cycle.request_read(PERIOD);
    for calls in [&[write][..], &[request], &[request, write]] {
        let mut bench = Bench::running();
        bench.switch_on();
        assert!(shown(&bench).len() > 4, "{:?}", shown(&bench));
        for _ in 0..20 {
            for call in calls {
                call(&mut bench);
            }
            bench.wait(PERIOD);
        }
        assert_eq!(shown(&bench), [""; 0], "{} calls", calls.len());
    }
}

#[test]
fn no_output_is_armed_while_the_user_has_set_io_error() {
    let mut bench = Bench::running();
    bench.switch_on();
    bench.set("io_error", true);
    bench.cycle.write(PERIOD);
    assert_eq!(shown(&bench), [""; 0]);
}

#[test]
fn board_that_is_abandoned_shows_an_error_that_stays() {
    let mut bench = Bench::running();
    bench.switch_on();
    for _ in 0..2 {
        bench.cycle.show_abandoned();
        assert_eq!(shown(&bench), [""; 0]);
        assert!(bench.is_on("io_error"));
        bench.set("io_error", false);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// In any order of calls, with the time for the watchdogs between some.
    #[test]
    fn no_pin_is_valid_long_after_the_last_read(
        calls in proptest::collection::vec((0..4, 1..12), 1..40),
    ) {
        let mut bench = Bench::running();
        let mut since_read = 0;
        for (call, times) in calls {
            for _ in 0..times {
                match call {
                    0 => bench.cycle.read(PERIOD),
                    1 => bench.cycle.write(PERIOD),
                    2 => bench.cycle.request_read(PERIOD),
                    _ => bench.run(1),
                }
                bench.wait(PERIOD);
                since_read = match call {
                    0 => 0,
                    // `run` writes after it has read.
                    3 => 1,
                    _ => since_read + 1,
                };
                prop_assert!(since_read <= FRESH_CALLS || shown(&bench).is_empty());
            }
        }
    }
}
