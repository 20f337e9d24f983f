//! A 5I25 with a 7I77 and a 7I76: servo axes, stepper axes and a spindle in one cycle, with the
//! clock of the PCI bus.

use mesa_hal::bus::Clock;
use mesa_hal::hal::Axis;
use mesa_hal::modules::stepgen::Stepgens;
use mesa_hal::{Driver, I7i77, Settings};
use mesa_hal_sim::{Motor, MotorConfig, SimFpga, machines};

use super::{PERIOD, SCALE, motor, set_up};

/// The first stepper motor among the axes of the machine, and the spindle.
const STEPPERS: usize = 6;
const SPINDLE: usize = 11;
/// The speed of a simulated motor at the end of its range.
const FULL_SPEED: f64 = 100.0;

fn cycle(driver: &mut Driver<SimFpga>, act: impl FnOnce(&mut Driver<SimFpga>)) {
    let report = driver.read().expect("the bus is well");
    assert!(report.is_good(), "{report:?}");
    act(driver);
    driver.write().expect("the bus is well");
    driver.bus_mut().wait(PERIOD);
}

#[test]
fn eleven_axes_of_a_5i25_arrive_together_and_the_spindle_turns() {
    let config = MotorConfig::default();
    let servo = Motor::new(config).expect("a motor");
    let board = machines::eleven_axes_5i25(servo, motor());
    let mut driver = Driver::start(board, Settings::default()).expect("it starts");
    assert_eq!(driver.name(), "hm2_5i25.0");
    assert_eq!(
        driver.remarks(),
        [],
        "everything of this firmware is driven"
    );
    let card: I7i77 = driver.attach_card((0, 0)).expect("a 7I77");
    let module = driver.modules::<Stepgens>().next().expect("generators");
    let generators: Vec<_> = module.pins().collect();
    assert_eq!(generators.len(), 5);
    for one in &generators {
        set_up(driver.pins_mut(), one);
    }
    let pins = driver.pins();
    let spindle = |name: &str| format!("hm2_5i25.0.7i76.0.3.{name}");
    let speed = pins.output::<f64>(&spindle("spinout")).expect("a pin");
    let enable = pins.output::<bool>(&spindle("spinena")).expect("a pin");
    let servos = card.analog.analog_out.into_iter().zip(card.encoders);
    let servos: Vec<_> = servos
        .map(|(output, encoder)| {
            let pins = driver.pins_mut();
            for (param, value) in [
                (encoder.scale, config.counts_per_unit),
                (output.full_scale, FULL_SPEED),
            ] {
                pins.set_param(param, value).expect("a scale");
            }
            Axis::servo(output, encoder)
        })
        .collect();
    for _ in 0..5 {
        cycle(&mut driver, |_| {});
    }
    for target in [2.0, -1.5] {
        for _ in 0..3_000 {
            cycle(&mut driver, |driver| {
                let pins = driver.pins_mut();
                for axis in &servos {
                    let error = target - axis.position(pins).value;
                    axis.enable(pins, true);
                    axis.set_speed(pins, (20.0 * error).clamp(-15.0, 15.0));
                }
                for one in &generators {
                    pins.set(one.enable, true);
                    pins.set(one.position_cmd, target);
                }
                pins.set(enable, true);
                pins.set(speed, 5.0);
            });
        }
        for n in 0..6 {
            let position = driver.bus_mut().motor(n).expect("a motor").position();
            assert!((position - target).abs() < 0.05, "axis {n}: {position}");
        }
        for (n, one) in generators.iter().enumerate() {
            let motor = driver.bus_mut().stepper(STEPPERS + n).expect("a motor");
            assert_eq!((motor.lost(), motor.overshot()), (0, 0), "generator {n}");
            let position = motor.position();
            let shown = driver.pins().read(one.position_fb);
            assert!(shown.valid, "generator {n}");
            for value in [position, shown.value] {
                assert!(
                    (value - target).abs() <= 1.0 / SCALE,
                    "generator {n}: {value}"
                );
            }
        }
    }
    let spindle = driver.bus_mut().motor(SPINDLE).expect("a motor");
    assert!(spindle.velocity() > 1.0, "{}", spindle.velocity());
    let turned = driver.pins().input::<f64>("hm2_5i25.0.encoder.06.position");
    let turned = driver.pins().read(turned.expect("its encoder"));
    assert!(turned.valid && turned.value > 1_000.0, "{turned:?}");
}
