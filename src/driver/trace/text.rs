//! A trace as text.

use core::fmt;

use super::{Trace, TraceOutcome, TraceRow, TraceState};
use crate::bus::{Instant, WordDirection};
use crate::sslbp::CsStatus;

impl fmt::Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: the last {} cycles, ", self.board, self.cycles())?;
        match self.state {
            TraceState::Frozen(cause) => writeln!(f, "frozen: {cause}")?,
            TraceState::Ending(..) | TraceState::Recording => f.write_str("still recording\n")?,
        }
        let mut before: Option<&[u32]> = None;
        for (row, words) in self.in_order() {
            writeln!(f, "cycle {}", row.cycle)?;
            for (way, heading) in [
                (
                    WordDirection::Read,
                    ExchangeText("read", row.read, row.read_at),
                ),
                (
                    WordDirection::Write,
                    ExchangeText("write", row.write, row.written_at),
                ),
            ] {
                writeln!(f, "  {heading}")?;
                if row.knows(way) {
                    self.words(f, way, words, before)?;
                }
            }
            before = Some(words);
        }
        Ok(())
    }
}

impl TraceRow {
    /// True if the words of this direction belong to the row's cycle: those of a successful read,
    /// and those of a write that was tried.
    fn knows(&self, way: WordDirection) -> bool {
        match way {
            WordDirection::Read => self.read == TraceOutcome::Done,
            WordDirection::Write | WordDirection::Setting => self.write != TraceOutcome::NotTried,
        }
    }
}

impl Trace {
    /// Prints the words of one direction that differ from those of the previous cycle.
    fn words(
        &self,
        f: &mut fmt::Formatter<'_>,
        way: WordDirection,
        words: &[u32],
        before: Option<&[u32]>,
    ) -> fmt::Result {
        for (n, (column, word)) in self.columns.iter().zip(words).enumerate() {
            let old = before.and_then(|before| before.get(n));
            let is_asked =
                (column.exchanged.way == WordDirection::Read) == (way == WordDirection::Read);
            if !is_asked || old == Some(word) {
                continue;
            }
            let (address, name) = (column.exchanged.address, &column.name);
            write!(f, "    {address:#06X} {word:#010X} {name}")?;
            if way == WordDirection::Read && name.ends_with(" CS") {
                write!(f, ": {}", CsStatus(*word))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

/// Outcome of an exchange, for people.
struct ExchangeText(&'static str, TraceOutcome, Instant);

impl fmt::Display for ExchangeText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(what, outcome, at) = self;
        let micros = at.as_nanos() / 1000;
        let (seconds, micros) = (micros / 1_000_000, micros % 1_000_000);
        match outcome {
            TraceOutcome::NotTried => write!(f, "{what}: not tried"),
            TraceOutcome::Done => write!(f, "{what} at {seconds}.{micros:06} s"),
            TraceOutcome::Failed(why) => {
                write!(f, "{what} at {seconds}.{micros:06} s failed: {why}")
            }
        }
    }
}

/// A trace as a table.
pub(super) struct Csv<'a>(pub &'a Trace);

impl fmt::Display for Csv<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("cycle,read,read_at_ns,write,written_at_ns,read_failed,write_failed")?;
        for column in &self.0.columns {
            let way = match column.exchanged.way {
                WordDirection::Read => "read",
                WordDirection::Write => "write",
                WordDirection::Setting => "setting",
            };
            let (address, name) = (column.exchanged.address, &column.name);
            write!(f, ",{way} {address:#06X} {name}")?;
        }
        writeln!(f)?;
        for (row, words) in self.0.in_order() {
            let (read, write) = (word(row.read), word(row.write));
            let (read_at, written_at) = (row.read_at.as_nanos(), row.written_at.as_nanos());
            let (why, why_not) = (FailureText(row.read), FailureText(row.write));
            write!(f, "{},{read},{read_at},{write},{written_at}", row.cycle)?;
            write!(f, ",{why},{why_not}")?;
            for (column, word) in self.0.columns.iter().zip(words) {
                if row.knows(column.exchanged.way) {
                    write!(f, ",{word:#010X}")?;
                } else {
                    f.write_str(",")?;
                }
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

/// Reason of a failed exchange, in words without a comma; empty if it did not fail.
struct FailureText(TraceOutcome);

impl fmt::Display for FailureText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            TraceOutcome::Failed(why) => write!(f, "{why}"),
            TraceOutcome::NotTried | TraceOutcome::Done => Ok(()),
        }
    }
}

/// Outcome of an exchange, for programs.
fn word(outcome: TraceOutcome) -> &'static str {
    match outcome {
        TraceOutcome::NotTried => "not tried",
        TraceOutcome::Done => "done",
        TraceOutcome::Failed(_) => "failed",
    }
}
