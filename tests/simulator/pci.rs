//! Boards on the PCI bus: firmwares, clocks and registers.

use std::fs;
use std::path::Path;
use std::time::Duration;

use mesa_hal::bus::{Access, Clock, RegisterBus};
use mesa_hal_sim::{
    BoardConfig, FirmwareImage, SimBoard, SimFirmware, SimFpga, SimPciBus, gtag, machines,
};

/// The firmware of a public pin file on a 7I92, as on a 5I25: 5I25 and 7I92 have the same pins.
fn public(name: &str) -> SimFirmware {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("transcripts/firmwares");
    let text = fs::read_to_string(folder.join(format!("{name}.txt"))).expect("an image");
    let image = FirmwareImage::parse(&text).expect("an image");
    let mut firmware = SimFpga::from_image(&image)
        .expect("a firmware")
        .firmware()
        .clone();
    firmware.board = *b"MESA5I25";
    firmware.clock_low = 33_333_333;
    firmware
}

#[test]
fn modules_and_pins_are_those_of_mesas_public_pin_files() {
    for (ours, name) in [
        (machines::firmware_5i25_7i77x2(), "7I92-7I77x2_34"),
        (machines::firmware_5i25_7i77_7i76(), "7I92-7I77_7I76_34"),
    ] {
        let public = public(name);
        assert_eq!(ours.modules, public.modules, "{name}");
        assert_eq!(ours.pins, public.pins, "{name}");
        assert_eq!(
            (ours.board, ours.clock_low),
            (public.board, public.clock_low)
        );
    }
}

/// FACTS 12.6: at ClockLow/8 a channel is sampled at ClockLow/16, and needs three samples.
#[test]
fn encoders_are_sampled_at_an_eighth_of_33_mhz_without_a_dpll() {
    for firmware in [
        machines::firmware_5i25_7i77(),
        machines::firmware_5i25_7i77x2(),
        machines::firmware_5i25_7i77_7i76(),
    ] {
        assert_eq!((firmware.clock_low, firmware.mux_rate), (33_333_333, 6));
        assert!(firmware.module(gtag::DPLL).is_none());
    }
}

#[test]
fn registers_of_the_flash_memory_complete_a_byte_after_a_while() {
    let board = SimBoard::new(BoardConfig::new("5I25"), machines::i5i25_7i77());
    let mut bus = SimPciBus::new(board);
    assert_eq!(bus.read(0x0100), Ok(0x55AA_CAFE));
    bus.write(0x0070, 0).expect("selected");
    let mut words = [0x9F, 0];
    bus.exchange(
        &[Access::write(0x0074, 0, 1), Access::read(0x0070, 1, 1)],
        &mut words,
    )
    .expect("sent");
    assert_eq!(words[1], 0, "selected, and not complete");
    bus.wait(Duration::from_micros(2));
    assert_eq!(bus.read(0x0070), Ok(0x04));
    bus.write(0x0070, 1).expect("not selected");
    assert_eq!(bus.read(0x0070), Ok(0x05));
    // A page is not written without the enable before it.
    for byte in [0x02, 0x08, 0x00, 0x00, 0x55] {
        bus.write(0x0070, 0).expect("selected");
        bus.write(0x0074, byte).expect("sent");
        bus.wait(Duration::from_micros(2));
    }
    bus.write(0x0070, 1).expect("not selected");
    assert_eq!(bus.board.changes(), 0);
}
