//! Outputs in rarely tested states: after a second fault, beyond crossed limits, of a port that is
//! switched off, of a board whose bus is down; and values that must not make any driver fail.

use std::time::Duration;

use crate::common::bus::{Around, Between};
use crate::common::chance::Chance;
use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, World, fpga, start};
use mesa_hal::bus::{Access, BusErrorKind, Clock, Direction, RegisterBus};
use mesa_hal::driver::{BoardState, FaultPolicy};
use mesa_hal::hal::{HalType, Pins, Role};
use mesa_hal::transport::{Fault, Faulty};
use mesa_hal_sim::{SimError, SimFpga};

/// The remote is unplugged until it is offline, then comes back.
fn away_and_back<B: World>(machine: &mut Machine<B>, channel: usize) {
    machine.cable(channel).unplug();
    machine.until(40, |machine| !machine.is_running(channel));
    machine.cable(channel).replug();
    machine.until(6000, |machine| machine.is_running(channel));
    machine.cycles(3);
}

#[test]
fn a_command_from_between_two_faults_does_not_come_back_when_re_armed() {
    let mut machine = Machine::new();
    machine.cycles(3);
    let output = machine.cards.outputs.outputs[7].pin;
    away_and_back(&mut machine, OUTPUTS);
    machine.driver.pins_mut().set(output, true);
    away_and_back(&mut machine, OUTPUTS);
    let _ = machine.driver.rearm().unwrap();
    machine.cycles(3);
    assert!(machine.is_armed(OUTPUTS));
    let world = machine.device(OUTPUTS).world();
    assert_eq!(world.output(7), Some(false));
}

#[test]
fn limits_that_cross_allow_nothing_but_the_safe_value() {
    let mut machine = Machine::new();
    let analog = machine.cards.analog;
    let name = "hm2_7i92.0.7i77.0.1.analogout1";
    for (min, max) in [(3.0, -3.0), (20.0, 10.0), (-10.0, -20.0), (9.0, 8.0)] {
        let pins = machine.driver.pins_mut();
        let minlim = pins.parameter(&format!("{name}-minlim")).unwrap();
        let maxlim = pins.parameter(&format!("{name}-maxlim")).unwrap();
        pins.set_param(minlim, min).unwrap();
        pins.set_param(maxlim, max).unwrap();
        pins.set(analog.analogena.pin, true);
        for volts in [-10.0, 0.0, 5.0, 10.0] {
            machine
                .driver
                .pins_mut()
                .set(analog.analog_out[1].volts, volts);
            machine.cycles(2);
            let volts_out = machine.device(ANALOG).world().analog_output(1).unwrap();
            let allowed = if min > max {
                0.0
            } else {
                volts.clamp(min, max)
            };
            assert!(
                (volts_out - allowed.clamp(-10.0, 10.0)).abs() < 0.01,
                "{min} {max}: {volts} V became {volts_out} V"
            );
        }
    }
}

#[test]
fn writes_alone_do_not_bring_back_a_board_whose_bus_was_down() {
    let driver = start(Faulty::new(fpga(), 1), |s| s.bus_error_limit = 1).unwrap();
    let mut machine = Machine::with(driver);
    machine.cycles(3);
    let bus = machine.driver.bus_mut();
    let next = bus.exchanges();
    bus.fail_at(next, Fault::NotExecuted(BusErrorKind::Lost));
    assert!(machine.driver.write().is_err());
    for _ in 0..3 {
        assert!(machine.driver.write().is_ok());
        assert_eq!(machine.driver.board_state(), BoardState::BusDown);
    }
}

#[test]
fn pauses_without_end_are_a_policy_like_any_other() {
    let policy = FaultPolicy {
        first_backoff: Duration::MAX,
        longest_backoff: Duration::MAX,
        ..FaultPolicy::default()
    };
    let mut machine = Machine::build(|s| s.fault_policy = policy);
    machine.cable(FIELD).unplug();
    machine.until(40, |machine| !machine.is_running(FIELD));
    machine.cycles(300);
    assert!(machine.is_running(ANALOG) && machine.is_valid(OUTPUTS));
}

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
    ) -> Result<(), SimError> {
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
