//! Parsing of a firmware's description of itself: FACTS 9.1, 9.2, 9.3, 9.5.

use mesa_hal::bus::RegisterBus;
use mesa_hal::hostmot2::{Gtag, HostMot2, IdentifyError};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::{SimFpga, machines};
use proptest::prelude::*;

fn identify(fpga: &mut SimFpga) -> Result<HostMot2, IdentifyError> {
    HostMot2::identify(fpga)
}

/// FACTS 9.2: its words are checked in `tests/simulator/identity.rs`.
fn i7i97() -> SimFpga {
    machines::i7i97(1)
}

#[test]
fn a_7i97_is_found_with_all_its_modules_and_pins() {
    let firmware = identify(&mut i7i97()).unwrap();
    assert_eq!(firmware.idrom.board(), "7i97");
    assert_eq!(
        firmware.gtags(),
        "HM2DPLL (1A) x1, Watchdog (02) x1, IOPort (03) x3, MuxedEncoder (0C) x6, MuxSelect (0D) \
         x1, SSerial (C1) x1, PWM (06) x6, SSR (C3) x1, InMux (1E) x1, LED (80) x1"
    );
    assert_eq!(firmware.pins.len(), 51);
    assert_eq!(firmware.pins[5].to_string(), "PWM 4 /Enable");
    assert_eq!(firmware.pins[32].to_string(), "SSerial 0 TX0");
    assert_eq!(firmware.pins[50].to_string(), "I/O");
    assert_eq!(firmware.sserial_channels(Gtag::SSERIAL, 0), 1);
    assert_eq!(firmware.sserial_channels(Gtag::SSERIAL, 1), 0);
    let pwm = firmware.require(Gtag::PWM).unwrap();
    assert_eq!(pwm.clock_hz, 200_000_000);
    assert_eq!(firmware.warnings, [""; 0]);
}

#[test]
fn a_7i92_with_two_7i77_is_found_with_three_channels_for_each() {
    let firmware = identify(&mut machines::i7i92_7i77()).unwrap();
    assert_eq!(firmware.pins.len(), 34);
    assert_eq!(firmware.sserial_channels(Gtag::SSERIAL, 0), 3);
    assert_eq!(firmware.pins[0].to_string(), "SSerial 0 TXEN2");
    assert_eq!(firmware.pins[7].to_string(), "MuxSelect 0 Select0");
    assert_eq!(firmware.pins[10].to_string(), "MuxedEncoder 0 Index");
    assert_eq!(firmware.warnings, [""; 0]);
}

#[test]
fn identification_takes_four_exchanges() {
    for mut bus in [i7i97(), machines::i7i92_7i77()] {
        identify(&mut bus).unwrap();
        assert_eq!(bus.statistics().exchanges, 4);
    }
}

#[test]
fn missing_module_is_named_beside_what_is_there() {
    let firmware = identify(&mut machines::i7i92_7i77()).unwrap();
    let missing = firmware.require(Gtag::PWM).unwrap_err();
    assert_eq!(
        missing.to_string(),
        "this firmware has no PWM (06); it has HM2DPLL (1A) x1, Watchdog (02) x1, IOPort (03) x2, \
         MuxedEncoder (0C) x6, MuxSelect (0D) x1, SSerial (C1) x1, LED (80) x1"
    );
    assert_eq!(missing.advice(), Some(advice::LOAD_MATCHING_FIRMWARE));
}

#[test]
fn wrong_cookie_is_reported_with_its_value_and_advice() {
    let mut bus = i7i97();
    bus.override_rom(0x0100, 0xFFFF_FFFF);
    let error = identify(&mut bus).unwrap_err();
    assert_eq!(
        error.to_string(),
        "no HostMot2 cookie at 0x0100: read 0xFFFFFFFF, expected 0x55AACAFE"
    );
    assert_eq!(error.advice(), Some(advice::CHECK_BOARD_FIRMWARE));
}

#[test]
fn each_wrong_word_gets_its_own_error() {
    let address_space = "expected a multiple of 4 in the 16-bit address space";
    let cases = [
        (
            0x0104,
            0x5453_4F49,
            "configuration name at 0x0104: IOSTMOT2, ",
        ),
        (0x010C, 0xFFF0, "IDROM header: 16 words at 0xFFF0, "),
        (0x010C, 0x402, "IDROM header: 16 words at 0x402, "),
        (0x0400, 4, "IDROM type: 4, expected 3 or 2"),
        (0x0404, u32::MAX, "IDROM module descriptors: 96 words at "),
        (
            0x0408,
            0xFC00,
            "IDROM pin descriptors: 51 words at 0x10000, ",
        ),
        (
            0x0424,
            24,
            "I/O ports: 3 ports of 24 pins, 51 pins in all, ",
        ),
        (
            0x0428,
            33_333,
            "ClockLow: 33333 Hz, expected at least 1 MHz",
        ),
        (
            0x0430,
            0x10_0000,
            "stride: 0x100000, expected at most 0xFFFF ",
        ),
        (
            0x0440,
            0x0103_001A,
            "clock tag of module descriptor 0, HM2DPLL (1A): 3, expected 1 (ClockLow) or 2 ",
        ),
        (
            0x0444,
            0x3007_7000,
            "choice of a stride of module descriptor 0, HM2DPLL (1A): 3, expected 0 or 1",
        ),
        (
            0x0444,
            0x0007_FA00,
            "addresses of module descriptor 0, HM2DPLL (1A): base 0xFA00, 7 registers, 1 inst",
        ),
    ];
    for (address, value, text) in cases {
        let mut bus = i7i97();
        bus.override_rom(address, value);
        let refused = identify(&mut bus).unwrap_err();
        assert_eq!(refused.advice(), Some(advice::CHECK_BYTE_ORDER));
        let error = refused.to_string();
        assert!(error.starts_with(text), "{address:#06X}: {error}");
        let is_place = text.starts_with("IDROM") && text.contains("words");
        assert_eq!(error.contains(address_space), is_place, "{error}");
    }
}

#[test]
fn odd_but_usable_descriptors_are_warnings() {
    let mut bus = i7i97();
    bus.override_rom(0x0448 + 12 + 12 - 8, 0x0201_0003); // I/O port descriptor: two instances
    bus.override_rom(0x05C0 + 4 * 50, 0); // last pin: no primary tag
    bus.override_rom(0x0440 + 12 * 3, 0x0601_020C); // muxed encoder, version 2
    bus.override_rom(0x05C0 + 4 * 49, 0x0300_1801); // a BISS pin without BISS
    let firmware = identify(&mut bus).unwrap();
    assert_eq!(
        firmware.warnings,
        [
            "the IDROM has 3 I/O ports, the module descriptor 2",
            "MuxedEncoder (0C) has version 2, which is not known to work",
            "pin 49 belongs to BISS (18), which has no descriptor",
            "pin 50 is a pin of None (00), expected an I/O port",
        ]
    );
}

proptest! {
    #[test]
    fn arbitrary_words_are_identified_or_refused_in_four_exchanges(
        words in prop::collection::vec(any::<u32>(), 256),
        keep in prop::collection::vec(any::<bool>(), 256),
    ) {
        let mut bus = i7i97();
        for (index, (word, keep)) in words.into_iter().zip(keep).enumerate().skip(5) {
            if !keep {
                bus.override_rom(0x0400 + 4 * index as u16, word);
            }
        }
        let result = identify(&mut bus);
        prop_assert!(bus.statistics().exchanges <= 4);
        if let Ok(firmware) = result {
            for module in &firmware.modules {
                for register in 0..module.registers {
                    for instance in 0..module.instances {
                        prop_assert!(module.register(register, instance).is_ok());
                    }
                }
            }
        }
    }
}

#[test]
fn machines_identify_with_both_idrom_types() {
    for idrom_type in [2, 3] {
        for (mut firmware, channels) in [
            (machines::firmware_7i92_7i77(), 3),
            (machines::firmware_5i25_7i77(), 3),
            (machines::firmware_7i97(1), 1),
            (machines::firmware_7i97(3), 3),
        ] {
            firmware.idrom_type = idrom_type;
            let mut fpga = SimFpga::new(firmware);
            let found = HostMot2::identify(&mut fpga).unwrap();
            assert_eq!(found.idrom.idrom_type, idrom_type);
            assert_eq!(found.sserial_channels(Gtag::SSERIAL, 0), channels);
            assert_eq!(found.warnings, [""; 0], "{}", found.idrom.board_name);
        }
    }
}
