//! Everything of a 7I97 in the cycle, on the simulated board and on virtual time.

mod ethernet_support;
#[path = "cyclic_7i97/other_firmware.rs"]
mod other_firmware;

use std::cell::Cell;
use std::collections::BTreeSet;
use std::rc::Rc;
use std::time::Duration;

use ethernet_support::{SimLink, WIRE, is_request};
use mesa_hal::boards::I7i97;
use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{BoardState, Builder, CycleReport, Driver, GpioConfig};
use mesa_hal::sim::{BoardConfig, MotorConfig, SimFpga, machines};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};

const PERIOD: Duration = Duration::from_millis(1);

/// A bus with a simulated FPGA at its end.
trait World: RegisterBus {
    fn fpga(&mut self) -> &mut SimFpga;
}

impl World for SimFpga {
    fn fpga(&mut self) -> &mut SimFpga {
        self
    }
}

impl World for UdpBus<SimLink> {
    fn fpga(&mut self) -> &mut SimFpga {
        self.link().board.gateware_mut()
    }
}

struct Machine<B: World> {
    driver: Driver<B>,
    card: I7i97,
}

fn ethernet(fpga: SimFpga) -> UdpBus<SimLink> {
    let link = SimLink::new(BoardConfig::new("7I97"), fpga);
    UdpBus::new(link, UdpConfig::default()).expect("the board answers")
}

impl<B: World> Machine<B> {
    fn new(bus: B) -> Self {
        Self::build(bus, |builder| builder)
    }

    fn build(bus: B, configure: impl FnOnce(Builder<B>) -> Builder<B>) -> Self {
        let builder = configure(Driver::builder(bus).period(PERIOD));
        let driver = builder.build().expect("the board is complete");
        let card = I7i97::of(driver.fpga_pins(), driver.firmware()).expect("a 7I97");
        Self { driver, card }
    }

    fn cycle(&mut self) -> CycleReport {
        let report = self.driver.read().expect("the bus does not fail");
        self.finish();
        report
    }

    /// The write, and the rest of the period.
    fn finish(&mut self) {
        self.driver.write().expect("the bus does not fail");
        let bus = self.driver.bus_mut();
        let period = PERIOD.as_nanos() as u64;
        let rest = period - bus.now().as_nanos() % period;
        bus.wait(Duration::from_nanos(rest));
    }

    fn cycles(&mut self, count: usize) {
        for _ in 0..count {
            let _ = self.cycle();
        }
    }

    fn fpga(&mut self) -> &mut SimFpga {
        self.driver.bus_mut().fpga()
    }
}

fn board() -> Machine<SimFpga> {
    Machine::new(machines::six_axes_7i97(MotorConfig::default()))
}

/// The usual firmware, with InMux and SSR, and a newer one with InM and OutM; motors on both.
fn both_firmwares() -> [SimFpga; 2] {
    let mut newer = machines::i7i97_inm_outm(1);
    machines::wire_7i97(&mut newer, MotorConfig::default());
    [machines::six_axes_7i97(MotorConfig::default()), newer]
}

/// Follows a sine on each axis, 0.3 s of it; gives the largest error after the start.
fn follow<B: World>(machine: &mut Machine<B>) -> f64 {
    let card = machine.card.clone();
    for encoder in card.encoders {
        machine
            .driver
            .pins_mut()
            .set_param(encoder.scale, 1000.0)
            .expect("a scale");
    }
    for enable in card.enables {
        machine.driver.pins_mut().set(enable, true);
    }
    let mut worst: f64 = 0.0;
    for n in 0..300u32 {
        let report = machine.driver.read().expect("the bus does not fail");
        assert!(report.is_good(), "cycle {n}: {report:?}");
        let pins = machine.driver.pins_mut();
        for (axis, (output, encoder)) in (0u32..).zip(card.analog_out.iter().zip(card.encoders)) {
            let phase = f64::from(n) * 0.01 + f64::from(axis);
            // A speed of 10 units/s at 1 V; the target begins where the axis stands.
            let target = phase.sin() - f64::from(axis).sin();
            let position = pins.read(encoder.position);
            assert!(position.valid, "axis {axis}");
            let error = target - position.value;
            if n > 100 {
                worst = worst.max(error.abs());
            }
            pins.set(output.value, phase.cos() + error * 5.0);
        }
        machine.finish();
    }
    worst
}

#[test]
fn six_position_loops_are_closed_on_the_boards_own_outputs_and_encoders() {
    let mut machine = board();
    let worst = follow(&mut machine);
    assert!(worst < 0.1, "{worst}");
    for axis in 0..6 {
        let position = machine.fpga().motor(axis).expect("an axis").position();
        assert!(position.abs() > 0.05, "axis {axis} has moved: {position}");
    }
}

#[test]
fn six_position_loops_are_closed_over_ethernet() {
    let mut machine = Machine::new(ethernet(machines::six_axes_7i97(MotorConfig::default())));
    let worst = follow(&mut machine);
    assert!(worst < 0.1, "{worst}");
}

#[test]
fn a_cycle_with_three_remotes_is_smaller_than_that_of_linuxcnc() {
    let mut machine = Machine::new(ethernet(machines::six_axes_7i97(MotorConfig::default())));
    assert!(machine.driver.missing().is_empty());
    let size = machine.driver.image_size();
    let (request, reply, write) = (size.request_bytes(), size.reply_bytes(), size.write_bytes());
    println!("planned: request {request}, reply {reply}, write {write} bytes ({size:?})");
    assert!(request < 80 && reply < 122 && write < 156);
    machine.cycles(10);
    let before = machine.driver.bus_mut().statistics();
    machine.cycles(100);
    let after = machine.driver.bus_mut().statistics();
    let sent = after.bytes_sent - before.bytes_sent;
    let received = after.bytes_received - before.bytes_received;
    println!(
        "sent {} and received {} bytes a cycle",
        sent / 100,
        received / 100
    );
    assert_eq!(
        after.exchanges - before.exchanges,
        200,
        "one read and one write"
    );
    assert_eq!(sent, 100 * u64::from(request + write));
    assert_eq!(received, 100 * u64::from(reply));
}

#[test]
fn analog_outputs_have_12_bits_of_volts_and_no_value_turns_round() {
    let mut machine = board();
    let card = machine.card.clone();
    machine.driver.pins_mut().set(card.enables[0], true);
    for (n, enable) in card.enables.into_iter().enumerate() {
        machine.driver.pins_mut().set(enable, true);
        machine.cycles(2);
        let on = machine.fpga().analog_output(n).enabled;
        assert!(on, "enable {n}");
    }
    let largest = 10.0 - 20.0 / 4096.0;
    for (set, expected) in [
        (2.5, 2.5),
        (-10.0, -10.0),
        (10.0, largest),
        (1e9, largest),
        (f64::NAN, 0.0),
        (-1e300, -10.0),
        (f64::NEG_INFINITY, 0.0),
        (7.0, 7.0),
    ] {
        for output in card.analog_out {
            machine.driver.pins_mut().set(output.value, set);
        }
        machine.cycles(1);
        for n in 0..6 {
            let volts = machine.fpga().analog_output(n).volts;
            assert!(
                (volts - expected).abs() <= 10.0 / 4096.0,
                "{set}: output {n} has {volts}"
            );
        }
    }
    for output in card.analog_out {
        let refused = machine.driver.pins().rejections(output.value);
        assert_eq!((refused.not_finite, refused.out_of_range), (2, 2));
    }
}

#[test]
fn enables_0_to_3_switch_together_and_4_and_5_alone() {
    let mut machine = board();
    let card = machine.card.clone();
    let enabled = |machine: &mut Machine<SimFpga>| {
        [0, 1, 2, 3, 4, 5].map(|n| machine.fpga().analog_output(n).enabled)
    };
    machine.cycles(2);
    assert_eq!(enabled(&mut machine), [false; 6]);
    for (enable, expected) in [
        (0, [true, true, true, true, false, false]),
        (4, [false, false, false, false, true, false]),
        (5, [false, false, false, false, false, true]),
    ] {
        for (n, pin) in card.enables.into_iter().enumerate() {
            machine.driver.pins_mut().set(pin, n == enable);
        }
        machine.cycles(1);
        assert_eq!(enabled(&mut machine), expected, "enable {enable}");
    }
}

#[test]
fn the_pwm_frequency_is_what_the_manual_says_and_can_be_changed() {
    let mut machine = board();
    let hz = |machine: &mut Machine<SimFpga>| machine.fpga().pwm().expect("PWM").frequency(3);
    assert!((hz(&mut machine) - 48_000.0).abs() < 1.0);
    let bank = machine.card.pwm_bank;
    let [output, ..] = machine.card.analog_out;
    let pins = machine.driver.pins_mut();
    pins.set_param(bank.pwm_frequency, 96_000)
        .expect("a frequency");
    pins.set(output.value, 5.0);
    pins.set(output.enable, true);
    machine.cycles(2);
    assert!((hz(&mut machine) - 96_000.0).abs() < 1.0);
    assert!((machine.fpga().analog_output(0).volts - 5.0).abs() < 0.01);
    let mut firmware = machines::firmware_7i97(1);
    firmware.module_mut(6).expect("PWM").version = 1;
    let mut dithers = Machine::new(SimFpga::new(firmware));
    assert!((hz(&mut dithers) - 96_000.0).abs() < 1.0);
    let [output, ..] = dithers.card.analog_out;
    let pins = dithers.driver.pins_mut();
    pins.set(output.value, 1.234_567);
    pins.set(output.enable, true);
    dithers.cycles(1);
    let volts = dithers.fpga().analog_output(0).volts;
    assert!((volts - 1.234_567).abs() < 1e-6, "{volts}");
}

#[test]
fn inputs_arrive_filtered_and_raw() {
    for mut machine in both_firmwares().map(Machine::new) {
        let inputs = machine.card.inputs.clone();
        assert_eq!(inputs.inputs.len(), 16);
        machine.driver.pins_mut().set(inputs.inputs[3].slow, true);
        machine.cycles(3);
        for n in 0..16 {
            machine.fpga().set_input(n, n % 3 == 0);
        }
        machine.cycles(4);
        for (n, input) in inputs.inputs.iter().enumerate() {
            let (level, pins) = (n % 3 == 0, machine.driver.pins());
            let filtered = level && n != 3;
            assert_eq!(pins.read(input.raw.pin).value, level, "input {n}");
            assert_eq!(pins.read(input.raw.not).value, !level, "input {n}");
            assert_eq!(pins.read(input.filtered.pin).value, filtered, "input {n}");
            assert_eq!(pins.read(input.filtered.not).value, !filtered, "input {n}");
            let terminal = &pins.info(input.filtered.pin).expect("a pin").signal;
            assert_eq!(*terminal, format!("IN{n}"));
        }
        // 500 scans at 20 kHz: 25 ms.
        machine.cycles(30);
        assert!(
            machine
                .driver
                .pins()
                .read(inputs.inputs[3].filtered.pin)
                .value
        );
    }
}

/// Turns the MPG on inputs 2k and 2k+1 by whole cycles.
fn turn_mpg(machine: &mut Machine<SimFpga>, k: usize, steps: usize) {
    for _ in 0..steps {
        for (a, b) in [(true, false), (true, true), (false, true), (false, false)] {
            machine.fpga().set_input(2 * k, a);
            machine.fpga().set_input(2 * k + 1, b);
            machine.cycles(1);
        }
    }
}

#[test]
fn mpgs_count_beyond_their_8_bits_at_1x_and_4x_and_can_be_reset() {
    for mut machine in both_firmwares().map(Machine::new) {
        let inputs = machine.card.inputs.clone();
        let count = |machine: &Machine<SimFpga>, k: usize| {
            machine.driver.pins().read(inputs.mpg_counts[k]).value.abs()
        };
        machine.cycles(3);
        turn_mpg(&mut machine, 1, 300);
        machine.cycles(2);
        assert_eq!(count(&machine, 1), 300);
        assert_eq!(count(&machine, 0), 0);
        machine
            .driver
            .pins_mut()
            .set_param(inputs.mpg_4x[3], true)
            .expect("a switch");
        machine.cycles(1);
        turn_mpg(&mut machine, 3, 100);
        machine.cycles(2);
        assert_eq!(count(&machine, 3), 400);
        machine.driver.pins_mut().set(inputs.mpg_resets[1], true);
        machine.cycles(1);
        assert_eq!(count(&machine, 1), 0);
        machine.driver.pins_mut().set(inputs.mpg_resets[1], false);
        turn_mpg(&mut machine, 1, 2);
        machine.cycles(2);
        assert_eq!((count(&machine, 1), count(&machine, 3)), (2, 400));
    }
}

#[test]
fn isolated_outputs_and_leds_follow_and_can_be_turned_round() {
    for mut machine in both_firmwares().map(Machine::new) {
        let card = machine.card.clone();
        let on = |machine: &mut Machine<SimFpga>| {
            let fpga = machine.fpga();
            [0, 1, 2, 3, 4, 5].map(|n| fpga.isolated_output(n))
        };
        let lit = |machine: &mut Machine<SimFpga>| {
            let leds = machine.fpga().leds();
            [0, 1, 2, 3].map(|n| leds.is_lit(n))
        };
        machine.cycles(2);
        assert_eq!(
            (on(&mut machine), lit(&mut machine)),
            ([false; 6], [false; 4])
        );
        for n in 0..6 {
            for (k, output) in card.outputs.outputs.iter().enumerate() {
                machine.driver.pins_mut().set(output.out, k == n);
            }
            for (k, led) in card.leds.leds.iter().enumerate() {
                machine.driver.pins_mut().set(*led, k == n);
            }
            machine.cycles(1);
            assert_eq!(on(&mut machine), [0, 1, 2, 3, 4, 5].map(|k| k == n));
            assert_eq!(lit(&mut machine), [0, 1, 2, 3].map(|k| k == n));
        }
        machine
            .driver
            .pins_mut()
            .set(card.outputs.outputs[2].invert, true);
        machine.cycles(1);
        assert_eq!(on(&mut machine), [false, false, true, false, false, true]);
        let Some(rate) = card.outputs.rate else {
            assert!(machine.fpga().ssr().is_none(), "only SSR has a drive");
            continue;
        };
        machine.driver.pins_mut().set(rate, 0);
        machine.cycles(1);
        assert_eq!(on(&mut machine), [false; 6], "without drive");
    }
}

#[test]
fn expansion_pins_are_inputs_or_outputs_as_configured() {
    let config = GpioConfig {
        output: true,
        ..GpioConfig::default()
    };
    let inverted = GpioConfig {
        invert: true,
        ..config
    };
    let fpga = machines::i7i97(1);
    let mut machine = Machine::build(fpga, |builder| builder.gpio(34, config).gpio(50, inverted));
    let io = machine.card.expansion().to_vec();
    assert_eq!(io.len(), 17);
    let out = |n: usize| io[n].out.expect("a plain output");
    machine.cycles(2);
    assert!(!machine.fpga().pin_level(34) && machine.fpga().pin_level(50));
    machine.driver.pins_mut().set(out(0), true);
    machine.driver.pins_mut().set(out(16), true);
    machine.driver.pins_mut().set(out(5), true);
    machine.fpga().drive_pin(39, Some(false));
    machine.cycles(2);
    assert!(machine.fpga().pin_level(34) && !machine.fpga().pin_level(50));
    let (level, not) = io[5].input.expect("an input");
    assert!(
        !machine.driver.pins().read(level).value,
        "driven from outside"
    );
    assert!(machine.driver.pins().read(not).value);
    machine.fpga().drive_pin(39, None);
    let output = io[5].is_output.expect("a parameter");
    machine
        .driver
        .pins_mut()
        .set_param(output, true)
        .expect("a switch");
    machine.driver.pins_mut().set(out(5), false);
    machine.cycles(2);
    assert!(!machine.fpga().pin_level(39));
    let drain = io[5].is_opendrain.expect("a parameter");
    machine
        .driver
        .pins_mut()
        .set_param(drain, true)
        .expect("a switch");
    machine.driver.pins_mut().set(out(5), true);
    machine.fpga().drive_pin(39, Some(false));
    machine.cycles(2);
    assert!(
        !machine.driver.pins().read(level).value,
        "it does not drive high"
    );
}

#[test]
fn a_pin_that_a_module_uses_is_no_plain_io() {
    let error = Driver::builder(machines::i7i97(1))
        .gpio(19, GpioConfig::default())
        .build()
        .expect_err("an isolated output");
    assert!(error.to_string().contains("I/O pin 19"), "{error}");
}

#[test]
fn after_a_bite_everything_is_safe_and_rearming_restores_all_settings() {
    for fpga in both_firmwares() {
        let mut machine = Machine::build(fpga, |builder| {
            builder.gpio(
                40,
                GpioConfig {
                    output: true,
                    ..GpioConfig::default()
                },
            )
        });
        let card = machine.card.clone();
        let (out, [analog, ..]) = (card.io[40].out.expect("an output"), card.analog_out);
        // A setting that is not the one of the set-up.
        let later = card.io[41];
        let (is_output, later_out) = (later.is_output.expect("one"), later.out.expect("one"));
        machine
            .driver
            .pins_mut()
            .set_param(is_output, true)
            .expect("a switch");
        let command = |machine: &mut Machine<SimFpga>| {
            let pins = machine.driver.pins_mut();
            pins.set(analog.value, 3.0);
            pins.set(analog.enable, true);
            pins.set(card.outputs.outputs[1].out, true);
            pins.set(card.outputs.outputs[4].invert, true);
            pins.set(out, true);
            pins.set(later_out, true);
        };
        let state = |machine: &mut Machine<SimFpga>| {
            let fpga = machine.fpga();
            let drive = fpga.analog_output(0);
            (
                (drive.volts * 10.0).round() as i32,
                drive.enabled,
                [1, 4].map(|n| fpga.isolated_output(n)),
            )
        };
        command(&mut machine);
        let slow = card.inputs.inputs[2];
        machine.driver.pins_mut().set(slow.slow, true);
        machine.cycles(3);
        assert_eq!(state(&mut machine), (30, true, [true; 2]));
        machine.driver.bus_mut().wait(Duration::from_millis(20));
        assert!(machine.fpga().watchdog().has_bitten());
        assert_eq!(
            state(&mut machine),
            (0, false, [false; 2]),
            "the board itself"
        );
        assert_eq!(machine.cycle().board, BoardState::WatchdogBitten);
        let pins = machine.driver.pins();
        assert!(!pins.commanded(out), "what was set before is forgotten");
        assert!(!pins.commanded(card.outputs.outputs[1].out));
        assert!(!pins.read(card.encoders[0].count).valid);
        assert!(!pins.read(card.inputs.inputs[0].filtered.pin).valid);
        assert!(!pins.read(card.inputs.mpg_counts[0]).valid);
        command(&mut machine);
        machine.cycles(3);
        assert_eq!(state(&mut machine), (0, false, [false; 2]), "not rearmed");
        // Once for the set-up, and again when the board has been seen to run.
        for _ in 0..2 {
            let _ = machine.driver.rearm().expect("the bus does not fail");
            let _ = machine.cycle();
        }
        let unset = (0, false, [false, true]);
        assert_eq!(state(&mut machine), unset, "nothing set since, and invert");
        command(&mut machine);
        machine.cycles(2);
        assert_eq!(state(&mut machine), (30, true, [true; 2]));
        assert!(machine.fpga().pin_level(40) && machine.fpga().pin_level(41));
        machine.driver.pins_mut().set(later_out, false);
        machine.cycles(1);
        assert!(
            !machine.fpga().pin_level(41),
            "a setting made later is restored too"
        );
        machine.fpga().set_input(2, true);
        machine.cycles(10);
        let read = |pin| machine.driver.pins().read(pin);
        let (raw, filtered) = (read(slow.raw.pin), read(slow.filtered.pin));
        assert!(raw.valid && raw.value, "inverted again");
        assert!(filtered.valid && !filtered.value, "slow again");
        let rate = machine.fpga().encoders().expect("encoders").sample_rate();
        assert!(
            (rate - 100e6 / 32.0).abs() < 1.0,
            "half of ClockLow/16: {rate}"
        );
    }
}

#[test]
fn a_setting_whose_write_was_lost_is_written_again() {
    let lose = Rc::new(Cell::new(false));
    let bus = {
        let fpga = machines::six_axes_7i97(MotorConfig::default());
        let mut link = SimLink::new(BoardConfig::new("7I97"), fpga);
        let lose = Rc::clone(&lose);
        link.to_board = Box::new(move |packet| {
            if lose.get() && !is_request(packet) {
                vec![]
            } else {
                vec![WIRE]
            }
        });
        UdpBus::new(link, UdpConfig::default()).expect("the board answers")
    };
    let mut machine = Machine::new(bus);
    let led = machine.card.leds.leds[0];
    machine.cycles(5);
    machine.driver.pins_mut().set(led, true);
    lose.set(true);
    machine.cycles(1);
    lose.set(false);
    assert!(!machine.fpga().leds().is_lit(0));
    machine.cycles(2);
    assert!(machine.fpga().leds().is_lit(0));
}

#[test]
fn the_dpll_locks_to_the_cycle() {
    let mut machine = board();
    let dpll = machine.card.dpll.expect("a DPLL");
    machine.cycles(500);
    let error = machine.driver.pins().read(dpll.phase_error_us);
    assert!(error.valid && error.value.abs() < 20.0, "{error:?}");
    let period = machine
        .fpga()
        .dpll()
        .expect("a DPLL")
        .period()
        .expect("it runs");
    assert!((period - 1e6).abs() < 100.0, "{period} ns");
}

#[test]
fn another_board_or_a_lacking_module_is_named() {
    let other = Driver::builder(machines::i7i92_7i77())
        .build()
        .expect("a 7I92");
    let error = I7i97::of(other.fpga_pins(), other.firmware()).expect_err("not a 7I97");
    assert!(error.to_string().contains("7I92"), "{error}");
    let mut firmware = machines::firmware_7i97(1);
    firmware.modules.retain(|module| module.gtag != 0xC3);
    let lacking = Driver::builder(SimFpga::new(firmware))
        .build()
        .expect("a board");
    let error = I7i97::of(lacking.fpga_pins(), lacking.firmware()).expect_err("no outputs");
    let text = error.to_string();
    assert!(
        text.contains("SSR") && text.contains("PWM"),
        "what is missing, and there: {text}"
    );
}

#[test]
fn the_driver_makes_exactly_the_pins_of_the_manifest() {
    let driver = Driver::builder(machines::i7i97(1)).build().expect("a 7I97");
    let manifest = include_str!("manifests/7i97.txt");
    let mut written: BTreeSet<(String, String, String)> = BTreeSet::new();
    for line in manifest.lines().filter(|line| !line.starts_with('#')) {
        let words: Vec<&str> = line.split_whitespace().collect();
        written.insert((words[3].into(), words[1].into(), words[2].into()));
    }
    // What the manifest does not tell of: the serial port's pins, and the driver's diagnostics.
    let own = |name: &str| name.contains(".sserial.") || name.ends_with(".lost-writes");
    let made: BTreeSet<_> = driver
        .pins()
        .infos()
        .iter()
        .filter(|info| !own(&info.name))
        .map(|info| {
            let direction = info.role.hal_direction().to_owned();
            (info.name.clone(), info.hal_type.to_string(), direction)
        })
        .collect();
    assert_eq!(
        made.symmetric_difference(&written).collect::<Vec<_>>(),
        Vec::<&_>::new()
    );
}
