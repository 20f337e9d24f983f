//! Claims become runs of neighbouring registers, and each word gets its place.

use alloc::{boxed::Box, vec, vec::Vec};

use super::{Claim, ImageError, ReadPhase, Tier, WritePhase};
use crate::bus::{Access, Direction};

/// A phase as a number to sort by.
pub(super) trait Phase: Copy {
    fn order(self) -> u8;
}

impl Phase for ReadPhase {
    fn order(self) -> u8 {
        self as u8
    }
}

impl Phase for WritePhase {
    fn order(self) -> u8 {
        self as u8
    }
}

/// One register of the image.
#[derive(Clone, Copy, Debug)]
struct Register {
    phase: u8,
    address: u16,
    tier: Tier,
    initial: u32,
    /// How many claims name it.
    claims: u16,
}

/// A run of neighbouring registers, before it becomes an [`Access`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    pub phase: u8,
    pub tier: Tier,
    address: u16,
    first: u16,
    count: u16,
}

/// Where each register and each claim is.
#[derive(Debug)]
pub(super) struct Layout {
    /// In the order of the exchange; the position is the place in the word buffer.
    registers: Vec<Register>,
    bridge: u16,
    index: Vec<u16>,
}

/// Lays out `claims`; gaps of up to `bridge` registers are filled.
pub(super) fn build<P: Phase, E>(
    claims: &[Claim<P>],
    bridge: u16,
) -> Result<Layout, ImageError<E>> {
    let mut registers = Vec::new();
    for claim in claims {
        add(&mut registers, claim)?;
    }
    registers.sort_by_key(|register| (register.phase, register.address));
    registers.dedup_by(|other, kept| {
        let same = (other.phase, other.address) == (kept.phase, kept.address);
        if same {
            kept.claims += other.claims;
            if other.tier == Tier::Cycle {
                kept.tier = Tier::Cycle;
            }
        }
        same
    });
    fill_gaps(&mut registers, bridge);
    let index = claims
        .iter()
        .map(|claim| {
            let key = (claim.phase.order(), claim.address);
            let place = registers.partition_point(|r| (r.phase, r.address) < key);
            place as u16
        })
        .collect();
    Ok(Layout {
        registers,
        bridge,
        index,
    })
}

fn add<P: Phase, E>(registers: &mut Vec<Register>, claim: &Claim<P>) -> Result<(), ImageError<E>> {
    let last = u32::from(claim.address) + 4 * u32::from(claim.count);
    if claim.count == 0 || !claim.address.is_multiple_of(4) || last > 0x1_0000 {
        return Err(ImageError::BadClaim {
            address: claim.address,
            count: claim.count,
        });
    }
    registers.extend((0..claim.count).map(|n| Register {
        phase: claim.phase.order(),
        address: claim.address + 4 * n,
        tier: claim.tier,
        initial: claim.initial,
        claims: 1,
    }));
    Ok(())
}

/// Registers between neighbours that are read along. They belong to the extended exchange; a
/// normal one that bridges the same gap uses their place.
fn fill_gaps(registers: &mut Vec<Register>, bridge: u16) {
    let mut filled: Vec<Register> = Vec::with_capacity(registers.len());
    for &register in registers.iter() {
        if let Some(&before) = filled.last() {
            let gap = (register.address.wrapping_sub(before.address) / 4).wrapping_sub(1);
            if before.phase == register.phase && gap <= bridge {
                filled.extend((1..=gap).map(|n| Register {
                    address: before.address + 4 * n,
                    tier: Tier::Extended,
                    initial: 0,
                    claims: 0,
                    ..before
                }));
            }
        }
        filled.push(register);
    }
    *registers = filled;
}

impl Layout {
    /// Refuses registers that two claims name: for writes.
    pub(super) fn unshared<E>(self) -> Result<Self, ImageError<E>> {
        let twice = |address: u16| {
            let named = self.registers.iter().filter(|r| r.address == address);
            named.map(|r| r.claims).sum::<u16>() > 1
        };
        match self.registers.iter().find(|r| twice(r.address)) {
            Some(&Register { address, .. }) => Err(ImageError::WrittenTwice { address }),
            None => Ok(self),
        }
    }

    /// Refuses registers that are claimed in several phases: for reads.
    pub(super) fn unshared_phases<E>(self) -> Result<Self, ImageError<E>> {
        let mut addresses: Vec<u16> = self
            .registers
            .iter()
            .filter(|r| r.claims > 0)
            .map(|r| r.address)
            .collect();
        addresses.sort_unstable();
        match addresses
            .windows(2)
            .find(|pair| pair.first() == pair.last())
        {
            Some(&[address, ..]) => Err(ImageError::ReadInTwoPhases { address }),
            _ => Ok(self),
        }
    }

    /// The runs of the registers that `keep` wants, bridged.
    fn runs(&self, keep: impl Fn(&Run) -> bool) -> Vec<Run> {
        let mut runs: Vec<Run> = Vec::new();
        for (place, register) in self.registers.iter().enumerate() {
            let one = Run {
                phase: register.phase,
                tier: register.tier,
                address: register.address,
                first: place as u16,
                count: 1,
            };
            if register.claims == 0 || !keep(&one) {
                continue;
            }
            if let Some(run) = runs.last_mut() {
                let places = one.first - run.first;
                let gap = places - run.count;
                let distance = one.address.checked_sub(run.address);
                let contiguous = distance == Some(4 * places);
                if run.phase == one.phase && contiguous && gap <= self.bridge {
                    run.count = places + 1;
                    continue;
                }
            }
            runs.push(one);
        }
        runs
    }

    /// The access list of the registers that `keep` wants.
    pub(super) fn accesses(
        &self,
        direction: Direction,
        keep: impl Fn(&Run) -> bool,
    ) -> Box<[Access]> {
        self.runs(keep)
            .into_iter()
            .map(|run| Access {
                address: run.address,
                direction,
                first: run.first,
                count: run.count,
            })
            .collect()
    }

    /// Everything that is written, such that each register of the extended tier is an access of its
    /// own; and which those are.
    pub(super) fn separate_writes(&self) -> (Box<[Access]>, Box<[bool]>) {
        let mut accesses: Vec<Access> = Vec::new();
        let mut is_extended: Vec<bool> = Vec::new();
        let mut before: Option<&Register> = None;
        for (place, register) in self.registers.iter().enumerate() {
            let continues = before.is_some_and(|before| {
                (before.phase, before.tier) == (register.phase, register.tier)
                    && register.tier == Tier::Cycle
                    && before.address.checked_add(4) == Some(register.address)
            });
            before = Some(register);
            match accesses.last_mut() {
                Some(run) if continues => run.count += 1,
                _ => {
                    accesses.push(Access::write(register.address, place as u16, 1));
                    is_extended.push(register.tier != Tier::Cycle);
                }
            }
        }
        (accesses.into(), is_extended.into())
    }

    /// Number of runs and of registers that `keep` wants, bridged ones included.
    pub(super) fn extent(&self, keep: impl Fn(&Run) -> bool) -> (u32, u32) {
        let runs = self.runs(keep);
        let words = runs.iter().map(|run| u32::from(run.count)).sum();
        (runs.len() as u32, words)
    }

    /// The word buffer before anything was put.
    pub(super) fn initial_words(&self) -> Box<[u32]> {
        let mut words = vec![0; self.registers.len()];
        for (word, register) in words.iter_mut().zip(&self.registers) {
            *word = register.initial;
        }
        words.into_boxed_slice()
    }

    /// The first word of each claim.
    pub(super) fn into_index(self) -> Box<[u16]> {
        self.index.into_boxed_slice()
    }
}
