//! A wired cabinet, and an operator who actuates the requested inputs.

mod chatter;
mod index;
mod numbers;

use super::*;
use mesa_hal::hal::{GroupId, InOut, Input, PinInfo, PinMaker, PinStore, Place, Spec};

/// Four switches and two analog inputs of a remote, two encoders of the board.
struct Cabinet {
    store: PinStore,
    board: GroupId,
    remote: GroupId,
    switches: Vec<Input<bool>>,
    encoders: Vec<Input<i32>>,
    latches: Vec<InOut<bool>>,
    volts: Vec<Input<f64>>,
    check: WiringCheck,
    ms: u64,
    /// A switch that toggles, and the interval in ms.
    pulsing: Option<(usize, u64)>,
    said: Vec<WiringMessage>,
    found: Option<WiringJudgement>,
}

/// Number of the first switch, behind two encoders with an index each.
const SWITCH: usize = 4;
const VOLTS: usize = 8;

fn place(terminal: &str) -> Place {
    Place {
        terminal: terminal.to_owned(),
        signal: String::new(),
    }
}

impl Cabinet {
    fn new() -> Self {
        let mut store = PinStore::default();
        let (board, remote) = (store.add_group(), store.add_group());
        let (mut encoders, mut switches, mut volts) = (Vec::new(), Vec::new(), Vec::new());
        let mut latches = Vec::new();
        for n in 0..2 {
            let stem = format!("hm2.encoder.0{n}.");
            let at = place(&format!("TB3 pin {}, TB3 pin {}", 2 * n + 1, 2 * n + 2));
            let mut make = PinMaker::new(&mut store, board, stem).at(at);
            make.input::<bool>("quad-error").unwrap();
            encoders.push(make.input("rawcounts").unwrap());
            make.input::<i32>("count").unwrap();
            make.input::<f64>("position").unwrap();
            let spec = Spec {
                place: place(&format!("TB3 pin {}", 10 + n)),
                ..Spec::from("index-enable")
            };
            latches.push(make.inout(spec).unwrap());
            let mut make = make.at(place(&format!("TB3 pin {}", 2 * n + 1)));
            make.input::<bool>("input-a").unwrap();
            let mut make = make.at(place(&format!("TB3 pin {}", 10 + n)));
            make.input::<bool>("input-index").unwrap();
        }
        for n in 0..4 {
            let at = place(&format!("TB8 pin {}", n + 1));
            let mut make = PinMaker::new(&mut store, remote, "hm2.card.").at(at);
            switches.push(make.input(format!("input-0{n}").as_str()).unwrap());
            make.input::<bool>(format!("input-0{n}-not").as_str())
                .unwrap();
            make.output::<bool>(format!("output-0{n}").as_str(), false)
                .unwrap();
        }
        for n in 0..2 {
            let at = place(&format!("TB9 pin {}", n + 1));
            let spec = Spec {
                limits: Some((0.0, 36.0)),
                ..Spec::from(format!("analogin{n}").as_str())
            };
            let mut make = PinMaker::new(&mut store, remote, "hm2.card.").at(at);
            volts.push(make.input(spec).unwrap());
        }
        let check = WiringCheck::new(points(&store, &[remote], |_| true));
        let mut cabinet = Self {
            store,
            board,
            remote,
            switches,
            encoders,
            latches,
            volts,
            check,
            ms: 0,
            pulsing: None,
            said: Vec::new(),
            found: None,
        };
        cabinet.store.group_good(board);
        cabinet.store.group_good(remote);
        cabinet
    }

    /// Cycles of 5 ms.
    fn run(&mut self, ms: u64) {
        let end = self.ms + ms;
        while self.ms < end {
            self.ms += 5;
            if let Some((switch, period)) = self.pulsing {
                self.set(switch, self.ms / period % 2 == 1);
            }
            let now = Instant::from_nanos(self.ms * 1_000_000);
            let store = &self.store;
            let found = self.check.observe(now, |pin| store.read_any(pin).ok());
            while let Some(news) = self.check.news() {
                self.said.push(news);
            }
            self.set_latches();
            self.found = self.found.take().or(found);
        }
    }

    fn set_latches(&mut self) {
        while let Some((pin, on)) = self.check.index_enable() {
            self.store.set_any(pin, on.into()).expect("index-enable");
        }
    }

    fn set(&mut self, switch: usize, on: bool) {
        self.store.publish(self.switches[switch], on);
    }

    /// Requests a switch after a quiet time.
    fn ask(&mut self, switch: usize) {
        self.run(HANDS_OFF.as_millis() as u64);
        self.check.ask(SWITCH + switch);
        self.run(50);
    }

    /// Actuates switches together and releases them.
    fn press(&mut self, switches: &[usize]) {
        for on in [true, false] {
            for &switch in switches {
                self.set(switch, on);
            }
            self.run(400);
        }
    }

    fn verdict(&mut self) -> WiringVerdict {
        let found = self.found.take();
        let found = found.unwrap_or_else(|| panic!("no judgement: {:?}", self.said));
        found.verdict
    }

    fn give_up(&mut self) -> WiringJudgement {
        let found = self.check.give_up(false).expect("something was asked for");
        self.set_latches();
        found
    }
}

fn names(points: &[Point], is_asked: bool) -> Vec<&str> {
    let points = points.iter().filter(|point| point.is_asked == is_asked);
    let names = points.map(|point| point.info.name.strip_prefix("hm2.").unwrap());
    names.collect()
}

#[test]
fn terminal_is_checked_by_one_pin_and_the_others_are_watched() {
    let cabinet = Cabinet::new();
    let all = [
        "encoder.00.rawcounts",
        "encoder.00.index-enable",
        "encoder.01.rawcounts",
        "encoder.01.index-enable",
        "card.input-00",
        "card.input-01",
        "card.input-02",
        "card.input-03",
        "card.analogin0",
        "card.analogin1",
    ];
    assert_eq!(names(cabinet.check.points(), true), all);
    assert_eq!(names(cabinet.check.points(), false), [""; 0]);
    let remotes = [cabinet.remote];
    let chosen = |part: &str| {
        points(&cabinet.store, &remotes, |info: &PinInfo| {
            info.name.contains(part) || info.place.terminal.contains(part)
        })
    };
    let some = chosen("TB8 pin 2");
    assert_eq!(names(&some, true), ["card.input-01"]);
    assert_eq!(names(&some, false).len(), all.len() - 1);
    // Another pin of a terminal replaces its usual one.
    let other = chosen("quad-error");
    assert_eq!(
        names(&other, true),
        ["encoder.00.quad-error", "encoder.01.quad-error"]
    );
    assert_eq!(names(&other, false).len(), all.len() - 2);
    // Turning an encoder changes all its terminals, so those not selected are not watched.
    let a = chosen("input-a");
    assert_eq!(
        names(&a, true),
        ["encoder.00.input-a", "encoder.01.input-a"]
    );
    assert_eq!(names(&a, false).len(), all.len() - 2);
    // An index is checked by its latch, and its encoder is watched.
    for part in ["TB3 pin 10", "encoder.00.input-index"] {
        let index = chosen(part);
        assert_eq!(names(&index, true), ["encoder.00.index-enable"], "{part}");
        assert_eq!(names(&index, false)[0], "encoder.00.rawcounts");
        assert_eq!(names(&index, false).len(), all.len() - 1);
    }
    assert_eq!(points(&cabinet.store, &remotes, |_| false).len(), all.len());
}

#[test]
fn counter_gives_way_to_its_inputs_and_cards_have_own_terminals() {
    let mut store = PinStore::default();
    let (board, one, two) = (store.add_group(), store.add_group(), store.add_group());
    for (group, stem) in [(one, "hm2.card.0."), (two, "hm2.card.1.")] {
        for n in 1..3 {
            let at = place(&format!("TB4 pin {n}"));
            let mut make = PinMaker::new(&mut store, group, stem).at(at);
            make.input::<bool>(format!("input-0{n}").as_str()).unwrap();
        }
        let both = place("TB4 pin 1, TB4 pin 2");
        let mut make = PinMaker::new(&mut store, group, stem).at(both);
        make.input::<i32>("enc0-count").unwrap();
        // An unknown card has no terminals, and only its levels are checked.
        let mut make = PinMaker::new(&mut store, group, stem);
        make.input::<bool>("door").unwrap();
        make.input::<bool>("door-not").unwrap();
        make.input::<u32>("temperature").unwrap();
    }
    let mut make = PinMaker::new(&mut store, board, "hm2.");
    make.input::<bool>("packet-error").unwrap();
    let all = points(&store, &[one, two], |_| true);
    assert_eq!(
        names(&all, true),
        [
            "card.0.input-01",
            "card.0.input-02",
            "card.0.door",
            "card.1.input-01",
            "card.1.input-02",
            "card.1.door"
        ]
    );
    let wheel = points(&store, &[one, two], |info| {
        info.name.ends_with("card.0.enc0-count")
    });
    assert_eq!(names(&wheel, true), ["card.0.enc0-count"]);
    let watched = names(&wheel, false);
    assert!(watched.contains(&"card.1.input-01"), "{watched:?}");
    assert!(!watched.contains(&"card.0.input-01"), "{watched:?}");
}

#[test]
fn switch_is_ok_after_a_change_and_return_from_either_rest() {
    for rest in [false, true] {
        let mut cabinet = Cabinet::new();
        cabinet.set(1, rest);
        cabinet.ask(1);
        assert_eq!(cabinet.said, [WiringMessage::Ready(rest.into())]);
        cabinet.set(1, !rest);
        cabinet.run(1000);
        assert_eq!(cabinet.said[1..], [WiringMessage::Changed((!rest).into())]);
        assert_eq!(cabinet.found, None, "it is not back yet");
        // A moving axis and a switch on its way are no wiring error.
        cabinet.store.publish(cabinet.encoders[0], 5000);
        cabinet.set(1, rest);
        cabinet.run(400);
        let moved = Some((rest.into(), (!rest).into()));
        let expected = WiringJudgement {
            verdict: WiringVerdict::Ok,
            others: Vec::new(),
            moved,
        };
        assert_eq!(cabinet.found, Some(expected));
    }
}

#[test]
fn exchanged_wires_are_reported_and_paired() {
    let mut cabinet = Cabinet::new();
    let mut judged = Vec::new();
    for (asked, wired) in [(0, 0), (1, 2), (2, 1), (3, 2)] {
        cabinet.ask(asked);
        cabinet.said.clear();
        cabinet.press(&[wired]);
        if asked == wired {
            assert_eq!(cabinet.verdict(), WiringVerdict::Ok);
            judged.push(None);
            continue;
        }
        assert_eq!(cabinet.said, [WiringMessage::Instead(SWITCH + wired)]);
        assert_eq!(cabinet.found, None, "it goes on waiting");
        let found = cabinet.give_up();
        assert_eq!(found.verdict, WiringVerdict::OtherChanged);
        assert_eq!(found.others, [SWITCH + wired]);
        judged.push(Some(found));
    }
    let of = |n: usize| judged.get(n.checked_sub(SWITCH)?)?.as_ref();
    assert_eq!(exchanged(of, VOLTS), [(SWITCH + 1, SWITCH + 2)]);
    // The requested input changes after all.
    cabinet.ask(3);
    cabinet.press(&[0]);
    cabinet.press(&[3]);
    let found = cabinet.found.take().expect("a judgement");
    assert_eq!(
        (found.verdict, found.others),
        (WiringVerdict::Ok, vec![SWITCH])
    );
}

#[test]
fn bridged_wires_are_not_ok_but_switches_in_sequence_are() {
    let mut cabinet = Cabinet::new();
    cabinet.ask(1);
    cabinet.press(&[1, 3]);
    let found = cabinet.found.take().expect("a judgement");
    let expected = (WiringVerdict::Together, vec![SWITCH + 3]);
    assert_eq!((found.verdict, found.others), expected);
    // An axis is pushed over its home switch onto its limit switch.
    cabinet.ask(1);
    for (switch, on) in [(1, true), (2, true), (2, false), (1, false)] {
        cabinet.set(switch, on);
        cabinet.run(150);
    }
    cabinet.run(200);
    assert_eq!(cabinet.verdict(), WiringVerdict::Ok);
}

#[test]
fn invalid_input_is_no_change_nor_is_its_next_value() {
    let mut cabinet = Cabinet::new();
    cabinet.ask(1);
    cabinet.store.fault(cabinet.remote);
    cabinet.run(1000);
    // The switch was actuated meanwhile, and stays actuated.
    cabinet.set(1, true);
    cabinet.store.group_good(cabinet.remote);
    cabinet.run(2000);
    let expected = [
        WiringMessage::Ready(false.into()),
        WiringMessage::NotValid,
        WiringMessage::Held(true.into()),
    ];
    assert_eq!(cabinet.said, expected);
    // The rest is still the earlier one.
    cabinet.set(1, false);
    cabinet.run(300);
    assert_eq!(cabinet.said.pop(), Some(WiringMessage::Ready(false.into())));
    // A single lost transfer has no effect.
    cabinet.store.invalidate(cabinet.remote);
    cabinet.run(20);
    cabinet.store.group_good(cabinet.remote);
    cabinet.run(100);
    assert_eq!(cabinet.said.len(), 3, "{:?}", cabinet.said);
    cabinet.set(1, true);
    cabinet.run(300);
    cabinet.store.fault(cabinet.remote);
    cabinet.run(300);
    assert_eq!(cabinet.found, None, "half of it was seen");
    assert_eq!(cabinet.give_up().verdict, WiringVerdict::NotValid);
    // An input that was never valid is reported once.
    let mut never = Cabinet::new();
    never.store.fault(never.board);
    never.run(1500);
    never.check.ask(0);
    never.run(1000);
    assert_eq!(never.said, [WiringMessage::NotValid]);
}

#[test]
fn switch_held_during_an_outage_is_not_taken_as_normally_closed() {
    let mut cabinet = Cabinet::new();
    cabinet.ask(1);
    cabinet.set(1, true);
    cabinet.run(300);
    cabinet.store.fault(cabinet.remote);
    cabinet.run(300);
    cabinet.store.group_good(cabinet.remote);
    cabinet.run(300);
    assert_eq!(cabinet.said.last(), Some(&WiringMessage::Held(true.into())));
    cabinet.set(1, false);
    cabinet.run(500);
    assert_eq!(
        cabinet.said.last(),
        Some(&WiringMessage::Ready(false.into()))
    );
    assert_eq!(cabinet.found, None, "a half is no whole");
    cabinet.press(&[1]);
    let found = cabinet.found.take().expect("a judgement");
    assert_eq!(found.verdict, WiringVerdict::Ok);
    assert_eq!(found.moved, Some((false.into(), true.into())));
    // For a switch that really has another rest now, the operator gives up and requests it again.
    cabinet.ask(2);
    cabinet.store.fault(cabinet.remote);
    cabinet.set(2, true);
    cabinet.run(300);
    cabinet.store.group_good(cabinet.remote);
    cabinet.run(300);
    assert_eq!(cabinet.said.last(), Some(&WiringMessage::Held(true.into())));
    assert_eq!(cabinet.check.value(SWITCH + 2), Some(true.into()));
    assert_eq!(cabinet.give_up().verdict, WiringVerdict::NoChange);
    cabinet.check.ask(SWITCH + 2);
    cabinet.run(300);
    assert_eq!(
        cabinet.said.last(),
        Some(&WiringMessage::Ready(true.into()))
    );
}

#[test]
fn look_that_comes_late_takes_nothing_for_lost() {
    let mut cabinet = Cabinet::new();
    cabinet.ask(1);
    cabinet.set(1, true);
    cabinet.run(50);
    // The observer was stopped for a while.
    cabinet.ms += 800;
    cabinet.run(50);
    cabinet.set(1, false);
    cabinet.run(300);
    assert_eq!(cabinet.verdict(), WiringVerdict::Ok);
}

#[test]
fn verdict_on_giving_up_matches_the_observed_change() {
    let mut cabinet = Cabinet::new();
    cabinet.ask(0);
    assert_eq!(cabinet.give_up().verdict, WiringVerdict::NoChange);
    cabinet.ask(0);
    let skipped = cabinet.check.give_up(true).expect("asked");
    assert_eq!(skipped.verdict, WiringVerdict::Skipped);
    cabinet.ask(0);
    cabinet.set(0, true);
    cabinet.run(300);
    let found = cabinet.give_up();
    assert_eq!(found.verdict, WiringVerdict::NotBack);
    assert_eq!(found.moved, Some((false.into(), true.into())));
    // A change without a request counts as spontaneous only until the input has been quiet for a
    // while.
    cabinet.set(0, false);
    cabinet.run(4000);
    cabinet.ask(0);
    cabinet.set(0, true);
    cabinet.run(300);
    cabinet.set(0, false);
    cabinet.run(30);
    assert_eq!(cabinet.give_up().verdict, WiringVerdict::Ok, "it is back");
    assert_eq!(cabinet.check.give_up(true), None, "nothing is asked for");
}
