//! Start, supervision and end of a machine, shared by all commands that run one.

use std::fmt::Write;
use std::time::Duration;

use mesa_hal::MesaError;
use mesa_hal::RemoteId;
use mesa_hal::bus::{ClockedBus, RegisterBus};
use mesa_hal::driver::{EventKind, Pace, StopError};
use mesa_hal::runner::Ended;
use mesa_hal::{Board, BoardState, Configured, Driver, Settings};
use mesa_tools::Counted;
use mesa_tools::advice::with_advice;
use mesa_tools::diagnosis::{PacketMark, Packets};

use crate::board::bus::Bus;
use crate::ui::context::Failure;
use crate::ui::output::complain;
use mesa_tools::advice::told;

/// Starts everything on a board with all outputs off. Reports on standard error which remotes were
/// found, which are missing, and what disagrees with its table.
pub fn start<B: ClockedBus>(bus: B, settings: Settings) -> Result<Driver<B>, Failure> {
    go(Board::identify(bus, settings)?.discover()?)
}

/// As [`start`], for a board whose remotes are known.
pub fn go<B: ClockedBus>(board: Configured<B>) -> Result<Driver<B>, Failure> {
    let driver = board.start()?;
    complain(found(&driver).trim_end());
    Ok(driver)
}

/// The state of a board that does not run; `None` if it runs.
pub fn trouble(state: BoardState) -> Option<BoardState> {
    Some(state).filter(|state| *state != BoardState::Running)
}

/// Fails if another program was found to drive the board during the run, because readings are
/// uncertain then.
pub fn check_alone(bus: &impl RegisterBus) -> Result<(), Failure> {
    match bus.statistics().foreign_packets {
        0 => Ok(()),
        packets => {
            let packets = u32::try_from(packets).unwrap_or(u32::MAX);
            let kind = EventKind::OtherMaster { packets };
            Err(Failure::refused(with_advice(kind, kind.advice())))
        }
    }
}

/// Reports the packets that were lost since the board was opened, if there are any.
pub fn say_losses(bus: &Bus) {
    let now = PacketMark {
        bus: bus.statistics(),
        board: None,
    };
    let packets = Packets::between(&PacketMark::default(), &now, Pace::Host);
    if packets.lost > 0 {
        let (lost, sent) = (packets.lost, Counted(packets.sent, "packet"));
        complain(format_args!(
            "mesa: {lost} of {sent} lost; `mesa doctor` shows on which way"
        ));
    }
}

/// Result of a run. Another program that drives the board is returned as the reason; outputs that
/// could not be stopped because of it are reported first, and lost packets before them.
pub fn check_end(ended: &Ended<Bus>) -> Result<(), Failure> {
    say_losses(ended.driver.bus());
    let alone = check_alone(ended.driver.bus());
    match (alone, ended.stopped.clone()) {
        (Err(other), Err(error)) => {
            complain(format_args!("mesa: {}", told(&error)));
            Err(other)
        }
        (alone, stopped) => {
            alone?;
            Ok(stopped?)
        }
    }
}

/// Fails if another program drives the board, or if the board does not run any more.
pub fn check<B: ClockedBus>(driver: &Driver<B>) -> Result<(), Failure> {
    check_alone(driver.bus())?;
    trouble(driver.board_state()).map_or(Ok(()), |trouble| Err(Failure::refused(trouble)))
}

/// Time of the board's watchdog for commands in which no output is ever on, so that the watchdog
/// protects nothing. Long, so that a delay of an ordinary thread does not end the run.
pub const WATCHDOG: Duration = Duration::from_millis(800);

/// Delay before a board that lost its set-up is set up again.
const AGAIN: Duration = Duration::from_secs(1);

/// Sets up a board again that has lost its set-up. For programs that drive nothing, because all
/// outputs are off afterwards.
#[derive(Debug, Default)]
pub struct Keeper {
    failed: Duration,
}

impl Keeper {
    /// Checks the state of the board; call in each cycle.
    pub fn look_after(&mut self, driver: &mut Driver<Bus>) {
        // After a failure the state stays as shown, and the next attempt follows. Packets of
        // another master meanwhile are counted by the bus.
        if self.pass_cycle(driver.board_state(), driver.period())
            && driver.bus_mut().check_alone().is_ok()
        {
            let _ = driver.rearm();
        }
    }

    /// Passes a cycle; true if the board is to be set up in it.
    pub fn pass_cycle(&mut self, state: BoardState, period: Duration) -> bool {
        self.failed = match state {
            BoardState::Running => Duration::ZERO,
            _ => self.failed + period,
        };
        let is_due = self.failed >= AGAIN;
        if is_due {
            self.failed = Duration::ZERO;
        }
        is_due
    }
}

/// Remotes with an output that may still be on after the stop; fails if the stop failed otherwise.
pub fn not_reached(stopped: Result<(), StopError>) -> Result<Vec<String>, Failure> {
    match stopped {
        Ok(()) => Ok(Vec::new()),
        Err(error) if error.failed.is_some() => Err(error.into()),
        Err(error) => Ok(error
            .not_reached
            .iter()
            .map(|remote| with_advice(remote, remote.advice()))
            .collect()),
    }
}

/// Text about the remotes on each channel, missing remotes and remarks.
fn found<B: ClockedBus>(driver: &Driver<B>) -> String {
    let mut text = String::new();
    for port in driver.ports() {
        let layout = port.layout();
        for channel in 0..layout.channels {
            let mut remotes = port.remotes();
            let remote = remotes.find(|remote| remote.started.channel.index() == channel);
            let id = RemoteId::new(layout.instance, channel);
            let place = format_args!("{}: {id}", driver.name());
            let _ = match remote {
                Some(remote) => writeln!(text, "{}: {}", driver.name(), remote.label),
                None if is_silent(driver, id) => writeln!(
                    text,
                    "{place}: nothing answers; a remote that should be there has no power or no cable \
                     (field power too, where it is powered from there)"
                ),
                None => writeln!(text, "{place}: no remote takes part"),
            };
        }
    }
    for missing in driver.missing().iter().filter(|remark| !remark.is_silent()) {
        let _ = writeln!(text, "MISSING: {}", told(missing));
    }
    for remark in driver.remarks() {
        let _ = writeln!(text, "Note: {}", told(remark));
    }
    text
}

/// True if nothing answers on a channel.
fn is_silent<B: ClockedBus>(driver: &Driver<B>, id: RemoteId) -> bool {
    let mut missing = driver.missing().iter();
    missing.any(|remark| remark.remote.is_some_and(|remote| remote == id) && remark.is_silent())
}
