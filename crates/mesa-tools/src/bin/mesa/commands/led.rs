//! `mesa led`: mode of the board's user LEDs.

use std::fmt::{self, Display};

use clap::{Args, ValueEnum};
use mesa_hal::ethernet::{EthernetBoard, LedMode, LedTime};
use serde::Serialize;

use crate::board::changed::ChangedTarget;
use crate::ui::context::{Context, Ending, Failure};

const AFTER_HELP: &str = "\
Without MODE, prints the current modes and changes nothing.

Examples:
  mesa led --sim 7i97
  mesa led hostmot2 --addr 10.10.10.10 --at-start";

/// Show or set the mode of the user LEDs, now and after a restart
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Led {
    #[command(flatten)]
    target: ChangedTarget,
    /// New mode of the LEDs
    #[arg(value_enum)]
    mode: Option<Mode>,
    /// Set the mode after each restart as well: writes the EEPROM
    #[arg(long, requires = "mode")]
    at_start: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Mode {
    #[value(
        name = "hostmot2",
        help = "the pins led.CR01 to led.CR04 of the driver"
    )]
    HostMot2,
    #[value(help = "a variable of the network side, usually the number of packets received")]
    Debug,
}

/// Modes of the LEDs.
#[derive(Debug, Serialize)]
struct Leds {
    now: Mode,
    at_start: Mode,
}

impl Led {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find(context)?;
        found.need_ethernet("the choice of what the LEDs show")?;
        let mut bus = found.open()?;
        let mut board = EthernetBoard::new(&mut bus);
        if let Some(mode) = self.mode {
            let what = if self.at_start {
                "set what the user LEDs show, now and, in the EEPROM, after each restart"
            } else {
                "set what the user LEDs show until the next restart"
            };
            if !context.agrees(&self.target, &found, what)? {
                return Ok(context.ending());
            }
            board.set_led_mode(LedTime::Now, mode.into())?;
            if self.at_start {
                board.set_led_mode(LedTime::AtStart, mode.into())?;
            }
        }
        context.print(&Leds {
            now: board.led_mode(LedTime::Now)?.into(),
            at_start: board.led_mode(LedTime::AtStart)?.into(),
        })?;
        Ok(context.ending())
    }
}

impl From<Mode> for LedMode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::HostMot2 => Self::HostMot2,
            Mode::Debug => Self::Debug,
        }
    }
}

impl From<LedMode> for Mode {
    fn from(mode: LedMode) -> Self {
        match mode {
            LedMode::HostMot2 => Self::HostMot2,
            LedMode::Debug => Self::Debug,
        }
    }
}

impl Display for Leds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "now       {}", self.now)?;
        writeln!(f, "at start  {}", self.at_start)
    }
}

impl Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::HostMot2 => "hostmot2",
            Self::Debug => "debug",
        })
    }
}
