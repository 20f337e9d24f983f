//! Module handles on the descriptors of FACTS 9.2 and 9.3: addresses, set-up, what is missing.

use crate::common::registers::{MapBus, i7i92_with_7i77, i7i97};
use core::time::Duration;
use mesa_hal::hostmot2::{
    Dpll, DpllConfig, EncoderConfig, Encoders, GpioSetup, Gtag, HostMot2, InMux, InMuxConfig,
    IoPinError, IoPorts, Leds, LocateError, OutM, PdmRate, PortPlan, PwmGenerators, PwmScale, Ssr,
    TickRate, Watchdog,
};

fn identified(mut bus: MapBus) -> (MapBus, HostMot2) {
    let firmware = HostMot2::identify(&mut bus).unwrap();
    bus.exchanges = 0;
    (bus, firmware)
}

#[test]
fn every_module_of_a_7i97_has_the_addresses_of_facts_9_4() {
    let (_, firmware) = identified(i7i97());
    let watchdog = Watchdog::locate(&firmware).unwrap();
    assert_eq!(
        [watchdog.time, watchdog.status, watchdog.reset],
        [0x0C00, 0x0D00, 0x0E00]
    );
    let ports = IoPorts::locate(&firmware).unwrap();
    let blocks = [
        ports.data,
        ports.direction,
        ports.alternate_source,
        ports.open_drain,
        ports.invert,
    ];
    assert_eq!(
        blocks.map(|block| block.address(2)),
        [0x1008, 0x1108, 0x1208, 0x1308, 0x1408].map(Some)
    );
    let encoders = Encoders::locate(&firmware, Gtag::MUXED_ENCODER).unwrap();
    assert_eq!(encoders.instances(), 6);
    assert_eq!(encoders.count.address(5), Some(0x3514));
    assert_eq!(encoders.control.address(5), Some(0x3614));
    assert_eq!(
        [
            encoders.timestamp_divider,
            encoders.timestamp,
            encoders.rate
        ],
        [0x3700, 0x3800, 0x3900]
    );
    assert!(encoders.is_muxed() && !encoders.has_unreliable_velocity());
    let pwm = PwmGenerators::locate(&firmware).unwrap();
    assert_eq!(pwm.value.address(5), Some(0x4014));
    assert_eq!(pwm.mode.address(5), Some(0x4114));
    assert_eq!(
        [pwm.master_rate, pwm.pdm_rate, pwm.enables],
        [0x4200, 0x4300, 0x4400]
    );
    assert!(!pwm.can_dither());
    let inputs = InMux::locate(&firmware, Gtag::IN_MUX, 0).unwrap();
    assert_eq!(
        [
            inputs.control,
            inputs.filter,
            inputs.filtered,
            inputs.raw,
            inputs.mpg
        ],
        [0x8000, 0x8100, 0x8200, 0x8300, 0x8400]
    );
    let ssr = Ssr::locate(&firmware, 0).unwrap();
    assert_eq!([ssr.data, ssr.rate], [0x7D00, 0x7E00]);
    let dpll = Dpll::locate(&firmware).unwrap();
    assert_eq!(
        [dpll.base_rate, dpll.control_1, dpll.timers_34, dpll.sync],
        [0x7000, 0x7300, 0x7500, 0x7600]
    );
    assert_eq!(Leds::locate(&firmware).unwrap().data, 0x0200);
}

#[test]
fn addresses_follow_the_descriptor_and_not_the_usual_place() {
    let mut bus = i7i97();
    bus.set(0x0440 + 12 * 5 + 4, 0x0005_9000);
    let (_, firmware) = identified(bus);
    let pwm = PwmGenerators::locate(&firmware).unwrap();
    assert_eq!(pwm.value.address(1), Some(0x9004));
    assert_eq!(pwm.enables, 0x9400);
}

/// OutM in the place of SSR, with so many instances and registers.
fn with_out_m(instances: u8, registers: u8) -> HostMot2 {
    let mut bus = i7i97();
    let ssr = 0x0440 + 12 * 7;
    bus.set(ssr, u32::from_le_bytes([0x2D, 0, 1, instances]));
    bus.set(ssr + 4, u32::from_le_bytes([0x00, 0xB0, registers, 0]));
    bus.set(ssr + 8, 1);
    identified(bus).1
}

#[test]
fn each_instance_of_outm_has_its_register_and_others_are_refused() {
    let firmware = with_out_m(2, 1);
    let addresses = [0, 1].map(|instance| OutM::locate(&firmware, instance).unwrap().data);
    assert_eq!(addresses, [0xB000, 0xB004]);
    assert_eq!(
        OutM::locate(&firmware, 2).unwrap_err().to_string(),
        "there is no OutM (2D) 2: this firmware has 2 of them, counted from 0"
    );
    assert!(matches!(
        Ssr::locate(&firmware, 0),
        Err(LocateError::Missing(_))
    ));
    let (_, usual) = identified(i7i97());
    let missing = OutM::locate(&usual, 0).unwrap_err();
    assert!(matches!(missing, LocateError::Missing(_)));
    assert!(missing.to_string().contains("OutM"), "{missing}");
    assert!(OutM::locate(&with_out_m(1, 0), 0).is_err(), "no register");
}

#[test]
fn modules_that_are_missing_or_unknown_are_refused_by_name() {
    let (_, firmware) = identified(i7i92_with_7i77());
    for result in [
        PwmGenerators::locate(&firmware).err(),
        Ssr::locate(&firmware, 0).err(),
        InMux::locate(&firmware, Gtag::IN_M, 0).err(),
        Dpll::locate(&firmware).err(),
    ] {
        assert!(matches!(result, Some(LocateError::Missing(_))));
    }
    let mut bus = i7i97();
    bus.set(0x0440 + 12 * 3, 0x0601_050C);
    bus.set(0x0440 + 12 * 4 + 8, 0);
    bus.set(0x0440 + 12 * 5 + 8, 0x7);
    let (_, firmware) = identified(bus);
    assert_eq!(
        Encoders::locate(&firmware, Gtag::MUXED_ENCODER)
            .unwrap_err()
            .to_string(),
        "MuxedEncoder (0C) has version 5, known are 2 to 4: use a firmware with one of them"
    );
    assert_eq!(
        PwmGenerators::locate(&firmware).unwrap_err().to_string(),
        "PWM (06) version 0 has 5 registers with multiple-register mask 0x7, expected at least 5 \
         and 0x3: this firmware has a layout that this crate does not know"
    );
    assert_eq!(
        InMux::locate(&firmware, Gtag::IN_MUX, 1)
            .unwrap_err()
            .to_string(),
        "there is no InMux (1E) 1: this firmware has 1 of them, counted from 0"
    );
}

#[test]
fn serial_pins_are_driven_by_their_module_and_everything_else_stays_input() {
    let (mut bus, firmware) = identified(i7i92_with_7i77());
    let ports = IoPorts::locate(&firmware).unwrap();
    let mut plan = PortPlan::new(&ports);
    plan.use_module(&firmware, Gtag::SSERIAL, 0).unwrap();
    plan.use_module(&firmware, Gtag::MUX_SELECT, 0).unwrap();
    for unit in 0..3 {
        plan.use_module(&firmware, Gtag::MUXED_ENCODER, unit)
            .unwrap();
    }
    let gpio = GpioSetup {
        output: true,
        open_drain: true,
        invert: true,
        level: true,
    };
    let place = plan.use_gpio(18, gpio).unwrap();
    assert_eq!((place.port, place.bit), (1, 1));
    ports.apply(&mut bus, &plan).unwrap();
    // TXEN2 TX2 RX2 TX1 RX1 TX0 RX0 EncMux: FACTS 8.1.
    assert_eq!(bus.get(0x1100), 0b1010_1011);
    assert_eq!(bus.get(0x1200), 0b1010_1011);
    assert_eq!(
        [0x1000, 0x1104, 0x1304, 0x1404].map(|a| bus.get(a)),
        [0, 2, 2, 2]
    );
    assert_eq!([0x1004, 0x1204].map(|a| bus.get(a)), [2, 0]);
    assert_eq!(bus.exchanges, 1);
}

#[test]
fn directions_are_set_last_and_pins_are_released_first() {
    let (mut bus, firmware) = identified(i7i97());
    let ports = IoPorts::locate(&firmware).unwrap();
    let mut plan = PortPlan::new(&ports);
    plan.use_module(&firmware, Gtag::SSERIAL, 0).unwrap();
    bus.writes.clear();
    ports.apply(&mut bus, &plan).unwrap();
    let addresses: Vec<_> = bus.writes.iter().map(|&(address, _)| address).collect();
    // Open drain drives whatever the direction says (FACTS 12.2).
    let gates = [0x1100, 0x1104, 0x1108, 0x1300, 0x1304, 0x1308];
    assert_eq!(addresses.len(), 6 + 9 + 6);
    assert_eq!(addresses[..6], gates);
    assert_eq!(addresses[15..], gates);
    assert!(bus.writes[..6].iter().all(|&(_, value)| value == 0));
    let configured = &addresses[6..15];
    assert!(configured.iter().all(|address| !gates.contains(address)));
}

#[test]
fn a_pin_has_one_user_only() {
    let (_, firmware) = identified(i7i97());
    let ports = IoPorts::locate(&firmware).unwrap();
    let mut plan = PortPlan::new(&ports);
    plan.use_module(&firmware, Gtag::SSERIAL, 0).unwrap();
    let gpio = GpioSetup::default();
    assert_eq!(plan.use_gpio(32, gpio), Err(IoPinError::InUse { pin: 32 }));
    assert_eq!(
        plan.use_gpio(51, gpio),
        Err(IoPinError::NoSuchPin { pin: 51, pins: 51 })
    );
    assert_eq!(
        plan.use_module(&firmware, Gtag::SSERIAL, 1),
        Err(IoPinError::NoPins {
            gtag: Gtag::SSERIAL,
            unit: 1
        })
    );
}

#[test]
fn the_watchdog_is_armed_petted_and_let_bite() {
    let (mut bus, firmware) = identified(i7i97());
    let watchdog = Watchdog::locate(&firmware).unwrap();
    bus.set(0x0D00, 1);
    assert!(!watchdog.read_status(&mut bus).unwrap().is_empty());
    bus.writes.clear();
    watchdog.arm(&mut bus, Duration::from_millis(5)).unwrap();
    watchdog.pet(&mut bus).unwrap();
    watchdog.bite_now(&mut bus).unwrap();
    assert_eq!(
        bus.writes,
        [
            (0x0C00, 499_998),
            (0x0E00, 0x5A00_0000),
            (0x0D00, 0),
            (0x0E00, 0x5A00_0000),
            (0x0C00, 1),
        ]
    );
    watchdog.disable(&mut bus).unwrap();
    assert!(bus.get(0x0C00) & 0x8000_0000 != 0);
}

#[test]
fn the_modules_of_a_7i97_are_set_up_in_an_exchange_each() {
    let (mut bus, firmware) = identified(i7i97());
    let encoders = Encoders::locate(&firmware, Gtag::MUXED_ENCODER).unwrap();
    let stamps = TickRate::for_hz(encoders.clock_hz(), TickRate::TIMESTAMP_HZ);
    let config = EncoderConfig::default();
    encoders
        .set_up(&mut bus, stamps, TickRate::MUX_7I97, &[config; 6])
        .unwrap();
    assert_eq!(
        [0x3700, 0x3900, 0x3600, 0x3614].map(|a| bus.get(a)),
        [98, 14, 0x1808, 0x1808]
    );
    let pwm = PwmGenerators::locate(&firmware).unwrap();
    let rate = pwm.rate_for(48_000.0, false);
    let scale = PwmScale::volts_7i97(rate, pwm.can_dither());
    pwm.set_up(
        &mut bus,
        rate,
        PdmRate::new(200_000_000, 6_000_000.0),
        &[scale; 6],
    )
    .unwrap();
    assert_eq!(
        [0x4014, 0x4114, 0x4200, 0x4300, 0x4400].map(|a| bus.get(a)),
        [0x0800_0000, 0x23, 64_425, 1_966, 0]
    );
    Ssr::locate(&firmware, 0).unwrap().start(&mut bus).unwrap();
    assert_eq!([0x7D00, 0x7E00].map(|a| bus.get(a)), [0, 0x1030]);
    assert_eq!(bus.exchanges, 3);
}

#[test]
fn input_scans_and_dpll_are_set_up_from_what_the_hardware_says() {
    let (mut bus, firmware) = identified(i7i97());
    bus.set(0x8000, 15);
    let inputs = InMux::locate(&firmware, Gtag::IN_MUX, 0).unwrap();
    let config = InMuxConfig {
        long_inputs: 0x00F0,
        mpg_4x: [false, true, false, false],
        ..InMuxConfig::default()
    };
    let control = inputs.set_up(&mut bus, &config).unwrap();
    assert!((control.scan_hz(inputs.clock_hz()) - 20_000.0).abs() < 100.0);
    assert_eq!([0x8100, 0x8400].map(|a| bus.get(a)), [0xF0, 0x0100]);
    bus.set(0x7300, 42);
    let dpll = Dpll::locate(&firmware).unwrap();
    let setup = dpll.set_up(&mut bus, &DpllConfig::default()).unwrap();
    assert_eq!(bus.get(0x7000), setup.base_rate);
    assert_eq!(bus.get(0x7200), 0x1840_0000);
    assert_eq!(bus.get(0x7400), 0x1999_1999);
    assert_eq!(bus.exchanges, 4);
}
