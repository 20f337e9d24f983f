//! Failed transfers of one remote: LinuxCNC's `fault-count`, and the row of their events.

use super::life::ChangeContext;
use crate::bus::Instant;
use crate::events::{EventKind, EventRow, Repeating};
use crate::sslbp::{Failure, RemoteLabel};

/// Failed transfers of a remote.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Failures {
    /// LinuxCNC's `fault-count`: rises with failures, falls with good transfers.
    count: u32,
    /// The previous transfer failed too.
    has_just_failed: bool,
    /// Current row of failed transfers; its first one has been reported as an event.
    row: EventRow,
    /// The remote is left out of transfers until this time. After a failed transfer the line needs
    /// an idle interval, in which a late reply or extra characters become visible: an immediate
    /// transfer could receive the reply to the one before (FACTS 5.4).
    rest_until: Instant,
}

impl Failures {
    /// LinuxCNC's `fault-count`.
    pub const fn count(&self) -> u32 {
        self.count
    }

    /// True if the remote is left out of a transfer at `now`.
    pub fn rests(&self, now: Instant) -> bool {
        self.rest_until > now
    }

    /// Counts a failed transfer: adds `fault_inc` to the count for each cycle without data, and
    /// lets the line rest. After another failure, the idle interval between the two counts as a
    /// cycle as well. The failure is reported as an event if it is the remote's `own`. Returns the
    /// count.
    pub fn count_failed(
        &mut self,
        at: ChangeContext<'_>,
        remote: RemoteLabel,
        own: Option<Failure>,
    ) -> u32 {
        if let Some(failure) = own {
            let kind = EventKind::TransferFailed { remote, failure };
            self.row.add(at.events, at.now, 1, kind);
        }
        let is_next = core::mem::replace(&mut self.has_just_failed, true);
        let cycles = if is_next { 2 } else { 1 };
        let more = at.policy.fault_inc.saturating_mul(cycles);
        self.rest_until = at.now.after(at.policy.rest);
        self.count = self.count.saturating_add(more);
        self.count
    }

    /// Counts a good transfer.
    pub fn count_good(&mut self, at: ChangeContext<'_>, remote: RemoteLabel) {
        self.has_just_failed = false;
        self.count = self.count.saturating_sub(at.policy.fault_dec);
        let what = Repeating::FailedTransfers { remote };
        self.row.look(at.events, at.now, what);
    }

    /// Ends the row of failed transfers, and reports the number of those without an event of their
    /// own.
    pub fn end_row(&mut self, at: ChangeContext<'_>, remote: RemoteLabel) {
        let what = Repeating::FailedTransfers { remote };
        self.row.end(at.events, at.now, what);
    }

    /// Forgets failures before a restart, or those that were not the remote's own.
    pub const fn forget_count(&mut self) {
        self.count = 0;
    }

    /// Begins anew with a remote that was restarted.
    pub const fn restarted(&mut self) {
        (self.count, self.has_just_failed) = (0, false);
    }

    /// True if failed transfers are not yet made up for by good ones, or if their row is still
    /// open.
    pub const fn are_open(&self) -> bool {
        self.count > 0 || self.has_just_failed || self.row.is_open()
    }

    #[cfg(test)]
    pub const fn set_count(&mut self, count: u32) {
        self.count = count;
    }
}
