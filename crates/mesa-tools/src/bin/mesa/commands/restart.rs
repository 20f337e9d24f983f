//! `mesa reset` and `mesa reload`: a board begins again.

use std::fmt::{self, Display};
use std::time::Duration;

use clap::Args;
use mesa_hal::Clock;
use mesa_hal::ethernet::{
    AddressSource, Area, EthernetBoard, EthernetError, FlashLayout, Identity,
};
use serde::Serialize;

use crate::context::{Context, Ending, Failure};
use crate::link::Bus;
use crate::output::complain;
use crate::target::{ChangedTarget, Found};

/// Restarts the network side of a board
///
/// It comes back with the address that its jumpers say. The FPGA keeps its registers; what drives the board loses it for up to half a second.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mesa reset --addr 10.10.10.10")]
pub struct Reset {
    #[command(flatten)]
    restart: Restart,
}

/// Makes the FPGA load its configuration from the flash memory again
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
    /// How long to wait until the board answers again, in seconds, 1 to 60
    #[arg(long, value_name = "SECONDS", default_value_t = 10,
        value_parser = clap::value_parser!(u64).range(1..=60))]
    wait: u64,
}

/// How a restart went.
#[derive(Debug, Serialize)]
struct Restarted {
    board: String,
    action: &'static str,
    /// From the command to the first answer.
    answered_after_s: f64,
}

impl Reset {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let what = "restarts the network side of the board: it is silent for up to half a second, \
                    and comes back with the address that its jumpers say";
        self.restart.run(context, "reset", what, |bus, _| {
            Ok(EthernetBoard::new(bus).reset()?)
        })
    }
}

impl Reload {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let what = "makes the FPGA load its configuration again: all outputs go off, and every \
                    register is lost";
        self.restart.run(context, "reload", what, |bus, identity| {
            let layout = layout_of(identity)?;
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
        restart: impl FnOnce(&mut Bus, &Identity) -> Result<(), Failure>,
    ) -> Result<Ending, Failure> {
        let found = self.target.find()?;
        let mut bus = found.open()?;
        let mut board = EthernetBoard::new(&mut bus);
        let identity = board.identity()?;
        let before = board.counters()?;
        let loads = match action {
            "reload" => what_it_loads(&mut bus, &identity)?,
            _ => "",
        };
        if !context.agrees(&self.target, &found, &format!("{what}{loads}"))? {
            return Ok(context.ending());
        }
        let begun = bus.now();
        restart(&mut bus, &identity)?;
        complain(format_args!(
            "mesa: the {action} is sent; {}",
            outputs(action)
        ));
        let limit = Duration::from_secs(self.wait);
        loop {
            match EthernetBoard::new(&mut bus).restarted(&before) {
                Ok(_) => break,
                Err(EthernetError::Bus(error)) => {
                    let waited = bus.now().since(begun);
                    if waited > limit {
                        return Err(silent(&found, &identity, waited, error));
                    }
                }
                Err(error) => return Err(error.into()),
            }
            if let Some(signal) = context.stop.signal() {
                complain(format_args!(
                    "mesa: ended by {signal}: nobody waits for the board any more, which has not \
                     answered yet; the {action} is on its way and can not be taken back; {}. \
                     `mesa info` tells whether it is there",
                    outputs(action)
                ));
                return Ok(context.ending());
            }
        }
        context.print(&Restarted {
            board: identity.card,
            action,
            answered_after_s: bus.now().since(begun).as_secs_f64(),
        })?;
        Ok(context.ending())
    }
}

/// What becomes of the outputs.
fn outputs(action: &str) -> &'static str {
    match action {
        "reload" => {
            "all outputs are off when the FPGA loads, those of remotes by their own watchdogs"
        }
        _ => {
            "outputs stay as they are, because the FPGA goes on: what was on is on until its watchdog \
             bites"
        }
    }
}

/// Nothing answers any more: where it may be.
fn silent(found: &Found, identity: &Identity, waited: Duration, error: impl Display) -> Failure {
    let fixed = AddressSource::FIXED;
    Failure::refused(format_args!(
        "{}: does not answer again within {:.1} s: {error}. By its jumpers it may be at {} (from the \
         EEPROM) or {fixed} (fixed) now",
        found.address,
        waited.as_secs_f64(),
        identity.eeprom_ip
    ))
}

fn layout_of(identity: &Identity) -> Result<&'static FlashLayout, Failure> {
    let card = &identity.card;
    FlashLayout::for_card(card).ok_or_else(|| {
        Failure::refused(format_args!(
            "this is a {card}; where its configurations are in its flash memory is not known here: \
             switch the board off and on instead"
        ))
    })
}

/// What there is to say of what the FPGA loads. A board that finds nothing does not answer any more.
fn what_it_loads(bus: &mut Bus, identity: &Identity) -> Result<&'static str, Failure> {
    let layout = layout_of(identity)?;
    let mut flash = EthernetBoard::new(bus).into_flash(*layout)?;
    if flash.begins(Area::User)? {
        return Ok("");
    }
    if flash.begins(Area::Fallback)? {
        return Ok(
            ". There is no user configuration, or its writing was cut off: it loads the fallback, whose \
             pins may be others; `mesa flash write` writes it",
        );
    }
    Err(Failure::refused(
        "there is no configuration in the flash memory, so that nothing would answer after a reload; \
         `mesa flash write` writes one",
    ))
}

impl Display for Restarted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let after = self.answered_after_s;
        writeln!(
            f,
            "{}: {} done, it answers again after {after:.1} s",
            self.board, self.action
        )
    }
}
