//! Modules process their pins only when one of them has changed. This has no visible effect: a
//! driver in which everything changes in every cycle behaves the same.

use std::time::Duration;

use super::arbitrary_values::set_something;
use crate::common::bus::{Around, Between};
use crate::common::chance::Chance;
use mesa_hal::Settings;
use mesa_hal::bus::{Access, BusError, Clock, RegisterBus};
use mesa_hal::driver::{Driver, GpioConfig};
use mesa_hal::hal::{AnyValue, HalType, PinInfo, Pins, Rejections, Role};
use mesa_hal_sim::{Motor, SimFpga, machines};

const CYCLES: u32 = 1_000;

/// Records the exchanges.
#[derive(Debug, Default)]
struct Log(Vec<(Access, Vec<u32>)>);

impl Between for Log {
    fn exchange(
        &mut self,
        fpga: &mut SimFpga,
        accesses: &[Access],
        words: &mut [u32],
    ) -> Result<(), BusError> {
        fpga.exchange(accesses, words)?;
        let exchanged = accesses
            .iter()
            .map(|&access| (access, words[access.words()].to_vec()));
        self.0.extend(exchanged);
        Ok(())
    }
}

/// Sets everything to another value and back.
fn touch_all(pins: &mut Pins) {
    let infos = pins.infos().to_vec();
    for PinInfo {
        name,
        role,
        hal_type,
        ..
    } in &infos
    {
        macro_rules! touch {
            ($type:ty, $other:expr) => {
                match role {
                    Role::Output => touch!(pins.output::<$type>(name), $other),
                    Role::InOut => touch!(pins.inout::<$type>(name), $other),
                    Role::Setting => {
                        let param = pins.parameter::<$type>(name).unwrap();
                        let value = pins.param(param);
                        pins.set_param(param, value).unwrap();
                    }
                    _ => {}
                }
            };
            ($pin:expr, $other:expr) => {{
                let pin = $pin.unwrap();
                let value = pins.commanded(pin);
                pins.set(pin, $other(value));
                pins.set(pin, value);
            }};
        }
        match hal_type {
            HalType::Bit => touch!(bool, |value: bool| !value),
            HalType::Float => touch!(f64, |value: f64| f64::from_bits(!value.to_bits())),
            HalType::S32 => touch!(i32, |value: i32| !value),
            HalType::U32 => touch!(u32, |value: u32| !value),
            HalType::S64 => touch!(i64, |value: i64| !value),
            HalType::U64 => touch!(u64, |value: u64| !value),
        }
    }
}

/// The result of a cycle: its exchanges, the values of the pins, and the rejected values.
type Cycle = (Vec<(Access, Vec<u32>)>, Vec<AnyValue>, Rejections);

/// Cycles in which arbitrary pins are set to arbitrary values, motors turn, and the board is reset,
/// bites or is not received for a while.
fn cycles(fpga: SimFpga, seed: u64, are_all_touched: bool) -> impl Iterator<Item = Cycle> {
    let mut chance = Chance(seed);
    let between = Log::default();
    let output = GpioConfig {
        output: true,
        ..GpioConfig::default()
    };
    // A pin that no module uses.
    let settings = Settings {
        gpio: vec![(50, output)],
        ..Settings::default()
    };
    let mut driver = Driver::start(Around { fpga, between }, settings).expect("a board");
    (0..CYCLES).map(move |_| {
        if chance.one_in(10) {
            set_something(driver.pins_mut(), &mut chance);
        }
        if chance.one_in(20) {
            let on = chance.one_in(2);
            let input = chance.below(16) as usize;
            driver.bus_mut().fpga.set_input(input, on);
        }
        if chance.one_in(10) {
            let axis = chance.below(6) as usize;
            let pins = driver.pins_mut();
            let index = pins.inout(&format!("hm2_7i97.0.encoder.{axis:02}.index-enable"));
            pins.set(index.expect("an encoder"), true);
            let speed = chance.of(&[None, Some(0.0), Some(10.0), Some(-3e5)]);
            if let Some(motor) = driver.bus_mut().fpga.motor(axis) {
                motor.turn_by_hand(speed);
            }
        }
        if chance.one_in(300) {
            driver.bus_mut().fpga.reload();
        }
        let pause = chance.below(200);
        let pause = if pause == 0 { 20 } else { 1 + pause / 195 };
        let _ = driver.read();
        if chance.one_in(15) {
            let _ = driver.rearm();
        }
        if are_all_touched {
            touch_all(driver.pins_mut());
        }
        let _ = driver.write();
        driver.bus_mut().wait(Duration::from_millis(pause));
        let values = driver.pins().values().collect();
        let exchanged = core::mem::take(&mut driver.bus_mut().between.0);
        (exchanged, values, driver.pins().total_rejections())
    })
}

#[test]
fn processing_changed_pins_equals_processing_all_pins() {
    for seed in 1..=4 {
        let board = || match seed % 2 {
            0 => machines::six_axes_7i97(Motor::default()),
            _ => machines::i7i97_inm_outm(1),
        };
        let both = cycles(board(), seed, false).zip(cycles(board(), seed, true));
        for (n, (resting, busy)) in both.enumerate() {
            let ((exchanged, values, rejected), (all, all_values, all_rejected)) = (resting, busy);
            let place = exchanged
                .iter()
                .zip(&all)
                .position(|(one, other)| one != other);
            assert_eq!(
                place, None,
                "seed {seed}, cycle {n}: {exchanged:X?}, {all:X?}"
            );
            assert_eq!(exchanged.len(), all.len(), "seed {seed}, cycle {n}");
            let place = values
                .iter()
                .zip(&all_values)
                .position(|(one, other)| one != other);
            assert_eq!(place, None, "seed {seed}, cycle {n}: values by infos()");
            assert_eq!(rejected, all_rejected, "seed {seed}, cycle {n}");
        }
    }
}
