//! Nothing in the cycle allocates: a counting allocator watches 100,000 cycles with faults.

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, fpga};
use allocation_counter::{AllocationInfo, measure};
use mesa_hal::bus::{BusErrorKind, RegisterBus};
use mesa_hal::driver::{EventKind, RemoteState};
use mesa_hal::runner::{CommandQueue, CommandSender, SnapshotWriter};
use mesa_hal::transport::{BusLog, Fault, Faulty, RecordedEntry, Recording};
use mesa_hal::{Board, Settings};
use mesa_hal_sim::SimFpga;
use mesa_hal_sim::remote::{Toward, WireFault};

type Recorded = Recording<Faulty<SimFpga>>;

const CYCLES: u32 = 100_000;

/// Allocations of the cycle itself: all calls of `read`, `write` and the rest together.
#[derive(Debug, Default)]
struct Count {
    allocations: u64,
    calls: u64,
}

impl Count {
    fn of(&mut self, work: impl FnOnce()) {
        let info: AllocationInfo = measure(work);
        self.allocations += info.count_total;
        self.calls += 1;
    }
}

#[test]
fn counter_counts() {
    let mut count = Count::default();
    count.of(|| drop(std::hint::black_box(vec![1u8])));
    assert_eq!(count.allocations, 1);
}

#[test]
fn hundred_thousand_cycles_with_faults_allocate_nothing() {
    let log = BusLog::new(5_000).freezing_on(RecordedEntry::is_fault, 500);
    let bus = Recording::new(Faulty::new(fpga(), 0x5EED), log);
    let settings = Settings {
        event_room: 16,
        ..Settings::default()
    };
    let mut board = Board::identify(bus, settings).expect("a board");
    let mut own = board.own_pins("mill").expect("a prefix");
    let shown = own.input::<f64>("error").expect("a pin");
    let commanded = own.inout::<u32>("step").expect("a pin");
    let driver = board.start().expect("the machine is complete");
    let mut machine = Machine::with(driver);
    let mut count = Count::default();
    let mut snapshot = SnapshotWriter::new(&machine.driver);
    let mut commands = CommandQueue::new(&machine.driver, 64);
    let (reader, sender) = (snapshot.reader(), commands.sender());
    let mut events = machine.driver.events();
    let (mut told, mut dropped, mut frozen) = (0, 0, 0);
    for n in 0..CYCLES {
        if n % 10 == 0 {
            disturb(&mut machine, n / 10);
        }
        let pins = machine.driver.pins_mut();
        pins.set(
            machine.cards.analog.analog_out[n as usize % 6].volts,
            value(n),
        );
        pins.set(machine.cards.field.outputs[n as usize % 16].pin, n % 3 == 0);
        count.of(|| {
            let _ = std::hint::black_box(machine.driver.read());
        });
        ask(&machine, &sender, n);
        count.of(|| {
            std::hint::black_box(commands.take(&mut machine.driver));
        });
        if n % 16 == 0 {
            count.of(|| {
                let _ = std::hint::black_box(machine.driver.rearm());
            });
        }
        count.of(|| {
            let pins = machine.driver.pins_mut();
            pins.show(shown, value(n));
            std::hint::black_box(pins.take(commanded));
        });
        count.of(|| {
            let _ = std::hint::black_box(machine.driver.write());
        });
        count.of(|| {
            let _ = std::hint::black_box(snapshot.publish(&machine.driver));
        });
        if n % 8 == 0 {
            let limit = std::time::Duration::from_micros(200);
            count.of(|| {
                let _ = std::hint::black_box(machine.driver.wait_transfers(limit));
            });
        }
        // At first no events are taken, and the queue is full.
        if n % 64 == 0 && n > CYCLES / 4 {
            count.of(|| {
                for event in &mut events {
                    told += 1;
                    if let EventKind::Dropped { count } = event.kind {
                        dropped += count;
                    }
                }
            });
        }
        if n % 1000 == 0 {
            count.of(|| {
                let log = &mut machine.driver.bus_mut().log;
                log.freeze();
                frozen += u32::from(log.cause().is_some() && log.entries().len() > 0);
                log.resume();
            });
        }
        machine.pass(machine.period);
    }
    assert!(count.calls > 400_000);
    assert_eq!(count.allocations, 0, "in {} calls", count.calls);
    let seen = reader.read().expect("published");
    assert_eq!(seen.driver_statistics(), machine.driver.statistics());
    let asked = sender.statistics();
    assert_eq!(asked.taken, asked.sent, "{asked:?}");
    assert!(asked.sent > 90_000 && asked.refused > 100, "{asked:?}");
    assert!(
        told > 500 && dropped > 100,
        "{told} events, {dropped} dropped"
    );
    assert!(frozen > 90, "{frozen} times");
    assert_has_lived(&machine);
}

/// A command in each cycle, some of which are refused.
fn ask(machine: &Machine<Recorded>, commands: &CommandSender, n: u32) {
    let output = machine.cards.analog.analog_out[2];
    let limit = output.max_limit.expect("a 7I77");
    let sent = match n % 1000 {
        0 => commands.rearm(),
        1 => commands.restart((0, ANALOG as u8)),
        2..10 => commands.rearm_group(machine.driver.group()),
        500..520 => commands.rearm_when_running(),
        520..530 => commands.rearm_group_when_running(machine.driver.group()),
        // Refused by the sender.
        10..20 => return assert!(commands.set_param(limit, f64::NAN).is_err()),
        20..500 => commands.set_param(limit, 9.0),
        _ => commands.set(output.volts, value(n)),
    };
    sent.expect("there is room");
}

/// Every disturbance that the cycle must survive, one after the other.
fn disturb(machine: &mut Machine<Recorded>, step: u32) {
    let channel = [FIELD, ANALOG, OUTPUTS][step as usize % 3];
    let toward = if step.is_multiple_of(2) {
        Toward::Fpga
    } else {
        Toward::Remote
    };
    let faults = [
        WireFault::Lost,
        WireFault::Corrupted,
        WireFault::Short(1),
        WireFault::Long(2),
        WireFault::Late(90_000),
        WireFault::Break,
    ];
    match step % 97 {
        10 => machine.cable(channel).unplug(),
        30 => machine.cable(channel).heal(),
        31 => [FIELD, ANALOG, OUTPUTS]
            .into_iter()
            .for_each(|c| machine.cable(c).replug()),
        50 => machine.sleep(20),
        60 => {
            let bus = &mut machine.driver.bus_mut().inner;
            let next = bus.exchanges();
            bus.fail_at(next, Fault::Executed(BusErrorKind::Late));
            bus.fail_at(next + 1, Fault::AckedButLost);
            bus.fail_at(next + 3, Fault::NotExecuted(BusErrorKind::Lost));
        }
        70 => machine
            .device_mut(FIELD)
            .set_over_current(3, true)
            .expect("output"),
        75 => machine
            .device_mut(FIELD)
            .set_over_current(3, false)
            .expect("output"),
        _ => {
            let fault = faults[step as usize % faults.len()];
            machine.cable(channel).inject(toward, fault, 1 + step % 3);
        }
    }
}

/// Sometimes not a number, sometimes out of range.
fn value(n: u32) -> f64 {
    match n % 50 {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => 1e9,
        other => f64::from(other) / 5.0 - 5.0,
    }
}

/// Checks that all disturbances occurred, without which the test would prove nothing.
fn assert_has_lived(machine: &Machine<Recorded>) {
    let statistics = machine.driver.statistics();
    assert!(statistics.watchdog_bites > 10, "{statistics:?}");
    assert!(
        statistics.read_errors > 10 && statistics.lost_writes > 10,
        "{statistics:?}"
    );
    let port = &machine.driver.ports()[0];
    assert!(port.statistics().starts > 100, "{:?}", port.statistics());
    for remote in port.remotes() {
        assert!(remote.failures.total() > 1000, "{:?}", remote.failures);
        assert!(remote.restarts > 10);
        assert!(remote.transfers > 10_000);
        assert!(!matches!(
            remote.state,
            RemoteState::Offline {
                next_attempt: None,
                ..
            }
        ));
    }
    let rejections = machine.driver.pins().total_rejections();
    assert!(
        rejections.not_finite > 100 && rejections.out_of_range > 100,
        "{rejections:?}"
    );
    assert!(machine.driver.bus().statistics().exchanges > 200_000);
    assert!(machine.now() > 100_000_000_000);
}
