//! Names, versions and registers, and what is written at rest only.

use super::*;

#[test]
fn names_types_and_fresh_values_are_those_of_linuxcnc() {
    let machine = start(firmware(WITH_LATCH), Settings::default());
    let pins = machine.driver.pins();
    let prefix = "hm2_7i92.0.stepgen.";
    let found: BTreeSet<_> = pins
        .infos()
        .iter()
        .zip(pins.values())
        .filter_map(|(info, value)| {
            let name = info.name.strip_prefix(prefix)?;
            let name = name
                .strip_prefix("00.")
                .or(Some(name).filter(|n| !n.starts_with("01.")))?;
            Some(format!(
                "{name} {} {} {value}",
                info.hal_type.as_str(),
                info.role.hal_direction()
            ))
        })
        .collect();
    let expected = "\
        control-type bit IN false|counts s32 OUT 0|dbg_err_at_match float OUT 0|dbg_ff_vel float OUT 0|\
        dbg_pos_minus_prev_cmd float OUT 0|dbg_s_to_match float OUT 0|dbg_step_rate s32 OUT 0|\
        dbg_vel_error float OUT 0|dirhold u32 RW 163830|dirsetup u32 RW 163830|disable-ramp bit RW false|\
        enable bit IN false|homed bit IN false|index-enable bit I/O false|index-invert bit IN false|maxaccel float RW 1|\
        maxvel float RW 0|near-max-rate bit OUT false|position-cmd float IN 0|position-fb float OUT 0|\
        position-lag float OUT 0|position-latch float OUT 0|position-reset bit IN false|\
        position-scale float RW 1|position-unsure bit OUT false|probe-enable bit I/O false|\
        probe-invert bit IN false|step_type u32 RW 0|steplen u32 RW 163830|stepspace u32 RW 163830|\
        swap_step_dir bit RW false|table-data-0 u32 RW 0|table-data-1 u32 RW 0|table-data-2 u32 RW 0|\
        table-data-3 u32 RW 0|timer-number s32 IN -1|velocity-cmd float IN 0|velocity-fb float OUT 0";
    let expected: BTreeSet<_> = expected.split('|').map(ToString::to_string).collect();
    assert_eq!(found, expected);
}

#[test]
fn set_up_ends_with_the_master_rate_and_the_directions() {
    let mut machine = machine(2);
    machine.assert_right();
    assert_eq!(machine.model().master, u32::MAX);
    let generator = machine.generator();
    assert_eq!((generator.step_len, generator.dir_hold), (0x3FFF, 0x3FFF));
    let driven: Vec<_> = (0..10)
        .filter(|n| machine.fpga().is_driven(FIRST_PIN + n))
        .collect();
    assert_eq!(driven, [0, 1, 4, 5], "the others are plain I/O");
    machine.cycle(0.0);
    machine.cycle(0.0);
    let generator = machine.generator();
    assert_eq!((generator.step_len, generator.step_space), (250, 250));
    assert_eq!((generator.dir_setup, generator.dir_hold), (500, 250 + 501));
    machine.assert_right();
}

#[test]
fn motor_does_not_move_before_a_read_confirms_the_times() {
    let mut machine = machine(2);
    machine.enable(true);
    let _ = machine.driver.read();
    machine
        .driver
        .pins_mut()
        .set(machine.pins.position_cmd, 1.0);
    // The write with the times is lost.
    let next = machine.driver.bus_mut().exchanges();
    machine.driver.bus_mut().fail_at(next, Fault::AckedButLost);
    machine.driver.write().unwrap();
    machine.wait(MS);
    assert_eq!(machine.generator().step_len, 0x3FFF);
    machine.cycle(1.0);
    assert_eq!(
        (machine.generator().rate, machine.generator().step_len),
        (0, 250)
    );
    machine.cycle(1.0);
    assert!(machine.generator().rate > 0);
    machine.go(1.0);
    machine.assert_motor_at(1_000.0);
    machine.assert_right();
}

#[test]
fn mode_swap_and_times_change_at_rest_only() {
    let mut machine = Machine::enabled(0x42);
    for _ in 0..20 {
        machine.cycle(1.0);
    }
    let pins = machine.pins;
    machine
        .driver
        .pins_mut()
        .set_param(pins.step_type, 2)
        .unwrap();
    machine
        .driver
        .pins_mut()
        .set_param(pins.steplen, 5_000)
        .unwrap();
    let swap = pins.swap_step_dir.unwrap();
    machine.driver.pins_mut().set_param(swap, true).unwrap();
    machine.cycle(1.0);
    assert_eq!(
        (machine.generator().mode, machine.generator().step_len),
        (0, 250)
    );
    machine.go(1.0);
    assert_eq!(
        (machine.generator().mode, machine.generator().step_len),
        (6, 500)
    );
    machine.go(0.0);
    machine.assert_right();
}

#[test]
fn table_is_written_whole_and_its_length_exchanges_no_outputs() {
    let settings = Settings {
        stepgen_width: 4,
        ..Settings::default()
    };
    let mut machine = start(firmware(0x42), settings);
    let pins = machine.pins;
    let table = pins.table_data.expect("pins for a table");
    for (param, data) in table
        .into_iter()
        .zip([0x0403_0201, 0x0807_0605, 0, 0x1000_0000])
    {
        machine.driver.pins_mut().set_param(param, data).unwrap();
    }
    machine
        .driver
        .pins_mut()
        .set_param(pins.step_type, 6)
        .unwrap();
    let _ = machine.driver.read();
    let next = machine.driver.bus_mut().exchanges();
    machine.driver.bus_mut().fail_at(next, Fault::AckedButLost);
    machine.driver.write().unwrap();
    machine.wait(MS);
    machine.cycle(0.0);
    machine.cycle(0.0);
    let generator = machine.generator();
    assert_eq!(generator.mode, 3);
    assert_eq!(generator.table_max, 5);
    let mut expected: Vec<u32> = (1..=8).collect();
    expected.resize(16, 0);
    expected[15] = 0x10;
    assert_eq!(generator.table, expected);
    assert!(machine.fpga().is_driven(FIRST_PIN + 3));
    machine.set_param(pins.position_scale, 1_000.0);
    machine.set_param(pins.maxaccel, 100.0);
    // It does not move before it is certain that nothing of the table is written again.
    machine.enable(true);
    for period in 0..400 {
        if period % 7 == 0 && period > 110 {
            let next = machine.driver.bus_mut().exchanges();
            machine
                .driver
                .bus_mut()
                .fail_at(next + 1, Fault::AckedButLost);
        }
        machine.cycle(1.0);
        assert!(machine.motor == 0 || period > 95, "{period}");
    }
    assert!(machine.motor > 100, "{}", machine.motor);
    machine.assert_right();
}

#[test]
fn table_is_refused_where_there_are_no_pins_for_one() {
    let settings = Settings {
        instances: [(Gtag::STEPGEN, 2)].into(),
        ..Settings::default()
    };
    let fpga = SimFpga::new(machines::firmware_7i92_7i76());
    let mut machine = start(fpga, settings);
    let (pins, to) = (machine.pins, machine.driver.pins_mut());
    assert!(pins.table_data.is_none());
    for step_type in [3, 4, 16, u32::MAX] {
        let refused = to.set_param(pins.step_type, step_type);
        assert!(refused.is_err(), "{step_type}");
    }
    to.set_param(pins.step_type, 2).expect("quadrature");
}

#[test]
fn each_generator_has_its_own_registers() {
    let mut machine = Machine::enabled(2);
    let module = machine.driver.modules::<Stepgens>().next();
    let second = module.and_then(|module| module.pins().nth(1)).unwrap();
    machine.set_param(second.position_scale, -500.0);
    machine.set_param(second.maxaccel, 50.0);
    machine.driver.pins_mut().set(second.enable, true);
    for _ in 0..2_000 {
        machine.driver.pins_mut().set(second.position_cmd, 2.0);
        machine.cycle(-1.0);
    }
    let steps = [0, 1].map(|n: usize| machine.model().generators[n].steps());
    assert!((steps[0] + 1_000).abs() <= 1 && (steps[1] + 1_000).abs() <= 1);
    assert!((machine.read(second.position_fb) - 2.0).abs() < 1e-4);
}

#[test]
fn unknown_versions_are_named_and_old_ones_are_remarked() {
    let module = |version| ModuleDescriptor {
        gtag: Gtag::STEPGEN,
        version,
        clock_hz: 100_000_000,
        instances: 5,
        base: 0x2000,
        registers: 10,
        register_stride: 0x100,
        instance_stride: 4,
        multiple_registers: 0x1FF,
    };
    let known: Vec<u8> = (0..=255)
        .filter(|version| check(&module(*version)).is_ok())
        .collect();
    assert_eq!(known, [0, 1, 2, 0x42, 0xC2]);
    let error = check(&module(3)).unwrap_err().to_string();
    assert!(
        error.contains("version 03") && error.contains("00, 01, 02, 42 or C2"),
        "{error}"
    );
    for (version, is_old) in [(0, true), (1, true), (2, false)] {
        let machine = start(firmware(version), Settings::default());
        let mut remarks = machine.driver.remarks().iter();
        let found =
            remarks.any(|Remark { kind, .. }| matches!(kind, RemarkKind::OldStepgen { .. }));
        assert_eq!(found, is_old, "{version}");
    }
}

#[test]
fn source_of_the_latch_is_off_or_a_timer() {
    let words = [-1, 0, 1, 4, 5, -2].map(latch_timer);
    assert_eq!(words, [0, 0x8000, 0x9000, 0xC000, 0x8000, 0x8000]);
}

#[test]
fn unused_generators_leave_their_pins_to_the_application() {
    let settings = Settings {
        instances: [(Gtag::STEPGEN, 1)].into(),
        ..Settings::default()
    };
    let machine = start(firmware(2), settings);
    let pins = machine.driver.pins();
    assert!(pins.output::<bool>("hm2_7i92.0.stepgen.00.enable").is_ok());
    let second = pins.output::<bool>("hm2_7i92.0.stepgen.01.enable");
    assert!(matches!(second, Err(PinError::NotFound { .. })));
    let free = format!("hm2_7i92.0.gpio.{:03}.out", FIRST_PIN + 4);
    assert!(pins.output::<bool>(&free).is_ok());
}
