//! Loading the boards of a `loadrt` line.

use core::ffi::{CStr, c_int};
use core::fmt;
use std::collections::BTreeMap;
use std::ffi::CString;
use std::panic::catch_unwind;

use mesa_hal::bus::DynBus;
use mesa_hal::driver::{Remark, RemarkKind};
use mesa_hal::hostmot2::Gtag;
use mesa_hal::transport::{BusLog, Recording};
use mesa_hal::{Board, Driver, MesaError, RemoteId, UdpBus, UdpConfig, WithAdvice};
use mesa_pci::PciDevice;

use crate::advice::words;
use crate::component::{self, BoardCycle, Step};
use crate::cycle::{Cycle, wanted};
use crate::ffi::{self, ComponentId, HalError, Level, RootRights};
use crate::interface::Interface;
use crate::log::{Log, at_set_up};
use crate::memory::{HalMemory, MemoryError};
use crate::parameters::{self, BoardParameters, BoardPlace, Words};
use crate::report::Subject;

type BoardDriver = Driver<Recording<DynBus>>;

/// An invalid argument, a missing device, and too little memory, as in C.
const EINVAL: c_int = -22;
const ENODEV: c_int = -19;
const ENOMEM: c_int = -12;

/// A sentence, and the result of the load.
struct LoadError {
    text: String,
    result: c_int,
}

impl LoadError {
    fn new(result: c_int, text: impl fmt::Display) -> Self {
        Self {
            text: text.to_string(),
            result,
        }
    }
}

/// Loads the boards of the `loadrt` line. A negative result means that nothing is loaded.
pub(crate) fn load(words: &Words) -> c_int {
    let loaded = catch_unwind(|| try_load(words));
    let loaded = loaded.unwrap_or_else(|_| {
        Err(LoadError::new(
            ENODEV,
            "this is an error of the component itself: a panic, whose text is above",
        ))
    });
    match loaded {
        Ok(()) => 0,
        Err(error) => {
            component::unload();
            at_set_up(Level::Error, &format_args!("{}", error.text));
            error.result
        }
    }
}

fn try_load(words: &Words) -> Result<(), LoadError> {
    let interface = Interface::own();
    let boards =
        parameters::parse(interface, words).map_err(|error| LoadError::new(EINVAL, error))?;
    let trace = words.trace();
    let trace = trace.map_err(|error| LoadError::new(EINVAL, error))?;
    let component = ComponentId::new(interface.name());
    let component = component.map_err(|HalError(result)| {
        LoadError::new(
            result,
            "HAL does not accept the component; is it loaded already?",
        )
    })?;
    component::keep(component);
    let mut of_kind = BTreeMap::new();
    for (number, board) in boards.into_iter().enumerate() {
        let (place, config) = (board.place.to_string(), board.words.clone());
        let of_board = |error: LoadError| {
            let words = match &*config {
                "" => place.clone(),
                config => format!("{place} config={config}"),
            };
            LoadError::new(error.result, format_args!("{words}: {}", error.text))
        };
        let driver = start(board, &mut of_kind).map_err(of_board)?;
        let name = driver.name().to_owned();
        let mut cycle = add(component, interface, number, driver).map_err(of_board)?;
        cycle.record(trace);
        component::keep_board(number, cycle);
        at_set_up(Level::Note, &format_args!("{place}: {name}"));
    }
    let ready = component.ready();
    ready.map_err(|HalError(result)| LoadError::new(result, "HAL does not accept the component"))
}

/// Starts the driver of a board. Boards of a kind are numbered: `of_kind` has their numbers so far.
fn start(
    board: BoardParameters,
    of_kind: &mut BTreeMap<String, u8>,
) -> Result<BoardDriver, LoadError> {
    let BoardParameters { place, config, .. } = board;
    let bus = Recording::new(open(&place)?, BusLog::new(0));
    let board = Board::identify_then(bus, config.settings.clone(), |firmware, settings| {
        let kind = firmware.idrom.board();
        let next = of_kind.entry(kind).or_default();
        settings.board_number = *next;
        *next += 1;
    });
    let board = board.map_err(|error| failed(&error))?;
    let checked = config.check(board.firmware());
    checked.map_err(|error| LoadError::new(EINVAL, error))?;
    if let Some(firmware) = config.firmware() {
        at_set_up(
            Level::Note,
            &format_args!(
                "{place}: firmware={firmware} is not loaded: the board goes on with the firmware that it has"
            ),
        );
    }
    let driver = board.start();
    driver.map_err(|error| failed(&error))
}

/// Opens the bus of a board.
fn open(place: &BoardPlace) -> Result<DynBus, LoadError> {
    match place {
        BoardPlace::Ethernet(address) => {
            let bus = UdpBus::connect(*address, UdpConfig::default());
            let bus = bus.map_err(|error| failed(&error))?;
            Ok(DynBus::new(bus))
        }
        // The kernel shows registers of a board, and the mappings of other programs, to root only.
        BoardPlace::Pci(device) => {
            let _rights = RootRights::take();
            open_on_pci(device)
        }
        // What the user names is opened with the user's rights.
        BoardPlace::InFolder(device) => open_on_pci(device),
    }
}

fn open_on_pci(device: &PciDevice) -> Result<DynBus, LoadError> {
    let bus = device.open();
    let bus = bus.map_err(|error| failed(&error))?;
    Ok(DynBus::new(bus))
}

/// An error of the driver, with its advice.
fn failed(error: &dyn MesaError) -> LoadError {
    LoadError::new(ENODEV, WithAdvice::of(error).in_words(words))
}

/// Makes the pins, parameters and functions of a board.
fn add(
    component: ComponentId,
    interface: Interface,
    number: usize,
    driver: BoardDriver,
) -> Result<BoardCycle, LoadError> {
    let wanted = wanted(&driver);
    let of_memory = |name: &str, error: MemoryError| {
        let result = match error {
            MemoryError::Full | MemoryError::Slots => ENOMEM,
            MemoryError::Refused(result) => result,
        };
        LoadError::new(result, format_args!("{name}: {error}"))
    };
    let memory = HalMemory::new(component, wanted.iter().map(|pin| pin.role));
    let mut memory = memory.map_err(|error| of_memory(driver.name(), error))?;
    for pin in &wanted {
        let made = memory.add(&c_name(&pin.name)?, pin.role, pin.hal_type);
        made.map_err(|error| of_memory(&pin.name, error))?;
    }
    let pins = driver.pins();
    for (alias, id) in pins.aliases() {
        // As in hostmot2, parameters only.
        if let Some(info) = pins.info_of(id).filter(|info| info.role.is_param()) {
            let made = ComponentId::alias(&c_name(&info.name)?, &c_name(alias)?);
            made.map_err(|HalError(result)| of_memory(alias, MemoryError::Refused(result)))?;
        }
    }
    for &step in Step::all(interface) {
        let name = format!("{}.{}", driver.name(), step.name());
        let exported = component.export(&c_name(&name)?, step.function(), number);
        exported.map_err(|HalError(result)| of_memory(&name, MemoryError::Refused(result)))?;
    }
    let listener = Box::new(|level: Level, text: &CStr| ffi::print(level, text));
    let log = Log::new(driver.name(), listener);
    report_remarks(&driver);
    let mut cycle = Cycle::new(driver, memory, log);
    cycle.look();
    Ok(cycle)
}

/// Prints what a user should know about the remotes and modules of a board.
fn report_remarks(driver: &BoardDriver) {
    let name = driver.name();
    let missing = driver.missing().iter();
    let (silent, missing): (Vec<_>, Vec<_>) = missing.partition(|remark| remark.is_silent());
    let missing = missing.into_iter().map(|remark| (Level::Error, remark));
    let remarks = driver.remarks().iter().map(|remark| (Level::Note, remark));
    for (level, remark) in missing.chain(remarks) {
        let (advice, more) = (remark.advice(), of_components(remark));
        let subject = Subject {
            board: name,
            remote: remark.remote,
        };
        let facts = WithAdvice::new(&remark.kind, advice).in_words(words);
        at_set_up(level, &format_args!("{subject}: {facts}{more}"));
    }
    // A `config=` with more channels than remotes is usual, so this is no error.
    let silent = silent
        .into_iter()
        .filter_map(|remark| Some(remark.remote?.id));
    for (port, channels) in channels_by_port(silent) {
        at_set_up(
            Level::Note,
            &format_args!(
                "{name}: no remote answers on these channels of port {port}: {channels}; check cable and \
                 power where there should be one, and put an x for the others in sserial_port_{port}="
            ),
        );
    }
}

/// What a remark means for components of LinuxCNC that call functions of hostmot2, as those for
/// Modbus do.
fn of_components(remark: &Remark) -> &'static str {
    const CALLED: [Gtag; 5] = [
        Gtag::PACKET_UART_TX,
        Gtag::PACKET_UART_RX,
        Gtag::UART_TX,
        Gtag::UART_RX,
        Gtag::BUFFERED_SPI,
    ];
    match &remark.kind {
        RemarkKind::Undriven(module) if CALLED.contains(&module.gtag) => {
            "; components that use it through hostmot2 (Modbus, SPI) cannot be loaded: they need hm2_eth or hm2_pci"
        }
        _ => "",
    }
}

/// The channels of each port, as a text.
fn channels_by_port(remotes: impl Iterator<Item = RemoteId>) -> BTreeMap<u8, String> {
    let mut ports = BTreeMap::<u8, Vec<String>>::new();
    for remote in remotes {
        let channels = ports.entry(remote.port).or_default();
        channels.push(remote.channel.to_string());
    }
    let texts = ports.into_iter();
    texts
        .map(|(port, channels)| (port, channels.join(", ")))
        .collect()
}

fn c_name(name: &str) -> Result<CString, LoadError> {
    CString::new(name).map_err(|error| LoadError::new(EINVAL, format_args!("{name}: {error}")))
}
