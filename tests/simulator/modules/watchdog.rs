//! The watchdog.

use super::{MS, wait};
use mesa_hal::sim::{SimFpga, machines};

#[test]
fn watchdog_bites_two_clocks_after_its_time_and_makes_all_pins_inputs_one_later() {
    let mut fpga = machines::i7i92_7i77();
    fpga.write_register(0x1104, 0x1FFFF);
    fpga.write_register(0x1304, 0x3);
    fpga.write_register(0x1004, 0);
    fpga.write_register(0x0C00, 499_999);
    wait(&mut fpga, 4 * MS);
    fpga.write_register(0x0E00, 0x5A00_0000);
    // 499,999 + 2 clocks of 10 ns.
    wait(&mut fpga, 5 * MS + 9);
    assert_eq!(fpga.read_register(0x0D00), 0);
    wait(&mut fpga, 1);
    assert_eq!(fpga.read_register(0x0D00), 1);
    wait(&mut fpga, 9);
    assert_eq!(fpga.read_register(0x1104), 0x1FFFF);
    assert!(!fpga.pin_level(20));
    wait(&mut fpga, 1);
    assert_eq!(fpga.read_register(0x1104), 0);
    assert_eq!(fpga.read_register(0x1004), 0x1FFFF, "pull-ups");

    fpga.write_register(0x0D00, 0);
    fpga.write_register(0x1104, 1);
    wait(&mut fpga, 6 * MS);
    assert_eq!(fpga.read_register(0x0D00), 0, "it sleeps until the cookie");
    fpga.write_register(0x0E00, 0x5A00_0000);
    wait(&mut fpga, 2 * MS);
    assert_eq!(fpga.read_register(0x0C00), 299_999, "what is left");
    assert_eq!(fpga.read_register(0x1104), 1);
    wait(&mut fpga, 3 * MS + 20);
    assert_eq!(fpga.read_register(0x0D00), 1);
    assert_eq!(fpga.read_register(0x1104), 0);
}

#[test]
fn watchdog_that_was_never_set_is_silent_and_wrong_cookies_do_not_feed_it() {
    let mut fpga = machines::i7i92_7i77();
    wait(&mut fpga, 1_000 * MS);
    fpga.write_register(0x0C00, 0x8000_0000);
    wait(&mut fpga, 1_000 * MS);
    assert_eq!(fpga.read_register(0x0D00), 0, "it did not run");
    fpga.write_register(0x0C00, 99_999);
    wait(&mut fpga, MS / 2);
    fpga.write_register(0x0E00, 0x5B00_0000);
    wait(&mut fpga, MS / 2 + 20);
    assert_eq!(fpga.read_register(0x0D00), 1);
    fpga.write_register(0x0D00, 0);
    fpga.write_register(0x0C00, 0x8000_0001);
    fpga.write_register(0x0E00, 0x5A00_0000);
    wait(&mut fpga, 1_000 * MS);
    assert_eq!(fpga.read_register(0x0D00), 0, "it did not run any more");
}

#[test]
fn watchdog_bites_when_it_is_disabled_while_it_runs_or_fed_before_it_was_set() {
    let disabled = |fpga: &mut SimFpga| {
        fpga.write_register(0x0C00, 99_999);
        fpga.write_register(0x0C00, 0x8000_0000);
    };
    let fed_too_early = |fpga: &mut SimFpga| fpga.write_register(0x0E00, 0x5A00_0000);
    for cause in [disabled, fed_too_early] {
        let mut fpga = machines::i7i92_7i77();
        fpga.write_register(0x1104, 0x1FFFF);
        cause(&mut fpga);
        wait(&mut fpga, 30);
        assert_eq!(fpga.read_register(0x0D00), 1);
        assert_eq!(fpga.read_register(0x1104), 0);
    }
}

#[test]
fn older_firmware_starts_with_the_status_of_the_watchdog_set() {
    for starts_bitten in [false, true] {
        let mut firmware = machines::firmware_7i97(1);
        firmware.starts_bitten = starts_bitten;
        let mut fpga = SimFpga::new(firmware);
        assert_eq!(fpga.read_register(0x0D00), u32::from(starts_bitten));
        fpga.write_register(0x0D00, 0);
        assert_eq!(fpga.read_register(0x0D00), 0);
        fpga.reload();
        assert_eq!(fpga.read_register(0x0D00), u32::from(starts_bitten));
    }
}
