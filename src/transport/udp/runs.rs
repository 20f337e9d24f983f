//! Neighbouring registers share a command.

use core::ops::Range;

use crate::bus::{Access, Direction};
use crate::lbp16::{Lbp16Error, MAX_COUNT, RequestBuilder, Space};

/// Accesses in their order, those joined that go on where the one before ends, in the registers and
/// in the buffer.
pub(super) fn joined(accesses: impl Iterator<Item = Access>) -> impl Iterator<Item = Access> {
    let mut accesses = accesses.peekable();
    core::iter::from_fn(move || {
        let mut joined = accesses.next()?;
        let goes_on = |joined: &Access, next: &Access| {
            u32::from(next.address) == u32::from(joined.address) + 4 * u32::from(joined.count)
                && next.words().start == joined.words().end
        };
        while let Some(next) = accesses.next_if(|next| goes_on(&joined, next)) {
            joined.count += next.count;
        }
        Some(joined)
    })
}

/// Neighbouring registers, as many as one command takes.
pub(super) struct Run {
    pub direction: Direction,
    address: u16,
    count: u16,
    /// First word and number of words, in order, where they are not neighbours in the buffer.
    words: Vec<(u16, u16)>,
}

/// The accesses in their order, neighbours joined and long ones split.
pub(super) fn runs(accesses: &[Access]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for access in accesses {
        let (mut address, mut left) = (access.address, access.count);
        let mut first = access.first;
        while left > 0 {
            let joins = |run: &Run| {
                let next = u32::from(run.address) + 4 * u32::from(run.count);
                let room = run.count < u16::from(MAX_COUNT);
                run.direction == access.direction && next == u32::from(address) && room
            };
            if !runs.last().is_some_and(joins) {
                runs.push(Run {
                    direction: access.direction,
                    address,
                    count: 0,
                    words: Vec::new(),
                });
            }
            let Some(run) = runs.last_mut() else { break };
            let count = left.min(u16::from(MAX_COUNT) - run.count);
            run.count += count;
            match run.words.last_mut() {
                Some((start, joined)) if *start + *joined == first => *joined += count,
                _ => run.words.push((first, count)),
            }
            first += count;
            address = address.wrapping_add(4 * count);
            left -= count;
        }
    }
    runs
}

impl Run {
    /// Adds the command; returns where its data are, in the request or the reply.
    pub(super) fn push(
        &self,
        request: &mut RequestBuilder<'_>,
    ) -> Result<Range<usize>, Lbp16Error> {
        let count = self.count as u8;
        match self.direction {
            Direction::Read => request.read(Space::HostMot2, self.address, count),
            Direction::Write => {
                let zeros = [0; MAX_COUNT as usize];
                let zeros = zeros.get(..usize::from(count)).unwrap_or(&[]);
                request.write_doubles(Space::HostMot2, self.address, zeros)
            }
        }
    }

    /// The words of each access, from byte `offset` of the packet on.
    pub(super) fn pieces(&self, offset: usize) -> impl Iterator<Item = Piece> {
        self.words
            .iter()
            .scan(offset as u16, |offset, &(first, count)| {
                let piece = Piece {
                    offset: *offset,
                    first,
                    count,
                };
                *offset += 4 * count;
                Some(piece)
            })
    }
}

/// Words of the buffer, and where their bytes are in a packet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    offset: u16,
    first: u16,
    count: u16,
}

impl Piece {
    pub(super) fn words(self) -> Range<usize> {
        let first = usize::from(self.first);
        first..first + usize::from(self.count)
    }

    pub(super) fn bytes(self) -> Range<usize> {
        let offset = usize::from(self.offset);
        offset..offset + 4 * usize::from(self.count)
    }
}
