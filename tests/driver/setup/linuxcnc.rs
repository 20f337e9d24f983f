//! Settings of LinuxCNC: its initial values, and the words of its `config=`.

use mesa_eth::Config;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{Defaults, Driver, DriverError, PwmConfig};
use mesa_hal::hal::AnyValue;
use mesa_hal::hostmot2::Gtag;
use mesa_hal::modules::RegisterError;
use mesa_hal::{Advice, MesaError, Settings, advice};
use mesa_hal_sim::{SimFirmware, SimFpga, gtag, machines};

type Started = Result<Driver<SimFpga>, DriverError>;

fn loaded(firmware: SimFirmware, config: &str) -> Started {
    let settings = Config::parse(config).expect("words of LinuxCNC").settings;
    Driver::start(SimFpga::new(firmware), settings)
}

/// A 7I97 with a card on its only channel.
/// A 7I97 with a card on its only channel.
fn i7i97(config: &str) -> Driver<SimFpga> {
    let settings = Config::parse(config).expect("words of LinuxCNC").settings;
    let mut fpga = machines::i7i97(1);
    machines::plug_7i72(&mut fpga, 0, 0);
    Driver::start(fpga, settings).unwrap_or_else(|error| panic!("{config}: {error}"))
}

/// Names of the board's pins that begin with `stem`.
fn count(driver: &Driver<SimFpga>, stem: &str) -> usize {
    let prefix = format!("{}.{stem}", driver.name());
    let infos = driver.pins().infos().iter();
    infos.filter(|info| info.name.starts_with(&prefix)).count()
}

fn value(driver: &Driver<SimFpga>, name: &str) -> AnyValue {
    let name = format!("{}.{name}", driver.name());
    let pin = driver.pins().id(&name).expect(&name);
    driver.pins().read_any(pin).value
}

/// Manual page hostmot2(9); the frequency is that of a clock of 100 MHz.
const FRESH: [(&str, f64); 9] = [
    ("pwmgen.05.scale", 1.0),
    ("pwmgen.05.offset-mode", 0.0),
    ("pwmgen.05.output-type", 1.0),
    ("pwmgen.pwm_frequency", 20_000.0),
    ("pwmgen.pdm_frequency", 20_000.0),
    ("encoder.05.filter", 1.0),
    ("encoder.muxed-sample-frequency", 8_333_333.0),
    ("watchdog.timeout_ns", 5_000_000.0),
    ("packet-read-timeout", 80.0),
];

/// A board without a table is not given the rate of a 7I77 that may not hang on it.
#[test]
fn muxed_encoders_of_an_unknown_board_start_at_linuxcncs_rate() {
    for (name, hz) in [(*b"MESA7I97", 6_250_000.0), (*b"MESA7I9X", 8_333_333.0)] {
        let mut firmware = machines::firmware_7i97(1);
        firmware.board = name;
        let driver = Driver::start(SimFpga::new(firmware), Settings::default());
        let driver = driver.expect("a board with encoders");
        let frequency = value(&driver, "encoder.muxed-sample-frequency");
        assert_eq!(frequency.as_f64(), hz, "{}", driver.name());
    }
}

#[test]
fn values_that_differ_are_those_of_linuxcnc_or_of_the_board() {
    let linuxcnc = i7i97("");
    for (name, fresh) in FRESH {
        assert_eq!(value(&linuxcnc, name).as_f64(), fresh, "{name}");
    }
    let fpga = SimFpga::new(machines::firmware_7i97(1));
    let board = Driver::start(fpga, Settings::default()).expect("a 7I97");
    for (name, on_the_bench) in [
        ("pwmgen.05.scale", 10.0),
        ("pwmgen.05.offset-mode", 1.0),
        ("pwmgen.pwm_frequency", 48_000.0),
        ("encoder.05.filter", 0.0),
        ("encoder.muxed-sample-frequency", 6_250_000.0),
    ] {
        assert_eq!(value(&board, name).as_f64(), on_the_bench, "{name}");
    }
}

/// Seen in LinuxCNC on a simulated 7I92 (`crates/mesa-linuxcnc/tests/linuxcnc/boards.rs`).
#[test]
fn pwm_descriptor_without_generators_has_linuxcnc_frequencies() {
    let i7i92 = |config| loaded(machines::firmware_7i92_7i77(), config).expect(config);
    let fresh = i7i92("");
    for name in ["pwmgen.pwm_frequency", "pwmgen.pdm_frequency"] {
        assert_eq!(value(&fresh, name).as_f64(), 20_000.0);
    }
    let fpga = SimFpga::new(machines::firmware_7i92_7i77());
    let board = Driver::start(fpga, Settings::default()).expect("a 7I92");
    for driver in [i7i92("num_pwmgens=0"), board] {
        assert_eq!(count(&driver, "pwmgen."), 0);
    }
}

#[test]
fn settings_of_the_application_take_precedence_over_both() {
    let scale = PwmConfig {
        scale: Some(24_000.0),
        ..PwmConfig::default()
    };
    let settings = Settings {
        defaults: Defaults::LinuxCnc,
        pwm_hz: Some(10_000),
        pwm: [(2, scale)].into(),
        ..Settings::default()
    };
    let fpga = SimFpga::new(machines::firmware_7i97(1));
    let driver = Driver::start(fpga, settings).expect("a 7I97");
    assert_eq!(value(&driver, "pwmgen.02.scale").as_f64(), 24_000.0);
    assert_eq!(value(&driver, "pwmgen.03.scale").as_f64(), 1.0);
    assert_eq!(value(&driver, "pwmgen.pwm_frequency").as_f64(), 10_000.0);
}

#[test]
fn pins_of_instances_that_are_not_used_are_plain_io() {
    let all = i7i97("");
    let is_free =
        |driver: &Driver<SimFpga>, pin: usize| count(driver, &format!("gpio.{pin:03}.out")) == 1;
    // The I/O pins: FACTS 9.2.
    for (config, stem, pins) in [
        ("num_encoders=4", "encoder.04.", 15..18),
        ("num_encoders=0", "encoder.", 9..19),
        ("num_pwmgens=5", "pwmgen.05.", 6..8),
        ("num_pwmgens=0", "pwmgen.", 0..9),
        ("num_ssrs=0", "ssr.", 19..26),
        ("num_inmuxs=0", "inmux.", 26..31),
        ("sserial_port_0=xxxxxxxx", "sserial.", 31..34),
        ("num_dplls=0", "dpll.", 0..0),
        ("num_leds=3", "led.CR04", 0..0),
    ] {
        assert_ne!(count(&all, stem), 0, "{stem}");
        let driver = i7i97(config);
        assert_eq!(count(&driver, stem), 0, "{config}");
        for pin in 0..51 {
            let expected = pins.contains(&pin) || pin >= 34;
            assert_eq!(is_free(&driver, pin), expected, "{config}: pin {pin}");
        }
    }
    let driver = i7i97("num_encoders=4 num_leds=3");
    assert_ne!(count(&driver, "encoder.03."), 0);
    assert_eq!(count(&driver, "led."), 3);
}

#[test]
fn serial_ports_behind_the_last_named_one_are_not_used() {
    let firmware = || machines::firmware_serial(&[2, 2, 2]);
    let ports = |config| loaded(firmware(), config).expect(config).ports().len();
    assert_eq!(ports(""), 3);
    assert_eq!(ports("sserial_port_1=00xxxxxx"), 2);
    assert_eq!(ports("sserial_port_0=xxxxxxxx sserial_port_1=00"), 2);
    assert_eq!(ports("sserial_port_0=xxxxxxxx"), 0);
    let settings = Config::parse("sserial_port_0=0xxxxxxx")
        .expect("a word")
        .settings;
    let mut fpga = SimFpga::new(firmware());
    machines::plug_7i72(&mut fpga, 0, 0);
    let driver = Driver::start(fpga, settings).expect("one port");
    assert_eq!(
        count(&driver, "gpio.000.out") + count(&driver, "gpio.001.out"),
        0
    );
    assert_eq!(
        count(&driver, "gpio.002.out") + count(&driver, "gpio.011.out"),
        2
    );
}

fn refusal(started: Started, said: &str) -> Option<Advice> {
    let error = started.map(drop).expect_err(said);
    let text = error.to_string();
    assert!(text.contains(said), "{text}");
    let DriverError::Register(RegisterError::Setting { .. }) = error else {
        panic!("{text}");
    };
    error.advice()
}

#[test]
fn too_many_instances_are_refused_where_linuxcnc_refuses_them() {
    let firmware = || machines::firmware_7i97(1);
    for (config, said) in [
        ("num_encoders=7", "encoder 7, expected at most 6"),
        ("num_pwmgens=7", "pwmgen 7, expected at most 6"),
        ("num_ssrs=2", "ssr 2, expected at most 1"),
        ("num_inmuxs=2", "inmux 2, expected at most 1"),
        ("sserial_port_1=0", "sserial 2, expected at most 1"),
    ] {
        let advice = refusal(loaded(firmware(), config), said);
        assert_eq!(advice, Some(advice::SET_INSTANCES));
    }
    // There, these are no errors.
    let driver = i7i97("num_leds=9 num_dplls=2 num_inms=3 num_outms=1");
    assert_eq!(count(&driver, "led."), 4);
    assert_ne!(count(&driver, "dpll."), 0);
    let mut firmware = firmware();
    firmware
        .modules
        .retain(|module| module.gtag != gtag::SSERIAL);
    let driver = loaded(firmware, "sserial_port_0=0000xxxx").expect("a board without ports");
    assert!(driver.ports().is_empty());
    // On the bench, every number is meant.
    let fpga = || SimFpga::new(machines::firmware_7i97(1));
    for (kind, number) in [(Gtag::LED, 5), (Gtag::IN_M, 1), (Gtag::HM2DPLL, 2)] {
        let settings = Settings {
            instances: [(kind, number)].into(),
            ..Settings::default()
        };
        refusal(Driver::start(fpga(), settings), "expected at most");
    }
}

#[test]
fn numbers_of_modules_that_are_not_counted_are_refused() {
    let start = |change: fn(&mut Settings)| {
        let mut settings = Settings::default();
        change(&mut settings);
        Driver::start(SimFpga::new(machines::firmware_7i97(1)), settings)
    };
    refusal(
        start(|s| s.instances = [(Gtag::MUXED_ENCODER, 2)].into()),
        "MuxedEncoder (0C), expected Encoder (04), PWM (06)",
    );
    refusal(
        start(|s| {
            s.instances = [(Gtag::SSERIAL, 1)].into();
            s.serial_ports = [(1, mesa_hal::SerialConfig::default())].into();
        }),
        "less than 1, the number of ports in use",
    );
}

/// Second names as LinuxCNC 2.9 made them for this firmware.
const SECOND_NAMES: [&str; 12] = [
    "encoder.00.sel0",
    "pwmgen.00.enable",
    "pwmgen.00.out0",
    "pwmgen.01.out0",
    "pwmgen.02.out0",
    "pwmgen.03.out0",
    "pwmgen.04.enable",
    "pwmgen.04.out0",
    "pwmgen.05.enable",
    "pwmgen.05.out0",
    "sserial.00.tx0",
    "sserial.00.txen0",
];

#[test]
fn parameters_of_module_driven_pins_have_linuxcncs_second_names() {
    let driver = i7i97("");
    let pins = driver.pins();
    let expected: Vec<String> = SECOND_NAMES
        .iter()
        .flat_map(|name| {
            ["invert_output", "is_opendrain"].map(|end| format!("hm2_7i97.0.{name}.{end}"))
        })
        .collect();
    let aliases: Vec<_> = pins.aliases().map(|(alias, _)| alias).collect();
    assert_eq!(aliases, expected);
    // The enable of generators 0 to 3: FACTS 9.2.
    let enable = pins.id("hm2_7i97.0.pwmgen.00.enable.invert_output");
    assert_eq!(enable, pins.id("hm2_7i97.0.gpio.008.invert_output"));
    let free = i7i97("num_pwmgens=0 sserial_port_0=xxxxxxxx");
    assert_eq!(free.pins().aliases().count(), 2);
    let fpga = SimFpga::new(machines::firmware_7i97(1));
    let board = Driver::start(fpga, Settings::default()).expect("a 7I97");
    assert_eq!(board.pins().aliases().count(), 0);
}

#[test]
fn all_io_pins_have_their_level_whatever_uses_them() {
    let mut driver = loaded(machines::firmware_7i97(1), "").expect("a 7I97");
    let level = |driver: &Driver<SimFpga>, pin: usize| {
        let [level, not] = ["in", "in_not"].map(|end| {
            let name = format!("hm2_7i97.0.gpio.{pin:03}.{end}");
            let input = driver.pins().input::<bool>(&name).expect(&name);
            driver.pins().read(input)
        });
        assert!(
            level.valid && not.valid && level.value != not.value,
            "{pin}"
        );
        level.value
    };
    let enable = driver.pins().output::<bool>("hm2_7i97.0.pwmgen.00.enable");
    let enable = enable.expect("an output");
    let mut levels = Vec::new();
    for on in [false, true, true, false] {
        for _ in 0..2 {
            driver.pins_mut().set(enable, on);
            driver.write().expect("the board is there");
            let period = driver.period();
            driver.bus_mut().wait(period);
            let _ = driver.read().expect("the board is there");
        }
        // The scan of the isolated inputs goes on after the read: pins 26 to 30.
        for pin in (0..26).chain(31..51) {
            let expected = driver.bus_mut().pin_level(pin);
            assert_eq!(level(&driver, pin), expected, "pin {pin}");
        }
        // The enable of generators 0 to 3, active low: FACTS 9.2.
        levels.push(level(&driver, 8));
    }
    assert_eq!(levels, [true, false, false, true]);
}
