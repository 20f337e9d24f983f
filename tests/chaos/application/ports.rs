//! Ports and remotes: switching them, and their states as reported by the driver.

use mesa_hal::RemoteId;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{Driver, OfflineReason, RemoteState, RemoteWatchdog, SerialPort};
use mesa_hal::hal::GroupState;

use super::Application;
use super::pins::Remote;

/// Data younger than this number of cycles count as new.
const NEWS: u64 = 4;

impl Application {
    /// Switches a port off, or on again; returns true if it is on.
    pub fn switch_port<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        port: usize,
    ) -> bool {
        let Some(run) = self.runs.get(port).copied() else {
            return true;
        };
        let is_on = !driver.pins().commanded(run);
        driver.pins_mut().set(run, is_on);
        is_on
    }

    /// Requests the time of the watchdog of all remotes of a port: they are started in setup mode
    /// before the port runs again the next time. Returns true if all of them take it.
    pub fn request_watchdogs<B: RegisterBus + Clock>(
        driver: &mut Driver<B>,
        port: usize,
        millis: u32,
    ) -> bool {
        let remotes = driver.ports().get(port).into_iter();
        let remotes = remotes.flat_map(SerialPort::remotes);
        let channels: Vec<_> = remotes
            .map(|remote| remote.started.channel.index())
            .collect();
        let mut are_taken = true;
        for channel in channels {
            // A time that the period cannot feed is refused.
            let remote = (port as u8, channel);
            let taken = driver.request_remote_parameter(remote, "nvwatchdogtimeout", millis);
            are_taken &= taken.is_ok();
        }
        are_taken
    }

    /// True if a port is commanded off.
    pub fn is_port_off<B: RegisterBus + Clock>(&self, driver: &Driver<B>, port: usize) -> bool {
        let run = self.runs.get(port);
        run.is_some_and(|run| !driver.pins().commanded(*run))
    }

    /// Remotes by number, each with true if it is known to have a watchdog.
    pub fn watchdogs<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
    ) -> impl Iterator<Item = (usize, bool)> {
        self.remotes.iter().filter_map(|remote| {
            let (port, channel) = remote.place;
            let status = driver.ports().get(port)?.remote(channel)?;
            Some((remote.number, status.watchdog.time().is_some()))
        })
    }

    /// The remotes whose watchdog times the driver has not read. It assumes the usual time, which
    /// may be too short for their watchdogs to bite.
    pub fn assumed_watchdogs<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Vec<usize> {
        let remotes = self.remotes.iter();
        let assumed = remotes.filter(|remote| {
            let (port, channel) = remote.place;
            let port = driver.ports().get(port);
            let status = port.and_then(|port| port.remote(channel));
            status.is_some_and(|status| status.watchdog == RemoteWatchdog::Assumed)
        });
        assumed.map(|remote| remote.number).collect()
    }

    /// Switches all ports on.
    pub fn switch_ports_on<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>) {
        for run in &self.runs {
            driver.pins_mut().set(*run, true);
        }
    }

    /// Running remotes, by number.
    pub fn running<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
    ) -> impl Iterator<Item = (usize, GroupState)> {
        let runs = |remote: &&Remote| remote.state(driver) == Some(RemoteState::Running);
        self.remotes.iter().filter(runs).filter_map(|remote| {
            let state = driver.pins().group_state(remote.group)?;
            Some((remote.number, state))
        })
    }

    /// The numbers of the remotes that the driver has started.
    pub fn numbers(&self) -> impl Iterator<Item = usize> {
        self.remotes.iter().map(|remote| remote.number)
    }

    /// The number of a remote.
    pub fn number(&self, id: impl Into<RemoteId>) -> Option<usize> {
        let id = id.into();
        let at = |remote: &&Remote| remote.id() == id;
        self.remotes.iter().find(at).map(|remote| remote.number)
    }

    /// The first reason of each remote for going offline, since it was re-armed.
    pub fn first_faults<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
    ) -> impl Iterator<Item = (usize, Option<OfflineReason>)> {
        self.remotes.iter().filter_map(|remote| {
            let (port, channel) = remote.place;
            let status = driver.ports().get(port)?.remote(channel)?;
            Some((remote.number, status.first_fault))
        })
    }

    /// `Ok` if all remotes have just transferred; otherwise the one that has not.
    pub fn all_have_news<B: RegisterBus + Clock>(&self, driver: &Driver<B>) -> Result<(), String> {
        let age = |remote: &Remote| {
            driver
                .pins()
                .group_state(remote.group)
                .map(|state| state.age)
        };
        let is_old = |remote: &&Remote| age(remote).is_none_or(|age| age.cycles > NEWS);
        self.remotes.iter().find(is_old).map_or(Ok(()), |remote| {
            Err(format!("remote {}: {:?}", remote.number, age(remote)))
        })
    }

    /// State of a remote: armed, valid, and the age of its inputs.
    pub fn remote_state<B: RegisterBus + Clock>(
        &self,
        driver: &Driver<B>,
        number: usize,
    ) -> Option<mesa_hal::hal::GroupState> {
        let remote = self.remotes.iter().find(|remote| remote.number == number)?;
        driver.pins().group_state(remote.group)
    }
}
