//! `mesa reset` and `mesa reload`: restart of a board.

use std::fmt::{self, Display};
use std::net::Ipv4Addr;
use std::time::Duration;

use clap::Args;
use mesa_hal::Clock;
use mesa_hal::boards::FlashLayout;
use mesa_hal::bus::{BusError, Instant};
use mesa_hal::ethernet::{AddressSource, Area, Counters, EthernetBoard, EthernetError, Identity};
use serde::Serialize;

use super::flash::layout_of_board;
use crate::board::address::BoardAddress;
use crate::board::bus::Bus;
use crate::board::changed::ChangedTarget;
use crate::board::target::Found;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::output::complain;
use mesa_tools::advice::told;

/// Restart the network side of a board
///
/// The board comes back with the address that its jumpers select, which is waited for there. The
/// FPGA keeps its registers; a program that drives the board loses it for up to half a second.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa reset --addr 10.10.10.10")]
pub struct Reset {
    #[command(flatten)]
    restart: Restart,
}

/// Reload the FPGA's configuration from the flash memory
///
/// All outputs go off, and every register is lost. Needs firmware 15 or later.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa reload --addr 10.10.10.10 --wait 20")]
pub struct Reload {
    #[command(flatten)]
    restart: Restart,
}

#[derive(Debug, Args)]
struct Restart {
    #[command(flatten)]
    target: ChangedTarget,
    /// Time to wait for the board to answer again, in seconds, 1 to 60
    #[arg(long, value_name = "SECONDS", default_value_t = 10,
        value_parser = clap::value_parser!(u64).range(1..=60))]
    wait: u64,
}

/// Result of a restart.
#[derive(Debug, Serialize)]
struct Restarted {
    board: String,
    action: &'static str,
    /// Address at which it answers.
    address: BoardAddress,
    /// Time from the command to the first answer.
    answered_after_s: f64,
}

/// A board that restarts.
struct Restarting<'a> {
    action: &'static str,
    found: &'a Found,
    /// The board before the restart.
    identity: &'a Identity,
    /// The board at the address that its jumpers select, if that is another one.
    moved: Option<Found>,
    before: Counters,
    limit: Duration,
}

impl Reset {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let what = "restart the network side of the board: it is silent for up to half a second, \
                    and comes back with the address that its jumpers select";
        self.restart.run(context, "reset", what, |bus| {
            Ok(EthernetBoard::new(bus).reset()?)
        })
    }
}

impl Reload {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let what = "make the FPGA load its configuration again: all outputs go off, and every \
                    register is lost";
        self.restart.run(context, "reload", what, |bus| {
            let layout = layout_of(bus)?;
            let (user, fallback) = (layout.user.0, layout.fallback.0);
            Ok(EthernetBoard::new(bus).reload(user, fallback)?)
        })
    }
}

impl Restart {
    fn run(
        &self,
        context: &Context,
        action: &'static str,
        what: &str,
        restart: impl FnOnce(&mut Bus) -> Result<(), Failure>,
    ) -> Result<Ending, Failure> {
        let found = self.target.find(context)?;
        found.need_ethernet("a reset or reload by this command")?;
        let mut bus = found.open()?;
        let mut board = EthernetBoard::new(&mut bus);
        let identity = board.identity()?;
        let before = board.counters()?;
        let loads = match action {
            "reload" => what_it_loads(&mut bus)?,
            _ => "",
        };
        let moved = next_address(&identity).filter(|&ip| Some(ip) != found.address.ip());
        let restarting = Restarting {
            action,
            found: &found,
            identity: &identity,
            moved: moved.and_then(|ip| found.moved_to(ip)),
            before,
            limit: Duration::from_secs(self.wait),
        };
        let place = restarting.place();
        if !context.agrees(&self.target, &found, &format!("{what}{loads}{place}"))? {
            return Ok(context.ending());
        }
        let begun = bus.now();
        restart(&mut bus)?;
        complain(format_args!(
            "mesa: the {action} is sent; {}{place}",
            outputs(action)
        ));
        if let Some(address) = restarting.wait(context, &mut bus, begun)? {
            context.print(&Restarted {
                board: identity.card.clone(),
                action,
                address,
                answered_after_s: bus.now().since(begun).as_secs_f64(),
            })?;
        }
        Ok(context.ending())
    }
}

impl Restarting<'_> {
    /// The address that the board will have, as a sentence, if that is another one.
    fn place(&self) -> String {
        let Some(moved) = &self.moved else {
            return String::new();
        };
        let from = self.identity.address_from.of_card(&self.identity.card);
        let at = moved.address.ip().map(|ip| ip.to_string());
        format!(
            ". By its jumpers it will be at {}: {from}",
            at.unwrap_or_default()
        )
    }

    /// Waits until the board answers; returns its address, or `None` after a signal.
    fn wait(
        &self,
        context: &Context,
        bus: &mut Bus,
        begun: Instant,
    ) -> Result<Option<BoardAddress>, Failure> {
        loop {
            let error = match self.answers(bus)? {
                Ok(address) => return Ok(Some(address)),
                Err(error) => error,
            };
            let waited = bus.now().since(begun);
            if waited > self.limit {
                return Err(self.silent(waited, &error));
            }
            if let Some(signal) = context.stop.signal() {
                let action = self.action;
                complain(format_args!(
                    "mesa: ended by {signal} before the board has answered; the {action} is sent and \
                     cannot be taken back; {}. `mesa info` shows whether the board is back",
                    outputs(action)
                ));
                return Ok(None);
            }
        }
    }

    /// The address at which the board answers again; else the reason why it does not.
    fn answers(&self, bus: &mut Bus) -> Result<Result<BoardAddress, String>, Failure> {
        let Some(error) = not_back(bus, &self.before)? else {
            return Ok(Ok(self.found.address));
        };
        let Some(moved) = &self.moved else {
            return Ok(Err(told(&error)));
        };
        let mut bus = match moved.open() {
            Ok(bus) => bus,
            Err(error) => return Ok(Err(error.to_string())),
        };
        Ok(match not_back(&mut bus, &self.before)? {
            Some(error) => Err(told(&error)),
            None => Ok(moved.address),
        })
    }

    /// Error for a board that does not answer again, with its possible addresses.
    fn silent(&self, waited: Duration, error: &str) -> Failure {
        let fixed = AddressSource::FIXED;
        let also = self
            .moved
            .as_ref()
            .map_or_else(String::new, |moved| format!(", nor at {}", moved.address));
        Failure::refused(format_args!(
            "{}: does not answer again within {:.1} s{also}: {error}. By its jumpers it may be at {} (from \
             the EEPROM) or {fixed} (fixed) now; this computer needs an address in the same network",
            self.found.address,
            waited.as_secs_f64(),
            self.identity.eeprom_ip
        ))
    }
}

/// The address of a board after its restart, as its jumpers select it; `None` if a server gives it
/// one.
fn next_address(identity: &Identity) -> Option<Ipv4Addr> {
    match identity.address_from {
        AddressSource::Eeprom => Some(identity.eeprom_ip),
        AddressSource::Fixed | AddressSource::Fallback => Some(AddressSource::FIXED),
        _ => None,
    }
}

/// Error of the bus while a restarted board does not answer yet; `None` once it does.
fn not_back(bus: &mut Bus, before: &Counters) -> Result<Option<BusError>, Failure> {
    match EthernetBoard::new(bus).restarted(before) {
        Ok(_) => Ok(None),
        Err(EthernetError::Bus(error)) => Ok(Some(error)),
        Err(error) => Err(error.into()),
    }
}

/// State of the outputs after the restart.
fn outputs(action: &str) -> &'static str {
    match action {
        "reload" => {
            "all outputs are off when the FPGA loads, those of remotes by their own watchdogs"
        }
        _ => {
            "outputs stay as they are, because the FPGA keeps running: an output that was on stays on \
             until the board's watchdog bites"
        }
    }
}

fn layout_of(bus: &mut Bus) -> Result<&'static FlashLayout, Failure> {
    layout_of_board(bus)
        .map_err(|why| Failure::refused(format_args!("{why}: switch the board off and on instead")))
}

/// Warning about the configuration that the FPGA will load; empty for the user configuration. Fails
/// if there is no configuration, because the board would not answer any more.
fn what_it_loads(bus: &mut Bus) -> Result<&'static str, Failure> {
    let layout = layout_of(bus)?;
    let mut flash = EthernetBoard::new(bus).into_flash(*layout)?;
    if flash.begins(Area::User)? {
        return Ok("");
    }
    if flash.begins(Area::Fallback)? {
        return Ok(
            ". There is no user configuration, or its writing was cut off: it loads the fallback, whose \
             pins may differ; `mesa flash write` writes a user configuration",
        );
    }
    Err(Failure::refused(
        "there is no configuration in the flash memory, so the board would not answer after a \
         reload; `mesa flash write` writes one",
    ))
}

impl Display for Restarted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let after = self.answered_after_s;
        writeln!(
            f,
            "{}: {} done, it answers again after {after:.1} s at {}",
            self.board, self.action, self.address
        )
    }
}
