//! The promises of the fault contract for outputs, checked against the simulator's true outputs.

use std::collections::VecDeque;
use std::mem;

use super::journal::{BoardCommand, ENABLES, Event, Level, PARTS, PORTS, Parts, SSR, VOLTS, What};
use super::plan::{LONGEST_WATCHDOG, MICRO, MILLI, Plan, WRITTEN_WATCHDOG};

/// The promises: see `docs/faults.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Promise {
    /// The value of a valid input was true within its age.
    Inputs,
    /// A cycle that only the network, the bus or the host misses leaves inputs valid, with their
    /// age.
    Missed,
    /// The state of a terminal was commanded, and not long ago.
    Commanded,
    /// Nothing is on after a fault until it is re-armed.
    Safe,
    /// A reported index has occurred.
    Index,
    /// Faults are detected in their time.
    Detected,
    /// Other remotes are not affected.
    Neighbours,
    /// Afterwards the machine can be re-armed, and outputs follow.
    ComesBack,
    /// Events, statistics and reasons are true, and complete.
    Told,
    /// A complete machine can be built, and no call panics.
    Works,
}

#[derive(Clone, Debug)]
pub struct Failure {
    pub promise: Promise,
    pub at: u64,
    pub text: String,
}

pub type Checked = Result<(), Failure>;

pub fn ensure(holds: bool, promise: Promise, at: u64, text: impl FnOnce() -> String) -> Checked {
    if holds {
        return Ok(());
    }
    Err(Failure {
        promise,
        at,
        text: text(),
    })
}

/// A remote switches off after its watchdog's time, by default 50 ms; the rest is for the cycles
/// around it.
fn off_after(plan: &Plan) -> u64 {
    // A time written during operation is in use from the next power-up on.
    let written = u32::from(plan.extras.deeds_one_in > 0) * WRITTEN_WATCHDOG;
    if plan.is_without_watchdog() {
        return NEVER;
    }
    (plan.extras.remote_watchdog.max(written.into()) + 10) * MILLI
}
/// Time from clearing a remote's faults to the first frame of chatter, which replaces its outputs:
/// up to then it applied none.
const CLEARED: u64 = MILLI;
/// Nothing switches off a remote whose watchdog is off.
const NEVER: u64 = 1_000_000 * MILLI;
/// The same limit for the board's own outputs.
const OFF_AFTER: u64 = 60 * MILLI;
/// A packet that drives pins ends with a command that makes a board bite that was reset: it is
/// executed within this time.
pub const PACKET: u64 = 20 * MICRO;
/// On an embedded bus the packet follows the reads of the evidence before it, which take longer the
/// more remotes there are.
const EVIDENCE: u64 = MICRO;
/// On an embedded bus the set-up is one exchange: length of the part of it that a reset can take
/// away.
const SET_UP: u64 = 200 * MICRO;
/// Over-temperature and over-current: the affected outputs switch off immediately.
const TRIPS: u8 = 0x0C;
/// Older commands are dropped.
const KEPT: u64 = 500 * MILLI;

#[derive(Clone, Copy, Debug)]
struct Command {
    at: u64,
    level: Level,
    is_armed: bool,
}

/// Outputs that change together.
#[derive(Debug)]
#[expect(clippy::struct_excessive_bools, reason = "independent of each other")]
struct Track {
    name: String,
    /// Bits may be missing: pins are inputs at this time, or outputs have tripped by themselves.
    has_gaps: bool,
    /// Time until which outputs of before a fault may stand for longer; `u64::MAX` while the fault
    /// is set.
    faulty_until: u64,
    /// Time until which a fault may be reported by the first frame after the board was set up
    /// again.
    asked_until: u64,
    /// The current state is a subset of the previous one.
    has_fewer: bool,
    commands: VecDeque<Command>,
    shown: Level,
    since: u64,
    /// Time after which a replaced command must no longer be visible.
    limit: u64,
    /// Time of the first fault since the last re-arming, and the time by which everything must be
    /// off.
    fault: Option<(u64, u64, &'static str)>,
    /// For `is_coming`: START has cleared its faults, including those that nothing has reported.
    is_started: bool,
    /// Until this time a packet from before the fault may arrive, which drives pins while it is
    /// executed.
    packet_until: u64,
    /// Longest time that its outputs may be on: until the packet ends or, if the board has bitten,
    /// until the bite is detected.
    packet_lasts: u64,
    /// The packet is the end of a set-up without its beginning, with outputs that were not
    /// commanded.
    packet_sets_up: bool,
    /// For a remote: re-armed together with a board that is being set up again, and armed when it
    /// runs.
    is_coming: bool,
}

impl Track {
    fn new(name: String, has_gaps: bool, limit: u64) -> Self {
        Self {
            name,
            has_gaps,
            faulty_until: 0,
            asked_until: 0,
            has_fewer: false,
            commands: VecDeque::new(),
            shown: Level::OFF,
            since: 0,
            limit,
            fault: None,
            is_started: false,
            packet_until: 0,
            packet_lasts: 0,
            packet_sets_up: false,
            is_coming: false,
        }
    }

    fn command(&mut self, at: u64, level: Level, is_armed: bool) {
        self.is_coming &= !is_armed;
        let is_news = self
            .commands
            .back()
            .is_none_or(|last| (last.level, last.is_armed) != (level, is_armed));
        if is_news {
            self.commands.push_back(Command {
                at,
                level,
                is_armed,
            });
        }
        while self.commands.len() > 2 && self.commands[1].at + KEPT.max(self.limit) < at {
            self.commands.pop_front();
        }
    }

    fn fault(&mut self, at: u64, within: u64, what: &'static str) {
        if self.fault.is_none() {
            self.fault = Some((at, at + within, what));
        }
    }

    /// A frame feeds its watchdog, which has to bite by `until`.
    fn is_fed(&mut self, until: u64) {
        if let Some((_, limit, _)) = &mut self.fault {
            *limit = until.max(*limit);
        }
    }

    fn show(&mut self, at: u64, level: Level) -> Checked {
        self.check(at)?;
        self.set(at, level);
        self.check(at)
    }

    fn set(&mut self, at: u64, level: Level) {
        if level != self.shown {
            // Some outputs have gone off before the remote reports the reason.
            let fewer = level.bits & !self.shown.bits == 0;
            self.has_fewer = fewer && level.millivolts == self.shown.millivolts;
            self.shown = level;
            self.since = at;
        }
    }

    fn check_off(&self, now: u64, why: &str) -> Checked {
        ensure(!self.shown.is_on(), Promise::Safe, now, || {
            format!("{}: {:x?} is on {why}", self.name, self.shown)
        })
    }

    /// Checks that the current state is permitted up to now.
    fn check(&self, now: u64) -> Checked {
        if !self.shown.is_on() {
            return Ok(());
        }
        if let Some((at, until, what)) = self.fault {
            let in_packet =
                self.since <= self.packet_until && now <= self.since + self.packet_lasts;
            ensure(now <= until || in_packet, Promise::Safe, now, || {
                format!(
                    "{}: {:x?} is on since {}, {} us after {what} at {at}, and was not re-armed since",
                    self.name,
                    self.shown,
                    self.since,
                    (now - at) / MICRO
                )
            })?;
            if in_packet && self.packet_sets_up {
                return Ok(());
            }
        }
        let shows = |command: &Command| {
            let shown = if self.has_gaps || self.has_fewer {
                Level {
                    bits: self.shown.bits & command.level.bits,
                    ..command.level
                }
            } else {
                command.level
            };
            command.is_armed && self.shown.is(&shown)
        };
        // A remote that got a fault while it was not addressed keeps its outputs, and its watchdog
        // is fed by the first frame that reports the fault.
        let times = if now <= self.faulty_until { 2 } else { 1 };
        let limit = times * self.limit;
        // From the newest back, each with the time at which the next command replaced it.
        let mut replaced = u64::MAX;
        let mut pairs = self
            .commands
            .iter()
            .rev()
            .map(|command| (command, mem::replace(&mut replaced, command.at)))
            .filter(|(command, _)| shows(command));
        // The same may have been commanded again since.
        let newest = pairs.next();
        let is_before = |(command, _): &(&Command, u64)| command.at <= self.since;
        let found = newest.filter(is_before).or_else(|| pairs.find(is_before));
        let found = found
            .zip(newest)
            .map(|((command, _), (_, until))| (command, until));
        ensure(
            found.is_some_and(|(_, until)| until.saturating_add(limit) >= now),
            Promise::Commanded,
            now,
            || match found {
                Some((command, until)) => format!(
                    "{}: {:x?} of {} was replaced {} us ago and still stands there, by {:x?}",
                    self.name,
                    self.shown,
                    command.at,
                    (now - until) / MICRO,
                    self.commands
                        .iter()
                        .filter(|next| next.at >= until)
                        .take(4)
                        .collect::<Vec<_>>()
                ),
                None => format!(
                    "{}: {:x?} is on since {}, which was not commanded while it was armed; last commands: {:x?}",
                    self.name,
                    self.shown,
                    self.since,
                    self.commands.iter().rev().take(4).collect::<Vec<_>>()
                ),
            },
        )
    }
}

/// Model of the outputs that may be on.
#[derive(Debug)]
pub struct Oracle {
    remotes: Vec<Track>,
    board: Vec<Track>,
    lateness: u64,
    /// Longest delay of a packet that was sent before a bite or a reset.
    in_flight: u64,
    is_setting_up: bool,
    period: u64,
    off_after: u64,
    /// Longest pause of a host between a write and the look that follows it: then the watchdog
    /// bites again.
    stalls: u64,
    /// Longest time until the board bites again by itself, if the replies to a host may be lost.
    unheard: u64,
    /// Longest time from a look at the board to the end of the packet that drives pins after it.
    packet: u64,
    /// Time after a fault until which a stopped host may still send earlier packets.
    late_by: u64,
}

impl Oracle {
    pub fn new(plan: &Plan) -> Self {
        let lateness = plan.lateness() + 2 * plan.period;
        let off_after = off_after(plan);
        let part = |part| match part {
            ENABLES => "drive enables".to_owned(),
            SSR => "isolated outputs".to_owned(),
            volts if volts >= VOLTS => format!("analog output {}", volts - VOLTS),
            port => format!("GPIO of port {port}"),
        };
        let remote = |n| {
            let (port, channel) = plan.place(n);
            let name = format!("remote {n} ({:?}, {port}.{channel})", plan.card(n));
            Track::new(name, false, off_after + lateness)
        };
        let board = (0..PARTS).map(|n| Track::new(part(n), n < PORTS, OFF_AFTER + lateness));
        let late_by = if plan.host_stands_still() {
            2 * plan.watchdog + 100 * MILLI
        } else {
            0
        };
        // A card that was swapped in is the last: it is never commanded.
        let stranger = Track::new("the other card".to_owned(), false, 0);
        Self {
            remotes: (0..plan.remotes()).map(remote).chain([stranger]).collect(),
            board: board.collect(),
            lateness: plan.lateness(),
            in_flight: if plan.is_homing { plan.lateness() } else { 0 },
            is_setting_up: false,
            period: plan.period,
            off_after,
            late_by,
            packet: if plan.is_network {
                PACKET
            } else {
                PACKET + plan.remotes() as u64 * EVIDENCE
            },
            stalls: if plan.more.stalls_in_write {
                late_by
            } else {
                0
            },
            unheard: if plan.loses_replies() {
                plan.watchdog.max(LONGEST_WATCHDOG)
            } else {
                0
            },
        }
    }

    pub fn command_remote(&mut self, remote: usize, at: u64, level: Level, is_armed: bool) {
        self.remotes[remote].command(at, level, is_armed);
    }

    pub fn command_board(&mut self, at: u64, command: &BoardCommand, is_armed: bool) {
        for (track, level) in self.board.iter_mut().zip(command.parts()) {
            track.command(at, level, is_armed);
        }
    }

    /// The process has ended: nothing is commanded any more.
    pub fn no_commands(&mut self, at: u64) {
        for track in self.remotes.iter_mut().chain(&mut self.board) {
            track.command(at, Level::OFF, false);
        }
    }

    /// The board is set up again by a re-arming. The effects of its outage on remotes, whose own
    /// watchdogs bite sooner or later, end with it.
    pub fn remotes_come(&mut self) {
        (0..self.remotes.len()).for_each(|remote| self.comes(remote));
    }

    /// A remote is to be armed as soon as it runs. Until it is started, its watchdog bites because
    /// of what was known.
    pub fn comes(&mut self, remote: usize) {
        let track = &mut self.remotes[remote];
        (track.is_coming, track.is_started) = (true, false);
    }

    /// The board is set up again without a re-arming. A remote that got a fault meanwhile, or gets
    /// one before it is started, is addressed until it has reported the fault, which feeds its
    /// watchdog.
    pub fn remotes_are_asked(&mut self, now: u64) {
        let asked = 45 * self.period + self.lateness;
        for track in &mut self.remotes {
            track.asked_until = now + asked;
            if now <= track.faulty_until {
                track.is_fed(now + asked + self.off_after);
            }
        }
    }

    /// Start or end of writing the set-up: all of it is one packet, which a reset can cut.
    pub fn set_up(&mut self, is_written: bool) {
        self.is_setting_up = is_written;
    }

    /// True while the set-up is written.
    pub fn is_setting_up(&self) -> bool {
        self.is_setting_up
    }

    /// The application re-arms everything, or one remote.
    pub fn rearmed(&mut self, remote: Option<usize>) {
        if let Some(remote) = remote {
            self.remotes[remote].fault = None;
            return;
        }
        for track in self.remotes.iter_mut().chain(&mut self.board) {
            track.fault = None;
        }
    }

    /// The board was set up at this time: faults before it are irrelevant.
    pub fn forget_before(&mut self, set_up: u64) {
        for track in self.remotes.iter_mut().chain(&mut self.board) {
            track.fault = track.fault.filter(|(at, ..)| *at >= set_up);
        }
    }

    /// Processes an event. `alone`: at most one fault has occurred.
    pub fn event(&mut self, event: &Event, alone: bool) -> Checked {
        let at = event.at;
        match event.what {
            What::Remote(remote, level) => self.remotes[remote].show(at, level),
            What::Part(part, level) if part >= VOLTS && !self.board[ENABLES].shown.is_on() => {
                // A drive that is not enabled ignores changes within an exchange.
                self.board[part].set(at, level);
                Ok(())
            }
            What::Part(part, level) => self.board[part].show(at, level),
            What::Bite | What::Reset => {
                let what = if matches!(event.what, What::Bite) {
                    "a bite"
                } else {
                    "a reset"
                };
                for track in &mut self.board {
                    track.fault(at, self.in_flight, what);
                }
                // The direction of an I/O pin was changed just before, or the set-up is written.
                let is_bite = matches!(event.what, What::Bite);
                let seen = if is_bite {
                    (2 * self.period + self.stalls.min(20 * MILLI)).max(self.unheard)
                } else {
                    0
                };
                // A long reset takes the middle of a set-up, and lets the end of it through.
                let in_reset = if self.is_setting_up { SET_UP } else { 0 };
                // So does a host that has not read since: its packets arrive after the set-up.
                let is_any = self.is_setting_up || self.late_by > 0;
                let count = if is_any { PARTS } else { PORTS };
                for track in self.board.iter_mut().take(count) {
                    track.packet_until = at + self.lateness + self.late_by + self.packet + in_reset;
                    track.packet_lasts = self.packet + seen;
                    track.packet_sets_up = self.is_setting_up;
                }
                for track in &mut self.remotes {
                    track.is_coming = false;
                }
                for track in &mut self.remotes {
                    track.fault(at, self.off_after + self.period, what);
                }
                Ok(())
            }
            What::Written | What::Opened | What::Closed => Ok(()),
            What::Faults(remote, 0) => {
                self.remotes[remote].has_gaps = false;
                self.remotes[remote].faulty_until = at + CLEARED;
                self.remotes[remote].asked_until = 0;
                self.remotes[remote].is_started = true;
                Ok(())
            }
            What::Faults(remote, faults) => {
                self.remotes[remote].has_gaps |= faults & TRIPS != 0;
                self.remotes[remote].faulty_until = u64::MAX;
                // Counted from the reply that reported the fault; with other faults the replies may
                // be lost, until the remote goes offline.
                let told = if alone { 3 } else { 45 } * self.period + self.lateness;
                if at <= self.remotes[remote].asked_until {
                    self.remotes[remote].is_fed(at + self.off_after + told);
                }
                let is_of_board =
                    self.remotes[remote].is_coming && !self.remotes[remote].is_started;
                self.remotes[remote].is_coming = is_of_board;
                if is_of_board {
                    return Ok(());
                }
                self.remotes[remote].fault(at, self.off_after + told, "a fault of its own");
                Ok(())
            }
        }
    }

    /// Checks that the current state is permitted.
    pub fn check(&self, now: u64) -> Checked {
        self.remotes
            .iter()
            .chain(&self.board)
            .try_for_each(|track| track.check(now))
    }

    /// Checks that a board other than the one at the start drives nothing.
    pub fn check_stranger(&self, now: u64) -> Checked {
        self.check_board_off(now, "of a stranger")
    }

    /// Checks that nothing is on.
    pub fn check_all_off(&self, now: u64, why: &str) -> Checked {
        (0..self.remotes.len()).try_for_each(|remote| self.check_remote_off(remote, now, why))?;
        self.check_board_off(now, why)
    }

    /// Checks that a remote drives nothing.
    pub fn check_remote_off(&self, remote: usize, now: u64, why: &str) -> Checked {
        self.remotes[remote].check_off(now, why)
    }

    /// Checks that the board drives nothing.
    pub fn check_board_off(&self, now: u64, why: &str) -> Checked {
        self.board
            .iter()
            .try_for_each(|track| track.check_off(now, why))
    }

    /// Longest time that an unreachable remote may take to switch off.
    pub fn off_after(&self) -> u64 {
        self.off_after
    }

    /// True if a remote has an output on.
    pub fn is_on(&self, remote: usize) -> bool {
        self.remotes[remote].shown.is_on()
    }

    /// True if a remote shows its current command.
    pub fn follows(&self, remote: usize) -> bool {
        let track = &self.remotes[remote];
        let command = track
            .commands
            .back()
            .map_or(Level::OFF, |command| command.level);
        track.shown.is(&command)
    }

    pub fn board_lags(&self, parts: &Parts) -> String {
        let lags = self
            .board
            .iter()
            .zip(parts)
            .find(|(track, level)| !track.shown.is(level));
        lags.map_or_else(String::new, |(track, level)| {
            format!("{}: {:x?} instead of {level:x?}", track.name, track.shown)
        })
    }

    pub fn board_follows(&self, parts: &Parts) -> bool {
        self.board
            .iter()
            .zip(parts)
            .all(|(track, level)| track.shown.is(level))
    }
}
