//! I/O ports and LEDs.

use mesa_hal::sim::machines;

#[test]
fn open_drain_pulls_low_whatever_the_direction_and_never_high() {
    let mut fpga = machines::i7i92_7i77();
    fpga.drive_pin(18, Some(false));
    fpga.write_register(0x1304, 0x7);
    for direction in [0, 0x7] {
        fpga.write_register(0x1104, direction);
        fpga.write_register(0x1004, 0x6);
        let levels = [17, 18, 19].map(|pin| fpga.driven_level(pin));
        assert_eq!(levels, [Some(false), Some(false), None]);
    }
}

#[test]
fn pins_follow_data_invert_open_drain_and_the_outside() {
    let mut fpga = machines::i7i92_7i77();
    fpga.drive_pin(17, Some(false));
    fpga.drive_pin(18, Some(false));
    assert_eq!(fpga.read_register(0x1004), 0x1FFFC);
    fpga.write_register(0x1104, 0x7);
    fpga.write_register(0x1004, 0x3);
    assert_eq!(fpga.read_register(0x1004), 0x1FFFB, "outputs win");
    fpga.write_register(0x1304, 0x1);
    assert_eq!(
        fpga.read_register(0x1004),
        0x1FFFA,
        "open drain lets go of a 1"
    );
    fpga.write_register(0x1404, 0x6);
    assert_eq!(fpga.read_register(0x1004), 0x1FFFC);
}

#[test]
fn leds_are_the_top_bits() {
    let mut fpga = machines::i7i97(1);
    fpga.write_register(0x0200, 0xA000_00FF);
    let lit: Vec<bool> = (0..4).map(|led| fpga.leds().is_lit(led)).collect();
    assert_eq!(lit, [true, false, true, false]);
}
