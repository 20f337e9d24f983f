//! The component under the name `mesa_pci.so`, on a simulated 5I25 in mapped memory.

use mesa_hal_sim::{SimFpga, machines};

use crate::hal::{Hal, hal};
use crate::pci_board::PciBoard;
use crate::{PERIOD, SETTLE};

fn with_7i77() -> SimFpga {
    let mut fpga = machines::i5i25_7i77();
    machines::plug_7i77(&mut fpga, 0, 0);
    fpga
}

fn refused(hal: &Hal, words: &[(&str, &str)]) -> String {
    assert!(hal.load_as("mesa_pci.so", words).is_err());
    let messages = hal.messages();
    assert!(messages.contains("mesa_pci: "), "{messages}");
    assert!(!messages.contains("mesa_eth"), "{messages}");
    messages
}

#[test]
fn component_drives_pci_boards_with_the_arguments_of_hm2_pci() {
    let (hal, board) = (hal(), PciBoard::start("driven", with_7i77()));
    let words = [
        ("config", "num_encoders=6 sserial_port_0=00xxxxxx"),
        ("sysfs", board.root()),
    ];
    let loaded = hal.load_as("mesa_pci.so", &words);
    let loaded = loaded.unwrap_or_else(|result| panic!("{result}: {}", hal.messages()));
    let messages = hal.messages();
    assert!(
        messages.contains("0 mesa_pci: 5I25 at 0000:05:00.0: hm2_5i25.0"),
        "{messages}"
    );
    loaded.set("hm2_5i25.0.watchdog.timeout_ns", 4e9);
    let cycle = || {
        loaded.call("hm2_5i25.0.read", PERIOD.as_nanos() as i64);
        loaded.call("hm2_5i25.0.write", PERIOD.as_nanos() as i64);
        std::thread::sleep(PERIOD);
    };
    loaded.set("hm2_5i25.0.7i77.0.0.output-03", 1.0);
    board.seen.set_input(7, true);
    let start = std::time::Instant::now();
    while !board.seen.output_3() || loaded.get("hm2_5i25.0.7i77.0.0.input-07") == 0.0 {
        assert!(start.elapsed() < SETTLE, "{}", loaded.messages());
        cycle();
    }
    loaded.unload();
    assert!(!board.seen.output_3(), "off at the end");
}

/// The I/O pins of the second connector are free. A faster thread has them between two cycles.
#[test]
fn faster_thread_reads_and_writes_the_io_pins_alone() {
    let (hal, board) = (hal(), PciBoard::start("gpio", with_7i77()));
    let words = [("config", "num_encoders=6"), ("sysfs", board.root())];
    let loaded = hal.load_as("mesa_pci.so", &words);
    let loaded = loaded.unwrap_or_else(|result| panic!("{result}: {}", hal.messages()));
    loaded.set("hm2_5i25.0.watchdog.timeout_ns", 4e9);
    let call = |name: &str| loaded.call(&format!("hm2_5i25.0.{name}"), PERIOD.as_nanos() as i64);
    let gpio = |end: &str| loaded.get(&format!("hm2_5i25.0.gpio.020.{end}"));
    let out = |value| loaded.set("hm2_5i25.0.gpio.020.out", value);
    loaded.set("hm2_5i25.0.gpio.020.is_output", 1.0);
    for _ in 0..3 {
        call("read");
        call("write");
    }
    for level in [1.0, 0.0, 1.0, 0.0] {
        out(level);
        call("write_gpio");
        call("read_gpio");
        assert_eq!((gpio("in"), gpio("in_not")), (level, 1.0 - level));
    }
    // Outputs that are safe stay so: the driver has not been told to go on.
    loaded.set("hm2_5i25.0.io_error", 1.0);
    out(1.0);
    call("write_gpio");
    loaded.set("hm2_5i25.0.io_error", 0.0);
    call("read_gpio");
    assert_eq!(gpio("in"), 0.0);
    loaded.unload();
}

#[test]
fn wrong_words_and_an_empty_bus_are_refused_with_the_reason() {
    let (hal, board) = (hal(), PciBoard::start("refused", with_7i77()));
    let sysfs = ("sysfs", board.root());
    let address = refused(&hal, &[sysfs, ("board_ip", "10.10.10.10")]);
    assert!(
        address.contains("board_ip=10.10.10.10: mesa_pci takes"),
        "{address}"
    );
    let surplus = refused(&hal, &[sysfs, ("config", "num_encoders=1,num_encoders=2")]);
    assert!(surplus.contains("config=num_encoders=2:"), "{surplus}");
    let empty = refused(&hal, &[("sysfs", "/var/empty/no-such-folder")]);
    assert!(
        empty.contains("no board on the PCI bus below /var/empty"),
        "{empty}"
    );
    let found = mesa_pci::search(&board.root).expect("boards");
    let bus = found[0].open().expect("free");
    let occupied = refused(&hal, &[sysfs]);
    assert!(occupied.contains("drives this board"), "{occupied}");
    drop(bus);
}
