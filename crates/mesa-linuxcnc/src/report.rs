//! Events in the words of LinuxCNC's users: the card by its name in HAL, what happened, and which
//! pin to set.

use core::fmt;

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{EventKind, OfflineReason, Repeating};
use mesa_hal::hal::{Age, Role};
use mesa_hal::{AdviceTopic, Driver, MesaError, RemoteLabel};

use crate::advice::words;
use crate::ffi::Level;
use crate::interface::Interface;
use crate::rearm::BOARD;

/// The names of a board and its cards in HAL.
#[derive(Clone, Debug)]
pub(crate) struct Names {
    interface: Interface,
    /// `hm2_7i97.0`
    board: String,
    /// In the order of the ports and channels.
    cards: Vec<Card>,
}

/// A card: a remote.
#[derive(Clone, Debug)]
struct Card {
    label: RemoteLabel,
    /// Its kind and unit number at the load.
    expected: String,
    has_outputs: bool,
    /// The names of its parameters in HAL, in their order in the driver.
    parameters: Vec<String>,
}

impl Names {
    pub fn new<B: RegisterBus + Clock>(driver: &Driver<B>, interface: Interface) -> Self {
        let infos = driver.pins().infos();
        let mut cards = Vec::new();
        for port in driver.ports() {
            for remote in port.remotes() {
                let is = remote.started;
                let mut own = infos.iter().filter(|info| info.group == remote.pins.group);
                let parameters = remote.pins.parameters.iter().map(|parameter| {
                    let info = driver.pins().info_of(parameter.pin());
                    info.map_or_else(String::new, |info| info.name.clone())
                });
                cards.push(Card {
                    label: remote.label,
                    expected: format!("{} (unit 0x{:08X})", is.name, is.unit_number),
                    has_outputs: own.any(|info| info.role == Role::Output),
                    parameters: parameters.collect(),
                });
            }
        }
        Self {
            interface,
            board: driver.name().to_owned(),
            cards,
        }
    }

    /// The name of the board in HAL.
    pub fn board(&self) -> &str {
        &self.board
    }

    /// A remote by its name in HAL, or the board.
    pub fn subject(&self, remote: Option<RemoteLabel>) -> Subject<'_> {
        let board = &self.board;
        Subject { board, remote }
    }

    /// Text for a card that is offline, or for a card or the board whose outputs wait for the user,
    /// although the machine is on.
    pub fn left_off(&self, number: usize, is_offline: bool, waits: bool) -> Option<LeftOff<'_>> {
        if number == BOARD {
            return waits.then_some(LeftOff::OfBoard(&self.board));
        }
        let card = self.cards.get(number)?;
        let subject = self.subject(Some(card.label));
        if is_offline {
            Some(LeftOff::Offline(subject))
        } else {
            let waits = waits && card.has_outputs;
            waits.then_some(LeftOff::Waiting(subject))
        }
    }

    /// Text for a board whose outputs stay off although the machine is on, because of these flags.
    pub fn all_off(&self, flags: Flags) -> LeftOff<'_> {
        let board = &self.board;
        LeftOff::Board(Acknowledge { board, flags })
    }

    fn find(&self, remote: RemoteLabel) -> Option<&Card> {
        self.cards.get(self.number(remote)?)
    }

    /// Number of a remote in the order of ports and channels.
    pub fn number(&self, remote: RemoteLabel) -> Option<usize> {
        self.cards.iter().position(|card| card.label == remote)
    }
}

/// The subject of a message: a board, or a remote of it by its name in HAL, `hm2_7i97.0.7i77.0.0`.
#[derive(Clone, Copy)]
pub(crate) struct Subject<'a> {
    pub board: &'a str,
    pub remote: Option<RemoteLabel>,
}

impl fmt::Display for Subject<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.board)?;
        match self.remote {
            Some(remote) if remote.name.is_some() => write!(f, ".{remote}"),
            // The place of what has no pins.
            Some(remote) => write!(f, ", {remote}"),
            None => Ok(()),
        }
    }
}

/// The flags of a board that keep its outputs off until the user clears them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Flags {
    pub has_bit: bool,
    pub io_error: bool,
}

impl Flags {
    pub const fn any(self) -> bool {
        self.has_bit || self.io_error
    }
}

/// The flag that brings the outputs of a board back.
pub(crate) struct Acknowledge<'a> {
    board: &'a str,
    flags: Flags,
}

impl fmt::Display for Acknowledge<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { board, flags } = self;
        match flags {
            Flags { io_error: true, .. } => write!(f, "set {board}.io_error to FALSE to go on"),
            Flags { has_bit: true, .. } => {
                write!(f, "set {board}.watchdog.has_bit to FALSE to go on")
            }
            _ => f.write_str("they follow again as soon as it runs"),
        }
    }
}

/// Outputs that stay off although the machine is on.
pub(crate) enum LeftOff<'a> {
    Offline(Subject<'a>),
    Waiting(Subject<'a>),
    OfBoard(&'a str),
    Board(Acknowledge<'a>),
}

impl fmt::Display for LeftOff<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Offline(card) => write!(
                f,
                "{card}: the machine is on, and this card is offline: its inputs are not valid, its outputs \
                 are off"
            ),
            Self::Waiting(card) => write!(
                f,
                "{card}: the machine is on, and the outputs of this card are off; set {card}.rearm to \
                 FALSE and TRUE to go on"
            ),
            Self::OfBoard(board) => write!(
                f,
                "{board}: the machine is on, and the outputs of the board are off; set {board}.rearm to FALSE \
                 and TRUE to go on"
            ),
            Self::Board(flag) => {
                let board = flag.board;
                write!(
                    f,
                    "{board}: the machine is on, and all outputs are off; {flag}"
                )
            }
        }
    }
}

/// State of the outputs of a card, or of the board, when an event of it is printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OutputState {
    /// They follow HAL, or do so as soon as the card runs.
    Follow,
    /// They wait for the user.
    Wait,
}

/// An event, and what a text about it needs.
#[derive(Clone, Copy)]
pub(crate) struct Report<'a> {
    pub kind: EventKind,
    pub names: &'a Names,
    pub flags: Flags,
    pub outputs: OutputState,
    /// Age of the last good reply of the board.
    pub silence: Age,
}

/// Cycles without a good reply from which on the connection was lost, and not only some packets.
const LOST: u64 = 3;

impl Report<'_> {
    /// Level of the message; `None` if nobody should see it.
    ///
    /// Errors are what the user asked for and does not get, and what the driver switched off.
    pub fn level(&self) -> Option<Level> {
        let waits = |level| match self.outputs {
            OutputState::Wait => level,
            OutputState::Follow => Level::Note,
        };
        Some(match self.kind {
            EventKind::RemoteOffline { reason, .. } if is_asked_for(reason) => Level::Note,
            EventKind::RemoteOffline { reason, .. } if is_other_card(reason) => Level::Error,
            // The board's own message has the next step for all.
            EventKind::RemoteOffline { .. } if self.flags.any() => Level::Note,
            // The board, or this computer, has not fed it for a moment; or a reset has stopped it.
            EventKind::RemoteOffline {
                reason:
                    OfflineReason::Watchdog | OfflineReason::BoardDown | OfflineReason::NotRunning(_),
                ..
            } => waits(Level::Error),
            EventKind::RemoteOffline { .. } => Level::Error,
            EventKind::RemoteStaysOffline { reason, .. } if needs_a_hand(reason) => Level::Error,
            EventKind::RemoteBack { .. } | EventKind::RemoteUp { .. } => {
                if self.has_outputs() && self.outputs == OutputState::Follow {
                    // `RemoteRearmed` comes with it.
                    return None;
                }
                if self.flags.any() || !self.has_outputs() {
                    Level::Note
                } else {
                    waits(Level::Error)
                }
            }
            EventKind::RemoteRearmCancelled { .. } if self.outputs == OutputState::Follow => {
                return None;
            }
            EventKind::WatchdogBitten | EventKind::BoardReset | EventKind::BusDown => {
                if self.flags.any() {
                    Level::Error
                } else {
                    Level::Note
                }
            }
            EventKind::RemoteStaysOffline { .. }
            | EventKind::RearmCancelled { .. }
            | EventKind::TransferFailed { .. }
            | EventKind::ReadFailed { .. }
            | EventKind::WriteFailed { .. }
            | EventKind::NotThere { .. }
            | EventKind::LostWrites { .. }
            | EventKind::MissedPeriods { .. }
            | EventKind::Dropped { .. } => Level::Note,
            kind if kind.is_fault() => Level::Error,
            _ => Level::Note,
        })
    }

    fn has_outputs(&self) -> bool {
        self.card().is_none_or(|card| card.has_outputs)
    }

    fn card(&self) -> Option<&Card> {
        self.names.find(self.kind.remote()?)
    }

    fn subject(&self) -> Subject<'_> {
        self.names.subject(self.kind.remote())
    }

    fn acknowledge(&self) -> Acknowledge<'_> {
        Acknowledge {
            board: &self.names.board,
            flags: self.flags,
        }
    }

    fn card_offline(&self, f: &mut fmt::Formatter<'_>, reason: OfflineReason) -> fmt::Result {
        let has_outputs = self.has_outputs();
        if is_other_card(reason) {
            self.reason(f, reason)?;
            f.write_str(". The card stays off: plug the right one in, or load ")?;
            return write!(f, "{} again", self.names.interface);
        }
        f.write_str("card offline")?;
        if has_outputs {
            f.write_str(", outputs off")?;
        }
        f.write_str(": ")?;
        self.reason(f, reason)?;
        if matches!(reason, OfflineReason::Stopped) || self.flags.any() {
            return Ok(());
        }
        f.write_str(". It is started again by itself")?;
        match self.outputs {
            _ if !has_outputs => Ok(()),
            OutputState::Follow => f.write_str(", and its outputs follow then"),
            OutputState::Wait => {
                f.write_str("; then ")?;
                self.rearm(f)
            }
        }
    }

    /// What lets the outputs of a card follow again.
    fn rearm(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let card = self.subject();
        write!(f, "set {card}.rearm to FALSE and TRUE to go on")
    }

    fn card_back(&self, f: &mut fmt::Formatter<'_>, text: &str) -> fmt::Result {
        f.write_str(text)?;
        if !self.has_outputs() {
            return Ok(());
        }
        match self.outputs {
            OutputState::Follow => f.write_str("; its outputs follow"),
            OutputState::Wait if self.flags.any() => {
                write!(f, ", outputs off: {}", self.acknowledge())
            }
            OutputState::Wait => {
                f.write_str(", outputs off: ")?;
                self.rearm(f)
            }
        }
    }

    fn reason(&self, f: &mut fmt::Formatter<'_>, reason: OfflineReason) -> fmt::Result {
        let expected = self.card().map_or("another card", |card| &card.expected);
        let port = self.kind.remote().map_or(0, |remote| remote.id.port);
        match reason {
            OfflineReason::TooManyFailures(failure) => {
                write!(f, "{failure}")?;
                match failure.advice() {
                    // Shorter, for the operator's screen.
                    Some(advice) if advice.topic() == AdviceTopic::RemotePower => {
                        f.write_str("; check its cable and power")
                    }
                    advice => {
                        let words = advice.and_then(words);
                        words.map_or(Ok(()), |words| write!(f, "; {words}"))
                    }
                }
            }
            OfflineReason::Absent => f.write_str("it was absent at the load"),
            OfflineReason::NotRunning(cs) => write!(f, "the port has stopped it ({cs})"),
            OfflineReason::Watchdog => f.write_str("its watchdog has bitten, or its power was off"),
            OfflineReason::IllegalMode => f.write_str("it has lost its software mode"),
            OfflineReason::FieldPower(faults) => write!(f, "{faults}; check its field power"),
            OfflineReason::Reported(faults) => {
                write!(f, "it reports {faults}; check its loads and supply")
            }
            OfflineReason::DidNotStart(cs) => write!(f, "it does not start ({cs})"),
            OfflineReason::AnotherDevice { found, .. } => write!(
                f,
                "{expected} expected, another card answers: {} (unit 0x{:08X})",
                found.name, found.unit_number
            ),
            OfflineReason::OtherTables { .. } | OfflineReason::OtherSizes { .. } => {
                write!(
                    f,
                    "{expected} answers with another firmware than at the load"
                )
            }
            OfflineReason::PortStuck => f.write_str("the port has not finished a command"),
            OfflineReason::Stopped => {
                let board = &self.names.board;
                write!(f, "{board}.sserial.port-{port}.run is FALSE")
            }
            OfflineReason::Requested => f.write_str("a restart"),
            OfflineReason::BoardDown => f.write_str("the board does not run"),
            other => write!(f, "{other}"),
        }
    }

    /// All outputs are off because of a fault; with what to check.
    fn all_off(
        &self,
        f: &mut fmt::Formatter<'_>,
        fault: fmt::Arguments<'_>,
        check: &str,
    ) -> fmt::Result {
        write!(f, "{fault}: all outputs off; {check}")?;
        if !check.is_empty() {
            f.write_str(if self.flags.any() { ", then " } else { "; " })?;
        }
        write!(f, "{}", self.acknowledge())
    }
}

/// True if the user has switched it off.
const fn is_asked_for(reason: OfflineReason) -> bool {
    matches!(reason, OfflineReason::Stopped | OfflineReason::Requested)
}

/// True if another card is in the place of the one that was there at the load.
const fn is_other_card(reason: OfflineReason) -> bool {
    matches!(
        reason,
        OfflineReason::AnotherDevice { .. }
            | OfflineReason::OtherTables { .. }
            | OfflineReason::OtherSizes { .. }
    )
}

/// True for a new reason that a card does not come back by itself.
const fn needs_a_hand(reason: OfflineReason) -> bool {
    is_other_card(reason)
        || matches!(
            reason,
            OfflineReason::FieldPower(_) | OfflineReason::Reported(_)
        )
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let board = &self.names.board;
        write!(f, "{}", self.subject())?;
        match self.kind {
            EventKind::StepRateLimited { generator, .. }
            | EventKind::StepTimeClipped { generator, .. }
            | EventKind::StepHoldShort { generator, .. }
            | EventKind::StepgenStalled { generator, .. } => {
                write!(f, ".stepgen.{generator:02}")?;
            }
            _ => {}
        }
        f.write_str(": ")?;
        match self.kind {
            EventKind::TransferFailed { failure, .. } => write!(f, "a transfer failed: {failure}"),
            EventKind::RemoteOffline { reason, .. } => self.card_offline(f, reason),
            EventKind::RemoteStaysOffline { reason, .. } if is_other_card(reason) => {
                self.card_offline(f, reason)
            }
            EventKind::RemoteStaysOffline { reason, .. } => {
                f.write_str("card still offline: ")?;
                self.reason(f, reason)
            }
            EventKind::RemoteBack { .. } => self.card_back(f, "card back"),
            EventKind::RemoteUp { .. } => self.card_back(f, "card plugged in, and running"),
            EventKind::RemoteRearmed { .. } => f.write_str("card runs, outputs follow"),
            EventKind::RemoteRearmCancelled { .. } => {
                f.write_str("outputs stay off because of a new fault; ")?;
                self.rearm(f)
            }
            EventKind::ParameterNotWritten { parameter, .. } => {
                let parameters = self.card().map(|card| &card.parameters);
                let name = parameters.and_then(|all| all.get(parameter as usize));
                let name = name.map_or("a parameter", |name| name);
                let port = self.kind.remote().map_or(0, |remote| remote.id.port);
                write!(
                    f,
                    "{name} was not written: no good reply, or the card does not keep the value; check the \
                     cable, then set {board}.sserial.port-{port}.run to FALSE and TRUE"
                )
            }
            EventKind::Repeated {
                what,
                count,
                lasted,
            } => {
                let lasted = lasted.as_secs_f64();
                match what {
                    Repeating::OtherMaster => {
                        write!(f, "{count} packets of another program within {lasted:.3} s")
                    }
                    _ => write!(f, "{count} {what} within {lasted:.3} s"),
                }
            }
            kind => self.of_board(f, kind),
        }
    }
}

impl Report<'_> {
    fn of_board(&self, f: &mut fmt::Formatter<'_>, kind: EventKind) -> fmt::Result {
        let Self { names, silence, .. } = self;
        let board = &names.board;
        match kind {
            EventKind::WatchdogBitten => self.all_off(
                f,
                format_args!(
                    "the board's watchdog has bitten (the thread has stopped or was late, or another \
                     program drives the board)"
                ),
                "",
            ),
            EventKind::BoardReset => self.all_off(
                f,
                format_args!(
                    "the board was reset or lost power, or another program wrote its watchdog's time"
                ),
                "",
            ),
            EventKind::BusDown if silence.cycles < LOST => {
                let fault = format_args!("too many packets were lost or late");
                self.all_off(f, fault, "check cable and latency")
            }
            EventKind::BusDown => {
                let time = silence.time.as_secs_f64();
                let fault = format_args!("connection lost for {time:.3} s");
                self.all_off(f, fault, "check cable and power")
            }
            EventKind::NotRead { .. } => {
                write!(f, "{board}.read is not called any more: inputs are not valid, all outputs off")?;
                match self.outputs {
                    OutputState::Follow => f.write_str("; add it to the thread"),
                    OutputState::Wait => write!(
                        f,
                        "; add it to the thread, then set {board}.rearm and that of each card to FALSE and TRUE"
                    ),
                }
            }
            EventKind::OtherFirmware => write!(
                f,
                "another board, or another firmware, answers than at the load: all outputs stay off; load {} \
                 again",
                names.interface
            ),
            EventKind::OtherMaster { packets } => write!(
                f,
                "another program drives this board ({packets} packets within 1 s): end it (LinuxCNC, \
                 mesaflash, another driver), also on other computers"
            ),
            EventKind::BoardSetUp => f.write_str("the board runs again"),
            EventKind::Rearmed { armed: 0, .. } => {
                f.write_str("outputs follow as soon as board and cards run")
            }
            EventKind::Rearmed { waiting: 0, .. } => f.write_str("outputs follow again"),
            EventKind::Rearmed { waiting, .. } => write!(
                f,
                "outputs follow again, but those of {waiting} cards or parts that do not run yet"
            ),
            EventKind::RearmCancelled { .. } => {
                f.write_str("outputs stay off because of a new fault")
            }
            EventKind::StepRateLimited { asked, limit, .. } => write!(
                f,
                "{asked} steps/s are commanded, and the limit is {limit} steps/s; check maxvel, \
                 position-scale, steplen and stepspace"
            ),
            EventKind::StepTimeClipped { asked, longest, .. } => write!(
                f,
                "{asked} ns became {longest} ns, the longest time of a pulse; check steplen, stepspace, \
                 dirsetup and dirhold"
            ),
            EventKind::StepHoldShort { asked, left, .. } => write!(
                f,
                "the direction can change {left} ns after a pulse, and dirhold is {asked} ns; check steplen \
                 and dirhold, which share a register"
            ),
            EventKind::StepgenStalled { rate, .. } => write!(
                f,
                "stopped, because its accumulator does not move at {rate} steps/s; check \
                 {board}.stepgen.timer-number and the timers of the DPLL, then set its enable to FALSE and \
                 TRUE"
            ),
            kind => {
                write!(f, "{}", kind.with_advice().in_words(words))
            }
        }
    }
}
