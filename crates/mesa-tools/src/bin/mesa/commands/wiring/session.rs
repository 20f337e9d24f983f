//! The dialog: one terminal after the other.

use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::time::{Duration, Instant};

use mesa_hal::bus::{Clock, HostClock};
use mesa_hal::hal::{AnyValue, PinId};
use mesa_hal::runner::Snapshot;
use mesa_tools::diagnosis::wiring::{
    HANDS_OFF, PointKind, WiringCheck, WiringJudgement, WiringMessage, WiringVerdict,
};

use super::machine::{self, Driven, Machine};
use super::report::{Input, Item, Mark, Names, Not, Outcome, What, text};
use crate::board::reason::Reason;
use crate::ui::context::Context;
use crate::ui::input;
use crate::ui::output::complain;
use mesa_tools::Counted;

/// Interval of the checks of inputs, keys and signals.
const LOOK: Duration = Duration::from_millis(5);

/// Time within which remotes recover after a start or a fault.
const COMES_BACK: Duration = Duration::from_secs(1);

/// Typed lines.
pub struct Lines {
    lines: Receiver<String>,
    /// True if a person types the lines, and ends the check by closing the input.
    is_terminal: bool,
}

impl Lines {
    pub fn of_standard_input(is_terminal: bool) -> Self {
        let (sender, lines) = sync_channel(1);
        input::read_lines(move |line| sender.send(line.trim().to_owned()).is_ok());
        Self { lines, is_terminal }
    }
}

/// Input of the person.
enum Typed {
    Nothing,
    Skip,
    Back,
    Text(String),
}

/// Direction in which the check continues.
enum Next {
    Forward,
    Back,
}

/// The dialog with the person.
pub struct Dialog {
    pub lines: Lines,
    /// Time to wait at each terminal.
    pub timeout: Option<Duration>,
    /// True if outputs are driven without a question.
    pub is_agreed: bool,
}

/// The terminals of a board to check.
pub struct Terminals {
    pub check: WiringCheck,
    pub items: Vec<Item>,
}

pub struct Session<'a> {
    pub context: &'a Context,
    pub machine: &'a Machine,
    pub check: WiringCheck,
    pub board: String,
    pub items: Vec<Item>,
    dialog: Dialog,
    clock: HostClock,
    seen: Option<Snapshot>,
}

impl<'a> Session<'a> {
    pub fn new(
        context: &'a Context,
        machine: &'a Machine,
        terminals: Terminals,
        dialog: Dialog,
        board: String,
    ) -> Self {
        Self {
            context,
            machine,
            check: terminals.check,
            board,
            items: terminals.items,
            dialog,
            clock: HostClock::new(),
            seen: None,
        }
    }

    pub fn names(&self) -> Names<'_> {
        Names {
            board: &self.board,
            points: self.check.points(),
        }
    }

    /// Goes through all terminals; calls `keep` after each judgement.
    pub fn run(&mut self, keep: impl Fn(&Self)) -> Outcome {
        match self.go(keep) {
            Ok(()) => Outcome::Done,
            Err(outcome) => outcome,
        }
    }

    fn go(&mut self, keep: impl Fn(&Self)) -> Result<(), Outcome> {
        complain(format_args!(
            "{}. Enter skips one, b and Enter goes back, q and Enter ends with the report.",
            Counted(self.items.len() as u64, "terminal")
        ));
        complain("Hands off for a moment: what changes now changes by itself.");
        let begun = Instant::now();
        while begun.elapsed() < HANDS_OFF {
            self.pass()?;
        }
        let mut at = 0;
        while let Some(what) = self.items.get(at).map(|item| item.what) {
            let next = match what {
                What::Input(input) => self.input(at, input)?,
                What::Output(pin) => self.output(at, pin)?,
            };
            keep(self);
            at = match next {
                Next::Forward => at + 1,
                Next::Back => at.saturating_sub(1),
            };
        }
        Ok(())
    }

    /// Waits for one interval. Returns what was typed, and the judgement if there is one.
    fn pass(&mut self) -> Result<(Typed, Option<WiringJudgement>), Outcome> {
        if self.context.stop.signal().is_some() {
            return Err(Outcome::Stopped);
        }
        if self.machine.reader.has_ended() {
            return Err(Outcome::Failed);
        }
        std::thread::sleep(LOOK);
        let judgement = self.look();
        let lines = &self.dialog.lines;
        let typed = match lines.lines.try_recv() {
            Ok(line) => match line.as_str() {
                "" => Typed::Skip,
                "b" | "B" => Typed::Back,
                "q" | "Q" => return Err(Outcome::Ended),
                _ => Typed::Text(line),
            },
            Err(TryRecvError::Disconnected) if lines.is_terminal => {
                return Err(Outcome::Ended);
            }
            Err(_) => Typed::Nothing,
        };
        Ok((typed, judgement))
    }

    fn look(&mut self) -> Option<WiringJudgement> {
        let read = match &mut self.seen {
            Some(seen) => self.machine.reader.read_into(seen),
            None => self.machine.reader.read().map(|seen| {
                self.seen = Some(seen);
            }),
        };
        // A failed read is repeated after the next interval. A snapshot that was half read mixes
        // cycles, and is discarded.
        if read.is_err() {
            self.seen = None;
        }
        let seen = self.seen.as_ref()?;
        let now = self.clock.now();
        let judgement = self.check.observe(now, |pin| seen.read_any(pin)?.ok());
        while let Some((pin, on)) = self.check.index_enable() {
            self.machine.set_index_enable(pin, on);
        }
        judgement
    }

    fn say(&self, at: usize, what: &str) {
        if let Some(item) = self.items.get(at) {
            let name = self.names().info(&item.info);
            let count = self.items.len();
            complain(format_args!("[{}/{count}] {name}: {what}", at + 1));
        }
    }

    fn reason(&self, at: usize) -> Reason {
        let found = self.seen.as_ref().zip(self.items.get(at));
        found.map_or_else(
            || Reason::new("the last cycle was not read in time"),
            |(seen, item)| machine::reason(seen, &item.info),
        )
    }

    fn is_timeout(&self, since: Instant) -> bool {
        self.dialog
            .timeout
            .is_some_and(|timeout| since.elapsed() >= timeout)
    }

    /// Checks an input.
    fn input(&mut self, at: usize, input: Input) -> Result<Next, Outcome> {
        let begun = Instant::now();
        self.check.ask(input.point);
        loop {
            let (typed, judgement) = self.pass()?;
            while let Some(news) = self.check.news() {
                self.tell(at, input, news);
            }
            if let Some(found) = judgement {
                self.judged(at, found);
                return Ok(Next::Forward);
            }
            let is_skipped = matches!(typed, Typed::Skip);
            match typed {
                Typed::Back => {
                    self.check.give_up(true);
                    return Ok(Next::Back);
                }
                Typed::Text(_) => complain("  Enter skips, b goes back, q ends with the report"),
                Typed::Skip | Typed::Nothing => {}
            }
            if is_skipped || self.is_timeout(begun) {
                if let Some(found) = self.check.give_up(is_skipped) {
                    self.judged(at, found);
                }
                return Ok(Next::Forward);
            }
        }
    }

    fn tell(&self, at: usize, input: Input, news: WiringMessage) {
        let name = |other| self.names().point(other);
        match (news, input.kind) {
            (WiringMessage::Ready(value), kind) => self.say(at, &request(kind, value)),
            (WiringMessage::Held(value), _) => {
                let value = text(value);
                let what = format!("let it go first: it is {value}, and was not before");
                self.say(at, &what);
            }
            (WiringMessage::NotValid, _) => {
                let what = format!("NOT VALID, and waited for: {}", self.reason(at));
                self.say(at, &what);
            }
            (WiringMessage::Restless(other), _) if other == input.point => {
                self.say(at, "CHANGES BY ITSELF; waited for until it is quiet");
            }
            (WiringMessage::Restless(other), _) => {
                let other = name(other);
                complain(format_args!(
                    "  {other} CHANGES BY ITSELF, and does not count"
                ));
            }
            (WiringMessage::Changed(level), PointKind::Digital) => {
                complain(format_args!("  {}; let it go", text(level)));
            }
            (WiringMessage::Changed(_), PointKind::Index) => complain("  the encoder moves"),
            (WiringMessage::Changed(_), _) => complain("  it moves; let it rest"),
            (WiringMessage::NoIndex(from, to), _) => complain(format_args!(
                "  {}; turn it on, by more than a turn",
                no_index(from, to)
            )),
            (WiringMessage::Instead(other), _) => {
                complain(format_args!(
                    "  {} changed instead: exchanged?",
                    name(other)
                ));
            }
            (WiringMessage::Dithers, _) => complain(format_args!("  {DITHERS}")),
        }
    }

    fn judged(&mut self, at: usize, found: WiringJudgement) {
        let reason = match found.verdict {
            WiringVerdict::NotValid => Some(self.reason(at)),
            WiringVerdict::Unstable if self.is_index(at) => Some(Reason::new(
                "it came while the encoder stood: noise, or an open wire?",
            )),
            WiringVerdict::NoChange if self.is_index(at) => Some(match found.moved {
                Some((from, to)) => {
                    Reason::new(format_args!("{}: is it wired?", no_index(from, to)))
                }
                None => Reason::new("the encoder was not turned"),
            }),
            WiringVerdict::Unstable if found.moved.is_none() && !self.is_restless(at) => {
                Some(Reason::new(DITHERS))
            }
            WiringVerdict::Unstable => Some(Reason::new("it changes by itself")),
            WiringVerdict::NoChange => self.stuck(at),
            _ => None,
        };
        self.mark(at, Mark::Judged(found.verdict), reason);
        if let Some(item) = self.items.get_mut(at) {
            item.judgement = Some(found);
        }
        self.tell_words(at);
    }

    /// Reason for a level that did not change.
    fn stuck(&self, at: usize) -> Option<Reason> {
        let What::Input(input) = self.items.get(at)?.what else {
            return None;
        };
        if input.kind != PointKind::Digital {
            return None;
        }
        let value = text(self.check.value(input.point)?);
        Some(Reason::new(format_args!("it was {value} all the time")))
    }

    fn is_index(&self, at: usize) -> bool {
        let item = self.items.get(at);
        item.is_some_and(|item| item.input_kind() == Some(PointKind::Index))
    }

    fn is_restless(&self, at: usize) -> bool {
        let Some(What::Input(input)) = self.items.get(at).map(|item| item.what) else {
            return false;
        };
        self.check.restless().any(|point| point == input.point)
    }

    fn mark(&mut self, at: usize, mark: Mark, reason: Option<Reason>) {
        if let Some(item) = self.items.get_mut(at) {
            item.mark = mark;
            item.reason = reason;
            item.said = None;
        }
    }

    /// Marks an output and reports its result.
    fn concluded(&mut self, at: usize, mark: Mark, reason: Option<Reason>) -> Next {
        self.mark(at, mark, reason);
        self.tell_words(at);
        Next::Forward
    }

    fn tell_words(&self, at: usize) {
        if let Some(item) = self.items.get(at) {
            complain(format_args!("  {}", item.words(&self.names())));
        }
    }

    /// Waits until an output can be driven and the person agrees. Returns the direction to continue
    /// in if the person does not. An agreement given while the output cannot be driven is
    /// discarded.
    fn may_drive(&mut self, at: usize) -> Result<Option<Next>, Outcome> {
        let (mut is_said, mut is_asked) = (false, false);
        let mut away = Instant::now();
        loop {
            let (typed, _) = self.pass()?;
            let is_ready = self.is_ready(at);
            if is_ready {
                (away, is_said) = (Instant::now(), false);
            } else if is_asked || !is_said && away.elapsed() >= COMES_BACK {
                (is_said, is_asked) = (true, false);
                let reason = self.reason(at);
                self.say(at, &format!("NOT VALID: {reason}; it is not driven"));
            }
            if is_ready && !is_asked {
                if self.dialog.is_agreed {
                    return Ok(None);
                }
                is_asked = true;
                self.forget_typed();
                self.say(at, "y and Enter drives it; Enter skips");
                continue;
            }
            match typed {
                Typed::Text(line) if is_yes(&line) && is_ready => return Ok(None),
                Typed::Text(line) if is_yes(&line) => {}
                Typed::Back => return Ok(Some(Next::Back)),
                Typed::Skip | Typed::Text(_) => {
                    self.mark(at, Mark::Judged(WiringVerdict::Skipped), None);
                    return Ok(Some(Next::Forward));
                }
                Typed::Nothing if !is_ready && self.is_timeout(away) => {
                    let reason = self.reason(at);
                    let next = self.concluded(at, Mark::Not(Not::Failed), Some(reason));
                    return Ok(Some(next));
                }
                Typed::Nothing => {}
            }
        }
    }

    fn is_ready(&self, at: usize) -> bool {
        let found = self.seen.as_ref().zip(self.items.get(at));
        found.is_some_and(|(seen, item)| machine::is_ready(seen, &item.info))
    }

    /// Discards lines that a person typed before the question.
    fn forget_typed(&self) {
        let lines = &self.dialog.lines;
        while lines.is_terminal && lines.lines.try_recv().is_ok() {
            std::thread::sleep(LOOK);
        }
    }

    /// Drives an output for a while, and asks whether it came on.
    fn output(&mut self, at: usize, pin: PinId) -> Result<Next, Outcome> {
        if let Some(next) = self.may_drive(at)? {
            return Ok(next);
        }
        self.machine.drive(pin);
        let mut was_on = false;
        let mut ended: Option<Instant> = None;
        let mut answer = None;
        loop {
            let (typed, _) = self.pass()?;
            match self.machine.driven() {
                Some(Driven::Failed(reason)) => {
                    return Ok(self.concluded(at, Mark::Not(Not::Failed), Some(reason)));
                }
                Some(Driven::On) if !was_on => {
                    was_on = true;
                    self.forget_typed();
                    self.say(
                        at,
                        "driven; did it come on? y, n, or what came on instead; a: once more",
                    );
                    continue;
                }
                Some(Driven::Off) => ended = Some(Instant::now()),
                Some(Driven::On) | None => {}
            }
            match typed {
                Typed::Text(line) if line == "a" => {
                    let is_over = ended.take().is_some();
                    if is_over {
                        self.machine.drive(pin);
                    }
                }
                Typed::Nothing => {}
                typed if was_on => answer = Some(typed),
                _ => {}
            }
            // The next output only once this one is off.
            let Some(since) = ended else {
                continue;
            };
            if let Some(typed) = answer {
                return Ok(self.answered(at, typed));
            }
            if self.is_timeout(since) {
                return Ok(self.concluded(at, Mark::Judged(WiringVerdict::Skipped), None));
            }
        }
    }

    fn answered(&mut self, at: usize, typed: Typed) -> Next {
        let (verdict, said) = match typed {
            Typed::Back => return Next::Back,
            Typed::Text(line) if is_yes(&line) => (WiringVerdict::Ok, None),
            Typed::Text(line) if matches!(&*line, "n" | "N" | "no") => {
                (WiringVerdict::NoChange, None)
            }
            Typed::Text(line) => (WiringVerdict::OtherChanged, Some(line)),
            Typed::Skip | Typed::Nothing => (WiringVerdict::Skipped, None),
        };
        self.mark(at, Mark::Judged(verdict), None);
        if let Some(item) = self.items.get_mut(at) {
            item.said = said;
        }
        self.tell_words(at);
        Next::Forward
    }
}

/// Request to the person at an input with this value.
fn request(kind: PointKind, value: AnyValue) -> String {
    match kind {
        PointKind::Digital => format!("actuate it now; it is {}", text(value)),
        PointKind::Counter => "turn it now by hand, in its positive direction".to_owned(),
        PointKind::Index => "turn the encoder past its index, by hand".to_owned(),
        PointKind::Analog => format!("change it now; it is {}", text(value)),
    }
}

/// Text for an encoder that was turned without its index coming.
fn no_index(from: AnyValue, to: AnyValue) -> String {
    format!(
        "the encoder counted {} to {}, and its index did not come",
        text(from),
        text(to)
    )
}

const DITHERS: &str = "it counts up and down, and gets nowhere: does one of A and B not arrive?";

fn is_yes(line: &str) -> bool {
    matches!(line, "y" | "Y" | "yes")
}
