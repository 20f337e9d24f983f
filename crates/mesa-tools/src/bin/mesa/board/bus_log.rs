//! What went over the bus of a command, as a file.

use std::path::PathBuf;

use clap::Args;
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::transport::{BusLog, RecordedEntry, Recording};

use crate::board::bus::Bus;
use crate::ui::context::Failure;
use crate::ui::files;
use crate::ui::output::complain;

/// Words that are kept: some hundred cycles.
const WORDS: usize = 20_000;
/// Part of these that follow an exchange that fails.
const AFTER: usize = 2_000;

/// The file for what went over the bus.
#[derive(Debug, Args)]
pub struct BusLogFile {
    /// File for what went over the bus, up to the first exchange that fails and some cycles after
    /// it, or to the end: times, registers by name, words
    #[arg(long = "bus-log", value_name = "FILE")]
    pub path: Option<PathBuf>,
}

impl BusLogFile {
    /// A layer around the bus that records if a file was asked for.
    pub fn around(&self, bus: Bus) -> Recording<Bus> {
        let words = if self.path.is_some() { WORDS } else { 0 };
        let log = BusLog::new(words).freezing_on(RecordedEntry::is_fault, AFTER);
        Recording::new(bus, log)
    }

    /// Writes the file, and says which exchange failed.
    pub fn save(&self, log: &BusLog, firmware: &HostMot2) -> Result<(), Failure> {
        let Some(path) = &self.path else {
            return Ok(());
        };
        files::write(path, log.text(firmware).to_string().as_bytes())?;
        if let Some(cause) = log.cause() {
            complain(format_args!(
                "mesa: an exchange has failed; {} has what went over the bus before it: {cause}",
                path.display()
            ));
        }
        Ok(())
    }
}
