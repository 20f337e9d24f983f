//! A machine that runs: what every command that starts one says first.

use std::fmt::Write;
use std::time::Duration;

use mesa_hal::RemoteId;
use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{EventKind, StopError};
use mesa_hal::runner::Ended;
use mesa_hal::transport::udp::UdpError;
use mesa_hal::{Board, BoardState, Driver, Settings};

use crate::context::Failure;
use crate::link::Bus;
use crate::output::complain;
use crate::words;

/// Starts everything on a board with all outputs off, and says on standard error what was found, what
/// is missing, and what disagrees with its table.
pub fn start(bus: Bus, settings: Settings) -> Result<Driver<Bus>, Failure> {
    go(Board::identify(bus, settings)?)
}

/// The same on a board that is identified, and may be discovered.
pub fn go(board: Board<Bus>) -> Result<Driver<Bus>, Failure> {
    let driver = board.start()?;
    complain(found(&driver).trim_end());
    Ok(driver)
}

/// What keeps a board from running, if anything does.
pub fn trouble(state: BoardState) -> Option<BoardState> {
    Some(state).filter(|state| *state != BoardState::Running)
}

/// Fails if somebody else was found to drive the board while it ran: nothing that it showed is certain.
pub fn check_alone(bus: &Bus) -> Result<(), Failure> {
    match bus.statistics().others {
        0 => Ok(()),
        packets => {
            let packets = u32::try_from(packets).unwrap_or(u32::MAX);
            Err(Failure::refused(EventKind::OtherMaster { packets }))
        }
    }
}

/// How a run has ended. Somebody else who drives the board is the reason, and whatever could not be
/// stopped because of him is told before it.
pub fn check_end(ended: &Ended<Bus>) -> Result<(), Failure> {
    let alone = check_alone(ended.driver.bus());
    match (alone, ended.stopped.clone()) {
        (Err(other), Err(error)) => {
            complain(format_args!("mesa: {error}"));
            Err(other)
        }
        (alone, stopped) => {
            alone?;
            Ok(stopped?)
        }
    }
}

/// Fails if somebody else drives the board, or it does not run any more.
pub fn check(driver: &Driver<Bus>) -> Result<(), Failure> {
    check_alone(driver.bus())?;
    trouble(driver.board_state()).map_or(Ok(()), |trouble| Err(Failure::refused(trouble)))
}

/// The board's watchdog where no output is ever on, so that it turns nothing off: a thread like any
/// other is late at times, and that shall not end it.
pub const WATCHDOG: Duration = Duration::from_millis(800);

/// How long a board that lost its set-up is left alone before it is set up again.
const AGAIN: Duration = Duration::from_secs(1);

/// Sets a board up again that has lost its set-up: for a program that drives nothing, because every
/// output is off then.
#[derive(Debug, Default)]
pub struct Keeper {
    failed: Duration,
}

impl Keeper {
    /// Call it in each cycle.
    pub fn look_after(&mut self, driver: &mut Driver<Bus>) {
        self.failed = match driver.board_state() {
            BoardState::Running => Duration::ZERO,
            _ => self.failed + driver.period(),
        };
        if self.failed >= AGAIN {
            self.failed = Duration::ZERO;
            // If it fails, the state stays as it is shown, and it is tried again. Who else may have
            // the board by now is counted there.
            if driver.bus_mut().check_alone().is_ok() {
                let _ = driver.rearm();
            }
        }
    }
}

/// Remotes of which an output may be on still, if nothing else went wrong at the end.
pub fn not_reached(stopped: Result<(), StopError<UdpError>>) -> Result<Vec<String>, Failure> {
    match stopped {
        Ok(()) => Ok(Vec::new()),
        Err(error) if error.failed.is_some() => Err(error.into()),
        Err(error) => Ok(error.not_reached.iter().map(words::typed).collect()),
    }
}

/// What a driver found on each channel, for people.
fn found(driver: &Driver<Bus>) -> String {
    let mut text = String::new();
    for port in driver.ports() {
        let layout = port.layout();
        for channel in 0..layout.channels {
            let mut remotes = port.remotes();
            let remote = remotes.find(|remote| remote.started.channel.index() == channel);
            let id = RemoteId::new(layout.instance, channel);
            let place = format_args!("{}: {id}", driver.name());
            let _ = match remote {
                Some(remote) => writeln!(text, "{place}: {}", remote.descriptor.name),
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
        let _ = writeln!(text, "MISSING: {missing}");
    }
    for remark in driver.remarks() {
        let _ = writeln!(text, "Note: {remark}");
    }
    words::typed(&text)
}

/// Whether nothing answers on a channel.
fn is_silent(driver: &Driver<Bus>, id: RemoteId) -> bool {
    let mut missing = driver.missing().iter();
    missing.any(|remark| remark.remote == Some(id) && remark.is_silent())
}
