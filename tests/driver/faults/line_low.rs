//! The report of a line that goes low does not depend on the time.

use mesa_hal::driver::{Failure, OfflineReason};

use crate::common::machine::{ANALOG, Machine};

/// CS of channel 1, and the local error bit of an overrun in it.
const CS: u16 = 0x5D04;
const OVERRUN: u32 = 0x04;
/// Number of times that it goes low, and the additional delay of each: a character takes 3809 ns.
const TIMES: u64 = 80;
const LATER: u64 = 790;

/// FACTS 5.4, 11.6 and 11.8: about one DOIT in 200 has an overrun.
#[test]
fn line_going_low_is_reported_as_low_or_silent_never_as_overrun() {
    let mut machine = Machine::new();
    let mut overruns = 0;
    for time in 0..TIMES {
        machine.until(10_000, |machine| machine.is_running(ANALOG));
        machine.rearm_all(100);
        machine.cycles(5);
        machine.pass_nanos(time * LATER);
        let cable = machine.cable(ANALOG);
        cable.set_low_when_unplugged(true);
        cable.unplug();
        let breaks = breaks(&machine);
        let mut seen = 0;
        machine.until(100, |machine| {
            seen |= machine.fpga().read_register(CS);
            !machine.is_running(ANALOG)
        });
        overruns += u32::from(seen & OVERRUN != 0);
        assert!(self::breaks(&machine) > breaks, "{time}: line low");
        let status = machine.status(ANALOG);
        let told = |failure| matches!(failure, Failure::Break | Failure::NoReply);
        let found: Vec<_> = status.failures.iter().filter(|found| found.1 > 0).collect();
        assert!(
            found.iter().all(|&(failure, _)| told(failure)),
            "{time}: {found:?}"
        );
        let reason = status.first_fault.expect("it is offline");
        let is_told = matches!(reason, OfflineReason::TooManyFailures(failure) if told(failure));
        assert!(is_told, "{time}: {reason}");
        machine.cable(ANALOG).replug();
    }
    assert!((1..=20).contains(&overruns), "{overruns} of {TIMES}");
}

fn breaks(machine: &Machine) -> u64 {
    let status = machine.status(ANALOG);
    let mut failures = status.failures.iter();
    let found = failures.find(|found| found.0 == Failure::Break);
    found.map_or(0, |found| found.1)
}
