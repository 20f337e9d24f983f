//! What a remote keeps on its way out: replies, and what it did besides.

use crate::wire::{Burst, Nanos};

/// The most bytes a frame holds, CRC included.
pub(super) const MAX_FRAME: usize = 64;
/// The most replies that are on their way at the same time.
const QUEUE: usize = 8;
/// The most events that are kept.
const EVENTS: usize = 16;

/// Something a remote did that is not a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RemoteEvent {
    /// The watchdog has bitten.
    WatchdogBites,
    /// The frame timeout dropped this many characters.
    FrameTimeout(usize),
    /// This reply is not sent.
    DropsReply,
    /// The next reply has a wrong CRC.
    BadCrc,
    /// The next reply has characters behind it.
    Extra,
    /// The next reply lacks characters.
    Short,
    /// The next reply is late.
    Late,
    /// The next reply is a break.
    Break,
}

/// A reply's data.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reply {
    bytes: [u8; MAX_FRAME],
    len: usize,
}

impl Reply {
    pub(super) const EMPTY: Self = Self {
        bytes: [0; MAX_FRAME],
        len: 0,
    };

    pub(super) fn new(data: &[u8]) -> Self {
        let mut reply = Self::EMPTY;
        reply.extend(data);
        reply
    }

    pub(super) fn extend(&mut self, data: &[u8]) {
        for &byte in data {
            if let Some(slot) = self.bytes.get_mut(self.len) {
                *slot = byte;
                self.len += 1;
            }
        }
    }

    pub(super) fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&[])
    }
}

/// Replies that are on their way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Queue {
    bursts: [Option<Burst>; QUEUE],
}

impl Queue {
    /// A reply for which there is no room is lost, as on an overrun line.
    pub(super) fn push(&mut self, burst: Burst) {
        if let Some(slot) = self.bursts.iter_mut().find(|slot| slot.is_none()) {
            *slot = Some(burst);
        }
    }

    pub(super) fn pop(&mut self) -> Option<Burst> {
        let first = self.bursts.first_mut()?.take();
        self.bursts.rotate_left(1);
        first
    }
}

/// The newest events.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Events {
    ring: [Option<(Nanos, RemoteEvent)>; EVENTS],
}

impl Events {
    /// The oldest event gives way when there are too many.
    pub(super) fn push(&mut self, at: Nanos, event: RemoteEvent) {
        if self.ring.iter().all(Option::is_some) {
            self.pop();
        }
        if let Some(slot) = self.ring.iter_mut().find(|slot| slot.is_none()) {
            *slot = Some((at, event));
        }
    }

    pub(super) fn pop(&mut self) -> Option<(Nanos, RemoteEvent)> {
        let first = self.ring.first_mut()?.take();
        self.ring.rotate_left(1);
        first
    }
}
