//! The trace of the last cycles: its contents, its end, and its format.

use crate::common::machine::{ANALOG, Machine, fpga};
use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::{EventKind, EventMask, TraceCause, TraceSettings};
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::SimFpga;

fn machine(trace: TraceSettings) -> Machine<Faulty<SimFpga>> {
    Machine::on(Faulty::new(fpga(), 3), |s| s.trace = Some(trace))
}

/// The lines of the table, without the names.
fn table(machine: &Machine<Faulty<SimFpga>>) -> (Vec<String>, Vec<Vec<String>>) {
    let trace = machine.driver.trace().expect("it was asked for");
    let text = trace.csv().to_string();
    let mut lines = text.lines().map(|line| {
        let fields = line.split(',');
        fields.map(str::to_owned).collect::<Vec<_>>()
    });
    let names = lines.next().expect("names");
    (names, lines.collect())
}

fn column(names: &[String], name: &str) -> usize {
    let found = names.iter().position(|it| it.ends_with(name));
    found.unwrap_or_else(|| panic!("{name}: {names:?}"))
}

#[test]
fn there_is_no_trace_unless_it_is_requested() {
    let mut machine = Machine::new();
    machine.cycles(3);
    assert!(machine.driver.trace().is_none());
    machine.driver.freeze_trace();
    assert!(machine.driver.take_trace().is_none());
}

#[test]
fn a_trace_contains_the_words_of_the_last_cycles_as_they_were_on_the_bus() {
    let mut machine = machine(TraceSettings {
        cycles: 8,
        after: 0,
        ..TraceSettings::default()
    });
    machine.cycles(20);
    let cs = machine.fpga().read_register(0x5D04);
    let (names, rows) = table(&machine);
    let cycles: Vec<_> = rows.iter().map(|row| row[0].as_str()).collect();
    assert_eq!(cycles, ["13", "14", "15", "16", "17", "18", "19", "20"]);
    for row in &rows {
        assert_eq!((row[1].as_str(), row[3].as_str()), ("done", "done"));
        assert_eq!(row.len(), names.len());
    }
    let cookie = column(&names, "read 0x0100 HostMot2 cookie");
    assert!(rows.iter().all(|row| row[cookie] == "0x55AACAFE"));
    let data = column(&names, "sserial 0 DATA");
    assert!(rows.iter().all(|row| row[data] == "0x00000000"));
    let command = column(&names, "write 0x5B00 sserial 0 COMMAND");
    assert!(
        rows.iter().all(|row| row[command] == "0x00001007"),
        "{rows:?}"
    );
    let shown = column(&names, "read 0x5D04 sserial 0 channel 1 CS");
    let expected = format!("{cs:#010X}");
    assert!(rows.iter().all(|row| row[shown] == expected), "{expected}");
    let interfaces = names.iter().filter(|name| name.contains("interface"));
    assert!(interfaces.count() > 6, "{names:?}");
}

#[test]
fn an_event_freezes_the_trace_some_cycles_later_with_the_cause_in_its_first_line() {
    let mut machine = machine(TraceSettings {
        cycles: 10,
        after: 3,
        freeze_on: EventMask::TRANSFER_FAILED,
    });
    machine.cycles(20);
    let trace = machine.driver.trace().expect("it was asked for");
    assert_eq!((trace.cause(), trace.cycles()), (None, 10));
    machine.cable(ANALOG).unplug();
    machine.cycles(50);
    let trace = machine.driver.trace().expect("it was asked for");
    let Some(TraceCause::Event(event)) = trace.cause() else {
        panic!("{:?}", trace.cause());
    };
    assert!(matches!(event.kind, EventKind::TransferFailed { .. }));
    assert_eq!(event.cycle, 22);
    let text = trace.to_string();
    let first = text.lines().next().expect("a line");
    assert!(
        first.starts_with("hm2_7i92.0: the last 10 cycles, frozen: cycle 22, "),
        "{first}"
    );
    assert!(
        first.ends_with("port 0, channel 1: a transfer failed: no reply"),
        "{first}"
    );
    let (names, rows) = table(&machine);
    assert_eq!(rows.first().expect("rows")[0], "16");
    assert_eq!(rows.last().expect("rows")[0], "25");
    // The event is about the channel's bit in DATA.
    let data = column(&names, "sserial 0 DATA");
    let failed = rows.iter().find(|row| row[data] != "0x00000000");
    assert_eq!(failed.expect("a failed transfer")[0], "22");
    assert!(text.contains(" sserial 0 channel 1 CS: "), "{text}");
}

#[test]
fn a_failed_read_is_in_the_trace_with_the_error_of_the_bus() {
    let mut machine = machine(TraceSettings {
        cycles: 4,
        after: 1,
        freeze_on: EventMask::READ_FAILED,
    });
    machine.cycles(6);
    let next = machine.driver.bus().exchanges();
    let lost = Fault::NotExecuted(BusErrorKind::Lost);
    machine.driver.bus_mut().fail_at(next, lost);
    for _ in 0..5 {
        let _ = machine.driver.read();
        machine.finish();
    }
    let text = machine.driver.trace().expect("a trace").to_string();
    assert!(text.contains("failed: no reply came"), "{text}");
    assert!(text.contains("frozen: cycle 7, "), "{text}");
    let (_, rows) = table(&machine);
    let outcomes: Vec<_> = rows.iter().map(|row| [&*row[1], &*row[5]]).collect();
    let done = ["done", ""];
    assert_eq!(
        outcomes,
        [done, done, ["failed", "no reply came"], done],
        "for programs too"
    );
}

#[test]
fn a_trace_can_be_frozen_by_call_taken_and_given_back() {
    let settings = TraceSettings {
        cycles: 4,
        after: 0,
        ..TraceSettings::default()
    };
    let mut machine = machine(settings);
    machine.cycles(6);
    machine.driver.freeze_trace();
    machine.cycles(6);
    let trace = machine.driver.take_trace().expect("it was asked for");
    assert_eq!(trace.cause(), Some(TraceCause::Asked));
    assert!(
        trace
            .csv()
            .to_string()
            .lines()
            .last()
            .expect("rows")
            .starts_with("6,")
    );
    machine.cycles(3);
    assert!(machine.driver.trace().is_none());

    let mut other = self::machine(settings);
    other.cycles(2);
    let stranger = other.driver.take_trace().expect("it was asked for");
    assert!(
        machine.driver.record(stranger).is_err(),
        "of another driver"
    );
    machine.driver.record(trace).expect("its own");
    machine.cycles(2);
    let trace = machine.driver.trace().expect("it was given back");
    assert_eq!((trace.cause(), trace.cycles()), (None, 2));
}

/// An application does its own work, and freezes the trace, between a read and a write.
#[test]
fn a_trace_frozen_between_read_and_write_ends_with_the_cycle_that_was_read() {
    for (cycles, before) in [(4, 2_u16), (4, 3), (4, 4), (4, 9), (1, 5)] {
        let mut machine = machine(TraceSettings {
            cycles,
            after: 0,
            ..TraceSettings::default()
        });
        machine.cycles(before.into());
        let _ = machine.driver.read().expect("the bus does not fail");
        machine.driver.freeze_trace();
        machine.finish();
        let (names, rows) = table(&machine);
        let command = column(&names, "write 0x5B00 sserial 0 COMMAND");
        let cookie = column(&names, "read 0x0100 HostMot2 cookie");
        let last = u64::from(before) + 1;
        let first = last.saturating_sub(u64::from(cycles)) + 1;
        let numbers: Vec<_> = rows
            .iter()
            .map(|row| row[0].parse::<u64>().unwrap())
            .collect();
        assert_eq!(numbers, (first..=last).collect::<Vec<u64>>());
        let (open, whole) = rows.split_last().expect("rows");
        assert_eq!((&*open[1], &*open[3]), ("done", "not tried"));
        assert_eq!((&*open[cookie], &*open[command]), ("0x55AACAFE", ""));
        assert!(
            whole
                .iter()
                .all(|row| row[3] == "done" && !row[command].is_empty())
        );
    }
}

#[test]
fn a_write_without_a_read_has_no_words_of_an_older_read_in_the_trace() {
    let mut machine = machine(TraceSettings {
        cycles: 4,
        after: 0,
        ..TraceSettings::default()
    });
    machine.cycles(9);
    let trace = machine.driver.take_trace().expect("it was asked for");
    let _ = machine.driver.read().expect("the bus does not fail");
    machine.driver.record(trace).expect("its own");
    machine.finish();
    let (names, rows) = table(&machine);
    let cookie = column(&names, "read 0x0100 HostMot2 cookie");
    let row = rows.first().expect("one");
    assert_eq!(rows.len(), 1);
    assert_eq!((&*row[0], &*row[1], &*row[3]), ("10", "not tried", "done"));
    assert_eq!(row[cookie], "");
}
