//! A log of what goes over the bus: the words of the cycle, and what freezes it.

use crate::common::machine::{ANALOG, Machine, fpga};
use mesa_hal::bus::BusErrorKind;
use mesa_hal::driver::EventMask;
use mesa_hal::transport::{BusLog, Fault, Faulty, RecordedEntry, Recording};
use mesa_hal_sim::SimFpga;

type Recorded = Recording<Faulty<SimFpga>>;

fn machine(log: BusLog) -> Machine<Recorded> {
    Machine::on(Recording::new(Faulty::new(fpga(), 3), log), |_| {})
}

fn text(machine: &Machine<Recorded>) -> String {
    let log = &machine.driver.bus().log;
    log.text(machine.driver.firmware()).to_string()
}

#[test]
fn log_has_the_words_of_the_cycle_with_register_names() {
    let mut machine = machine(BusLog::new(1_000));
    machine.cycles(3);
    machine.driver.bus_mut().log.resume();
    machine.cycles(1);
    let cs = machine.fpga().read_register(0x5D04);
    let text = text(&machine);
    for (what, name) in [
        ("read 0x0100 0x55AACAFE".to_owned(), "cookie"),
        ("write 0x5B00 0x00001007".into(), "sserial.0.command"),
        (format!("read 0x5D04 {cs:#010X}"), "sserial.0.1.cs: "),
    ] {
        let line = format!(" host {what} ; {name}");
        assert!(text.contains(&line), "{line}: {text}");
    }
    let mut lines = text.lines();
    let last = lines.rfind(|line| line.contains(" host write "));
    let last = last.expect("writes");
    assert!(last.ends_with("sserial.0.command"), "DOIT is last: {last}");
}

#[test]
fn late_read_freezes_the_log_with_what_was_before_it() {
    let log = BusLog::new(500).freezing_on(RecordedEntry::is_fault, 100);
    let mut machine = machine(log);
    machine.cycles(20);
    assert!(!machine.driver.bus().log.is_frozen());
    let bus = &mut machine.driver.bus_mut().inner;
    let next = bus.exchanges();
    bus.fail_at(next, Fault::Executed(BusErrorKind::Late));
    let at = machine.driver.statistics().reads;
    for _ in 0..20 {
        let _ = machine.driver.read();
        machine.finish();
    }
    assert!(machine.driver.statistics().reads > at);
    let log = &machine.driver.bus().log;
    let late = BusErrorKind::Late;
    let Some(cause @ RecordedEntry::Failed { kind, .. }) = log.cause() else {
        panic!("{log}");
    };
    assert_eq!(kind, late);
    let place = log.entries().position(|entry| *entry == cause);
    assert_eq!((place, log.entries().len()), (Some(399), 500));
    let second = text(&machine).lines().nth(1).map(str::to_owned);
    let second = second.expect("a cause");
    assert!(second.starts_with("# frozen after: ") && second.contains("Late"));

    let log = &mut machine.driver.bus_mut().log;
    log.resume();
    assert_eq!((log.entries().len(), log.cause()), (0, None));
    machine.cycles(2);
    assert!(machine.driver.bus().log.entries().len() > 50);
}

#[test]
fn application_freezes_the_log_with_an_event_of_the_driver() {
    let mut machine = machine(BusLog::new(2_000));
    let mut events = machine.driver.events();
    machine.cable(ANALOG).unplug();
    let safe = EventMask::OUTPUTS_SAFE;
    for _ in 0..100 {
        machine.cycles(1);
        if events.any(|event| safe.contains(event.kind.mask())) {
            machine.driver.bus_mut().log.freeze();
        }
    }
    let log = &machine.driver.bus().log;
    assert!(log.is_frozen());
    assert_eq!((log.cause(), log.entries().len()), (None, 2_000));
    // The bit of the channel in DATA.
    let failed = "sserial.0.data";
    let text = text(&machine);
    let mut data = text.lines().filter(|line| line.ends_with(failed));
    assert!(data.any(|line| !line.contains(" 0x00000000 ")), "{text}");
}
