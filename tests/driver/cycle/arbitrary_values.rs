//! Arbitrary values of registers, pins and parameters: no cycle fails, and every input is finite.

use std::time::Duration;

use crate::common::bus::{Around, Between};
use crate::common::chance::Chance;
use crate::common::machine::{fpga, start};
use mesa_hal::bus::{Access, BusError, Clock, Direction, RegisterBus};
use mesa_hal::hal::{HalType, Pins, Role};
use mesa_hal_sim::SimFpga;

/// A register with arbitrary contents, extremes more often than by chance.
fn garbage(chance: &mut Chance) -> u32 {
    let word = (chance.below(1 << 16) << 16 | chance.below(1 << 16)) as u32;
    match chance.below(6) {
        0 => 0,
        1 => u32::MAX,
        2 => 0x0042_0000,
        _ => word,
    }
}

/// Reads garbage, except for the cookie.
struct Garbage {
    chance: Chance,
    one_in: u64,
}

impl Between for Garbage {
    fn exchange(
        &mut self,
        fpga: &mut SimFpga,
        accesses: &[Access],
        words: &mut [u32],
    ) -> Result<(), BusError> {
        fpga.exchange(accesses, words)?;
        for access in accesses.iter().filter(|a| a.direction == Direction::Read) {
            for (n, word) in words[access.words()].iter_mut().enumerate() {
                let is_cookie = access.address + 4 * n as u16 == 0x0100;
                if self.one_in > 0 && !is_cookie && self.chance.one_in(self.one_in) {
                    *word = garbage(&mut self.chance);
                }
            }
        }
        Ok(())
    }
}

/// Sets any pin or parameter to an extreme value.
pub fn set_something(pins: &mut Pins, chance: &mut Chance) {
    let place = chance.below(pins.infos().len() as u64) as usize;
    let info = &pins.infos()[place];
    let (name, role, hal_type) = (info.name.clone(), info.role, info.hal_type);
    let reals = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        -0.0,
        0.0,
        5e-324,
        -1e-300,
        1.0,
        1e9,
    ];
    let real = reals[chance.below(reals.len() as u64) as usize];
    let word = garbage(chance);
    macro_rules! set {
        ($type:ty, $value:expr) => {
            match role {
                Role::Output => {
                    let pin = pins.output::<$type>(&name).unwrap();
                    pins.set(pin, $value);
                }
                Role::InOut => {
                    let pin = pins.inout::<$type>(&name).unwrap();
                    pins.set(pin, $value);
                }
                Role::Setting => {
                    let param = pins.parameter::<$type>(&name).unwrap();
                    let _ = pins.set_param(param, $value);
                }
                _ => {}
            }
        };
    }
    match hal_type {
        HalType::Bit => set!(bool, word & 1 != 0),
        HalType::Float => set!(f64, real),
        HalType::S32 => set!(i32, word as i32),
        HalType::U32 => set!(u32, word),
        HalType::S64 => set!(i64, i64::from(word as i32) << 31),
        HalType::U64 => set!(u64, u64::from(word) << 32),
    }
}

#[test]
fn no_value_of_a_register_pin_or_parameter_makes_the_cycle_fail() {
    for seed in 1..=30 {
        let mut chance = Chance(seed);
        let between = Garbage {
            chance: Chance(seed ^ 0xFFFF),
            one_in: 0,
        };
        let fpga = fpga();
        let mut driver = start(Around { fpga, between }, |s| {
            s.serial_ports = [(0, "301".parse().unwrap())].into();
        })
        .unwrap();
        driver.bus_mut().between.one_in = [0, 3, 30, 1000][seed as usize % 4];
        for _ in 0..1500 {
            for _ in 0..3 {
                set_something(driver.pins_mut(), &mut chance);
            }
            let _ = driver.read();
            if chance.below(20) == 0 {
                let _ = driver.rearm();
            }
            let _ = driver.write();
            let pause = Duration::from_nanos(chance.below(2_000_000));
            driver.bus_mut().wait(pause);
            for info in driver.pins().infos() {
                let role = info.role;
                if role != Role::Input || info.hal_type != HalType::Float {
                    continue;
                }
                let pin = driver.pins().input::<f64>(&info.name).unwrap();
                let value = driver.pins().read(pin).value;
                assert!(value.is_finite(), "seed {seed}: {}", info.name);
            }
        }
    }
}
