//! The plan of a driver while its board is configured.

use alloc::{boxed::Box, format, string::String, vec::Vec};

use super::{DriverError, Remark, RemarkKind, Settings};
use crate::boards::{BoardTable, REMOTES};
use crate::bus::{ImagePlan, RegisterBus};
use crate::discovery::RemoteTable;
use crate::events::EventSink;
use crate::hal::{GroupId, PinStore, Pins};
use crate::hostmot2::{Gtag, HostMot2, IoPorts};
use crate::modules::built_in;
use crate::modules::stepgen;
use crate::modules::{Module, RegisterError, Registrar};

/// The plan of a driver before its start, without the bus: the part that [`Board`](super::Board)
/// and [`Configured`](super::Configured) have in common.
#[derive(Debug)]
pub struct Plan {
    pub(super) firmware: HostMot2,
    pub(super) name: String,
    pub(super) table: &'static BoardTable,
    pub(super) settings: Settings,
    pub(super) pins: PinStore,
    /// The group of the board's own I/O.
    pub(super) group: GroupId,
    /// The group of the driver's own pins.
    pub(super) status: GroupId,
    /// The group of the application's own pins, if it has any.
    pub(super) own: Option<GroupId>,
    pub(super) io: IoPorts,
    pub(super) image: ImagePlan,
    pub(super) missing: Vec<Remark>,
    pub(super) remarks: Vec<Remark>,
    /// The modules that the current registration has added.
    pub(super) added: Vec<Box<dyn Module>>,
    /// The kinds of modules that the application drives.
    pub(super) claimed: Vec<Gtag>,
    /// Sink of the driver's events.
    pub(super) events: EventSink,
    /// Kinds of remotes: the application's own, then the built-in ones.
    pub(super) tables: Vec<&'static RemoteTable>,
}

impl Plan {
    /// The description of the board's firmware.
    pub fn firmware(&self) -> &HostMot2 {
        &self.firmware
    }

    /// Prefix of the names of the board's pins, for example `hm2_7i92.0`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Remarks on step generators that need newer firmware.
    pub(super) fn remark_old_stepgens(&mut self) {
        let modules = self.firmware.modules_of(Gtag::STEPGEN);
        let versions = modules.map(|(_, module)| module.version);
        if let Some(version) = versions.min().filter(|version| stepgen::is_old(*version)) {
            let kind = RemarkKind::OldStepgen { version };
            self.remarks.push(Remark::of_board(kind));
        }
    }

    /// All pins and parameters so far: those of the modules, and after
    /// [`Board::discover`](super::Board::discover) those of the remotes as well.
    pub fn pins(&self) -> &Pins {
        &self.pins
    }
}

impl Plan {
    pub(super) fn new(firmware: HostMot2, io: IoPorts, settings: Settings) -> Self {
        let name = format!("hm2_{}.{}", firmware.idrom.board(), settings.board_number);
        let mut pins = PinStore::default();
        pins.set_stale_after(settings.fault_policy.stale_after);
        let (status, group) = (pins.add_group(), pins.add_group());
        pins.keep_valid(status);
        let tables = settings.remotes.iter().copied().chain(REMOTES).collect();
        Self {
            table: BoardTable::for_firmware(&firmware, &settings.boards),
            status,
            own: None,
            group,
            pins,
            io,
            image: ImagePlan::default(),
            events: EventSink::new(&name, settings.event_room),
            name,
            settings,
            firmware,
            missing: Vec::new(),
            remarks: Vec::new(),
            added: Vec::new(),
            claimed: Vec::new(),
            tables,
        }
    }

    /// Calls `register` with a registrar for pins of this group.
    pub(super) fn register<B: RegisterBus, T>(
        &mut self,
        bus: &mut B,
        group: GroupId,
        register: impl FnOnce(&mut Registrar<'_>) -> Result<T, RegisterError>,
    ) -> Result<T, DriverError> {
        let mut bus_error = None;
        let mut peek = |address| {
            bus.read(address).map_err(|error| {
                bus_error = Some(error);
                RegisterError::Peek { address }
            })
        };
        let registered = register(&mut Registrar {
            firmware: &self.firmware,
            board: self.table,
            name: &self.name,
            settings: &self.settings,
            group,
            status: self.status,
            pins: &mut self.pins,
            events: &self.events,
            io: &mut self.io,
            image: &mut self.image,
            added: &mut self.added,
            claimed: &mut self.claimed,
            is_driven: |module| built_in::check(module).is_ok(),
            bus: &mut peek,
        });
        match (registered, bus_error) {
            (Ok(made), _) => {
                self.image.check().map_err(RegisterError::from)?;
                Ok(made)
            }
            (Err(RegisterError::Peek { .. }), Some(error)) => Err(DriverError::Bus(error)),
            (Err(error), _) => Err(DriverError::Register(error)),
        }
    }
}
