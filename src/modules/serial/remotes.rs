//! The remotes of a port, with the channels on which they are in a certain state.

use alloc::vec::Vec;

use super::RemoteWatchdog;
use super::life::{ChangeContext, Life, LifeChange};
use super::remote::Remote;
use super::slot::RemoteSlot;
use crate::bus::Instant;
use crate::events::EventSink;
use crate::settings::FaultPolicy;
use crate::sslbp::{Channel, ChannelMask};

/// The remotes of a port. Their lives change in [`change`](Self::change) alone.
#[derive(Debug)]
pub(super) struct Remotes {
    all: Vec<Remote>,
    events: EventSink,
    /// When they go offline, and when they are tried again.
    pub policy: FaultPolicy,
    /// Channels with a remote.
    configured: ChannelMask,
    /// Channels that transfer.
    running: ChannelMask,
    /// Channels with failures that good transfers have not made up for, or with an open row of
    /// failures.
    with_failures: ChannelMask,
    /// Channels that run, and were offline since they were armed last.
    awaiting_rearm: ChannelMask,
}

impl Remotes {
    pub fn new(all: Vec<Remote>, events: EventSink, policy: FaultPolicy) -> Self {
        let mut remotes = Self {
            configured: all.iter().map(Remote::channel).collect(),
            all,
            events,
            policy,
            running: ChannelMask::NONE,
            with_failures: ChannelMask::NONE,
            awaiting_rearm: ChannelMask::NONE,
        };
        remotes.update();
        remotes
    }

    /// Changes the remotes on these channels, and reports what they report. Returns the channels on
    /// which a [new fault](LifeChange::has_new_fault) was found.
    pub fn change(
        &mut self,
        channels: ChannelMask,
        now: Instant,
        mut change: impl FnMut(&mut Remote, ChangeContext<'_>) -> LifeChange,
    ) -> ChannelMask {
        let (events, policy) = (&self.events, &self.policy);
        let at = ChangeContext {
            now,
            policy,
            events,
        };
        let mut new_faults = ChannelMask::NONE;
        for remote in &mut self.all {
            let channel = remote.channel();
            if !channels.contains(channel) {
                continue;
            }
            let LifeChange {
                event,
                has_new_fault,
            } = change(remote, at);
            if let Some(event) = event {
                events.report(now, event.of(remote.label()));
            }
            if has_new_fault {
                new_faults = new_faults.union(channel.mask());
            }
        }
        self.update();
        new_faults
    }

    fn update(&mut self) {
        self.running = self.mask(|remote| remote.life.is_running());
        self.with_failures = self.mask(|remote| remote.failures.are_open());
        self.awaiting_rearm =
            self.mask(|remote| remote.life.is_running() && remote.life.first_fault().is_some());
    }

    /// The channels for which `condition` holds.
    pub fn mask(&self, condition: impl Fn(&Remote) -> bool) -> ChannelMask {
        let remotes = self.all.iter().filter(|remote| condition(remote));
        remotes.map(Remote::channel).collect()
    }

    pub const fn configured(&self) -> ChannelMask {
        self.configured
    }

    pub const fn running(&self) -> ChannelMask {
        self.running
    }

    pub const fn with_failures(&self) -> ChannelMask {
        self.with_failures
    }

    pub const fn awaiting_rearm(&self) -> ChannelMask {
        self.awaiting_rearm
    }

    pub fn iter(&self) -> core::slice::Iter<'_, Remote> {
        self.all.iter()
    }

    /// The remote on a channel.
    pub fn get(&self, channel: Channel) -> Option<&Remote> {
        self.all.iter().find(|remote| remote.channel() == channel)
    }

    /// The slots of all remotes, with their lives.
    pub fn slots(&mut self) -> impl Iterator<Item = (&Life, &mut RemoteSlot)> {
        let all = self.all.iter_mut();
        all.map(|remote| (&remote.life, &mut remote.slot))
    }

    /// The slot of the remote on a channel, and its watchdog.
    pub fn slot(&mut self, channel: Channel) -> Option<(&mut RemoteSlot, &mut RemoteWatchdog)> {
        let mut all = self.all.iter_mut();
        let remote = all.find(|remote| remote.channel() == channel)?;
        Some((&mut remote.slot, &mut remote.watchdog))
    }

    /// The sink of the remotes' events.
    pub const fn events(&self) -> &EventSink {
        &self.events
    }
}
