//! Events, statistics and reasons, checked against the true events.

use mesa_hal::driver::{BoardState, Driver, Event, EventKind, Events, OfflineReason, Positions};
use mesa_hal_sim::{FaultKind, FaultPlace};

use super::super::application::Application;
use super::super::journal::{self, What};
use super::super::network::Host;
use super::super::oracle::{Checked, Promise, ensure};
use super::super::plan::{Planned, Stranger};
use super::Scenario;

/// The application's own counts, and the true events since the driver started.
#[derive(Debug, Default)]
pub(super) struct Told {
    events: Option<Events>,
    /// Those that were read, and not judged yet.
    heard: Vec<Event>,
    /// Number of resets among all events.
    pub(super) resets_heard: u32,
    /// The lost positions among all events since they were judged: their kind, the number of bit 0,
    /// and the mask.
    pub(super) unsure: Vec<(Positions, u32, u32)>,
    state: Option<BoardState>,
    reads: u64,
    failed_reads: u64,
    writes: u64,
    failed_writes: u64,
    /// Bites and resets of the board.
    bites: u64,
    resets: u64,
    /// Fault bits that each remote has had.
    faults: Vec<u8>,
}

/// Packets of the other program.
#[derive(Debug, Default)]
pub(super) struct Others {
    pub(super) cycles: u64,
    pub(super) sent: u64,
    told: u64,
}

impl Told {
    /// A new driver reports from here on.
    pub(super) fn begin<B: Host>(&mut self, driver: &Driver<B>) {
        *self = Self {
            events: Some(driver.events()),
            state: Some(driver.board_state()),
            bites: self.bites,
            resets: self.resets,
            faults: std::mem::take(&mut self.faults),
            ..Self::default()
        };
    }

    /// Reads the events of the driver.
    pub(super) fn hear(&mut self) {
        for event in self.events.iter_mut().flatten() {
            if let EventKind::PositionUnsure { of, first, mask } = event.kind {
                self.unsure.push((of, first, mask));
            }
            self.resets_heard += u32::from(event.kind == EventKind::BoardReset);
            self.heard.push(event);
        }
    }

    pub(super) fn happened(&mut self, event: &journal::Event) {
        match event.what {
            What::Bite => self.bites += 1,
            What::Reset => self.resets += 1,
            What::Faults(remote, faults) => {
                let most = self.faults.len().max(remote + 1);
                self.faults.resize(most, 0);
                self.faults[remote] |= faults;
            }
            _ => {}
        }
    }

    /// The driver has read and written by itself.
    pub(super) fn recount<B: Host>(&mut self, driver: &Driver<B>) {
        let counted = driver.statistics();
        (self.reads, self.writes) = (counted.reads, counted.writes);
        (self.failed_reads, self.failed_writes) = (counted.read_errors, counted.write_errors);
    }

    pub(super) fn read(&mut self, is_good: bool) {
        self.reads += 1;
        self.failed_reads += u64::from(!is_good);
    }

    pub(super) fn written(&mut self, is_good: bool) {
        self.writes += 1;
        self.failed_writes += u64::from(!is_good);
    }
}

impl Scenario {
    /// Adds the packets of another program that a read has reported.
    pub(super) fn hears_others(&mut self, count: u32) -> Checked {
        let now = self.sim.now();
        self.others.told += u64::from(count);
        let Others { sent, told, .. } = self.others;
        // A board that was reset restarts its count, and duplicate packets count twice.
        let is_sound = self.plan.spares_the_board() || !self.plan.extras.second_master;
        ensure(told <= sent || !is_sound, Promise::Told, now, || {
            format!("{told} packets of another program, which has sent {sent}")
        })
    }

    /// Checks that a program that writes all the time is detected.
    pub(super) fn others_are_told(&self) -> Checked {
        let wires =
            |fault: &Planned| matches!(fault.kind.place(), FaultPlace::Wire | FaultPlace::Remote);
        let is_sound = self.plan.faults.iter().all(wires) && !self.plan.has_deeds();
        let must = self.plan.more.master_stays && is_sound;
        let Others { sent, told, .. } = self.others;
        ensure(told > 0 || !must, Promise::Told, self.sim.now(), || {
            format!("the other program has sent {sent} packets, which no statistic counts")
        })
    }

    /// Compares the reports of the driver with the true events, at the end of a cycle.
    pub(super) fn told_truly<B: Host>(
        &mut self,
        driver: &Driver<B>,
        application: &mut Application,
    ) -> Checked {
        let now = self.sim.now();
        if self.what_is_told.reads.is_multiple_of(16)
            && let Some(other) = application.shows_another(driver)
        {
            ensure(false, Promise::Told, now, || other)?;
        }
        let counted = driver.statistics();
        let found = (
            counted.reads,
            counted.writes,
            counted.read_errors,
            counted.write_errors,
        );
        let told = &mut self.what_is_told;
        told.hear();
        let expected = (
            told.reads,
            told.writes,
            told.failed_reads,
            told.failed_writes,
        );
        ensure(found == expected, Promise::Told, now, || {
            format!("{expected:?} reads, writes, and failed ones, but statistics say {found:?}")
        })?;
        let state = driver.board_state();
        let before = told.state.replace(state);
        let events = std::mem::take(&mut told.heard);
        let is_told = |kind: EventKind| events.iter().any(|event| event.kind == kind);
        let expected = match state {
            BoardState::WatchdogBitten => Some(EventKind::WatchdogBitten),
            BoardState::Reset => Some(EventKind::BoardReset),
            BoardState::BusDown => Some(EventKind::BusDown),
            BoardState::OtherFirmware => Some(EventKind::OtherFirmware),
            _ => None,
        };
        if let Some(kind) = expected.filter(|_| before != Some(state)) {
            ensure(is_told(kind), Promise::Told, now, || {
                format!("{kind:?} is not told: {events:?}")
            })?;
        }
        let has = |kind| self.plan.faults.iter().any(|fault| fault.kind == kind);
        // An older setting that arrives late looks like one left by a reset.
        let is_late = has(FaultKind::NetworkLate) || has(FaultKind::NetworkDuplicate);
        // A late reply can be one of another kind, whose first byte is no fault byte. A line that
        // is released within a character gives one more before the reply, which the CRC of 8 bits
        // takes for good once in 256 times.
        let is_other = [
            FaultKind::WireSwapped,
            FaultKind::WireLate,
            FaultKind::WireLow,
        ]
        .into_iter()
        .any(has);
        for event in &events {
            let is_true = match event.kind {
                EventKind::WatchdogBitten => told.bites > 0,
                // A bite that comes sooner than possible is taken for the effect of a reset.
                EventKind::BoardReset => told.resets + told.bites > 0 || is_late,
                EventKind::OtherMaster { .. } => self.plan.extras.second_master,
                EventKind::OtherFirmware => self.plan.extras.stranger != Stranger::None,
                EventKind::RemoteOffline { remote, reason } => {
                    let remote = application.number(remote);
                    let faults = remote.and_then(|remote| told.faults.get(remote));
                    // Faults reported by the other card are not the remote's own.
                    is_other || reason_is_true(reason, faults.copied().unwrap_or_default())
                }
                _ => true,
            };
            ensure(is_true, Promise::Told, now, || {
                format!("{event} is told, and has not happened")
            })?;
        }
        self.first_reasons(driver, application)
    }

    /// The first reason of a remote whose only fault is one that it reports itself, on a sound
    /// wire, is that fault.
    fn first_reasons<B: Host>(&self, driver: &Driver<B>, application: &Application) -> Checked {
        let [fault] = &self.plan.faults[..] else {
            return Ok(());
        };
        let is_reported = fault.kind.fault_bit().is_some() && !fault.in_build && self.is_armed;
        if !is_reported || self.plan.has_deeds() {
            return Ok(());
        }
        let now = self.sim.now();
        for (number, first) in application.first_faults(driver) {
            let Some(reason) = first else { continue };
            let fits = number == fault.target && fits(fault.kind, reason);
            ensure(fits, Promise::Told, now, || {
                format!("the first reason of remote {number} is '{reason}'")
            })?;
        }
        Ok(())
    }
}

/// True if a remote that has had these faults can have gone offline for this reason.
fn reason_is_true(reason: OfflineReason, had: u8) -> bool {
    match reason {
        OfflineReason::Watchdog => had & 0x01 != 0,
        OfflineReason::IllegalMode => had & 0x40 != 0,
        OfflineReason::FieldPower(faults) | OfflineReason::Reported(faults) => {
            faults.bits() & !had == 0
        }
        _ => true,
    }
}

fn fits(kind: FaultKind, reason: OfflineReason) -> bool {
    match reason {
        OfflineReason::Watchdog => kind == FaultKind::RemoteWatchdog,
        OfflineReason::IllegalMode => kind == FaultKind::RemoteIllegalMode,
        OfflineReason::FieldPower(faults) | OfflineReason::Reported(faults) => {
            kind.fault_bit().is_some_and(|bit| faults.contains(bit))
        }
        _ => false,
    }
}
