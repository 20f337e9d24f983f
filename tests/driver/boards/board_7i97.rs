//! All functions of a 7I97 in the cycle, on the simulated board and on virtual time.

mod analog;
mod digital;
mod dither;
mod long_watchdog;
mod other_firmware;

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use crate::common::ethernet::{self, SimLink, WIRE, connect, is_request};
use crate::common::machine::{self, World};
use mesa_hal::Settings;
use mesa_hal::boards::{AttachError, BoardHandles, BoardTable, Finder, I7i97, i7i97};
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{BoardState, Driver, GpioConfig};
use mesa_hal::hal::{DigitalIn, Input, Output, Param, Pins};
use mesa_hal_sim::{Motor, SimFpga, machines};

/// All pins of the module at the isolated inputs, InMux or InM.
#[derive(Clone, Copy)]
struct Inputs {
    raw: [DigitalIn; 16],
    filtered: [DigitalIn; 16],
    slow: [Output<bool>; 16],
    mpg_4x: [Param<bool>; 4],
    mpg_counts: [Input<i32>; 4],
    mpg_resets: [Output<bool>; 4],
}

impl BoardHandles for Inputs {
    const TABLE: &'static BoardTable = &i7i97::BOARD;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        let module = if pins.has("inmux.00.scan_rate") {
            "inmux.00"
        } else {
            "inm.00"
        };
        let slow = |n| pins.one(&format!("{module}.input-{n:02}-slow"), Pins::output);
        let mode = |n| pins.one(&format!("{module}.enc{n}_4xmode"), Pins::parameter);
        let count = |n| pins.one(&format!("{module}.enc{n}-count"), Pins::input);
        let reset = |n| pins.one(&format!("{module}.enc{n}-reset"), Pins::output);
        Ok(Self {
            raw: pins.numbered(&format!("{module}.raw-input-"), DigitalIn::find)?,
            filtered: pins.numbered(&format!("{module}.input-"), DigitalIn::find)?,
            slow: pins.each(slow)?,
            mpg_4x: pins.each(mode)?,
            mpg_counts: pins.each(count)?,
            mpg_resets: pins.each(reset)?,
        })
    }
}

pub type Machine<B> = machine::Machine<B, I7i97>;

fn inputs<B: World>(machine: &Machine<B>) -> Inputs {
    machine.driver.attach_board().expect("InMux or InM")
}

fn started<B: World>(bus: B) -> Machine<B> {
    build(bus, |_| {})
}

fn build<B: World>(bus: B, change: impl FnOnce(&mut Settings)) -> Machine<B> {
    let mut machine = Machine::on(bus, change);
    // The first cycle has a whole period, however long the set-up took.
    machine.rest();
    machine
}

pub fn board() -> Machine<SimFpga> {
    started(machines::six_axes_7i97(Motor::default()))
}

/// The usual firmware, with InMux and SSR, and a newer one with InM and OutM; motors on both.
fn both_firmwares() -> [SimFpga; 2] {
    let mut newer = machines::i7i97_inm_outm(1);
    machines::wire_7i97(&mut newer, |_| Motor::default());
    [machines::six_axes_7i97(Motor::default()), newer]
}

/// Follows a sine on each axis, 0.3 s of it; returns the largest error after the start.
pub fn follow<B: World>(machine: &mut Machine<B>) -> f64 {
    let card = machine.cards;
    for encoder in card.encoders {
        machine.set_param(encoder.scale, 1000.0);
    }
    for output in card.analog_out {
        machine.driver.pins_mut().set(output.enable, true);
    }
    let mut worst: f64 = 0.0;
    for n in 0..300u32 {
        let report = machine.driver.read().expect("the bus does not fail");
        assert!(report.is_good(), "cycle {n}: {report:?}");
        let pins = machine.driver.pins_mut();
        for (axis, (output, encoder)) in (0u32..).zip(card.analog_out.iter().zip(card.encoders)) {
            let phase = f64::from(n) * 0.01 + f64::from(axis);
            // A speed of 10 units/s at 1 V; the target begins at the position of the axis.
            let target = phase.sin() - f64::from(axis).sin();
            let position = pins.read(encoder.position);
            assert!(position.valid, "axis {axis}");
            let error = target - position.value;
            if n > 100 {
                worst = worst.max(error.abs());
            }
            pins.set(output.volts, phase.cos() + error * 5.0);
        }
        machine.finish();
    }
    worst
}

#[test]
fn six_position_loops_close_on_the_boards_outputs_and_encoders() {
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
    let mut machine = started(ethernet::bus(machines::six_axes_7i97(Motor::default())));
    let worst = follow(&mut machine);
    assert!(worst < 0.1, "{worst}");
}

#[test]
fn cycle_with_three_remotes_is_smaller_than_that_of_linuxcnc() {
    let mut machine = started(ethernet::bus(machines::six_axes_7i97(Motor::default())));
    assert!(machine.driver.missing().is_empty());
    // In its first 100 periods the phase of the DPLL is written, as by LinuxCNC.
    machine.cycles(110);
    let bytes = |machine: &mut Machine<_>| {
        let statistics = machine.driver.bus_statistics();
        (statistics.bytes_sent, statistics.bytes_received)
    };
    let before = bytes(&mut machine);
    let _ = machine.driver.read();
    let between = bytes(&mut machine);
    let _ = machine.driver.write();
    let (request, reply) = (between.0 - before.0, between.1 - before.1);
    let write = bytes(&mut machine).0 - between.0;
    println!("request {request}, reply {reply}, write {write} bytes");
    // Of request and reply, four bytes each are the evidence that the board was not reset, which
    // LinuxCNC does not read.
    assert!(request - 4 < 80 && reply - 4 < 122 && write < 156);
    assert!(request + reply + write < 80 + 122 + 156);
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
    assert_eq!(sent, 100 * (request + write));
    assert_eq!(received, 100 * reply);
}

#[test]
fn outputs_are_safe_after_a_bite_and_rearm_restores_settings() {
    for fpga in both_firmwares() {
        let output = GpioConfig {
            output: true,
            ..GpioConfig::default()
        };
        let mut machine = build(fpga, |s| s.gpio = vec![(40, output)]);
        let card = machine.cards;
        let (out, [analog, ..]) = (machine.output("gpio.040.out"), card.analog_out);
        // A setting that differs from the set-up.
        let is_output = machine.param("gpio.041.is_output");
        let later_out = machine.output("gpio.041.out");
        let inputs = inputs(&machine);
        machine.set_param(is_output, true);
        let command = |machine: &mut Machine<SimFpga>| {
            let pins = machine.driver.pins_mut();
            pins.set(analog.volts, 3.0);
            pins.set(analog.enable, true);
            card.outputs[1].set(pins, true);
            card.outputs[4].set_inverted(pins, true).expect("a pin");
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
        machine.driver.pins_mut().set(inputs.slow[2], true);
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
        assert!(!pins.commanded(card.outputs[1].pin));
        assert!(!pins.read(card.encoders[0].count).valid);
        assert!(!pins.read(card.inputs[0].pin).valid);
        assert!(!pins.read(card.mpg_counts[0]).valid);
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
        // The long filter takes 25 ms until its output is known.
        machine.cycles(30);
        machine.fpga().set_input(2, true);
        machine.cycles(10);
        let read = |pin| machine.driver.pins().read(pin);
        let (raw, filtered) = (read(inputs.raw[2].pin), read(inputs.filtered[2].pin));
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
fn setting_whose_write_was_lost_is_written_again() {
    let lose = Rc::new(Cell::new(false));
    let bus = {
        let fpga = machines::six_axes_7i97(Motor::default());
        let mut link = SimLink::new(fpga);
        let lose = Rc::clone(&lose);
        link.to_board = Box::new(move |_, packet| {
            if lose.get() && !is_request(packet) {
                vec![]
            } else {
                vec![WIRE]
            }
        });
        connect(link)
    };
    let mut machine = started(bus);
    let led = machine.cards.leds[0];
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
fn another_board_or_a_lacking_module_is_named() {
    let other = Driver::start(machines::i7i92_7i77(), Settings::default()).expect("a 7I92");
    let error = other.attach_board::<I7i97>().expect_err("not a 7I97");
    assert!(error.to_string().contains("7I92"), "{error}");
    let mut firmware = machines::firmware_7i97(1);
    firmware.modules.retain(|module| module.gtag != 0xC3);
    let lacking = Driver::start(SimFpga::new(firmware), Settings::default()).expect("a board");
    let error = lacking.attach_board::<I7i97>().expect_err("no outputs");
    let text = error.to_string();
    assert!(
        text.contains("SSR") && text.contains("PWM"),
        "what is missing, and there: {text}"
    );
}
