//! Commands that pass through a queue, and reach the outputs some cycles later.

use std::collections::VecDeque;

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::Driver;
use mesa_hal::hal::{PinId, Role};
use mesa_hal::runner::{CommandQueue, CommandSender, SnapshotReader, SnapshotWriter};

use super::super::plan::Card;
use super::pins::Remote;
use crate::common::chance::Chance;

/// More than a cycle takes, so that some wait.
const CAPACITY: usize = 400;

/// A queue of commands, and the application's record of it.
pub(super) struct Queue {
    commands: CommandQueue,
    sender: CommandSender,
    waiting: VecDeque<Waiting>,
    snapshots: (SnapshotWriter, SnapshotReader),
}

/// A command that was sent.
struct Waiting {
    /// Index of its remote in the application.
    remote: usize,
    output: usize,
    on: bool,
    /// Number of times that its remote had been disarmed.
    after: u64,
}

/// True if the outputs of a card are commanded through the queue.
pub(super) const fn is_queued(card: Card) -> bool {
    !matches!(card, Card::Analog)
}

impl Queue {
    pub(super) fn new<B: RegisterBus + Clock>(driver: &Driver<B>) -> Self {
        let queue = CommandQueue::new(driver, CAPACITY);
        Self {
            sender: queue.sender(),
            commands: queue,
            waiting: VecDeque::new(),
            snapshots: {
                let writer = SnapshotWriter::new(driver);
                let reader = writer.reader();
                (writer, reader)
            },
        }
    }

    /// Lets the cycle take the commands that are due. A command from before its remote was disarmed
    /// has no effect, even if the remote was re-armed since; but a command that switches an output
    /// off always has.
    pub(super) fn take<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        remotes: &mut [Remote],
    ) {
        let taken = self.commands.take(driver);
        for sent in self.waiting.drain(..taken as usize) {
            let remote = &mut remotes[sent.remote];
            let is_meant = remote.is_armed && sent.after == remote.disarmed;
            let bit = 1 << sent.output;
            if !sent.on {
                remote.set.bits &= !bit;
            } else if is_meant {
                remote.set.bits |= bit;
            }
        }
    }

    /// Compares the values published to another thread with those of the cycle; returns the first
    /// input that differs.
    pub(super) fn shows_another<B: RegisterBus + Clock>(
        &mut self,
        driver: &Driver<B>,
    ) -> Option<String> {
        let (writer, reader) = &mut self.snapshots;
        let published = writer.publish(driver);
        let Ok(seen) = reader.read() else {
            return Some(format!("nothing is shown: {published:?}"));
        };
        // Freshness is measured on the host's own clock, which a busy computer can stop.
        if !seen.is_fresh() {
            return None;
        }
        let pins = driver.pins();
        let is_input = |id: &PinId| {
            pins.info_of(*id)
                .is_some_and(|info| info.role == Role::Input)
        };
        pins.ids().filter(is_input).find_map(|id| {
            let (own, shown) = (pins.read_any(id), seen.read_any(id)?);
            let is_same = own.valid == shown.valid
                && own.age.cycles == shown.age.cycles
                && (!own.valid || own.value == shown.value);
            (!is_same).then(|| format!("{:?}: {own:?}, shown {shown:?}", pins.info_of(id)))
        })
    }

    /// Sends commands for the cycles to come: occasionally many more than one takes.
    pub(super) fn send(&mut self, remotes: &[Remote], chance: &mut Chance) {
        let count = if chance.one_in(12) { 250 } else { 10 };
        let queued = |remote: &Remote| is_queued(remote.card);
        if !remotes.iter().any(queued) {
            return;
        }
        for _ in 0..chance.below(count) {
            let number = chance.below(remotes.len() as u64) as usize;
            let remote = &remotes[number];
            if !queued(remote) {
                continue;
            }
            let output = chance.below(remote.outputs.len() as u64) as usize;
            let on = !chance.one_in(4);
            if self.sender.set(remote.outputs[output], on).is_ok() {
                self.waiting.push_back(Waiting {
                    remote: number,
                    output,
                    on,
                    after: remote.disarmed,
                });
            }
        }
    }
}
