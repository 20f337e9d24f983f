//! A board, a module of its gateware and a remote card that this crate does not know, in one driver
//! and without a change to the crate. The module is that of the example `own_module`.

mod axis;
#[path = "../common/mod.rs"]
mod common;
mod drive;
#[path = "../../examples/own_module/gateware.rs"]
#[allow(dead_code, reason = "the example begins with a board of its own")]
mod gateware;
#[path = "../../examples/own_module/pulser.rs"]
mod pulser;
mod services;

use std::time::Duration;

use common::valves::{VALVES, Valves, valve_block};
use gateware::{Gateware, PIN};
use mesa_hal::boards::{AttachError, BoardHandles, BoardTable, Finder, ModuleTerminals, PwmTable};
use mesa_hal::bus::Clock;
use mesa_hal::driver::{Board, BoardState, Driver, GpioConfig, Settings};
use mesa_hal::hal::{Output, Pins, Terminals};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::modules::encoder::TickRate;
use mesa_hal_sim::devices::{SimDevice, find, find_mut};
use mesa_hal_sim::{SimFpga, machines};
use pulser::{GTAG, Pulser, PulserPins};

const PERIOD: Duration = Duration::from_millis(1);
/// The register of the module's output.
const RATE: u16 = 0xA000;
/// The I/O pin of the board's lamp.
const LAMP: u16 = 21;

/// The board.
const BOARD: BoardTable = BoardTable {
    name: "9X99",
    terminals: &[ModuleTerminals {
        modules: &[Gtag::IO_PORT],
        terminals: &[Terminals {
            connector: "X2 pin ",
            first: LAMP,
            signals: &["LAMP"],
            pins: &[7],
        }],
    }],
    ..BoardTable::CONNECTORS
};

#[derive(Clone, Copy)]
struct Lamp {
    on: Output<bool>,
}

impl BoardHandles for Lamp {
    const TABLE: &'static BoardTable = &BOARD;

    fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
        let on = pins.one(&format!("gpio.{LAMP:03}.out"), Pins::output)?;
        Ok(Self { on })
    }
}

fn fpga() -> SimFpga {
    let mut firmware = machines::firmware_7i92_7i77();
    firmware.board = *b"MESA9X99";
    let mut fpga = gateware::with_pulser(firmware);
    fpga.plug(0, 0, Some(valve_block("")));
    fpga
}

fn settings() -> Settings {
    let lamp = GpioConfig {
        output: true,
        ..GpioConfig::default()
    };
    Settings {
        period: PERIOD,
        boards: vec![&BOARD],
        remotes: vec![&VALVES],
        gpio: vec![(LAMP, lamp)],
        ..Settings::default()
    }
}

struct Machine {
    driver: Driver<SimFpga>,
    lamp: Lamp,
    valves: Valves,
    pulses: PulserPins,
}

impl Machine {
    fn new() -> Self {
        Self::on(fpga())
    }

    fn on(fpga: SimFpga) -> Self {
        let mut board = Board::identify(fpga, settings()).expect("a board");
        let pulses = board.add(Pulser::register).expect("the module");
        let pulses = pulses.expect("the firmware has it");
        let board = board.discover().expect("the card");
        let valves = board.attach((0, 0)).expect("the card");
        let lamp = board.attach_board().expect("the board");
        let driver = board.start().expect("the machine is complete");
        Self {
            driver,
            lamp,
            valves,
            pulses,
        }
    }

    fn cycles(&mut self, count: u32) {
        for _ in 0..count {
            // A read of a board that was reset returns no inputs, and reports that.
            let _ = self.driver.read();
            self.driver.write().expect("the bus does not fail");
            self.driver.bus_mut().wait(PERIOD);
        }
    }

    fn set(&mut self, hertz: f64, lamp: bool, valve: bool) {
        let pins = self.driver.pins_mut();
        pins.set(self.pulses.frequency, hertz);
        pins.set(self.lamp.on, lamp);
        self.valves.outputs[2].set(pins, valve);
    }

    fn count(&self) -> Option<i32> {
        let count = self.driver.pins().read(self.pulses.count);
        count.valid.then_some(count.value)
    }

    /// Checks that 5 pulses per millisecond are counted, after a count from the previous cycle.
    fn pulses_for_100_cycles(&mut self, before: i32) {
        let begin = SimFpga::now(self.driver.bus());
        self.cycles(100);
        let expected = (SimFpga::now(self.driver.bus()) - begin) / 200_000;
        let counted = self.count().expect("valid") - before;
        let differs = expected.abs_diff(counted as u64);
        assert!(differs <= 6, "{counted} pulses, expected {expected}");
    }

    fn gateware(&self) -> &Gateware {
        self.driver.bus().module(GTAG.0).expect("it was added")
    }

    fn card(&self) -> &dyn SimDevice {
        find(self.driver.bus().remote(0, 0).expect("plugged in")).expect("a device")
    }

    /// The driven levels of lamp and valve, and true if the pin with the pulses is driven.
    fn driven(&self) -> (Option<bool>, Option<bool>, bool) {
        let fpga = self.driver.bus();
        let pulses = fpga.driven_level(PIN).is_some();
        let lamp = fpga.driven_level(LAMP.into());
        (lamp, self.card().world().output(2), pulses)
    }

    fn terminal(&self, name: &str) -> &str {
        let name = format!("hm2_9x99.0.{name}");
        let infos = self.driver.pins().infos();
        let info = infos.iter().find(|info| info.name == name);
        &info.unwrap_or_else(|| panic!("no {name}")).place.terminal
    }
}

#[test]
fn external_board_module_and_card_work_like_built_in_ones() {
    let mut machine = Machine::new();
    assert_eq!(machine.terminal("gpio.021.out"), "X2 pin 7");
    assert_eq!(machine.terminal("VlV4.0.0.valve-02"), "X2.5");
    machine.set(5_000.0, true, true);
    let supply = find_mut(
        machine
            .driver
            .bus_mut()
            .remote_mut(0, 0)
            .expect("plugged in"),
    );
    let set = supply.expect("a device").set_input_volts(0, 24.0);
    set.expect("it has a supply");
    machine.cycles(5);
    let before = machine.count().expect("valid");
    machine.pulses_for_100_cycles(before);
    assert_eq!(machine.driven(), (Some(true), Some(true), true));
    let supply = machine.valves.supply.read(machine.driver.pins());
    assert!(
        supply.valid && (supply.value - 24.0).abs() < 0.1,
        "{supply:?}"
    );
}

#[test]
fn reset_switches_all_off_and_rearm_restores_settings_only() {
    let mut machine = Machine::new();
    machine.set(5_000.0, true, true);
    let width = machine.pulses.width_us;
    machine
        .driver
        .pins_mut()
        .set_param(width, 20)
        .expect("a setting");
    machine.cycles(50);
    assert_eq!(machine.gateware().width, 20 * 100, "clocks of 10 ns");
    let before = machine.count().expect("valid");

    machine.driver.bus_mut().reload();
    assert_eq!(machine.gateware().width, 0);
    machine.cycles(100);
    assert_eq!(machine.driver.board_state(), BoardState::Reset);
    assert_eq!(machine.count(), None);
    assert_eq!(machine.driven(), (None, Some(false), false));
    assert_eq!((machine.gateware().rate, machine.gateware().width), (0, 0));

    for _ in 0..300 {
        let _ = machine.driver.rearm().expect("the bus does not fail");
        machine.cycles(1);
    }
    assert_eq!(machine.driver.board_state(), BoardState::Running);
    assert_eq!(machine.gateware().width, 20 * 100, "as it was set");
    assert_eq!(
        machine.gateware().rate,
        0,
        "what was commanded is forgotten"
    );
    assert_eq!(machine.driven(), (Some(false), Some(false), true));
    let after = machine.count().expect("valid again");
    assert!((before..before + 10).contains(&after), "{before}, {after}");

    machine.set(5_000.0, true, true);
    machine.pulses_for_100_cycles(after);
    assert_eq!(machine.driven(), (Some(true), Some(true), true));
}

#[test]
fn external_output_is_safe_between_set_up_and_first_write() {
    // Left by an earlier program.
    let mut used = fpga();
    used.write_register(RATE, 0x0100_0000);
    let mut machine = Machine::on(used);
    assert_eq!(machine.gateware().rate, 0, "it was set up");
    machine.set(5_000.0, false, false);
    machine.cycles(5);
    assert_ne!(machine.gateware().rate, 0);

    machine.driver.bus_mut().reload();
    machine.cycles(3);
    assert_eq!(machine.driver.board_state(), BoardState::Reset);
    // A write that the network held back.
    machine.driver.bus_mut().write_register(RATE, 0x0100_0000);
    let _ = machine.driver.rearm().expect("the bus does not fail");
    assert_eq!(machine.driver.board_state(), BoardState::Running);
    assert_eq!(machine.gateware().rate, 0, "it was set up again");
    assert_eq!(machine.gateware().width, 10 * 100, "with its settings");
}

#[test]
fn end_leaves_nothing_of_it_on() {
    let mut machine = Machine::new();
    machine.set(5_000.0, true, true);
    machine.cycles(10);
    assert_eq!(machine.driven(), (Some(true), Some(true), true));
    let (mut fpga, stopped) = machine.driver.shutdown();
    stopped.expect("the bus does not fail");
    fpga.wait(Duration::from_millis(60));
    assert_eq!(fpga.driven_level(PIN), None);
    assert_eq!(fpga.driven_level(LAMP.into()), None);
    let card = find(fpga.remote(0, 0).expect("plugged in")).expect("a device");
    assert_eq!(card.world().output(2), Some(false));
}

#[test]
fn absent_and_duplicate_parts_are_reported() {
    let mut board = Board::identify(fpga(), settings()).expect("a board");
    board.add(Pulser::register).expect("the module");
    let twice = board
        .add(Pulser::register)
        .expect_err("its I/O pin is taken");
    println!("{twice}");
    let board = board.discover().expect("the card");
    let absent = board
        .attach::<Valves>((0, 1))
        .expect_err("nothing is there");
    assert!(absent.to_string().contains("valve block"), "{absent}");

    let mut other = Board::identify(machines::i7i92_7i77(), Settings::default()).expect("a 7I92");
    let pulses = other.add(Pulser::register);
    assert!(pulses.expect("there is none, which is fine").is_none());
    let other = other.discover().expect("no remotes");
    let error = other.attach_board::<Lamp>().err().expect("another board");
    assert!(error.to_string().contains("9X99"), "{error}");
    let driver = other.start().expect("a 7I92");
    assert!(driver.modules::<Pulser>().next().is_none());
}

#[test]
fn module_handles_are_valid_from_registration_to_the_driver() {
    let mut board = Board::identify(fpga(), settings()).expect("a board");
    let pulses = board.add(Pulser::register).expect("the module");
    let pulses = pulses.expect("the firmware has it");
    let name = |pins: &Pins| pins.info(pulses.frequency).map(|info| info.name.clone());
    let expected = Some("hm2_9x99.0.pulser.frequency".to_owned());
    assert_eq!(name(board.pins()), expected);
    let board = board.discover().expect("the card");
    assert_eq!(name(board.pins()), expected);
    let driver = board.start().expect("the machine is complete");
    assert_eq!(name(driver.pins()), expected);
    let (_, stopped) = driver.shutdown();
    stopped.expect("the bus does not fail");
}

#[test]
fn module_with_a_failed_registration_is_not_in_the_cycle() {
    let mut board = Board::identify(fpga(), settings()).expect("a board");
    let failed = board.add(|r| {
        Pulser::register(r)?;
        r.use_io(GTAG, 0)
    });
    println!("{}", failed.expect_err("its I/O pin is taken"));
    let driver = board.start().expect("the board and the card");
    assert!(driver.modules::<Pulser>().next().is_none());
}

#[test]
fn module_takes_less_than_100_lines() {
    let module = include_str!("../../examples/own_module/pulser.rs");
    assert!(module.lines().count() < 100);
}

/// A hypothetical 7I97 with other rates, terminals and full scales.
const OTHER: BoardTable = BoardTable {
    name: "9I99",
    encoder_rate: Some(TickRate(30)),
    pwm: PwmTable {
        hz: 24_000,
        hz_dither: &[24_000],
        generators: 6,
        full_scale: 5.0,
        unit: "V",
        is_offset: true,
        ..PwmTable::PLAIN
    },
    terminals: &[ModuleTerminals {
        modules: &[Gtag::MUXED_ENCODER],
        terminals: &[Terminals::encoders("X1 pin ", 0)],
    }],
    ..BoardTable::CONNECTORS
};

#[test]
fn external_board_table_sets_rates_terminals_and_full_scales() {
    let mut firmware = machines::firmware_7i97(1);
    firmware.board = *b"MESA9I99";
    let settings = Settings {
        boards: vec![&OTHER],
        ..Settings::default()
    };
    let driver = Driver::start(SimFpga::new(firmware), settings).expect("a 9I99");
    let pins = driver.pins();
    let hz = pins.parameter::<u32>("hm2_9i99.0.pwmgen.pwm_frequency");
    assert_eq!(pins.param(hz.expect("PWM")), 24_000);
    let value = pins.output::<f64>("hm2_9i99.0.pwmgen.00.value");
    let info = pins.info(value.expect("PWM")).expect("a pin");
    assert_eq!((info.limits, &*info.unit), (Some((-5.0, 5.0)), "V"));
    let count = pins.input::<i32>("hm2_9i99.0.encoder.01.count");
    let info = pins.info(count.expect("encoders")).expect("a pin");
    assert!(
        info.place.terminal.starts_with("X1 pin 9, X1 pin 10"),
        "{info:?}"
    );
    let (mut fpga, stopped) = driver.shutdown();
    stopped.expect("the bus does not fail");
    // ClockLow/32, each encoder in every other tick.
    let rate = fpga.encoders().expect("encoders").sample_rate();
    assert!((rate - 100e6 / 32.0 / 2.0).abs() < 1.0, "{rate}");
}
