//! Values that the hardware cannot have: corrected in the parameter, and reported with the allowed
//! range.

use std::time::Duration;

use crate::common::machine::start;
use mesa_hal::Driver;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{CorrectedValue, EventKind, Events};
use mesa_hal::hal::{HalType, PinId};
use mesa_hal_sim::{Motor, SimFpga, machines};

struct Bench {
    driver: Driver<SimFpga>,
    events: Events,
}

impl Bench {
    fn new() -> Self {
        let driver = start(machines::six_axes_7i97(Motor::default()), |_| {}).expect("a 7I97");
        let mut this = Self {
            events: driver.events(),
            driver,
        };
        this.run();
        this
    }

    fn run(&mut self) {
        for _ in 0..5 {
            let _ = self.driver.read().expect("the bus is well");
            self.driver.write().expect("the bus is well");
            self.driver.bus_mut().wait(Duration::from_millis(1));
        }
    }

    fn id(&self, name: &str) -> PinId {
        let name = format!("hm2_7i97.0.{name}");
        self.driver
            .pins()
            .id(&name)
            .unwrap_or_else(|error| panic!("{error}"))
    }

    /// Sets a value as HAL does.
    fn set(&mut self, name: &str, value: i64) {
        let id = self.id(name);
        let bits = match self
            .driver
            .pins()
            .info_of(id)
            .expect("it is there")
            .hal_type
        {
            HalType::Float => (value as f64).to_bits(),
            HalType::S32 => i64::from(value as i32) as u64,
            _ => value as u64,
        };
        self.driver.pins_mut().set_bits(id, bits).expect("taken");
        self.run();
    }

    fn corrections(&mut self) -> Vec<EventKind> {
        let kinds = self.events.by_ref().map(|event| event.kind);
        kinds
            .filter(|kind| matches!(kind, EventKind::ValueCorrected { .. }))
            .collect()
    }
}

#[test]
fn impossible_parameter_gets_an_allowed_value_and_an_event() {
    let mut bench = Bench::new();
    for (name, asked, expected, allowed) in [
        ("pwmgen.00.output-type", 5, 1, "1 to 4"),
        ("pwmgen.03.output-type", -1, 1, "1 to 4"),
        ("pwmgen.pwm_frequency", 10_000_000, 390_619, "1 to 390619"),
        ("pwmgen.pwm_frequency", 0, 1, "1 to 390619"),
        ("pwmgen.pdm_frequency", 0, 1, "1 to 199996948"),
        (
            "pwmgen.pdm_frequency",
            4_000_000_000,
            199_996_948,
            "1 to 199996948",
        ),
        ("inmux.00.fast_scans", 0, 1, "1 to 63"),
        ("inmux.00.fast_scans", 64, 63, "1 to 63"),
        ("inmux.00.slow_scans", 5_000, 1_023, "1 to 1023"),
        (
            "inmux.00.scan_rate",
            100_000_000,
            1_562_500,
            "1526 to 1562500",
        ),
        ("inmux.00.scan_rate", 1, 1_526, "1526 to 1562500"),
        (
            "watchdog.timeout_ns",
            100,
            2_000_000,
            "2000000 to 4294967295",
        ),
    ] {
        bench.set(name, asked);
        let shown = bench.driver.pins().bits_of(bench.id(name));
        assert_eq!(shown as u32, expected, "{name} {asked}");
        let said = bench.corrections();
        let [event] = &said[..] else {
            panic!("{name} {asked}: {said:?}");
        };
        let text = event.to_string();
        assert!(
            text.starts_with(&format!("{name}: {asked} is out of range ")),
            "{text}"
        );
        assert!(
            text.contains(&format!("{allowed}, {expected} is used")),
            "{text}"
        );
        assert!(event.is_fault());
    }
}

/// HAL owns pins, and sets them in every cycle.
#[test]
fn impossible_pin_is_reported_once_for_each_value() {
    let mut bench = Bench::new();
    for (name, wrong, right) in [
        (
            "encoder.muxed-sample-frequency",
            [1, 4_000_000_000],
            5_000_000,
        ),
        ("encoder.timer-number", [7, -2], 1),
        ("ssr.00.rate", [30_000_000, 50_000_000], 1_000_000),
        ("dpll.time-const", [70_000, 4_000_000_000], 2_000),
        ("dpll.plimit", [0x100_0000, 0x200_0000], 0x40_0000),
        ("dpll.base-freq-khz", [0, 100_000], 1),
    ] {
        for value in wrong {
            bench.set(name, value);
            bench.set(name, value);
            let said = bench.corrections();
            assert_eq!(said.len(), 1, "{name} {value}: {said:?}");
            let text = said[0].to_string();
            assert!(text.starts_with(name), "{text}");
        }
        bench.set(name, right);
        assert_eq!(bench.corrections(), [], "{name}");
        bench.set(name, wrong[0]);
        assert_eq!(bench.corrections().len(), 1, "{name}, again");
        bench.set(name, right);
    }
}

#[test]
fn allowed_values_are_not_reported() {
    let mut bench = Bench::new();
    for (name, value) in [
        ("pwmgen.00.output-type", 4),
        ("pwmgen.pwm_frequency", 390_619),
        ("watchdog.timeout_ns", 2_000_000),
        ("inmux.00.fast_scans", 63),
        ("ssr.00.rate", 0),
        ("encoder.timer-number", -1),
    ] {
        bench.set(name, value);
        assert_eq!(bench.corrections(), [], "{name} {value}");
    }
    assert_ne!(CorrectedValue::PwmFrequency, CorrectedValue::PdmFrequency);
}
