//! The wiring check of an index, on a simulated motor.

use mesa_hal::bus::Clock;
use mesa_hal::hal::PinId;
use mesa_hal_sim::{Motor, MotorConfig, SimFpga, machines};
use mesa_tools::diagnosis::wiring::{
    HANDS_OFF, PointKind, WiringCheck, WiringJudgement, WiringMessage, WiringVerdict, points,
};

use crate::common::machine::Machine;

/// What a generator has counted does not change when its motor is turned by hand.
#[test]
fn step_generators_are_not_turned_by_hand() {
    let machine: Machine<SimFpga, ()> = Machine::on(machines::i7i92_7i76(), |_| {});
    let pins = machine.driver.pins();
    let points = points(pins, &[], |_| true);
    let asked: Vec<_> = points.iter().filter(|point| point.is_asked).collect();
    let of_generators = asked
        .iter()
        .filter(|point| point.info.name.contains(".stepgen."));
    assert_eq!(of_generators.count(), 0, "{asked:?}");
}

struct Guide {
    machine: Machine<SimFpga, ()>,
    check: WiringCheck,
    said: Vec<WiringMessage>,
}

impl Guide {
    /// A 7I77 with motors whose encoders have an index each `counts_per_revolution` counts; 0: no
    /// index is wired.
    fn new(counts_per_revolution: u32) -> Self {
        let motor = Motor::new(MotorConfig {
            counts_per_revolution,
            position: 1.0,
            ..MotorConfig::default()
        });
        let fpga = machines::six_axes_7i92(motor.expect("a motor"));
        let machine = Machine::on(fpga, |_| {});
        let check = WiringCheck::new(points(machine.driver.pins(), &[], |info| {
            info.name.contains(".encoder.00.")
        }));
        let mut guide = Self {
            machine,
            check,
            said: Vec::new(),
        };
        assert_eq!(guide.run(HANDS_OFF.as_millis() as u64), None);
        guide
    }

    /// Runs cycles of 1 ms, up to a judgement.
    fn run(&mut self, cycles: u64) -> Option<WiringJudgement> {
        for _ in 0..cycles {
            self.machine.cycles(1);
            let now = self.machine.driver.bus_mut().now();
            let pins = self.machine.driver.pins();
            let found = self.check.observe(now, |pin| pins.read_any(pin).ok());
            self.said.extend(std::iter::from_fn(|| self.check.news()));
            self.set_latch();
            if found.is_some() {
                return found;
            }
        }
        None
    }

    fn set_latch(&mut self) {
        while let Some((pin, on)) = self.check.index_enable() {
            let pins = self.machine.driver.pins_mut();
            pins.set_any(pin, on.into()).expect("index-enable");
        }
    }

    /// Number and pin of the index of encoder 0.
    fn index(&self) -> (usize, PinId) {
        let mut points = self.check.points().iter().enumerate();
        let found = points.find(|(_, point)| point.kind == PointKind::Index && point.is_asked);
        let (number, point) = found.expect("an index");
        assert!(point.info.name.ends_with(".encoder.00.index-enable"));
        assert!(point.info.place.signal.contains("IDX0"), "{:?}", point.info);
        (number, point.pin)
    }
}

/// The motor's index is at multiples of 4000 counts, and the motor stands at 1000.
#[test]
fn motor_index_comes_when_turned_past_it_and_not_before() {
    let mut guide = Guide::new(4000);
    let (index, pin) = guide.index();
    guide.check.ask(index);
    assert_eq!(guide.run(300), None);
    assert_eq!(guide.said, [WiringMessage::Ready(true.into())]);
    guide.machine.turn(0, 10.0);
    // The motor turns by 2500 counts, then it stands.
    assert_eq!(guide.run(250), None);
    guide.machine.turn(0, 0.0);
    assert_eq!(guide.run(1000), None);
    let [WiringMessage::Changed(_), WiringMessage::NoIndex(from, to)] = guide.said[1..] else {
        panic!("{:?}", guide.said);
    };
    assert_eq!(from.as_f64(), 0.0);
    assert!((2_400.0..2_600.0).contains(&to.as_f64()), "{to:?}");
    guide.machine.turn(0, 10.0);
    let found = guide.run(200).expect("a judgement");
    assert_eq!(found.verdict, WiringVerdict::Ok);
    let (_, to) = found.moved.expect("it moved");
    assert!((2_999.0..3_100.0).contains(&to.as_f64()), "{to:?}");
    let latch = guide.machine.driver.pins().read_any(pin);
    assert_eq!(latch.value.as_f64(), 0.0);
}

#[test]
fn unwired_index_is_reported_and_its_request_is_cancelled() {
    let mut guide = Guide::new(0);
    let (index, pin) = guide.index();
    let is_armed = |guide: &Guide| guide.machine.driver.pins().read_any(pin).value.as_f64() != 0.0;
    guide.check.ask(index);
    guide.run(300);
    guide.machine.turn(0, 20.0);
    assert_eq!(guide.run(1000), None);
    guide.machine.turn(0, 0.0);
    assert_eq!(guide.run(1000), None);
    let told = guide.said.last();
    assert!(
        matches!(told, Some(WiringMessage::NoIndex(..))),
        "{:?}",
        guide.said
    );
    assert!(is_armed(&guide));
    let found = guide.check.give_up(true).expect("it is asked for");
    assert_eq!(found.verdict, WiringVerdict::NoChange);
    let (from, to) = found.moved.expect("it moved");
    assert_eq!(from.as_f64(), 0.0);
    assert!((19_900.0..20_100.0).contains(&to.as_f64()), "{to:?}");
    guide.set_latch();
    assert!(!is_armed(&guide));
}
