//! `mesa update`: firmware update of a remote.

use std::fmt::{self, Display};
use std::path::PathBuf;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use mesa_hal::RemoteId;
use mesa_hal::boards::i7i77;
use mesa_hal::driver::{RemoteConfig, SerialConfig};
use mesa_hal::sslbp::{RemoteName, StartedRemote};
use mesa_hal::{Board, DriverError, Settings};
use mesa_tools::Counted;
use mesa_tools::setup::update::{UpdateError, UpdatePlan, UpdateProgress, UpdateStep};
use mesa_tools::setup::{FirmwareFile, RemoteLink, RemotePlace, SETUP_BAUD_RATE};
use serde::Serialize;

use super::param::cabinet::CabinetTarget;
use crate::board::consent::{Asks, Plan};
use crate::board::target::Found;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;
use crate::ui::output::complain;
use mesa_tools::advice::told;

/// Limit for the size of a firmware file: more than any has.
const MAX_BYTES: u64 = 4 << 20;

const AFTER_HELP: &str = "\
The card's jumper must be in the setup position (7I77: W12 for field I/O, W4 for analog, to the
right; 7I72: W6 down), and the card must have been switched off and on since. A board stops its
serial ports and turns all pins into inputs: do not use this on a running machine.

FILE is an image of the flash memory, such as Mesa's .BIN files, which need not name their card.
Doubts about the file are reported: only its name matches, it begins with another bootloader, or it
ends before the data on the card does. The file is compared with the memory; blocks that differ are
erased, written and read back one by one, except the first, which holds the bootloader. The same
command finishes an update that was cut off. The new firmware runs from the next power-up on: put
the jumper back before it.

Not confirmed on hardware: that the flash memory can be read back. A card that does not allow it is
refused; --no-verify writes blindly, as LinuxCNC's setsserial does.

Examples:
  mesa update 7i77 7I77.BIN --serial /dev/ttyUSB0
  mesa update 7i72 7I72.BIN --at 0.1 --addr 10.10.10.10 --dry-run";

/// Update the firmware of a remote: erase, write, verify
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Update {
    /// Name of the card, for example 7i77; the card that answers and the file must match it
    #[arg(value_parser = parse_card)]
    card: RemoteName,
    /// Firmware file (.BIN) for that card
    file: PathBuf,
    /// Place of the card on a board: serial port 0 to 3, channel 0 to 7
    #[arg(
        long, value_name = "PORT.CHANNEL", value_parser = parse_place,
        required_unless_present = "serial", conflicts_with = "serial"
    )]
    at: Option<RemoteId>,
    /// Print what would be written, and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Do not read the flash memory back
    #[arg(long)]
    no_verify: bool,
    #[command(flatten)]
    asks: Asks,
    #[command(flatten)]
    target: CabinetTarget,
}

fn parse_card(text: &str) -> Result<RemoteName, String> {
    let name = text.to_ascii_uppercase();
    let name = name.as_bytes().try_into().map(RemoteName);
    name.map_err(|_| format!("`{text}` is no name of a card, which has four characters, as 7i77"))
}

fn parse_place(text: &str) -> Result<RemoteId, String> {
    let id = text.parse().ok().filter(|id: &RemoteId| id.port < 4);
    id.ok_or_else(|| format!("`{text}` is no PORT.CHANNEL, 0.0 to 3.7"))
}

/// The card to update.
struct Card<'a> {
    place: RemotePlace,
    started: StartedRemote,
    /// True if only the bootloader answers.
    is_bare: bool,
    /// The board that it is connected to; `None` on a serial port of the PC.
    board: Option<&'a Found>,
}

/// Result of an update or of a dry run.
#[derive(Debug, Serialize)]
struct UpdateReport {
    card: String,
    place: String,
    unit_number: u32,
    file: PathBuf,
    /// True if only the bootloader answered.
    was_cut_off: bool,
    block_size: u32,
    blocks: usize,
    different: usize,
    written: usize,
    verified: bool,
    dry_run: bool,
    /// Doubts about the file.
    doubts: Vec<String>,
}

/// Doubts about a file, and checks that were not possible.
fn doubts(firmware: &FirmwareFile, plan: &UpdatePlan) -> Vec<String> {
    let mut doubts = Vec::new();
    if !firmware.names_card() {
        doubts.push("only the file's name shows that it is for this card".to_owned());
    }
    match plan.has_bootloader {
        Some(true) => {}
        Some(false) => {
            doubts.push("the file begins with another bootloader than the card's".into());
        }
        None => doubts.push("the card cannot be read, so nothing was compared".into()),
    }
    let bytes = firmware.bytes().len();
    if let Some(offset) = plan.behind_end {
        doubts.push(format!(
            "the file ends after {bytes} bytes, but the card has something at {offset}: is the file incomplete?"
        ));
    }
    doubts
}

impl Update {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let firmware = self.firmware()?;
        let report = match self.target.line.open()? {
            Some(mut host) => {
                let device = self.target.line.serial.as_deref().unwrap_or_default();
                let remote = host.identify();
                let remote = remote.map_err(|error| {
                    Failure::of(&error, format_args!("{device}: {}", told(&error)))
                })?;
                let card = Card {
                    place: RemotePlace::Serial,
                    started: remote.started,
                    is_bare: remote.is_bare,
                    board: None,
                };
                self.update(context, &mut host, &card, &firmware)?
            }
            None => self.over_board(context, &firmware)?,
        };
        if let Some(report) = report {
            context.print(&report)?;
        }
        Ok(context.ending())
    }

    fn firmware(&self) -> Result<FirmwareFile, Failure> {
        let path = self.file.display();
        let contents = files::read(&self.file, MAX_BYTES).map_err(Failure::usage)?;
        let name = self.file.file_name().unwrap_or_default().to_string_lossy();
        let firmware = FirmwareFile::new(&name, contents, self.card);
        firmware.map_err(|error| Failure::of(&error, format_args!("{path}: {}", told(&error))))
    }

    fn over_board(
        &self,
        context: &Context,
        firmware: &FirmwareFile,
    ) -> Result<Option<UpdateReport>, Failure> {
        // clap requires `--at` unless `--serial` is given.
        let id = self.at.unwrap_or(RemoteId::new(0, 0));
        let found = self.target.target.find(context)?;
        // Only this remote of the port takes part.
        let only = SerialConfig {
            channels: [(id.channel, RemoteConfig::default())].into(),
        };
        let settings = Settings {
            serial_ports: [(id.port, only)].into(),
            ..Settings::default()
        };
        let mut board = Board::identify(found.open()?, settings)?.discover()?;
        let (mut link, started) =
            board
                .setup_at(id, SETUP_BAUD_RATE)
                .map_err(|error| match error {
                    DriverError::Missing(missing) => Failure::refused(format_args!(
                        "{}. It was asked at {SETUP_BAUD_RATE} baud: is its jumper in the \
                         setup position, and was it switched off and on since?",
                        told(&missing)
                    )),
                    error => error.into(),
                })?;
        let card = Card {
            place: RemotePlace::Channel(id),
            started,
            is_bare: started.is_bare(),
            board: Some(&found),
        };
        let report = self.update(context, &mut link, &card, firmware);
        let ended = board.end_setup_at(id);
        let report = report?;
        ended?;
        Ok(report)
    }

    /// Returns `None` for an update that a signal ended, which standard error reports.
    fn update<L: RemoteLink>(
        &self,
        context: &Context,
        link: &mut L,
        card: &Card<'_>,
        firmware: &FirmwareFile,
    ) -> Result<Option<UpdateReport>, Failure> {
        let name = card.started.name;
        if name.0.map(|c| c.to_ascii_uppercase()) != self.card.0 {
            return Err(Failure::refused(format_args!(
                "{}: this is a {name}, not a {}; nothing was written",
                card.place, self.card
            )));
        }
        let is_verified = !self.no_verify;
        let bar = Bar::new(context);
        let mut on_progress = |progress| bar.show(progress, context);
        let plan = match UpdatePlan::make(link, firmware, &mut on_progress) {
            Err(UpdateError::Stopped { .. }) => return Ok(stopped("nothing was written")),
            plan => plan?,
        };
        let mut report = self.report(card, firmware, &plan);
        if self.dry_run || report.different == 0 {
            return Ok(Some(report));
        }
        if is_verified && !plan.is_readable {
            return Err(UpdateError::NotReadable.into());
        }
        bar.clear();
        self.asks
            .consent_to_change(context, &report.plan(card), card.board)?;
        match plan.carry_out(link, firmware, is_verified, &mut on_progress) {
            Err(error @ UpdateError::Stopped { .. }) => return Ok(stopped(error)),
            done => done?,
        }
        bar.clear();
        report.written = report.different;
        Ok(Some(report))
    }

    /// Report before anything is written.
    fn report(&self, card: &Card<'_>, firmware: &FirmwareFile, plan: &UpdatePlan) -> UpdateReport {
        let different = plan.different().count();
        UpdateReport {
            card: card.started.name.to_string(),
            place: card.place.to_string(),
            unit_number: card.started.unit_number,
            file: self.file.clone(),
            was_cut_off: card.is_bare,
            block_size: plan.erase_size,
            blocks: plan.blocks.len(),
            different,
            written: 0,
            verified: plan.is_readable && (!self.no_verify || different == 0),
            dry_run: self.dry_run,
            doubts: doubts(firmware, plan),
        }
    }
}

fn stopped(why: impl Display) -> Option<UpdateReport> {
    complain(format_args!("mesa: {why}"));
    None
}

/// Name of a card. The two parts of a 7I77 share a name and differ in the class of their unit
/// numbers.
fn kind(started: &StartedRemote) -> String {
    let class = (started.unit_number >> 24) as u8;
    match (&started.name.0, class) {
        (b"7I77", 0x12) => i7i77::FIELD.title.to_owned(),
        (b"7I77", 0x11) => i7i77::ANALOG.title.to_owned(),
        _ => started.name.to_string(),
    }
}

/// A progress bar on standard error, if that is a terminal.
struct Bar(ProgressBar);

impl Bar {
    fn new(context: &Context) -> Self {
        let bar = if context.json {
            ProgressBar::hidden()
        } else {
            ProgressBar::new(0)
        };
        let form = "{msg:>8} {wide_bar} {bytes}/{total_bytes} {eta}";
        if let Ok(style) = ProgressStyle::with_template(form) {
            bar.set_style(style);
        }
        Self(bar)
    }

    /// Updates the bar; returns `false` after a signal, to end the update.
    fn show(&self, progress: UpdateProgress, context: &Context) -> bool {
        let UpdateProgress { step, done, total } = progress;
        self.0.set_message(match step {
            UpdateStep::Compare => "compare",
            UpdateStep::Write => "write",
            UpdateStep::Verify => "verify",
        });
        self.0.set_length(total);
        self.0.set_position(done);
        context.stop.signal().is_none()
    }

    fn clear(&self) {
        self.0.finish_and_clear();
        self.0.reset();
    }
}

impl UpdateReport {
    /// Planned action as text.
    fn plan(&self, card: &Card<'_>) -> Plan {
        let (place, unit) = (&self.place, self.unit_number);
        let (place, what) = if self.was_cut_off {
            let what = "finish a firmware update that was cut off: ";
            (place.clone(), what)
        } else {
            let kind = kind(&card.started);
            (format!("{place}: a {kind}, unit number {unit:#010X}"), "")
        };
        let action = format!(
            "{what}erase and write {} of {} of {} bytes ({}){}. Until this is done, the card \
             has no program; keep its power on",
            self.different,
            Counted::of(self.blocks, "block"),
            self.block_size,
            self.file.display(),
            self.said_doubts()
        );
        Plan::at(place, action)
    }

    fn said_doubts(&self) -> String {
        let doubts = self.doubts.iter();
        doubts.map(|doubt| [". NOTE: ", doubt].concat()).collect()
    }
}

impl Display for UpdateReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            card,
            place,
            blocks,
            different,
            block_size,
            ..
        } = self;
        write!(
            f,
            "{place}  {card}, unit number {:#010X}: ",
            self.unit_number
        )?;
        let blocks = Counted::of(*blocks, "block");
        let verified = if self.verified {
            ", verified"
        } else {
            ", not verified"
        };
        if self.dry_run {
            writeln!(
                f,
                "{different} of {blocks} of {block_size} bytes differ; nothing was written"
            )?;
            for doubt in &self.doubts {
                writeln!(f, "NOTE: {doubt}")?;
            }
        } else if *different == 0 {
            writeln!(
                f,
                "has this firmware already ({blocks} of {block_size} bytes)"
            )?;
        } else {
            writeln!(
                f,
                "{} of {blocks} of {block_size} bytes written{verified}",
                self.written
            )?;
            writeln!(
                f,
                "Switch it off, put its jumper back to operate mode, and switch it on."
            )?;
        }
        Ok(())
    }
}
