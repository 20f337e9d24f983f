//! What went over the bus before an exchange failed: the word `trace=` of the `loadrt` line.

use core::fmt;
use core::time::Duration;

use mesa_hal::bus::{AccessList, Clock, RegisterBus};
use mesa_hal::transport::{BusLog, RecordedEntry, Recording};

use super::{Cycle, since_start};
use crate::ffi::Level;
use crate::table::Memory;

/// Cycles that are recorded after the one in which an exchange fails.
const AFTER: usize = 2;

/// Least time from one log to the next.
const PAUSE: Duration = Duration::from_secs(10);

/// Words of a line: it fits a message of LinuxCNC.
const WORDS: usize = 60;

impl<B: RegisterBus + Clock, M: Memory> Cycle<Recording<B>, M> {
    /// Records what goes over the bus in this number of cycles; 0 for nothing.
    pub fn record(&mut self, cycles: usize) {
        let lists = self.driver.lists();
        let count = |list: &AccessList| {
            let words = list.as_ref().iter().map(|access| usize::from(access.count));
            words.sum::<usize>()
        };
        let words = count(lists.read) + count(lists.write);
        let log = BusLog::new(words * cycles);
        let log = log.freezing_on(RecordedEntry::is_fault, words * AFTER);
        self.driver.bus_mut().log = log;
    }

    /// Prints the next line of what went over the bus before an exchange failed. At the end, and
    /// [`PAUSE`] after the failure, it is recorded again.
    ///
    /// # Real time
    /// One line. No allocation.
    pub fn print_bus(&mut self) {
        let Some(cause) = self.driver.bus().log.cause() else {
            return;
        };
        let count = self.print_exchange(cause);
        self.printed += count;
        let failed = since_start(cause.at());
        if count == 0 && self.now().saturating_sub(failed) >= PAUSE {
            self.printed = 0;
            self.driver.bus_mut().log.resume();
        }
    }

    /// Prints the next entries; returns their number.
    fn print_exchange(&mut self, cause: RecordedEntry) -> usize {
        let log = &self.driver.bus().log;
        let total = log.entries().len();
        if self.printed == 0 {
            let what: &dyn fmt::Display = match &cause {
                RecordedEntry::Failed { kind, .. } => kind,
                _ => &"writes were lost",
            };
            let heading = format_args!("what went over the bus, {total} entries: {what}");
            self.log.line(Level::Note, heading);
        }
        let mut entries = log.entries().skip(self.printed);
        let line = ExchangeLine(entries.clone());
        let Some(first) = entries.next() else {
            return 0;
        };
        self.log.line(Level::Note, format_args!("bus {line}"));
        let others = entries.position(|entry| entry.at() != first.at());
        let count = others.map_or(total - self.printed, |others| others + 1);
        count.min(WORDS)
    }
}

/// The first exchange of these entries, in a line.
struct ExchangeLine<I>(I);

impl<'a, I: Iterator<Item = &'a RecordedEntry> + Clone> fmt::Display for ExchangeLine<I> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut entries = self.0.clone().take(WORDS).peekable();
        let Some(at) = entries.peek().map(|entry| entry.at()) else {
            return Ok(());
        };
        let micros = since_start(at).as_micros();
        write!(f, "{}.{:06}:", micros / 1_000_000, micros % 1_000_000)?;
        let mut before = None;
        for entry in entries.take_while(|entry| entry.at() == at) {
            let (direction, address, word) = match *entry {
                RecordedEntry::Read { address, word, .. } => ("read", address, word),
                RecordedEntry::Written { address, word, .. } => ("write", address, word),
                RecordedEntry::Failed { kind, .. } => {
                    write!(f, " failed: {kind}")?;
                    continue;
                }
                RecordedEntry::LostWrites { count, .. } => {
                    write!(f, " writes lost before: {count}")?;
                    continue;
                }
                _ => continue,
            };
            if before.replace(direction) != Some(direction) {
                write!(f, " {direction}")?;
            }
            write!(f, " {address:04X}={word:08X}")?;
        }
        Ok(())
    }
}
