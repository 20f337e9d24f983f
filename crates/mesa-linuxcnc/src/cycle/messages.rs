//! The messages of a board's cycle.

use core::time::Duration;

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{BoardState, EventKind};
use mesa_hal::hal::{Age, PinId};

use super::{Cycle, since_start};
use crate::ffi::Level;
use crate::rearm::{BOARD, RemoteMask};
use crate::report::{Flags, OutputState, Report};
use crate::table::Memory;

/// Longer than the start of a remote takes, after a fault of the board too.
const START: Duration = Duration::from_secs(1);

impl<B: RegisterBus + Clock, M: Memory> Cycle<B, M> {
    /// The flags that keep the outputs off, also if HAL does not have them yet.
    fn flags(&self) -> Flags {
        let board = self.driver.pins().group_state(self.driver.group());
        let is_pending = board.is_some_and(|state| state.rearm_pending);
        // The user may have cleared the flag of a fault that is not over.
        let keeps_off = |flag: Option<PinId>| {
            !is_pending || flag.is_some_and(|id| self.memory.load(id.index()) != 0)
        };
        let [has_bit, io_error] = self.acknowledged.map(keeps_off);
        let state = self.driver.board_state();
        let is_down = !matches!(state, BoardState::Running | BoardState::WatchdogBitten);
        Flags {
            has_bit: state == BoardState::WatchdogBitten && has_bit,
            io_error: (is_down && io_error) || self.has_io_error(),
        }
    }

    /// State of the outputs of a remote by its number, or of the board.
    fn output_state(&self, number: usize) -> OutputState {
        let state = self.driver.pins().group_state(self.group(number));
        if state.is_some_and(|state| state.armed || state.rearm_pending)
            || self.rearming.follow_by_themselves(1 << number)
        {
            OutputState::Follow
        } else {
            OutputState::Wait
        }
    }

    pub(super) fn say_events(&mut self) {
        while let Some(event) = self.events.next() {
            // Arming at the load is no news.
            if event.cycle <= 1 && matches!(event.kind, EventKind::Rearmed { .. }) {
                continue;
            }
            let remote = event.kind.remote().and_then(|id| self.names.number(id));
            let board = self.driver.pins().group_state(self.driver.group());
            let report = Report {
                kind: event.kind,
                names: &self.names,
                flags: self.flags(),
                outputs: self.output_state(remote.unwrap_or(BOARD)),
                silence: board.map_or(Age::NEVER, |state| state.age),
            };
            if let Some(level) = report.level() {
                let at = since_start(event.at);
                self.log.report(at, level, format_args!("{report}"));
            }
        }
    }

    /// Says that the machine is on and outputs are not, of which LinuxCNC shows nothing.
    pub(super) fn say_left_off(&mut self, remotes: RemoteMask) {
        let now = self.now();
        let flags = self.flags();
        if flags.any() {
            let text = self.names.all_off(flags);
            return self.log.report(now, Level::Error, format_args!("{text}"));
        }
        for number in (0..self.remotes.len()).chain([BOARD]) {
            let waits = remotes >> number & 1 != 0;
            let text = self.names.left_off(number, self.is_offline(number), waits);
            if let Some(text) = text {
                self.log.report(now, Level::Error, format_args!("{text}"));
            }
        }
    }

    /// True for a remote that has not run for longer than its start takes.
    fn is_offline(&self, number: usize) -> bool {
        let state = self.driver.pins().group_state(self.group(number));
        state.is_some_and(|state| !state.armed && state.age.time > START)
    }

    /// Says once that the DPLL cannot follow the thread, and once that a timer is set nevertheless.
    pub(super) fn say_dpll(&mut self) {
        if let Some((level, text)) = self.dpll.news(&self.memory) {
            let now = since_start(self.driver.bus_mut().now());
            self.log.print(now, level, format_args!("{text}"));
        }
    }

    /// Says once that too many packets are lost.
    pub(super) fn say_losses(&mut self) {
        let statistics = self.driver.statistics();
        let total = statistics
            .read_errors
            .saturating_add(statistics.lost_writes);
        if let Some(report) = self.losses.cycle(total) {
            let now = self.now();
            let board = self.driver.name();
            self.log.print(
                now,
                Level::Error,
                format_args!(
                    "{report}; check the cable, the network card, and the latency of this computer \
                     ({board}.packet-error-total)"
                ),
            );
        }
    }
}
