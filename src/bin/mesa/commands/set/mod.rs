//! `mesa set`: jogs one output.

pub mod jog;
mod report;

use std::time::Duration;

use clap::Args;
use mesa_hal::hal::{AnyValue, HalType, PinId, PinInfo, Pins, Role};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal::{Board, I7i77Analog, I7i97, Settings};

use super::named;
use crate::context::{Context, Ending, Failure};
use crate::output::complain;
use crate::running;
use crate::target::Target;

/// Long, because nothing here is fast, and the thread is any thread. It feeds remotes, whose watchdogs
/// have 50 ms.
const PERIOD: Duration = Duration::from_millis(8);
/// How long a reply is waited for.
const DEADLINE: Duration = Duration::from_millis(20);
/// A program that stands still for so long has no outputs any more.
const WATCHDOG: Duration = Duration::from_millis(100);

const AFTER_HELP: &str = "\
PIN is a name, or its end if no other has that: 7i77.0.0.output-03. All other outputs are off
meanwhile. It is safe again after the time, after SIGINT (Ctrl-C) and SIGTERM, and if anything
fails: then the exit code is 1, and the reason is printed. A board that another program drives is
left alone.

A drive moves with a voltage on its input and its enable: --analog lets an analog output be set,
--drive-enable a drive enable; an analog output with both is enabled for the time.

Examples:
  mesa set 7i77.0.0.output-03 on --for 2s --addr 10.10.10.10
  mesa set 7i77.0.1.analogout0 0.5 --for 1s --analog --drive-enable --sim 7i92-7i77 --yes";

/// Sets one output for a time, and makes it safe again
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Set {
    #[command(flatten)]
    target: Target,
    /// The output, or a parameter that can be set
    pin: String,
    /// What to set it to: on or off, or a number within its range
    #[arg(allow_negative_numbers = true)]
    value: String,
    /// For how long: 0.1 s to 60 s, as 2s, 1.5s or 500ms
    #[arg(long = "for", value_name = "TIME", value_parser = parse_time)]
    time: Duration,
    /// Let an analog output be set
    #[arg(long)]
    analog: bool,
    /// Let a drive be enabled
    #[arg(long)]
    drive_enable: bool,
}

impl Set {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find()?;
        let mut board = Board::identify(found.open_with(unhurried())?, settings())?;
        // Everything is off, and no remote runs before the consent.
        board.discover()?;
        let pins = board.pins();
        let pin = named::find(pins, &self.pin)?;
        let info = pins.info_of(pin).ok_or("the pin is gone")?.clone();
        let value = named::value(&info, &self.value)?;
        info.check_settable(value)
            .map_err(|error| Failure::usage(format_args!("{}: {error}", info.name)))?;
        self.allow(&info)?;
        let enable = if self.drive_enable && hazard(&info) == Hazard::Analog {
            enable_of(&board, pin)
        } else {
            None
        };
        let safe = pins.read_any(pin).value;
        let what = self.says(
            &info,
            (value, safe),
            enable.and_then(|pin| pins.info_of(pin)),
        );
        context.consent(&format!("{}: {what}", found.address), Some(&found))?;
        if let Some(signal) = context.stop.signal() {
            complain(format_args!("mesa: ended by {signal}; nothing was set"));
            return Ok(Ending::Stopped(signal));
        }
        let driver = running::go(board)?;
        let jog = jog::Jog::new(&driver, (pin, value, safe), enable, self.time);
        let report = jog.run(driver, context, &info)?;
        context.print(&report)?;
        if let Some(reason) = report.failure() {
            return Err(Failure::refused(reason));
        }
        Ok(context.ending())
    }

    /// What moves a machine has to be asked for by its name.
    fn allow(&self, info: &PinInfo) -> Result<(), Failure> {
        let (what, flag, is_given) = match hazard(info) {
            Hazard::None => return Ok(()),
            Hazard::Analog => ("is an analog output", "--analog", self.analog),
            Hazard::DriveEnable => ("can enable a drive", "--drive-enable", self.drive_enable),
            Hazard::Watchdog => {
                return Err(Failure::usage(format_args!(
                    "{} is what makes the board safe; it is not set by hand",
                    info.name
                )));
            }
        };
        if is_given {
            return Ok(());
        }
        Err(Failure::usage(format_args!(
            "{} {what}: a machine may move. Give {flag} if that is meant",
            info.name
        )))
    }

    fn says(
        &self,
        info: &PinInfo,
        (value, safe): (AnyValue, AnyValue),
        enable: Option<&PinInfo>,
    ) -> String {
        let unit = if info.unit.is_empty() {
            String::new()
        } else {
            format!(" {}", info.unit)
        };
        let place = match &*info.place.terminal {
            "" => String::new(),
            terminal => format!(" ({terminal})"),
        };
        let with = enable.map_or_else(String::new, |enable| {
            format!(", enables its drive with {}", enable.name)
        });
        format!(
            "sets {}{place} to {}{unit} for {:?}{with}, with all other outputs off, then back to {}{unit}",
            info.name,
            named::text(value),
            self.time,
            named::text(safe)
        )
    }
}

/// How a board is talked to whose outputs a person drives.
pub fn unhurried() -> UdpConfig {
    UdpConfig {
        cycle_deadline: DEADLINE,
        ..UdpConfig::default()
    }
}

/// With what settings.
pub fn settings() -> Settings {
    Settings {
        period: PERIOD,
        watchdog: Some(WATCHDOG),
        ..Settings::default()
    }
}

/// What a pin can do to a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hazard {
    /// No more than any output.
    None,
    Analog,
    DriveEnable,
    Watchdog,
}

/// By the name, because remotes that nobody knows have enables as well: rather too often than not.
pub fn hazard(info: &PinInfo) -> Hazard {
    let last = info.name.rsplit('.').next().unwrap_or_default();
    let harmless = [
        "index-enable",
        "probe-enable",
        "quad-error-enable",
        "latch-enable",
    ];
    let is_enable = last.contains("ena") && !harmless.contains(&last);
    // What inverts an I/O pin may invert the one that a drive is enabled by.
    let turns_pin = info.name.contains(".gpio.") && info.role.is_param() && last != "is_output";
    let is_param = info.role.is_param();
    if info.name.contains(".watchdog.") {
        Hazard::Watchdog
    } else if is_enable || turns_pin {
        Hazard::DriveEnable
    } else if (info.hal_type != HalType::Bit && info.role != Role::Input && !is_param)
        || last.starts_with("analogout")
        || (is_param && (info.name.contains(".pwmgen.") || bounds_output(last)))
    {
        Hazard::Analog
    } else {
        Hazard::None
    }
}

/// Limits and scales of an output: a least value above 0 is what the output has then.
fn bounds_output(last: &str) -> bool {
    ["-minlim", "-maxlim", "-scalemax"]
        .iter()
        .any(|end| last.ends_with(end))
}

/// What enables the drive of an analog output, of cards that are known.
pub fn enable_of(board: &Board<UdpBus>, pin: PinId) -> Option<PinId> {
    let cards = board.remotes().filter_map(|(port, remote)| {
        let channel = remote.started.channel.index();
        board.attach::<I7i77Analog>(port, channel).ok()
    });
    let mut outputs: Vec<_> = cards.flat_map(|card| card.analog_out).collect();
    if let Ok(own) = board.attach_board::<I7i97>() {
        outputs.extend(own.analog_out);
    }
    let mut found = outputs
        .into_iter()
        .filter(|output| PinId::from(output.volts) == pin);
    found.next().map(|output| output.enable.into())
}

/// Pins that tell what an output did: inputs at terminals, and read-back of I/O pins.
fn is_told(info: &PinInfo) -> bool {
    // Those that tell nothing more than others do.
    let more = [
        "-not",
        "_not",
        ".rawcounts",
        ".velocity-rpm",
        ".count-unsure",
    ];
    info.role == Role::Input
        && !info.place.terminal.is_empty()
        && !more.iter().any(|end| info.name.ends_with(end))
}

/// The pins that are told about, in their order.
fn told(pins: &Pins) -> Vec<PinId> {
    let ids = pins.ids();
    let inputs = ids.filter(|&pin| pins.info_of(pin).is_some_and(is_told));
    inputs.collect()
}

fn parse_time(text: &str) -> Result<Duration, String> {
    let (number, unit) = match (text.strip_suffix("ms"), text.strip_suffix('s')) {
        (Some(number), _) => (number, 0.001),
        (None, Some(number)) => (number, 1.0),
        (None, None) => (text, 1.0),
    };
    let seconds = number.parse::<f64>().map(|number| number * unit);
    let seconds = seconds
        .ok()
        .filter(|seconds| (0.1..=60.0).contains(seconds));
    seconds
        .map(Duration::from_secs_f64)
        .ok_or_else(|| format!("`{text}` is no time from 0.1 s to 60 s, as 2s or 500ms"))
}
