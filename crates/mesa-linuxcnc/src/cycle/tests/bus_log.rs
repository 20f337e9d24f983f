//! What is printed of the bus after an exchange has failed.

use mesa_hal::transport::{BusLog, Recording};

use super::*;

type Recorded = Cycle<Recording<Faulty<SimFpga>>, FakeMemory>;

fn cycle(cycles: usize) -> (Recorded, Heard) {
    let bus = Faulty::new(machines::six_axes_7i97(Motor::default()), 1);
    let bus = Recording::new(bus, BusLog::new(0));
    let driver = Driver::start(bus, Settings::default()).expect("the machine is complete");
    let (mut cycle, _, heard) = cycle_of(driver);
    cycle.record(cycles);
    (cycle, heard)
}

fn run(cycle: &mut Recorded, cycles: u32) {
    for _ in 0..cycles {
        cycle.read(PERIOD);
        cycle.write(PERIOD);
        cycle.print_bus();
        cycle.driver.bus_mut().wait(PERIOD);
    }
}

fn fail_read(cycle: &mut Recorded) {
    let bus = &mut cycle.driver.bus_mut().inner;
    let next = bus.exchanges();
    bus.fail_at(next, Fault::Executed(BusErrorKind::Late));
}

/// The lines about the bus.
fn lines(heard: &Heard) -> Vec<String> {
    let mut heard = heard.lock().expect("no panic");
    let all = heard.drain(..).map(|(_, text)| text);
    all.filter(|text| text.contains(": bus ") || text.contains("over the bus"))
        .collect()
}

#[test]
fn late_read_prints_what_went_over_the_bus_before_it() {
    let (mut cycle, heard) = cycle(8);
    run(&mut cycle, 100);
    assert_eq!(lines(&heard), [""; 0]);
    fail_read(&mut cycle);
    run(&mut cycle, 100);
    let printed = lines(&heard);
    assert!(printed[0].contains("what went over the bus, "));
    let failed = printed.iter().position(|line| line.contains(" failed: "));
    let failed = failed.expect("the failed read");
    assert!(failed > 8, "{printed:#?}");
    assert!(failed < printed.len() - 2, "cycles after it: {printed:#?}");
    for line in &printed[1..] {
        assert!(line.starts_with("board: bus 0."), "{line}");
        assert!(line.len() < 990, "{}: {line}", line.len());
    }
    let cookie = " 0100=55AACAFE";
    assert!(printed.iter().any(|line| line.contains(cookie)));
    assert!(printed.iter().any(|line| line.contains(" write ")));

    // One log in ten seconds.
    fail_read(&mut cycle);
    run(&mut cycle, 1_000);
    assert_eq!(lines(&heard), [""; 0]);
    run(&mut cycle, 10_000);
    fail_read(&mut cycle);
    run(&mut cycle, 100);
    assert!(lines(&heard).len() > 8);
}

#[test]
fn nothing_is_recorded_without_the_word() {
    let (mut cycle, heard) = cycle(0);
    run(&mut cycle, 10);
    fail_read(&mut cycle);
    run(&mut cycle, 100);
    assert_eq!(lines(&heard), [""; 0]);
}
