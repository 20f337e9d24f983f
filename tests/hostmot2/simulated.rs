//! The HostMot2 handles against the simulated FPGA: an axis is moved by PWM and followed by its
//! encoder; inputs, outputs, watchdog and DPLL.

use core::time::Duration;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::hostmot2::{
    ControlWord, CountWord, Dpll, DpllConfig, Encoder, EncoderConfig, EncoderReading,
    EncoderSample, Encoders, GpioSetup, Gtag, HostMot2, InMux, InMuxConfig, IoPorts, LatchRequest,
    LedWord, Leds, MpgCounters, MpgWord, OutM, PdmRate, PinPlace, PortPlan, PwmGenerators,
    PwmScale, Ssr, TickRate, Watchdog, WatchdogStatus,
};
use mesa_hal::sim::{AxisWiring, DriveSource, MotorConfig, SimFpga, machines};

const CYCLE: Duration = Duration::from_millis(1);

/// A 7I97 whose pins belong to their modules, with a GPIO output on the first expansion pin.
struct Machine {
    fpga: SimFpga,
    firmware: HostMot2,
    ports: IoPorts,
    gpio: PinPlace,
}

const EXPANSION: u16 = 34;

fn i7i97() -> Machine {
    machine(machines::i7i97(1), [Gtag::SSR, Gtag::IN_MUX])
}

/// With the modules of its isolated outputs and inputs.
fn machine(mut fpga: SimFpga, [outputs, inputs]: [Gtag; 2]) -> Machine {
    let firmware = HostMot2::identify(&mut fpga).unwrap();
    let ports = IoPorts::locate(&firmware).unwrap();
    let plan = &mut PortPlan::new(&ports);
    for (gtag, unit) in [
        (Gtag::PWM, 0),
        (Gtag::PWM, 1),
        (Gtag::MUXED_ENCODER, 0),
        (Gtag::MUX_SELECT, 0),
        (outputs, 0),
        (inputs, 0),
        (Gtag::SSERIAL, 0),
    ] {
        plan.use_module(&firmware, gtag, unit).unwrap();
    }
    let output = GpioSetup {
        output: true,
        ..GpioSetup::default()
    };
    let gpio = plan.use_gpio(EXPANSION, output).unwrap();
    ports.apply(&mut fpga, plan).unwrap();
    Machine {
        fpga,
        firmware,
        ports,
        gpio,
    }
}

/// Encoder 0, cycle by cycle.
struct Feedback {
    registers: Encoders,
    encoder: Encoder,
}

impl Feedback {
    fn new(machine: &mut Machine, config: EncoderConfig) -> Self {
        let registers = Encoders::locate(&machine.firmware, Gtag::MUXED_ENCODER).unwrap();
        let stamps = TickRate::for_hz(registers.clock_hz(), TickRate::TIMESTAMP_HZ);
        let all = vec![config; registers.instances() as usize];
        registers
            .set_up(&mut machine.fpga, stamps, TickRate::MUX_7I97, &all)
            .unwrap();
        Self {
            registers,
            encoder: Encoder::new(config, stamps.hz(registers.clock_hz())),
        }
    }

    fn cycle(&mut self, fpga: &mut SimFpga) -> EncoderReading {
        fpga.wait(CYCLE);
        let count = CountWord(fpga.read(self.registers.count.first()).unwrap());
        let control = ControlWord(fpga.read(self.registers.control.first()).unwrap());
        let timestamp = fpga.read(self.registers.timestamp).unwrap() as u16;
        let at = fpga.now();
        let reading = self.encoder.read(EncoderSample {
            count,
            control,
            timestamp,
            at,
        });
        let control = self.encoder.control().0;
        fpga.write(self.registers.control.first(), control).unwrap();
        reading
    }
}

fn by_hand(machine: &mut Machine, velocity: f64) {
    machine.fpga.motor(0).unwrap().turn_by_hand(Some(velocity));
}

fn with_motor(source: DriveSource) -> Machine {
    let mut machine = i7i97();
    let axis = machine.fpga.wire_axis(AxisWiring {
        source,
        encoder: 0,
        motor: MotorConfig::default(),
    });
    assert_eq!(axis, 0);
    machine
}

/// 1000 counts a unit, as the motor has. The long filter would not follow the fastest ones.
fn config() -> EncoderConfig {
    EncoderConfig {
        scale: 1_000.0,
        filter: false,
        ..EncoderConfig::default()
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
            assert_eq!(found.idrom().idrom_type, idrom_type);
            assert_eq!(found.sserial_channels(Gtag::SSERIAL, 0), channels);
            assert_eq!(found.warnings(), &[], "{}", found.idrom().board_name);
        }
    }
}

#[test]
fn pwm_in_offset_mode_drives_the_motor_at_the_volts_that_were_asked_for() {
    let mut machine = with_motor(DriveSource::Pwm { unit: 0 });
    let pwm = PwmGenerators::locate(&machine.firmware).unwrap();
    let rate = pwm.rate_for(48_000.0, false);
    let scale = PwmScale::volts_7i97(rate, pwm.can_dither());
    let pdm = PdmRate::new(200_000_000, 48_000.0);
    pwm.set_up(&mut machine.fpga, rate, pdm, &[scale; 6])
        .unwrap();
    assert!(machine.fpga.analog_output(0).volts.abs() < 0.01);
    assert!(!machine.fpga.analog_output(0).enabled);
    machine.fpga.write(pwm.enables, 1).unwrap();
    assert!(machine.fpga.analog_output(0).enabled);
    for volts in [5.0, -7.25, 0.0, -10.0, 10.0, f64::NAN] {
        let value = scale.encode(volts).word;
        machine.fpga.write(pwm.value.first(), value).unwrap();
        machine.fpga.wait(Duration::from_micros(21));
        let expected = if volts.is_nan() { 0.0 } else { volts };
        let output = machine.fpga.analog_output(0).volts;
        assert!((output - expected).abs() < 0.006, "{volts}: {output}");
    }
}

#[test]
fn counts_follow_the_motor_across_many_wraps_of_the_counter() {
    let mut machine = with_motor(DriveSource::Nothing);
    let mut feedback = Feedback::new(&mut machine, config());
    let start = machine.fpga.motor(0).unwrap().counts();
    feedback.cycle(&mut machine.fpga);
    for velocity in [700.0, -350.0, 2_000.0] {
        by_hand(&mut machine, velocity);
        for _ in 0..500 {
            feedback.cycle(&mut machine.fpga);
        }
        by_hand(&mut machine, 0.0);
        let reading = feedback.cycle(&mut machine.fpga);
        let moved = machine.fpga.motor(0).unwrap().counts() - start;
        assert!(
            (reading.rawcounts as f64 - moved).abs() <= 1.0,
            "{} and {moved}",
            reading.rawcounts
        );
        assert!((reading.position - moved / 1_000.0).abs() < 0.002);
        assert!(!reading.quadrature_error);
    }
}

#[test]
fn velocities_are_right_from_a_count_in_ten_cycles_to_thousands_in_one() {
    for velocity in [0.1, -0.45, 3.0, 250.0, -1_500.0] {
        let mut machine = with_motor(DriveSource::Nothing);
        let mut feedback = Feedback::new(&mut machine, config());
        by_hand(&mut machine, velocity);
        let mut measured = 0.0;
        for _ in 0..400 {
            measured = feedback.cycle(&mut machine.fpga).velocity;
        }
        assert!(
            (measured - velocity).abs() < velocity.abs() * 0.01,
            "{velocity}: {measured}"
        );
        by_hand(&mut machine, 0.0);
        for _ in 0..600 {
            measured = feedback.cycle(&mut machine.fpga).velocity;
        }
        assert!(measured.abs() < 1e-12, "{velocity}: {measured}");
    }
}

#[test]
fn a_quadrature_error_is_said_until_it_is_taken_back() {
    let mut machine = with_motor(DriveSource::Nothing);
    let mut feedback = Feedback::new(&mut machine, config());
    feedback.cycle(&mut machine.fpga);
    machine.fpga.encoders().unwrap().disturb(0);
    for _ in 0..3 {
        assert!(feedback.cycle(&mut machine.fpga).quadrature_error);
    }
    feedback.encoder.clear_quadrature_error();
    feedback.cycle(&mut machine.fpga);
    assert!(!feedback.cycle(&mut machine.fpga).quadrature_error);
    assert_eq!(
        feedback.encoder.control().0 & ControlWord::QUADRATURE_ERROR,
        0
    );
}

#[test]
fn index_enable_finds_the_index_at_every_speed() {
    for velocity in [5.0, -5.0, 900.0] {
        let mut machine = with_motor(DriveSource::Nothing);
        let mut feedback = Feedback::new(&mut machine, config());
        feedback.cycle(&mut machine.fpga);
        by_hand(&mut machine, velocity);
        for _ in 0..10 {
            feedback.cycle(&mut machine.fpga);
        }
        feedback.encoder.request(LatchRequest::Index);
        let mut cycles = 0;
        while feedback.encoder.requested() == LatchRequest::Index {
            feedback.cycle(&mut machine.fpga);
            cycles += 1;
            assert!(cycles < 2_000, "no index at {velocity}");
        }
        by_hand(&mut machine, 0.0);
        let reading = feedback.cycle(&mut machine.fpga);
        let counts = machine.fpga.motor(0).unwrap().counts();
        // Zero is at a multiple of the 4000 counts of a revolution.
        let off = (counts - reading.count as f64).rem_euclid(4_000.0);
        assert!(
            off <= 2.0 || off >= 3_998.0,
            "{velocity}: count {} at {counts}",
            reading.count
        );
    }
}

#[test]
fn inputs_outputs_leds_and_gpio_reach_their_terminals() {
    let mut machine = i7i97();
    let fpga = &mut machine.fpga;
    let inputs = InMux::locate(&machine.firmware, Gtag::IN_MUX, 0).unwrap();
    let control = inputs.set_up(fpga, &InMuxConfig::default()).unwrap();
    assert_eq!(control.last_input(), 15);
    let scan = fpga.inputs().unwrap().scan_rate();
    assert!((scan - control.scan_hz(inputs.clock_hz())).abs() < 1.0);
    fpga.set_input(5, true);
    fpga.wait(CYCLE);
    assert_eq!(fpga.read(inputs.filtered).unwrap(), 1 << 5);
    assert_eq!(fpga.read(inputs.raw).unwrap(), 1 << 5);

    let ssr = Ssr::locate(&machine.firmware, 0).unwrap();
    ssr.start(fpga).unwrap();
    assert!((fpga.ssr().unwrap().drive_frequency() - 1e6).abs() < 1.0);
    fpga.write(ssr.data, 0b10_0001).unwrap();
    assert_eq!(
        [0, 1, 5].map(|output| fpga.isolated_output(output)),
        [true, false, true]
    );

    let leds = Leds::locate(&machine.firmware).unwrap();
    fpga.write(leds.data, LedWord::default().with(1, true).0)
        .unwrap();
    assert_eq!([0, 1].map(|led| fpga.leds().is_lit(led)), [false, true]);

    let data = machine.ports.data.address(machine.gpio.port).unwrap();
    for on in [true, false] {
        fpga.write(data, machine.gpio.put(0, on)).unwrap();
        assert_eq!(fpga.pin_level(EXPANSION as usize), on);
        assert_eq!(machine.gpio.get(fpga.read(data).unwrap()), on);
    }
}

#[test]
fn the_outputs_and_inputs_of_newer_firmware_reach_their_terminals() {
    let mut machine = machine(machines::i7i97_inm_outm(1), [Gtag::OUT_M, Gtag::IN_M]);
    let fpga = &mut machine.fpga;
    let inputs = InMux::locate(&machine.firmware, Gtag::IN_M, 0).unwrap();
    let control = inputs.set_up(fpga, &InMuxConfig::default()).unwrap();
    assert_eq!(control.last_input(), 15);
    fpga.set_input(15, true);
    fpga.wait(CYCLE);
    assert_eq!(fpga.read(inputs.filtered).unwrap(), 1 << 15);

    let out_m = OutM::locate(&machine.firmware, 0).unwrap();
    let on = |fpga: &SimFpga| [0, 1, 2, 3, 4, 5].map(|output| fpga.isolated_output(output));
    assert_eq!(on(fpga), [false; 6]);
    for lit in 0..6 {
        fpga.write(out_m.data, 1 << lit).unwrap();
        assert_eq!(on(fpga), [0, 1, 2, 3, 4, 5].map(|output| output == lit));
    }
    let watchdog = Watchdog::locate(&machine.firmware).unwrap();
    watchdog.arm(fpga, Watchdog::DEFAULT_TIMEOUT).unwrap();
    assert!(fpga.isolated_output(5));
    fpga.wait(6 * CYCLE);
    assert_eq!(on(fpga), [false; 6], "the watchdog has bitten");
}

#[test]
fn an_mpg_on_the_inputs_counts_as_its_mode_says_and_up_when_b_leads() {
    let up = [(false, true), (true, true), (true, false), (false, false)];
    let down = [(true, false), (true, true), (false, true), (false, false)];
    for (four_x, steps, expected) in [
        (true, up, 8),
        (false, up, 2),
        (true, down, -8),
        (false, down, -2),
    ] {
        let mut machine = i7i97();
        let fpga = &mut machine.fpga;
        let inputs = InMux::locate(&machine.firmware, Gtag::IN_MUX, 0).unwrap();
        let config = InMuxConfig {
            mpg_4x: [false, four_x, false, false],
            ..InMuxConfig::default()
        };
        inputs.set_up(fpga, &config).unwrap();
        let mut counters = MpgCounters::default();
        fpga.wait(CYCLE);
        counters.read(MpgWord(fpga.read(inputs.mpg).unwrap()));
        let mut counts = [0; 4];
        for _ in 0..2 {
            for (a, b) in steps {
                fpga.set_input(2, a);
                fpga.set_input(3, b);
                fpga.wait(5 * CYCLE);
                counts = counters.read(MpgWord(fpga.read(inputs.mpg).unwrap()));
            }
        }
        assert_eq!(counts, [0, expected, 0, 0]);
    }
}

#[test]
fn a_watchdog_that_is_not_petted_takes_the_pins_away() {
    let mut machine = i7i97();
    let fpga = &mut machine.fpga;
    let watchdog = Watchdog::locate(&machine.firmware).unwrap();
    let direction = machine.ports.direction.address(1).unwrap();
    let driven = fpga.read(direction).unwrap();
    assert_ne!(driven, 0);
    watchdog.arm(fpga, Watchdog::DEFAULT_TIMEOUT).unwrap();
    for _ in 0..20 {
        fpga.wait(CYCLE);
        watchdog.pet(fpga).unwrap();
    }
    assert_eq!(watchdog.read_status(fpga).unwrap(), WatchdogStatus::empty());
    fpga.wait(6 * CYCLE);
    assert!(
        watchdog
            .read_status(fpga)
            .unwrap()
            .contains(WatchdogStatus::HAS_BIT)
    );
    assert_eq!(fpga.read(direction).unwrap(), 0);

    watchdog.arm(fpga, Watchdog::DEFAULT_TIMEOUT).unwrap();
    assert_eq!(watchdog.read_status(fpga).unwrap(), WatchdogStatus::empty());
    watchdog.bite_now(fpga).unwrap();
    fpga.wait(Duration::from_micros(1));
    assert!(fpga.watchdog().has_bitten());
}

#[test]
fn the_dpll_takes_its_set_up() {
    let mut machine = i7i97();
    let dpll = Dpll::locate(&machine.firmware).unwrap();
    let bits = machine.fpga.read(dpll.control_1).unwrap() as u8;
    let setup = dpll
        .set_up(&mut machine.fpga, &DpllConfig::default())
        .unwrap();
    assert!((setup.hz(100_000_000, bits) - 1_000.0).abs() < 0.001);
    assert_eq!(machine.fpga.read(dpll.base_rate).unwrap(), setup.base_rate);
}
