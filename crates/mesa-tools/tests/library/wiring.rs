//! The wiring check of switches, at the terminals of a simulated 7I77: what an operator does, and
//! what is said.

use mesa_hal::bus::Clock;
use mesa_hal_sim::SimFpga;
use mesa_tools::diagnosis::wiring::{
    HANDS_OFF, WiringCheck, WiringJudgement, WiringMessage, WiringVerdict, points,
};

use crate::common::machine::{FIELD, Machine, fpga};

/// Times of an operator, in ms.
const PRESSED: u64 = 400;
const BETWEEN: u64 = 600;

/// Ten inputs, and the switches that are wired to them.
struct Cabinet {
    machine: Machine<SimFpga>,
    check: WiringCheck,
    /// The number of each input in the check, which looks at all other pins as well.
    inputs: [usize; 10],
    said: Vec<WiringMessage>,
    /// For each input, the switch at its terminal.
    wires: [usize; 10],
    /// An input whose contact chatters.
    chatters: Option<usize>,
    ms: u64,
}

impl Cabinet {
    fn new() -> Self {
        let machine = Machine::on(fpga(), |_| {});
        let groups = [machine.status(FIELD).pins.group];
        let pins = machine.driver.pins();
        let check = WiringCheck::new(points(pins, &groups, |info| {
            info.name.contains(".7i77.0.0.input-0")
        }));
        let points = check.points().iter().enumerate();
        let asked = points.filter_map(|(point, info)| info.is_asked.then_some(point));
        let asked: Vec<usize> = asked.collect();
        Self {
            machine,
            check,
            inputs: asked.try_into().expect("ten inputs"),
            said: Vec::new(),
            wires: core::array::from_fn(|n| n),
            chatters: None,
            ms: 0,
        }
    }

    /// The same, when the time in which nothing is touched is over.
    fn after_hands_off() -> Self {
        let mut cabinet = Self::new();
        assert_eq!(cabinet.run(HANDS_OFF.as_millis() as u64), None);
        cabinet
    }

    /// Runs cycles of 1 ms, up to a judgement.
    fn run(&mut self, cycles: u64) -> Option<WiringJudgement> {
        for _ in 0..cycles {
            self.ms += 1;
            if let Some(input) = self.chatters {
                self.set(input, self.ms / 50 % 2 == 1);
            }
            self.machine.cycles(1);
            let now = self.machine.driver.bus_mut().now();
            let pins = self.machine.driver.pins();
            let found = self.check.observe(now, |pin| pins.read_any(pin).ok());
            self.said.extend(std::iter::from_fn(|| self.check.news()));
            if found.is_some() {
                return found;
            }
        }
        None
    }

    fn set(&mut self, input: usize, on: bool) {
        let device = self.machine.device_mut(FIELD);
        device.set_input(input, on).expect("an input");
    }

    fn actuate(&mut self, switch: usize, on: bool) {
        let wired = self.wires;
        let inputs = (0..wired.len()).filter(|&input| wired[input] == switch);
        inputs.for_each(|input| self.set(input, on));
    }

    /// Requests an input; the operator actuates its switch and lets it go.
    fn ask(&mut self, input: usize) -> Option<WiringJudgement> {
        self.said.clear();
        self.check.ask(self.inputs[input]);
        let early = self.run(BETWEEN);
        assert_eq!(early, None, "{:?}", self.said);
        self.actuate(input, true);
        let early = self.run(PRESSED);
        self.actuate(input, false);
        early.or_else(|| self.run(BETWEEN))
    }
}

#[test]
fn each_terminal_whose_switch_is_there_is_in_order() {
    let mut cabinet = Cabinet::after_hands_off();
    for input in 0..10 {
        let place = &cabinet.check.points()[cabinet.inputs[input]].info.place;
        assert_eq!(place.terminal, format!("TB8 pin {}", input + 1));
        assert_eq!(place.signal, format!("INPUT{input}"));
        let found = cabinet.ask(input).expect("a judgement");
        assert_eq!(found.verdict, WiringVerdict::Ok, "{input}");
        assert!(found.others.is_empty(), "{found:?}");
        let said = [
            WiringMessage::Ready(false.into()),
            WiringMessage::Changed(true.into()),
        ];
        assert_eq!(cabinet.said, said);
    }
}

#[test]
fn exchanged_wires_are_reported_with_the_input_that_changed() {
    let mut cabinet = Cabinet::after_hands_off();
    cabinet.wires.swap(1, 2);
    for (asked, wired) in [(1, 2), (2, 1)] {
        assert_eq!(cabinet.ask(asked), None);
        let wired = cabinet.inputs[wired];
        assert!(
            cabinet.said.contains(&WiringMessage::Instead(wired)),
            "{:?}",
            cabinet.said
        );
        let found = cabinet.check.give_up(true).expect("it is asked for");
        assert_eq!(found.verdict, WiringVerdict::OtherChanged);
        assert_eq!(found.others, [wired]);
    }
}

#[test]
fn wire_that_reaches_two_terminals_is_reported_with_both() {
    let mut cabinet = Cabinet::after_hands_off();
    cabinet.wires[4] = 3;
    let found = cabinet.ask(3).expect("a judgement");
    assert_eq!(found.verdict, WiringVerdict::Together);
    assert_eq!(found.others, [cabinet.inputs[4]]);
}

#[test]
fn loose_wire_changes_nothing_and_a_chattering_one_is_ignored() {
    let mut cabinet = Cabinet::new();
    cabinet.chatters = Some(6);
    assert_eq!(cabinet.run(HANDS_OFF.as_millis() as u64), None);
    // No switch has this number.
    cabinet.wires[5] = 99;
    assert_eq!(cabinet.ask(5), None);
    let restless: Vec<_> = cabinet.check.restless().collect();
    assert_eq!(restless, [cabinet.inputs[6]]);
    let found = cabinet.check.give_up(false).expect("it is asked for");
    assert_eq!(found.verdict, WiringVerdict::NoChange);
    let found = cabinet.ask(7).expect("a judgement");
    assert_eq!(found.verdict, WiringVerdict::Ok, "beside one that chatters");
    cabinet.check.ask(cabinet.inputs[6]);
    assert_eq!(cabinet.run(BETWEEN), None);
    let found = cabinet.check.give_up(false).expect("it is asked for");
    assert_eq!(found.verdict, WiringVerdict::Unstable);
}

#[test]
fn card_that_is_pulled_is_not_valid_and_no_change() {
    let mut cabinet = Cabinet::after_hands_off();
    cabinet.check.ask(cabinet.inputs[0]);
    assert_eq!(cabinet.run(BETWEEN), None);
    cabinet.machine.cable(FIELD).unplug();
    assert_eq!(cabinet.run(PRESSED), None);
    assert_eq!(cabinet.said.last(), Some(&WiringMessage::NotValid));
    let found = cabinet.check.give_up(false).expect("it is asked for");
    assert_eq!(found.verdict, WiringVerdict::NotValid);
    cabinet.machine.cable(FIELD).replug();
    let is_back = |machine: &mut Machine<SimFpga>| machine.is_running(FIELD);
    cabinet.machine.until(5_000, is_back);
    let found = cabinet.ask(0).expect("a judgement");
    assert_eq!(found.verdict, WiringVerdict::Ok);
}
