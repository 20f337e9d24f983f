use super::*;
use crate::bus::{Access, AccessList, Clock, Direction, Hold, Instant, Reply};
use core::convert::Infallible;
use core::time::Duration;
use proptest::prelude::*;
use std::collections::BTreeMap;

/// A bus that remembers what was written, in which order, and answers reads with a function of
/// the address.
#[derive(Default)]
struct Memory {
    written: Vec<(u16, u32)>,
    read: Vec<u16>,
}

fn content(address: u16) -> u32 {
    0xC0DE_0000 | u32::from(address)
}

impl RegisterBus for Memory {
    type Error = Infallible;
    type List = AccessList;

    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), Infallible> {
        for access in accesses {
            for (n, word) in (0u16..).zip(words[access.words()].iter_mut()) {
                let address = access.address + 4 * n;
                match access.direction {
                    Direction::Read => {
                        *word = content(address);
                        self.read.push(address);
                    }
                    Direction::Write => self.written.push((address, *word)),
                }
            }
        }
        Ok(())
    }

    fn prepare(&mut self, accesses: &[Access], _: Option<Hold>) -> Result<AccessList, Infallible> {
        Ok(AccessList::new(accesses))
    }

    fn finish(&mut self, list: &AccessList, words: &mut [u32]) -> Result<Reply, Infallible> {
        self.exchange(list.accesses(), words)?;
        Ok(Reply::CERTAIN)
    }
}

impl Clock for Memory {
    fn now(&mut self) -> Instant {
        Instant::default()
    }

    fn wait(&mut self, _: Duration) {}
}

/// A port with two channels of two interface registers each, as SSLBP lays them out.
struct Port {
    command: ReadSlot,
    interface: [ReadSlot; 4],
    doit: WriteSlot,
    out: [WriteSlot; 2],
}

fn port(plan: &mut ImagePlan) -> Port {
    let doit = plan.write(WritePhase::Trigger, Tier::Cycle, 0x5A00, 1, 0x8000_0000);
    Port {
        command: plan.read(ReadPhase::Status, Tier::Cycle, 0x5A00, 1),
        interface: [0x5D00, 0x5D04, 0x5E00, 0x5E04].map(|address| plan.read_data(address)),
        doit,
        out: [0x5D00, 0x5D04].map(|address| plan.write_data(address, 0)),
    }
}

#[test]
fn neighbouring_registers_share_an_access_and_the_trigger_comes_last() {
    let mut plan = ImagePlan::new();
    let port = port(&mut plan);
    let mut bus = Memory::default();
    let (mut image, lists) = plan.freeze(&mut bus, ImageLimits::default(), None).unwrap();
    image.put(port.out[1], 2);
    image.put(port.out[0], 1);
    image.put(port.doit, 0x1003);
    image.exchange_writes(&mut bus, &lists).unwrap();
    assert_eq!(
        bus.written,
        [(0x5D00, 1), (0x5D04, 2), (0x5A00, 0x1003)],
        "data first although the trigger was claimed first and has the lowest address"
    );
    image.exchange_reads(&mut bus, &lists, Tier::Cycle).unwrap();
    assert_eq!(bus.read, [0x5A00, 0x5D00, 0x5D04, 0x5E00, 0x5E04]);
    assert_eq!(image.word(port.command), Some(content(0x5A00)));
    assert_eq!(image.word(port.interface[3]), Some(content(0x5E04)));
    assert_eq!(
        image.size(),
        ImageSize {
            read_words: 5,
            read_accesses: 3,
            write_words: 3,
            write_accesses: 2,
        }
    );
}

#[test]
fn extended_registers_are_moved_only_in_extended_exchanges() {
    let mut plan = ImagePlan::new();
    let usual = plan.read_data(0x5D00);
    let more = plan.read(ReadPhase::Data, Tier::Extended, 0x5D04, 2);
    let mode = plan.write(WritePhase::Data, Tier::Extended, 0x5C00, 1, 7);
    let mut bus = Memory::default();
    let (mut image, lists) = plan.freeze(&mut bus, ImageLimits::default(), None).unwrap();
    image.exchange_reads(&mut bus, &lists, Tier::Cycle).unwrap();
    image.exchange_writes(&mut bus, &lists).unwrap();
    assert_eq!((&bus.read[..], &bus.written[..]), (&[0x5D00][..], &[][..]));
    assert_eq!(image.words(more), [0, 0]);
    image
        .exchange_reads(&mut bus, &lists, Tier::Extended)
        .unwrap();
    image.request_write(mode);
    image.exchange_writes(&mut bus, &lists).unwrap();
    assert_eq!(image.words(more), [content(0x5D04), content(0x5D08)]);
    assert_eq!(image.word(usual), Some(content(0x5D00)));
    assert_eq!(image.written(mode), [7]);
    assert_eq!(bus.written, [(0x5C00, 7)]);
}

#[test]
fn what_is_asked_for_is_written_alone_and_again_while_it_may_be_lost_or_undone() {
    let mut plan = ImagePlan::new();
    plan.write_data(0x4000, 1);
    let [_, second, _] =
        [0x4100, 0x4104, 0x4108].map(|at| plan.write(WritePhase::Data, Tier::Extended, at, 1, 9));
    let mut bus = Memory::default();
    let (mut image, lists) = plan.freeze(&mut bus, ImageLimits::default(), None).unwrap();
    image.put(second, 5);
    image.request_write(second);
    let mut writes = |image: &mut CycleImage| {
        bus.written.clear();
        image.exchange_writes(&mut bus, &lists).unwrap();
        bus.written.clone()
    };
    let (usual, with) = ([(0x4000, 1)], [(0x4000, 1), (0x4104, 5)]);
    assert_eq!(writes(&mut image), with);
    assert_eq!(writes(&mut image), usual, "not heard of yet");
    image.confirm_writes(false);
    assert_eq!(writes(&mut image), with, "perhaps it was lost");
    image.confirm_writes(true);
    assert_eq!(writes(&mut image), usual);
    image.confirm_writes(false);
    assert_eq!(writes(&mut image), with, "an older one may have come late");
    for _ in 0..=101 {
        image.confirm_writes(true);
        assert_eq!(writes(&mut image), usual);
    }
    image.confirm_writes(false);
    assert_eq!(writes(&mut image), usual, "nothing so old is under way");
}

#[test]
fn evidence_is_read_after_all_data() {
    let mut plan = ImagePlan::new();
    plan.read(ReadPhase::Evidence, Tier::Cycle, 0x0C00, 1);
    plan.read(ReadPhase::Evidence, Tier::Evidence, 0x1100, 2);
    plan.read_data(0x3500);
    plan.read(ReadPhase::Data, Tier::Extended, 0x5D00, 1);
    let mut bus = Memory::default();
    let (mut image, lists) = plan.freeze(&mut bus, ImageLimits::default(), None).unwrap();
    image.exchange_reads(&mut bus, &lists, Tier::Cycle).unwrap();
    assert_eq!(bus.read, [0x3500, 0x0C00]);
    bus.read.clear();
    image
        .exchange_reads(&mut bus, &lists, Tier::Evidence)
        .unwrap();
    assert_eq!(bus.read, [0x3500, 0x0C00, 0x1100, 0x1104]);
    bus.read.clear();
    image
        .exchange_reads(&mut bus, &lists, Tier::Extended)
        .unwrap();
    assert_eq!(bus.read, [0x3500, 0x5D00, 0x0C00, 0x1100, 0x1104]);
    bus.read.clear();
    image.exchange_evidence(&mut bus, &lists).unwrap();
    assert_eq!(bus.read, [0x0C00, 0x1100, 0x1104]);
}

#[test]
fn the_status_exchange_reads_nothing_else() {
    let mut plan = ImagePlan::new();
    port(&mut plan);
    let mut bus = Memory::default();
    let (mut image, lists) = plan.freeze(&mut bus, ImageLimits::default(), None).unwrap();
    image.exchange_status(&mut bus, &lists).unwrap();
    assert_eq!(bus.read, [0x5A00]);
}

#[test]
fn small_gaps_of_reads_are_bridged_and_those_of_writes_never() {
    let mut plan = ImagePlan::new();
    for address in [0x3500, 0x3508, 0x3518] {
        plan.read_data(address);
        plan.write_data(address, 0);
    }
    let mut bus = Memory::default();
    let (image, _) = plan.freeze(&mut bus, ImageLimits::default(), None).unwrap();
    let runs = |accesses: &[Access]| -> Vec<(u16, u16)> {
        accesses.iter().map(|a| (a.address, a.count)).collect()
    };
    assert_eq!(runs(image.read_accesses()), [(0x3500, 3), (0x3518, 1)]);
    assert_eq!(
        runs(image.write_accesses()),
        [(0x3500, 1), (0x3508, 1), (0x3518, 1)]
    );
}

#[test]
fn what_can_not_be_planned_is_refused_with_the_register_at_fault() {
    let mut bus = Memory::default();
    let mut frozen = |claim: fn(&mut ImagePlan)| {
        let mut plan = ImagePlan::new();
        claim(&mut plan);
        plan.freeze(&mut bus, ImageLimits::default(), None)
            .map(|_| ())
    };
    let odd = frozen(|plan| {
        plan.read_data(0x5D02);
    });
    assert!(matches!(
        odd,
        Err(ImageError::BadClaim {
            address: 0x5D02,
            ..
        })
    ));
    let past = frozen(|plan| {
        plan.read(ReadPhase::Data, Tier::Cycle, 0xFFFC, 2);
    });
    assert!(matches!(past, Err(ImageError::BadClaim { .. })));
    let twice = frozen(|plan| {
        plan.write_data(0x1000, 0);
        plan.write(WritePhase::Trigger, Tier::Extended, 0x1000, 1, 0);
    });
    assert!(matches!(
        twice,
        Err(ImageError::WrittenTwice { address: 0x1000 })
    ));
    let phases = frozen(|plan| {
        plan.read_data(0x5A00);
        plan.read(ReadPhase::Status, Tier::Cycle, 0x5A00, 1);
    });
    assert!(matches!(
        phases,
        Err(ImageError::ReadInTwoPhases { address: 0x5A00 })
    ));
}

#[test]
fn a_slot_of_another_image_reads_nothing_and_writes_nothing() {
    let mut bus = Memory::default();
    let mut other = ImagePlan::new();
    let slot = (0..9).map(|n| other.read_data(4 * n)).last().unwrap();
    let target = (0..9).map(|n| other.write_data(4 * n, 0)).last().unwrap();
    let mut plan = ImagePlan::new();
    plan.read_data(0);
    let (mut image, _) = plan.freeze(&mut bus, ImageLimits::default(), None).unwrap();
    image.put(target, 1);
    assert_eq!(image.word(slot), None);
    assert!(image.written(target).is_empty());
}

proptest! {
    /// Whatever is claimed, each slot reads its own registers, each register is written once with
    /// what was put, and no trigger is written before the last data word.
    #[test]
    fn every_claim_gets_its_own_registers(
        reads in prop::collection::vec((0u16..64, 1u16..5, any::<bool>()), 0..20),
        writes in prop::collection::btree_map(0u16..64, (any::<bool>(), any::<bool>()), 0..20),
        bridge in 0u16..4,
    ) {
        let tier = |extended| if extended { Tier::Extended } else { Tier::Cycle };
        let mut plan = ImagePlan::new();
        let slots: Vec<_> = reads
            .iter()
            .map(|&(n, count, extended)| {
                let address = 0x1000 + 4 * n;
                (address, count, extended, plan.read(ReadPhase::Data, tier(extended), address, count))
            })
            .collect();
        let targets: Vec<_> = writes
            .iter()
            .map(|(&n, &(trigger, extended))| {
                let phase = if trigger { WritePhase::Trigger } else { WritePhase::Data };
                let address = 0x2000 + 4 * n;
                (address, trigger, extended, plan.write(phase, tier(extended), address, 1, 0))
            })
            .collect();
        let limits = ImageLimits { bridge };
        for run in [Tier::Cycle, Tier::Extended] {
            let mut bus = Memory::default();
            let (mut image, lists) = plan.freeze(&mut bus, limits, None).unwrap();
            image.exchange_reads(&mut bus, &lists, run).unwrap();
            for &(address, count, extended, slot) in &slots {
                if !extended || run == Tier::Extended {
                    let expected: Vec<_> = (0..count).map(|n| content(address + 4 * n)).collect();
                    prop_assert_eq!(image.words(slot), expected);
                }
            }
            for &(address, .., target) in &targets {
                image.put(target, content(address));
            }
            for &(_, _, extended, target) in &targets {
                if extended && run == Tier::Extended {
                    image.request_write(target);
                }
            }
            image.exchange_writes(&mut bus, &lists).unwrap();
            let expected: BTreeMap<u16, u32> = targets
                .iter()
                .filter(|&&(_, _, extended, _)| !extended || run == Tier::Extended)
                .map(|&(address, ..)| (address, content(address)))
                .collect();
            prop_assert_eq!(bus.written.len(), expected.len());
            prop_assert_eq!(bus.written.iter().copied().collect::<BTreeMap<_, _>>(), expected);
            let is_trigger = |address| targets.iter().any(|t| t.0 == address && t.1);
            prop_assert!(bus.written.iter().map(|w| is_trigger(w.0)).is_sorted());
        }
    }
}
