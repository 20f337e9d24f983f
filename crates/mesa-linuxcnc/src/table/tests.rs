//! The copy against a model, over a HAL that is a vector.

use mesa_hal::hal::{GroupId, InOut, Input, Param, PinMaker, PinStore, Spec};
use proptest::prelude::*;

use super::*;

#[derive(Debug, Default)]
pub(crate) struct FakeMemory(pub Vec<u64>);

impl Memory for FakeMemory {
    fn load(&self, index: usize) -> u64 {
        self.0[index]
    }

    fn store(&mut self, index: usize, bits: u64) {
        if self.0.len() <= index {
            self.0.resize(index + 1, 0);
        }
        self.0[index] = bits;
    }
}

/// Numbers of the pins in HAL.
const INPUT: usize = 0;
const COUNTER: usize = 1;
const OUTPUT: usize = 2;
const VOLTS: usize = 3;
const BOTH: usize = 4;
const SETTING: usize = 5;
const SCALE: usize = 6;
const PROPERTY: usize = 7;
const PINS: usize = 8;

struct Bench {
    store: PinStore,
    group: GroupId,
    input: Input<i32>,
    counter: Input<u64>,
    both: InOut<bool>,
    property: Param<u32>,
    table: Table,
    memory: FakeMemory,
    changes: Vec<Change>,
}

impl Bench {
    fn new() -> Self {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "card.");
        let input = make.input("input").expect("made");
        let counter = make.input("counter").expect("made");
        make.output("output", false).expect("made");
        make.output("volts", 0.0).expect("made");
        let both = make.inout("both").expect("made");
        let setting = Spec {
            limits: Some((0.0, 10.0)),
            ..Spec::from("setting")
        };
        make.setting(setting, 5_u32).expect("made");
        make.scale("scale", 1.0).expect("made");
        let property = make.property("property", 0).expect("made");
        let mut memory = FakeMemory::default();
        let table = Table::new(&store, &mut memory);
        Self {
            store,
            group,
            input,
            counter,
            both,
            property,
            table,
            memory,
            changes: Vec::new(),
        }
    }

    fn step(&mut self, step: u8) {
        let Self {
            store,
            table,
            memory,
            changes,
            ..
        } = self;
        let pins: &mut Pins = store;
        let changes = &mut |change| changes.push(change);
        match step {
            0 => table.before_read(pins, memory, changes),
            1 => table.after_read(pins, memory),
            2 => table.before_write(pins, memory, changes),
            _ => table.after_write(pins, memory),
        }
    }

    fn own(&self, index: usize) -> u64 {
        let id = self.store.ids().nth(index).expect("a pin");
        self.store.read_any(id).value.bits
    }
}

/// A step of either side.
#[derive(Clone, Debug)]
enum Act {
    Hal(usize, u64),
    Publish(i32, u64),
    PublishBoth(bool),
    PublishProperty(u32),
    Good,
    Fault,
    Rearm,
    Step(u8),
}

fn act() -> impl Strategy<Value = Act> {
    let float = prop_oneof![any::<f64>(), Just(0.0), Just(2.5)].prop_map(f64::to_bits);
    prop_oneof![
        prop_oneof![Just(OUTPUT), Just(BOTH)]
            .prop_flat_map(|pin| (0..2_u64).prop_map(move |bits| Act::Hal(pin, bits))),
        (0..20_u64).prop_map(|bits| Act::Hal(SETTING, bits)),
        (prop_oneof![Just(VOLTS), Just(SCALE)], float).prop_map(|(pin, bits)| Act::Hal(pin, bits)),
        (any::<i32>(), any::<u64>()).prop_map(|(input, counter)| Act::Publish(input, counter)),
        any::<bool>().prop_map(Act::PublishBoth),
        (0..4_u32).prop_map(Act::PublishProperty),
        Just(Act::Good),
        Just(Act::Fault),
        Just(Act::Rearm),
        (0..4_u8).prop_map(Act::Step),
        (0..4_u8).prop_map(Act::Step),
    ]
}

/// The expected values, from the rules of the documentation.
struct Model {
    hal: [u64; PINS],
    own: [u64; PINS],
    /// The last value on which both sides agreed.
    agreed: [u64; PINS],
    is_valid: bool,
}

impl Model {
    fn show(&mut self, pin: usize) {
        self.hal[pin] = if pin == COUNTER {
            self.own[pin].min(u32::MAX.into())
        } else {
            self.own[pin]
        };
        self.agreed[pin] = self.own[pin];
    }

    fn exchange(&mut self, pin: usize) {
        let is_accepted = match pin {
            SETTING => self.hal[pin] <= 10,
            SCALE => {
                let scale = f64::from_bits(self.hal[pin]).abs();
                (1e-100..=1e100).contains(&scale)
            }
            _ => true,
        };
        if self.own[pin] != self.agreed[pin] || !is_accepted {
            self.show(pin);
        } else {
            (self.own[pin], self.agreed[pin]) = (self.hal[pin], self.hal[pin]);
        }
    }

    fn step(&mut self, step: u8) {
        match step {
            0 => self.exchange(BOTH),
            1 => {
                if self.is_valid {
                    self.show(INPUT);
                    self.show(COUNTER);
                }
                self.show_own();
            }
            2 => {
                for pin in [BOTH, SETTING, SCALE] {
                    self.exchange(pin);
                }
                for pin in [OUTPUT, VOLTS] {
                    self.own[pin] = self.hal[pin];
                }
            }
            _ => self.show_own(),
        }
    }

    fn show_own(&mut self) {
        self.show(PROPERTY);
        if self.own[BOTH] != self.agreed[BOTH] {
            self.show(BOTH);
        }
    }
}

proptest! {
    #[test]
    fn table_follows_the_rules_for_any_sequence_of_both_sides(acts in proptest::collection::vec(act(), 0..60)) {
        let mut bench = Bench::new();
        let at_first: [u64; PINS] = core::array::from_fn(|pin| bench.own(pin));
        let mut model = Model { hal: at_first, own: at_first, agreed: at_first, is_valid: false };
        for act in acts {
            match act {
                Act::Hal(pin, bits) => (bench.memory.0[pin], model.hal[pin]) = (bits, bits),
                Act::Publish(input, counter) => {
                    bench.store.publish(bench.input, input);
                    bench.store.publish(bench.counter, counter);
                    (model.own[INPUT], model.own[COUNTER]) = (i64::from(input) as u64, counter);
                }
                Act::PublishBoth(value) => {
                    bench.store.publish(bench.both, value);
                    model.own[BOTH] = value.into();
                }
                Act::PublishProperty(value) => {
                    bench.store.publish(bench.property, value);
                    model.own[PROPERTY] = value.into();
                }
                Act::Good => {
                    bench.store.group_good(bench.group);
                    model.is_valid = true;
                }
                Act::Fault => {
                    bench.store.fault(bench.group);
                    model.is_valid = false;
                    // Commands are forgotten, of all that the application sets.
                    for pin in [OUTPUT, VOLTS] {
                        model.own[pin] = bench.own(pin);
                    }
                    model.own[BOTH] = bench.own(BOTH);
                }
                Act::Rearm => {
                    let _ = bench.store.rearm(bench.group);
                    for pin in [OUTPUT, VOLTS, BOTH] {
                        model.own[pin] = bench.own(pin);
                    }
                }
                Act::Step(step) => {
                    bench.step(step);
                    model.step(step);
                }
            }
            prop_assert_eq!(&bench.memory.0[..], &model.hal[..]);
            for pin in [BOTH, SETTING, SCALE, OUTPUT, VOLTS] {
                prop_assert_eq!(bench.own(pin), model.own[pin], "pin {}", pin);
            }
        }
    }
}

#[test]
fn refused_setting_gets_its_old_value_back_and_is_reported_once() {
    let mut bench = Bench::new();
    bench.memory.0[SETTING] = 11;
    for _ in 0..3 {
        bench.step(2);
    }
    assert_eq!((bench.memory.0[SETTING], bench.own(SETTING)), (5, 5));
    let [Change::Refused(error)] = &bench.changes[..] else {
        panic!("{:?}", bench.changes);
    };
    assert!(error.to_string().contains("`card.setting`"), "{error}");
}

#[test]
fn outputs_are_set_again_after_arming_has_forgotten_them() {
    let mut bench = Bench::new();
    bench.store.group_good(bench.group);
    bench.memory.0[OUTPUT] = 1;
    bench.step(2);
    bench.store.fault(bench.group);
    bench.store.group_good(bench.group);
    bench.store.rearm(bench.group).expect("it runs");
    assert_eq!(bench.own(OUTPUT), 0);
    bench.step(2);
    assert_eq!(bench.own(OUTPUT), 1);
}
