//! The remotes of a board as a cabinet, those with the jumper in the setup position included.

use mesa_hal::discovery::{DiscoveryOptions, RemoteDescriptor, discover};
use mesa_hal::driver::Remark;
use mesa_hal::hal::AnyValue;
use mesa_hal::lbp::RemoteAccess;
use mesa_hal::remote::ParameterError;
use mesa_hal::sslbp::{DEFAULT_BAUD_RATE, MAX_INTERFACE_REGISTERS, PortLink};
use mesa_hal::{Board, Configured, DriverError, RemoteId, RemoteLabel, Settings};

use mesa_tools::setup::{Cabinet, CabinetError, CabinetRemote, RemotePlace};

use crate::board::bus::Bus;
use crate::board::target::Found;
use crate::ui::context::Failure;
use crate::ui::output::complain;
use mesa_tools::advice::told;

type BoardError = DriverError;

/// The remotes of a board in setup mode.
pub struct BoardCabinet {
    board: Box<Configured<Bus>>,
    pub found: Found,
    /// Remotes that answer at another baud rate only.
    others: Vec<OtherRemote>,
    running: Running,
}

/// A remote that answers at another baud rate than that of an FPGA.
struct OtherRemote {
    id: RemoteId,
    baud: u32,
    descriptor: RemoteDescriptor,
}

/// Remotes at the usual baud rate that are started.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Running {
    All,
    One(RemoteId),
    None,
}

impl BoardCabinet {
    /// Stops the ports of the board and starts its remotes in setup mode. Channels on which nothing
    /// answers are asked again at other baud rates. Prints missing remotes and problems to standard
    /// error.
    pub fn open(found: Found, rates: &[u32]) -> Result<Self, Failure> {
        let board = Board::identify(found.open()?, Settings::default())?.discover()?;
        for missing in board.missing().iter().filter(|remark| !remark.is_silent()) {
            complain(format_args!("MISSING: {}", told(missing)));
        }
        for remark in board.remarks() {
            complain(format_args!("Note: {}", told(remark)));
        }
        let mut this = Self {
            board: Box::new(board),
            found,
            others: Vec::new(),
            running: Running::All,
        };
        this.find_others(rates)?;
        if this.remotes().is_empty() {
            let missing = this.board.missing().iter();
            let why: Vec<_> = missing.map(|remark| told(remark)).collect();
            return Err(Failure::refused(format_args!(
                "{}: no remote answers. {}",
                this.found.address,
                why.join("\n")
            )));
        }
        Ok(this)
    }

    pub fn firmware(&self) -> &mesa_hal::hostmot2::HostMot2 {
        self.board.firmware()
    }

    /// Asks silent channels at these baud rates.
    fn find_others(&mut self, rates: &[u32]) -> Result<(), BoardError> {
        let silent = self.board.missing().iter().filter(|it| it.is_silent());
        let silent: Vec<RemoteId> = silent
            .filter_map(|it: &Remark| Some(it.remote?.id))
            .collect();
        for id in silent {
            for &baud in rates {
                let described = self.at(id, baud, |link, started| {
                    let options = DiscoveryOptions::default();
                    Ok(discover(link, started, MAX_INTERFACE_REGISTERS, &options))
                });
                let described = match described {
                    Err(DriverError::Missing(_)) => continue,
                    described => described?,
                };
                let remote = RemoteLabel::new(id, described.descriptor.name);
                complain(format_args!("Note: {remote}: it answers at {baud} baud"));
                for problem in &described.problems {
                    complain(format_args!("Note: {remote}: {}", told(problem)));
                }
                self.others.push(OtherRemote {
                    id,
                    baud,
                    descriptor: described.descriptor,
                });
                break;
            }
        }
        Ok(())
    }

    /// Starts one remote at a baud rate, and stops it again after the work.
    fn at<T>(
        &mut self,
        id: RemoteId,
        baud: u32,
        work: impl FnOnce(
            &mut PortLink<'_, Bus>,
            &mesa_hal::sslbp::StartedRemote,
        ) -> Result<T, BoardError>,
    ) -> Result<T, BoardError> {
        self.running = Running::None;
        let done = self.board.setup_at(id, baud);
        let done = done.and_then(|(mut link, started)| work(&mut link, &started));
        let ended = self.board.end_setup_at(id);
        let done = done?;
        ended?;
        Ok(done)
    }

    fn other(&self, id: RemoteId) -> Option<(u32, &RemoteDescriptor)> {
        let other = self.others.iter().find(|other| other.id == id)?;
        Some((other.baud, &other.descriptor))
    }

    /// Makes sure that a remote at the usual baud rate is started.
    fn start(&mut self, id: RemoteId) -> Result<(), BoardError> {
        if self.running == Running::All || self.running == Running::One(id) {
            return Ok(());
        }
        self.running = Running::None;
        self.board.setup_at(id, DEFAULT_BAUD_RATE)?;
        self.running = Running::One(id);
        Ok(())
    }

    /// Accesses a parameter of a remote at another baud rate.
    fn parameter<T>(
        &mut self,
        id: RemoteId,
        name: &str,
        work: impl FnOnce(
            &mesa_hal::discovery::DataRecord,
            &mut PortLink<'_, Bus>,
        ) -> Result<T, ParameterError>,
    ) -> Result<Option<T>, BoardError> {
        let Some((baud, descriptor)) = self.other(id) else {
            return Ok(None);
        };
        let remote = RemoteLabel::new(id, descriptor.name);
        let failed = |source| DriverError::Parameter {
            remote,
            name: name.into(),
            source,
        };
        let record = descriptor.parameter(name).cloned();
        let record = record.ok_or_else(|| failed(ParameterError::Unknown))?;
        let done = self.at(id, baud, |link, _| work(&record, link).map_err(failed));
        done.map(Some)
    }
}

/// The channel of a place; a board has no other places.
fn channel(place: RemotePlace) -> RemoteId {
    match place {
        RemotePlace::Channel(id) => id,
        RemotePlace::Serial => RemoteId::new(0, 0),
    }
}

impl Cabinet for BoardCabinet {
    fn remotes(&self) -> Vec<CabinetRemote> {
        let others = self.others.iter().map(|other| CabinetRemote {
            place: RemotePlace::Channel(other.id),
            descriptor: other.descriptor.clone(),
        });
        let mut remotes = Cabinet::remotes(&*self.board);
        remotes.extend(others);
        remotes.sort_by_key(|remote| remote.place);
        remotes
    }

    fn read(&mut self, place: RemotePlace, name: &str) -> Result<u64, CabinetError> {
        let id = channel(place);
        let read = self.parameter(id, name, |record, link| record.read_parameter(link))?;
        if let Some(value) = read {
            return Ok(value.raw);
        }
        self.start(id)?;
        self.board.read(place, name)
    }

    fn write(
        &mut self,
        place: RemotePlace,
        name: &str,
        value: AnyValue,
    ) -> Result<(), CabinetError> {
        let id = channel(place);
        let write = |record: &mesa_hal::discovery::DataRecord, link: &mut PortLink<'_, Bus>| {
            record.write_parameter(link, value)
        };
        if self.parameter(id, name, write)?.is_some() {
            return Ok(());
        }
        self.start(id)?;
        self.board.write(place, name, value)
    }

    fn exchange(&mut self, place: RemotePlace, access: RemoteAccess) -> Result<u64, CabinetError> {
        let id = channel(place);
        if let Some((baud, _)) = self.other(id) {
            return Ok(self.at(id, baud, |link, _| {
                Ok(link.port.on(link.bus).access(link.channel, access)?)
            })?);
        }
        self.start(id)?;
        self.board.exchange(place, access)
    }
}
