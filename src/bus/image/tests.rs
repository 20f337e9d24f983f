use super::*;
use crate::bus::{Access, AccessList, BusError, Direction, RegisterBus, Reply};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// A bus that records the writes in their order, and answers reads with the last word written
/// there, or else with a function of the address.
#[derive(Default)]
struct Memory {
    written: Vec<(u16, u32)>,
    read: Vec<u16>,
    registers: BTreeMap<u16, u32>,
    reply: Option<Reply>,
}

fn content(address: u16) -> u32 {
    0xC0DE_0000 | u32::from(address)
}

impl RegisterBus for Memory {
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        for access in accesses {
            for (n, word) in (0u16..).zip(words[access.words()].iter_mut()) {
                let address = access.address + 4 * n;
                match access.direction {
                    Direction::Read => {
                        let known = self.registers.get(&address);
                        *word = known.copied().unwrap_or(content(address));
                        self.read.push(address);
                    }
                    Direction::Write => {
                        self.written.push((address, *word));
                        self.registers.insert(address, *word);
                    }
                }
            }
        }
        Ok(())
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, BusError> {
        self.exchange(list.as_ref(), words)?;
        Ok(self.reply.unwrap_or(Reply::CERTAIN))
    }
}

impl Memory {
    fn take_written(&mut self) -> Vec<(u16, u32)> {
        core::mem::take(&mut self.written)
    }

    fn take_read(&mut self) -> Vec<u16> {
        core::mem::take(&mut self.read)
    }
}

const USUAL: ReadRequest = ReadRequest {
    held: false,
    extra: false,
    after: None,
};
const EXTRA: ReadRequest = ReadRequest {
    held: false,
    extra: true,
    after: None,
};

/// A frozen image, with its words.
struct Image {
    exchanges: Exchanges,
    words: Words,
}

impl Image {
    fn frozen(plan: &ImagePlan, bus: &mut Memory, held: Option<core::time::Duration>) -> Self {
        let (exchanges, words) = plan.freeze(bus, held).unwrap();
        Self { exchanges, words }
    }
}

fn prepared(plan: &ImagePlan, bus: &mut Memory) -> Image {
    Image::frozen(plan, bus, None)
}

fn read(image: &mut Image, bus: &mut Memory, ask: ReadRequest) -> Vec<u16> {
    let started = image.exchanges.start_read(bus, &image.words, ask).unwrap();
    image
        .exchanges
        .finish(bus, &mut image.words, started)
        .unwrap();
    bus.take_read()
}

fn written(image: &mut Image, bus: &mut Memory) -> Vec<(u16, u32)> {
    image
        .exchanges
        .write(bus, &mut image.words, CycleWrites::Settings)
        .unwrap();
    bus.take_written()
}

#[test]
fn neighbour_registers_share_an_access_and_the_trigger_is_last() {
    let mut plan = ImagePlan::default();
    let doit = plan.write(Phase::Trigger, 0x5A00, 0x8000_0000);
    let command = plan.read(Phase::Status, 0x5A00);
    let inputs = [0x5D00, 0x5D04, 0x5E00, 0x5E04].map(|at| plan.read(Phase::Data, at));
    let out = [0x5D00, 0x5D04].map(|at| plan.write(Phase::Data, at, 0));
    let mut bus = Memory::default();
    let mut image = prepared(&plan, &mut bus);
    let words = &mut image.words;
    words.put(out[1], 2);
    words.put(out[0], 1);
    words.put(doit, 0x1003);
    assert_eq!(
        written(&mut image, &mut bus),
        [(0x5D00, 1), (0x5D04, 2), (0x5A00, 0x1003)],
        "data first although the trigger was registered first and has the lowest address"
    );
    bus.registers.clear();
    let order = read(&mut image, &mut bus, USUAL);
    assert_eq!(order, [0x5A00, 0x5D00, 0x5D04, 0x5E00, 0x5E04]);
    assert_eq!(image.words.word(command), content(0x5A00));
    assert_eq!(image.words.word(inputs[3]), content(0x5E04));
    let lists = image.exchanges.lists();
    assert_eq!(
        (lists.read.as_ref().len(), lists.write.as_ref().len()),
        (3, 2)
    );
}

#[test]
fn paced_cycle_is_one_list_and_settings_precede_it_with_writes() {
    let mut plan = ImagePlan::default();
    let out = plan.write(Phase::Data, 0x4000, 1);
    let setting = plan.setting(Stage::Configure, 0x4100, 5);
    plan.write(Phase::Trigger, 0x4200, 2);
    plan.read(Phase::Data, 0x4000);
    let mut bus = Memory::default();
    let held = core::time::Duration::from_millis(1);
    let mut image = Image::frozen(&plan, &mut bus, Some(held));
    let ask = ReadRequest {
        held: true,
        extra: false,
        after: None,
    };
    let paced = image.exchanges.lists().paced.unwrap();
    assert_eq!(paced.as_ref().len(), 3, "two writes and a read");
    image.words.put(out, 7);
    let started = image
        .exchanges
        .start_cycle(&mut bus, &mut image.words, ask, CycleWrites::Settings)
        .unwrap();
    image
        .exchanges
        .finish(&mut bus, &mut image.words, started.unwrap())
        .unwrap();
    assert_eq!(bus.take_written(), [(0x4000, 7), (0x4200, 2)]);
    image.words.set(setting, 6);
    let started = image
        .exchanges
        .start_cycle(&mut bus, &mut image.words, ask, CycleWrites::Settings)
        .unwrap();
    let all = [(0x4000, 7), (0x4100, 6), (0x4200, 2)];
    assert_eq!(bus.take_written(), all);
    image
        .exchanges
        .finish(&mut bus, &mut image.words, started.unwrap())
        .unwrap();
    assert_eq!(bus.take_written(), [], "the trigger comes once");
}

#[test]
fn extra_registers_are_read_only_on_request_and_evidence_last() {
    let mut plan = ImagePlan::default();
    plan.read(Phase::Evidence, 0x0C00);
    plan.read_extra(Phase::Evidence, 0x1100);
    plan.read(Phase::Data, 0x3500);
    plan.read_extra(Phase::Data, 0x5D00);
    plan.read(Phase::First, 0x7600);
    plan.read(Phase::Status, 0x0100);
    let mut bus = Memory::default();
    let mut image = prepared(&plan, &mut bus);
    let usual = [0x7600, 0x0100, 0x3500, 0x0C00];
    assert_eq!(read(&mut image, &mut bus, USUAL), usual);
    let all = [0x7600, 0x0100, 0x3500, 0x5D00, 0x0C00, 0x1100];
    assert_eq!(read(&mut image, &mut bus, EXTRA), all);
    image
        .exchanges
        .read_evidence(&mut bus, &mut image.words)
        .unwrap();
    assert_eq!(bus.take_read(), [0x0C00, 0x1100]);
    image
        .exchanges
        .read_status(&mut bus, &mut image.words)
        .unwrap();
    assert_eq!(bus.take_read(), [0x0100]);
}

#[test]
fn setting_is_written_on_change_and_again_while_it_may_be_lost() {
    let mut plan = ImagePlan::default();
    plan.write(Phase::Data, 0x4000, 1);
    let setting = plan.setting(Stage::Configure, 0x4104, 9);
    let mut bus = Memory::default();
    let mut image = prepared(&plan, &mut bus);
    let (usual, with) = ([(0x4000, 1)], [(0x4000, 1), (0x4104, 5)]);
    image.words.set(setting, 9);
    assert_eq!(written(&mut image, &mut bus), usual, "it is so already");
    image.words.set(setting, 5);
    image
        .exchanges
        .write(&mut bus, &mut image.words, CycleWrites::Quiet)
        .unwrap();
    assert_eq!(bus.take_written(), usual, "the board is not set up");
    assert_eq!(written(&mut image, &mut bus), with);
    assert_eq!(written(&mut image, &mut bus), usual, "not heard of yet");
    image.words.confirm(false);
    assert_eq!(written(&mut image, &mut bus), with, "perhaps it was lost");
    image.words.confirm(true);
    assert_eq!(written(&mut image, &mut bus), usual);
    image.words.confirm(false);
    let why = "an older one may have come late";
    assert_eq!(written(&mut image, &mut bus), with, "{why}");
    for _ in 0..=101 {
        image.words.confirm(true);
        assert_eq!(written(&mut image, &mut bus), usual);
    }
    image.words.confirm(false);
    let why = "nothing so old is in flight";
    assert_eq!(written(&mut image, &mut bus), usual, "{why}");
}

#[test]
fn set_up_is_written_in_stages_with_current_words_then_evidence() {
    let mut plan = ImagePlan::default();
    let enable = plan.setting(Stage::Enable, 0x7D00, 3);
    let drive = plan.drive(0x1100, 0xF0);
    plan.opening(0x0C00, 1, 2);
    plan.closing(0x0D00, None, 8);
    let output = plan.output(0x4000, 7);
    plan.step(Stage::Quiesce, 0x1100, 0);
    plan.on_demand(0x7700);
    let mut bus = Memory::default();
    plan.set_up(&mut bus).unwrap();
    let first = [
        (0x0C00, 1),
        (0x1100, 0),
        (0x4000, 7),
        (0x1100, 0xF0),
        (0x7D00, 3),
    ];
    assert_eq!(bus.take_written(), first);
    plan.watch(&mut bus).unwrap();
    let mut image = prepared(&plan, &mut bus);
    bus.take_read();
    let words = &mut image.words;
    words.set(enable, 4);
    words.set(drive, 0x30);
    words.put(output, 99);
    words.put_safe(output, 6);
    image.exchanges.set_up(&mut bus, &mut image.words).unwrap();
    let again = [
        (0x0C00, 2),
        (0x1100, 0),
        (0x4000, 6),
        (0x1100, 0x30),
        (0x7D00, 4),
        (0x0D00, 8),
    ];
    assert_eq!(bus.take_written(), again);
    assert_eq!(bus.take_read(), [0x1100]);
    assert!(image.words.evidence_matches());
    image.words.all_set();
    assert_eq!(written(&mut image, &mut bus), [(0x4000, 99)]);
    image.exchanges.quiesce(&mut bus, &mut image.words).unwrap();
    assert_eq!(bus.take_written(), [(0x1100, 0)]);
    image.words.put_safe(output, 5);
    image.exchanges.renew(&mut bus, &mut image.words).unwrap();
    let renewed = [(0x4000, 5), (0x1100, 0x30), (0x7D00, 4)];
    assert_eq!(bus.take_written(), renewed, "no pin is let go of");
    assert_eq!(bus.take_read(), [0x1100]);
}

/// Behind the settings come the safe words, and behind these the steps: a number that this image
/// does not have must reach neither. In a debug build it panics.
fn after_a_mistake(mistake: fn(&mut Words)) -> Vec<(u16, u32)> {
    let mut plan = ImagePlan::default();
    plan.output(0x4000, 7);
    plan.step(Stage::Configure, 0x4100, 8);
    let mut bus = Memory::default();
    let mut image = prepared(&plan, &mut bus);
    mistake(&mut image.words);
    image.exchanges.set_up(&mut bus, &mut image.words).unwrap();
    bus.take_written()
}

#[test]
#[cfg_attr(
    debug_assertions,
    should_panic(expected = "a setting of another image")
)]
fn setting_of_another_image_changes_no_safe_word() {
    let written = after_a_mistake(|words| words.set(Setting(0), 5));
    assert_eq!(written, [(0x4000, 7), (0x4100, 8)]);
}

#[test]
#[cfg_attr(debug_assertions, should_panic(expected = "a slot of another image"))]
fn safe_word_of_another_image_changes_no_step() {
    let written = after_a_mistake(|words| words.put_safe(WriteSlot(1), 5));
    assert_eq!(written, [(0x4000, 7), (0x4100, 8)]);
}

#[test]
fn pin_drive_is_written_alone_after_dependencies_until_shown() {
    let mut plan = ImagePlan::default();
    plan.write(Phase::First, 0x0E00, 0x5A);
    plan.output(0x1000, 0);
    let direction = plan.drive(0x1100, 1);
    let invert = plan.setting(Stage::Route, 0x1400, 0);
    plan.write(Phase::Trigger, 0x5A00, 0);
    let mut bus = Memory::default();
    plan.set_up(&mut bus).unwrap();
    plan.watch(&mut bus).unwrap();
    let mut image = prepared(&plan, &mut bus);
    bus.take_written();
    let words = &mut image.words;
    words.set(direction, 3);
    words.set(invert, 2);
    assert!(image.words.has_guarded_pending());
    image
        .exchanges
        .write_guarded(&mut bus, &mut image.words)
        .unwrap();
    let guarded = [(0x1000, 0), (0x1400, 2), (0x1100, 3), (0x0E00, 0x5A)];
    assert_eq!(bus.take_written(), guarded);
    bus.registers.insert(0x1100, 1);
    image
        .exchanges
        .read_evidence(&mut bus, &mut image.words)
        .unwrap();
    image.words.guarded_sent();
    assert!(image.words.evidence_matches(), "what was driven is driven");
    assert!(image.words.has_guarded_pending(), "it has not arrived");
    image
        .exchanges
        .write_guarded(&mut bus, &mut image.words)
        .unwrap();
    image
        .exchanges
        .read_evidence(&mut bus, &mut image.words)
        .unwrap();
    image.words.guarded_sent();
    assert!(!image.words.has_guarded_pending());
    let usual = [(0x0E00, 0x5A), (0x1000, 0), (0x5A00, 0)];
    bus.take_written();
    assert_eq!(written(&mut image, &mut bus), usual);
    image.words.confirm(false);
    assert!(image.words.has_guarded_pending(), "it may be undone");
}

#[test]
fn late_write_after_the_set_up_does_not_undo_a_setting() {
    let mut plan = ImagePlan::default();
    let invert = plan.setting(Stage::Configure, 0x1400, 0);
    let direction = plan.setting(Stage::Drive, 0x1100, 0);
    let mode = plan.on_demand(0x7700);
    let mut bus = Memory::default();
    let mut image = prepared(&plan, &mut bus);
    for word in [1, 2] {
        image.words.set(invert, word);
        written(&mut image, &mut bus);
    }
    image.words.set(direction, 3);
    image.words.set(mode, 4);
    image.exchanges.set_up(&mut bus, &mut image.words).unwrap();
    image.words.all_set();
    bus.take_written();
    assert_eq!(written(&mut image, &mut bus), []);
    // A duplicate of the first write arrives late.
    image.words.confirm(false);
    assert!(image.words.has_guarded_pending());
    assert_eq!(written(&mut image, &mut bus), [(0x1400, 2)]);
}

#[test]
fn every_reply_since_the_news_were_taken_counts() {
    let mut plan = ImagePlan::default();
    plan.read(Phase::Status, 0x0100);
    let mut bus = Memory::default();
    let mut image = prepared(&plan, &mut bus);
    // An uncertain reply without details looks as if nothing had been received.
    bus.reply = Some(Reply::CERTAIN.with_certain(false));
    image
        .exchanges
        .read_status(&mut bus, &mut image.words)
        .unwrap();
    bus.reply = None;
    read(&mut image, &mut bus, USUAL);
    assert!(!image.words.take_replies().certain);
    assert!(image.words.take_replies().certain);
}

#[test]
fn small_gaps_of_reads_are_bridged_and_those_of_writes_never() {
    let mut plan = ImagePlan::default();
    for address in [0x3500, 0x3508, 0x3514] {
        plan.read(Phase::Data, address);
        plan.write(Phase::Data, address, 0);
    }
    let image = prepared(&plan, &mut Memory::default());
    let runs = |accesses: &[Access]| -> Vec<(u16, u16)> {
        accesses.iter().map(|a| (a.address, a.count)).collect()
    };
    let lists = image.exchanges.lists();
    assert_eq!(runs(lists.read.as_ref()), [(0x3500, 3), (0x3514, 1)]);
    assert_eq!(
        runs(lists.write.as_ref()),
        [(0x3500, 1), (0x3508, 1), (0x3514, 1)]
    );
}

#[test]
fn impossible_plan_is_refused_with_the_register_at_fault() {
    let refused = |register: fn(&mut ImagePlan)| {
        let mut plan = ImagePlan::default();
        register(&mut plan);
        plan.check().unwrap_err()
    };
    let odd = refused(|plan| {
        plan.read(Phase::Data, 0x5D02);
    });
    assert_eq!(odd.address, 0x5D02);
    let twice = refused(|plan| {
        plan.output(0x1000, 0);
        plan.setting(Stage::Drive, 0x1000, 0);
    });
    assert_eq!(twice.address, 0x1000);
    let phases = refused(|plan| {
        plan.read(Phase::Data, 0x5A00);
        plan.read(Phase::Status, 0x5A00);
    });
    assert_eq!(phases.address, 0x5A00);
    let late = refused(|plan| {
        plan.read(Phase::Trigger, 0x5B00);
    });
    assert_eq!(late.address, 0x5B00);
    for phase in [Phase::Status, Phase::Evidence] {
        let mut plan = ImagePlan::default();
        plan.write(phase, 0x5C00, 0);
        let error = plan.check().unwrap_err();
        assert_eq!(error.address, 0x5C00, "{phase:?}");
    }
}

proptest! {
    /// Whatever is registered, each slot reads its own register, each register is written once with
    /// the word that was put, and no trigger is written before the last data word.
    #[test]
    fn every_slot_gets_its_own_register(
        reads in prop::collection::vec((0u16..64, any::<bool>()), 0..40),
        writes in prop::collection::btree_map(0u16..64, 0u8..3, 0..20),
    ) {
        let mut plan = ImagePlan::default();
        let slots: Vec<_> = reads
            .iter()
            .map(|&(n, extra)| {
                let address = 0x1000 + 4 * n;
                let slot = if extra {
                    plan.read_extra(Phase::Data, address)
                } else {
                    plan.read(Phase::Data, address)
                };
                (address, extra, slot)
            })
            .collect();
        let mut puts = Vec::new();
        let mut settings = Vec::new();
        for (&n, &kind) in &writes {
            let address = 0x2000 + 4 * n;
            match kind {
                0 => puts.push((address, plan.write(Phase::Trigger, address, 0))),
                1 => puts.push((address, plan.write(Phase::Data, address, 0))),
                _ => settings.push((address, plan.setting(Stage::Configure, address, 0))),
            }
        }
        let mut bus = Memory::default();
        let mut image = prepared(&plan, &mut bus);
        for ask in [USUAL, EXTRA] {
            read(&mut image, &mut bus, ask);
            for &(address, extra, slot) in &slots {
                if !extra || ask.extra {
                    prop_assert_eq!(image.words.word(slot), content(address));
                }
            }
        }
        for &(address, slot) in &puts {
            image.words.put(slot, content(address));
        }
        for &(address, setting) in &settings {
            image.words.set(setting, content(address));
        }
        let order = written(&mut image, &mut bus);
        let expected: BTreeMap<u16, u32> = writes
            .keys()
            .map(|n| (0x2000 + 4 * n, content(0x2000 + 4 * n)))
            .collect();
        prop_assert_eq!(order.len(), expected.len());
        prop_assert_eq!(order.iter().copied().collect::<BTreeMap<_, _>>(), expected);
        let is_trigger = |address: u16| writes.get(&((address - 0x2000) / 4)) == Some(&0);
        prop_assert!(order.iter().map(|w| is_trigger(w.0)).is_sorted());
    }
}
