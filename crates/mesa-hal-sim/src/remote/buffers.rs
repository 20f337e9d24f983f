//! Output buffers of a remote: replies and events.

use crate::wire::{Burst, Nanos};

/// Maximum length of a frame in bytes, CRC included.
pub(super) const MAX_FRAME: usize = 64;
/// Maximum number of replies in flight.
const QUEUE: usize = 8;
/// Maximum number of stored events.
const EVENTS: usize = 16;

/// An action of a remote other than a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RemoteEvent {
    /// The watchdog has bitten.
    WatchdogBites,
    /// The frame timeout dropped this number of characters.
    FrameTimeout(usize),
    /// The reply is not sent.
    DropsReply,
    /// The next reply has a wrong CRC.
    BadCrc,
    /// The next reply is followed by extra characters.
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
pub(super) struct ReplyBuffer {
    bytes: [u8; MAX_FRAME],
    len: usize,
}

impl ReplyBuffer {
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

/// Replies in flight.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Queue {
    bursts: [Option<Burst>; QUEUE],
}

impl Queue {
    /// Queues a reply; without room it is lost, like on an overrun line.
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
pub(super) struct RemoteEvents {
    ring: [Option<(Nanos, RemoteEvent)>; EVENTS],
}

impl RemoteEvents {
    /// Stores an event; the oldest one is dropped if the buffer is full.
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
