//! Number of bus reads and writes of a cycle: the table of `docs/pci.md`.

use std::collections::BTreeSet;
use std::time::Duration;

use mesa_hal::bus::{AccessList, Clock};
use mesa_hal::{Driver, Settings};
use mesa_hal_sim::devices::FieldIo;
use mesa_hal_sim::{Motor, SimFpga, Stepper, machines};

const PAGE: &str = include_str!("../../../../docs/pci.md");
const CYCLES: u64 = 100;

/// A firmware with one serial port, and a 7I77's field I/O on each of its channels.
fn field_cards(count: u8) -> SimFpga {
    let mut fpga = SimFpga::new(machines::firmware_serial(&[count]));
    for channel in 0..usize::from(count) {
        fpga.plug(0, channel, Some(Box::new(FieldIo::i7i77().expect("7I77"))));
    }
    fpga
}

fn with_7i77(mut fpga: SimFpga, first: &[usize]) -> SimFpga {
    for &channel in first {
        machines::plug_7i77(&mut fpga, 0, channel);
    }
    fpga
}

/// Registers of a list, each of them once.
fn registers(list: &AccessList) -> usize {
    let accesses = list.as_ref().iter();
    let addresses: Vec<u16> = accesses
        .flat_map(|access| (0..access.count).map(move |n| access.address + 4 * n))
        .collect();
    let once: BTreeSet<_> = addresses.iter().collect();
    assert_eq!(
        once.len(),
        addresses.len(),
        "a register twice: {addresses:04X?}"
    );
    addresses.len()
}

/// Reads and writes of a cycle: as planned, which is as counted by the board.
fn cost(fpga: SimFpga) -> (usize, usize) {
    let mut driver = Driver::start(fpga, Settings::default()).expect("a machine");
    let cycle = |driver: &mut Driver<SimFpga>| {
        let report = driver.read().expect("read");
        driver.write().expect("written");
        driver.bus_mut().wait(Duration::from_millis(1));
        report
    };
    for _ in 0..10 {
        let _ = cycle(&mut driver);
    }
    let before = driver.bus().counters();
    for _ in 0..CYCLES {
        assert!(cycle(&mut driver).is_good());
    }
    let after = driver.bus().counters();
    let lists = driver.lists();
    let planned = (registers(lists.read), registers(lists.write));
    // Further evidence is read now and then.
    let reads = (after.reads - before.reads) as usize / CYCLES as usize;
    let writes = (after.writes - before.writes) as usize / CYCLES as usize;
    assert_eq!((reads, writes), planned);
    planned
}

#[test]
fn page_lists_the_cycle_cost_and_no_register_is_read_twice() {
    let mut missing = Vec::new();
    for (machine, fpga) in [
        ("1 field I/O", field_cards(1)),
        ("2 field I/O", field_cards(2)),
        ("8 field I/O", field_cards(8)),
        (
            "a 5I25 with a 7I77 and its six encoders: 2",
            with_7i77(machines::i5i25_7i77(), &[0]),
        ),
        (
            "a 5I25 with two 7I77 and twelve encoders: 4",
            with_7i77(machines::i5i25_7i77x2(), &[0, 3]),
        ),
        (
            "a 5I25 with a 7I77, a 7I76 and its five step generators: 3",
            machines::eleven_axes_5i25(Motor::default(), Stepper::default()),
        ),
    ] {
        let (reads, writes) = cost(fpga);
        let row = format!("| {machine} | {reads} | {writes} |");
        if !PAGE.lines().any(|line| line == row) {
            missing.push(row);
        }
    }
    assert!(
        missing.is_empty(),
        "docs/pci.md lacks:\n{}",
        missing.join("\n")
    );
}
