//! Stepper motors on step generators, register by register: what the motors do is the truth.

use mesa_hal::bus::RegisterBus;
use mesa_hal_sim::{
    FirmwareImage, SimFirmware, SimFpga, SimTerminal, Stepper, StepperConfig, StepperWiring,
    SwitchConfig, gtag, machines,
};

const MS: u64 = 1_000_000;

const RATE: u16 = 0x2000;
const ACCUM: u16 = 0x2100;
const MASTER: u16 = 0x2900;

/// Steps per second in a rate register at 100 MHz.
fn rate(hz: f64) -> u32 {
    (hz * 4_294_967_296.0 / 100e6) as i32 as u32
}

fn stepper(config: StepperConfig) -> Stepper {
    Stepper::new(config).expect("a valid motor")
}

/// A 7I92 with a 7I76, all generators with pulses of 2 us and their pins driven.
fn machine() -> SimFpga {
    let mut fpga = machines::i7i92_7i76();
    set_up(&mut fpga);
    fpga
}

fn set_up(fpga: &mut SimFpga) {
    for generator in 0..5 {
        for (register, ticks) in [(0x2300, 100), (0x2400, 400), (0x2500, 200), (0x2600, 200)] {
            fpga.write_register(register + 4 * generator, ticks);
        }
    }
    fpga.write_register(MASTER, u32::MAX);
    let port = fpga.firmware().pins.iter();
    let first = port
        .take_while(|pin| pin.secondary != gtag::STEPGEN)
        .count()
        / 17;
    let port = 4 * first as u16;
    fpga.write_register(0x1200 + port, 0x3FF);
    fpga.write_register(0x1100 + port, 0x3FF);
}

fn wire(fpga: &mut SimFpga, generator: usize, encoder: Option<usize>) -> usize {
    fpga.wire_stepper(StepperWiring {
        generator,
        encoder,
        motor: stepper(StepperConfig::default()),
    })
}

/// Accelerates to a speed and back to 0 within the motor's acceleration, in 1 ms cycles.
fn move_once(fpga: &mut SimFpga, generator: u16, hz: f64) {
    let cycles = (hz.abs() / 500.0) as u32;
    let part = |n: u32| hz * f64::from(n) / f64::from(cycles);
    let up = 1..=cycles;
    for n in up.clone().chain(up.rev()).map(|n| n - 1) {
        fpga.write_register(RATE + 4 * generator, rate(part(n)));
        fpga.advance_to(fpga.now() + MS);
    }
}

fn whole_steps(fpga: &mut SimFpga, generator: u16) -> i64 {
    let accum = fpga.read_register(ACCUM + 4 * generator);
    i64::from(accum as i32 >> 16)
}

#[test]
fn motor_matches_the_accumulator_after_moves_in_both_directions() {
    for mut fpga in [machines::i7i92_7i76(), machines::i7i97_7i76()] {
        set_up(&mut fpga);
        let axes: Vec<usize> = (0..5).map(|n| wire(&mut fpga, n, None)).collect();
        for (generator, hz) in [(0, 50_000.0), (1, -30_000.0), (4, 20_000.0), (0, -20_000.0)] {
            move_once(&mut fpga, generator, hz);
        }
        for (generator, axis) in axes.into_iter().enumerate() {
            let expected = whole_steps(&mut fpga, generator as u16);
            let motor = fpga.stepper(axis).expect("a stepper motor");
            assert_eq!(motor.commanded(), expected, "generator {generator}");
            assert_eq!(motor.steps(), expected, "generator {generator}");
            assert_eq!((motor.lost(), motor.overshot()), (0, 0));
        }
        let moved = whole_steps(&mut fpga, 0);
        assert!((4_000..4_300).contains(&moved), "{moved}");
    }
}

#[test]
fn motor_loses_steps_on_a_rate_jump_unknown_to_the_accumulator() {
    let mut fpga = machine();
    let axis = wire(&mut fpga, 0, None);
    fpga.write_register(RATE, rate(80_000.0));
    fpga.advance_to(fpga.now() + 10 * MS);
    fpga.write_register(RATE, 0);
    fpga.advance_to(fpga.now() + 10 * MS);
    let expected = whole_steps(&mut fpga, 0);
    let motor = fpga.stepper(axis).expect("a stepper motor");
    assert_eq!(motor.commanded(), expected);
    assert!(motor.lost() > 700, "{} of {expected}", motor.lost());
    assert_eq!(motor.steps() + motor.lost() as i64, expected);
}

#[test]
fn timings_that_are_too_short_for_the_drive_lose_all_steps() {
    let mut fpga = machine();
    fpga.write_register(0x2500, 20);
    let axis = wire(&mut fpga, 0, None);
    move_once(&mut fpga, 0, 10_000.0);
    let motor = fpga.stepper(axis).expect("a stepper motor");
    assert_eq!(motor.steps(), 0);
    assert_eq!(motor.lost() as i64, motor.commanded());
    assert!(motor.lost() > 180, "{}", motor.lost());
}

#[test]
fn motor_stops_after_a_bite_while_the_accumulator_runs_on() {
    let mut fpga = machine();
    let axis = wire(&mut fpga, 0, None);
    fpga.write_register(RATE, rate(900.0));
    fpga.write_register(0x0C00, 500_000);
    fpga.advance_to(fpga.now() + 20 * MS);
    let motor = fpga.stepper(axis).expect("a stepper motor");
    // Pins that become inputs are pulled up, both at once: a step down without any set-up time.
    let seen = (motor.steps(), motor.commanded(), motor.lost());
    assert_eq!(seen, (4, 3, 1));
    let steps = whole_steps(&mut fpga, 0);
    assert!((17..=18).contains(&steps), "{steps}");
}

#[test]
fn inverted_step_pin_steps_with_its_falling_edges() {
    let mut fpga = machine();
    fpga.write_register(0x1400, 1 << 1);
    let axis = wire(&mut fpga, 0, None);
    move_once(&mut fpga, 0, 10_000.0);
    let expected = whole_steps(&mut fpga, 0);
    let motor = fpga.stepper(axis).expect("a stepper motor");
    // The last pulse has ended: its end is the rising edge.
    assert_eq!(motor.commanded(), expected);
    assert!(expected > 180);
}

#[test]
fn encoder_and_a_home_switch_follow_the_motor() {
    const HOME: usize = 20;
    let mut fpga = machine();
    let axis = wire(&mut fpga, 2, Some(0));
    fpga.add_switch(SwitchConfig {
        axis,
        from: 0.1,
        to: f64::INFINITY,
        hysteresis: 0.0,
        bounce: 0,
        normally_closed: false,
        terminal: SimTerminal::Pin { pin: HOME },
    });
    assert_eq!(fpga.read_register(0x3000) as i16, 0);
    move_once(&mut fpga, 2, 10_000.0);
    let steps = whole_steps(&mut fpga, 2);
    assert!(steps > 180);
    assert_eq!(i64::from(fpga.read_register(0x3000) as i16), steps);
    assert!(fpga.pin_level(HOME));
    move_once(&mut fpga, 2, -10_000.0);
    let steps = whole_steps(&mut fpga, 2);
    assert_eq!(i64::from(fpga.read_register(0x3000) as i16), steps);
    assert!(!fpga.pin_level(HOME));
}

#[test]
fn reload_stops_the_generators_and_keeps_the_motor() {
    let mut fpga = machine();
    let axis = wire(&mut fpga, 0, None);
    move_once(&mut fpga, 0, 10_000.0);
    let before = fpga.stepper(axis).expect("a stepper motor").steps();
    fpga.reload();
    fpga.advance_to(fpga.now() + 10 * MS);
    assert_eq!(fpga.read(ACCUM).expect("a register"), 0);
    set_up(&mut fpga);
    move_once(&mut fpga, 0, 10_000.0);
    let after = fpga.stepper(axis).expect("a stepper motor").steps();
    // Pins that are released and driven again make an edge each.
    assert!((after - 2 * before).abs() <= 1, "{before} {after}");
}

/// The words of the firmwares are those of Mesa's public ones, but for one version: the recorded
/// firmware with a 7I76 has step generators of version 42.
#[test]
fn firmwares_are_the_public_ones() {
    for (firmware, name) in [
        (machines::firmware_7i92_7i76(), "7I92-7I76x1D_34"),
        (machines::firmware_7i97_7i76(), "7I97-7I97_7I76D_51"),
    ] {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/transcripts/firmwares");
        let text = std::fs::read_to_string(format!("{folder}/{name}.txt")).expect("an image");
        let image = FirmwareImage::parse(&text).expect("an image");
        let mut public = image.firmware().expect("a firmware");
        public.mux_rate = firmware.mux_rate;
        if let Some(steps) = public.module_mut(gtag::STEPGEN) {
            steps.version = firmware.module(gtag::STEPGEN).map_or(0, |one| one.version);
        }
        let local_pins = firmware.local_pins.clone();
        assert_eq!(
            firmware,
            SimFirmware {
                local_pins,
                ..public
            },
            "{name}"
        );
    }
}
