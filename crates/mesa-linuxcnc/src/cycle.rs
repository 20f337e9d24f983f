//! The cycle of a board: HAL's values to the driver and back.

mod bus_log;
mod messages;

use core::fmt;
use core::time::Duration;

use mesa_hal::driver::{BoardState, Events, SerialPort};
use mesa_hal::hal::{AnyValue, GroupId, GroupState, HalType, PinId, Pins, Role, Value};
use mesa_hal::{Clock, Driver, RegisterBus, RemoteId};

use crate::dpll::Dpll;
use crate::ffi::Level;
use crate::gpio::Gpio;
use crate::interface::Interface;
use crate::log::Log;
use crate::loss::Losses;
use crate::outputs::Outputs;
use crate::rearm::{ArmRequest, BOARD, Inputs, Rearming, RemoteMask};
use crate::refused::RefusedPeriod;
use crate::report::Names;
use crate::table::{Change, Memory, Table};

/// The largest number of remotes: four ports of eight channels.
const MAX_REMOTES: usize = 32;

/// Calls of `write` and `read-request` after a `read` up to which its values count as fresh: five
/// cycles of a thread with both.
const FRESH_CALLS: u32 = 10;

/// Time after which the reason is repeated for which nothing is exchanged with the board: an
/// operator's screen may begin after the thread.
const REPEAT: Duration = Duration::from_secs(5);

/// Time between looks for a board that does not answer, each of which takes as long as a reply may.
const LOOK_AGAIN: Duration = Duration::from_millis(10);

/// Period whose share is the deadline of the read at the load.
const LOOK: Duration = Duration::from_millis(100);

/// A pin or parameter that the component makes in HAL.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Wanted {
    pub name: String,
    pub role: Role,
    pub hal_type: HalType,
}

/// The pins and parameters of a board in HAL: all of the driver's, and then the component's own.
/// HAL's numbers of the values are in this order.
pub(crate) fn wanted<B: RegisterBus + Clock>(driver: &Driver<B>) -> Vec<Wanted> {
    let of_driver = driver.pins().infos().iter().map(|info| Wanted {
        name: info.name.clone(),
        role: info.role,
        hal_type: info.hal_type,
    });
    let own = |prefix: &str, name: &str, role| Wanted {
        name: format!("{prefix}.{name}"),
        role,
        hal_type: HalType::Bit,
    };
    let mut wanted: Vec<_> = of_driver.collect();
    let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
    let remotes = remotes.map(|remote| &*remote.pins.prefix);
    for prefix in core::iter::once(driver.name()).chain(remotes) {
        wanted.push(own(prefix, "valid", Role::Input));
        wanted.push(own(prefix, "armed", Role::Input));
        wanted.push(own(prefix, "rearm", Role::Output));
    }
    wanted
}

/// A remote, or the board's own inputs and outputs, and the numbers of the component's own pins of
/// them in HAL.
#[derive(Clone, Copy, Debug)]
struct GroupEntry {
    group: GroupId,
    valid: usize,
    armed: usize,
    rearm: usize,
}

/// A parameter that a remote keeps.
#[derive(Clone, Debug)]
struct InRemote {
    id: PinId,
    remote: RemoteId,
    /// As the remote spells it.
    name: String,
}

/// The parameters that the remotes of a driver keep.
fn in_remotes<B: RegisterBus + Clock>(driver: &Driver<B>) -> Vec<InRemote> {
    let mut all = Vec::new();
    for port in driver.ports() {
        for remote in port.remotes() {
            let parameters = remote.pins.parameters.iter();
            all.extend(parameters.map(|parameter| InRemote {
                id: parameter.pin(),
                remote: remote.label.id,
                name: parameter.record.name.clone(),
            }));
        }
    }
    all
}

/// A board in its cycle.
pub(crate) struct Cycle<B: RegisterBus + Clock, M: Memory> {
    driver: Driver<B>,
    memory: M,
    table: Table,
    gpio: Gpio,
    events: Events,
    log: Log,
    names: Names,
    losses: Losses,
    outputs: Outputs,
    rearming: Rearming,
    /// Those whose clearing re-arms everything.
    acknowledged: [Option<PinId>; 2],
    dpll: Dpll,
    /// Number in HAL of the parameter `io_error`.
    io_error: Option<usize>,
    /// The parameters that remotes keep.
    in_remotes: Vec<InRemote>,
    /// Values that HAL has for them, and that the driver has not been asked for yet; it has room
    /// for all.
    requests: Vec<(PinId, AnyValue)>,
    /// Number in HAL of the pin `run` of each port.
    run: Vec<usize>,
    board: GroupEntry,
    /// The board's pin `rearm` was on in the last read.
    was_acknowledging: bool,
    remotes: Vec<GroupEntry>,
    /// The driver has the period of the thread. Nothing is exchanged with the board before.
    has_begun: bool,
    /// Time of the last look at a board that waits, if it was not reached.
    missed: Option<Duration>,
    /// Time of the last message that the driver does not take the period of the thread.
    refused: Option<Duration>,
    /// Calls of other functions since the last `read` of the thread; `None` before the first one.
    calls_since_read: Option<u32>,
    /// The user has cleared one of `acknowledged`.
    is_cleared: bool,
    /// Number of printed entries of what went over the bus before an exchange failed.
    printed: usize,
}

impl<B: RegisterBus + Clock, M: Memory> fmt::Debug for Cycle<B, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Cycle({})", self.driver.name())
    }
}

impl<B: RegisterBus + Clock, M: Memory> Cycle<B, M> {
    /// The cycle of a driver whose pins, as [`wanted`] lists them, are in `memory`.
    pub fn new(driver: Driver<B>, mut memory: M, log: Log) -> Self {
        let pins = driver.pins();
        let mut table = Table::new(pins, &mut memory);
        let id = |name: &str| pins.find(&format!("{}.{name}", driver.name()));
        let acknowledged = [id("watchdog.has_bit"), id("io_error")];
        if let Some(io_error) = id("io_error") {
            table.acknowledge_by(io_error);
        }
        let io_error = id("io_error").map(PinId::index);
        let in_remotes = in_remotes(&driver);
        let run = driver.ports().iter();
        let run = run.map(|port| format!("sserial.port-{}.run", port.layout().instance));
        let run: Vec<_> = run.filter_map(|name| Some(id(&name)?.index())).collect();
        let entry = |group, first| GroupEntry {
            group,
            valid: first,
            armed: first + 1,
            rearm: first + 2,
        };
        let mut places = (pins.infos().len()..).step_by(3);
        let board = entry(driver.group(), places.next().unwrap_or_default());
        let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
        let remotes = remotes.zip(places);
        let remotes = remotes.map(|(remote, first)| entry(remote.pins.group, first));
        let remotes: Vec<_> = remotes.take(MAX_REMOTES).collect();
        let mut first = 0;
        let ports = driver.ports().iter().map(|port| {
            let count = port.remotes().count();
            let mask = mask_of(first..first + count);
            first += count;
            mask
        });
        let rearming = Rearming::new(ports.collect(), run_of(&run, &memory));
        let events = driver.events();
        let dpll = Dpll::new(driver.name(), driver.pins());
        let gpio = Gpio::new(driver.firmware(), driver.name(), driver.pins());
        Self {
            table,
            dpll,
            gpio,
            events,
            log,
            names: Names::new(&driver, Interface::own()),
            losses: Losses::default(),
            outputs: Outputs::new(&driver),
            rearming,
            acknowledged,
            io_error,
            requests: Vec::with_capacity(in_remotes.len()),
            in_remotes,
            run,
            board,
            was_acknowledging: false,
            remotes,
            has_begun: false,
            missed: None,
            refused: None,
            calls_since_read: None,
            is_cleared: false,
            printed: 0,
            driver,
            memory,
        }
    }

    /// The name of the board.
    pub fn name(&self) -> &str {
        self.driver.name()
    }

    /// Reads the board once, so that HAL has its inputs before the thread starts, as with hostmot2.
    pub fn look(&mut self) {
        // There is time: a reply that is late is no packet error yet.
        let period = self.driver.period();
        self.driver.bus_mut().set_cycle(LOOK, None);
        // What fails here fails in the first cycle too, and is reported then.
        let _ = self.driver.read();
        self.driver.bus_mut().set_cycle(period, None);
        self.table.after_read(self.driver.pins(), &mut self.memory);
        self.show_own();
    }

    /// The function `read` of the thread with the given period.
    pub fn read(&mut self, period: Duration) {
        self.begin(period);
        self.calls_since_read = Some(0);
        self.acknowledge();
        self.take_changes(Table::before_read);
        if self.is_silent() {
            self.follow();
            return self.show_own();
        }
        if self.is_cleared {
            // What the user has cleared covers the faults that were known then, and none that this
            // read finds.
            let wishes = self.wishes();
            self.rearm(wishes);
        }
        // Events report what fails.
        let _ = self.driver.read();
        self.table.after_read(self.driver.pins(), &mut self.memory);
        self.show_own();
        self.say_events();
        self.say_losses();
    }

    /// Reads a board that waits until the user clears its `io_error`: positions are followed, and
    /// nothing is written. An `io_error` that the user has set stops all exchanges, as in LinuxCNC.
    fn follow(&mut self) {
        if matches!(
            self.driver.board_state(),
            BoardState::Running | BoardState::WatchdogBitten
        ) {
            return;
        }
        let now = self.now();
        let is_recent = |missed| now.saturating_sub(missed) < LOOK_AGAIN;
        if self.missed.is_some_and(is_recent) {
            return;
        }
        self.missed = (!self.driver.follow()).then_some(now);
        self.say_events();
    }

    /// A rising edge of the board's `rearm` clears `io_error` and `watchdog.has_bit`, as the user
    /// does: `io_error` is a parameter, which no signal reaches.
    fn acknowledge(&mut self) {
        let is_on = self.memory.load(self.board.rearm) != 0;
        let was_on = core::mem::replace(&mut self.was_acknowledging, is_on);
        if !is_on || was_on {
            return;
        }
        for id in self.acknowledged.iter().flatten() {
            self.memory.store(id.index(), false.to_bits());
        }
    }

    /// True if nothing may be written to the board until the user clears `io_error`, as in
    /// LinuxCNC.
    fn has_io_error(&self) -> bool {
        self.io_error
            .is_some_and(|number| self.memory.load(number) != 0)
    }

    /// True if nothing may be written to the board: because of `io_error`, or because the driver
    /// does not take the period of the thread.
    fn is_silent(&self) -> bool {
        !self.has_begun || self.has_io_error()
    }

    /// The function `write`.
    pub fn write(&mut self, period: Duration) {
        self.begin(period);
        self.count_call();
        // The safe values are still written in the cycle in which the driver sets it.
        let is_silent = self.is_silent();
        self.take_changes(Table::before_write);
        self.request_parameters();
        // ArmRequest while `io_error` is set are lost: all of them come with its end.
        let wishes = if self.has_begun {
            self.wishes()
        } else {
            ArmRequest::default()
        };
        if is_silent {
            return self.show_own();
        }
        self.rearm(wishes);
        let _ = self.driver.write();
        self.table.after_write(self.driver.pins(), &mut self.memory);
        self.show_own();
        self.say_events();
        self.say_dpll();
    }

    /// The function `read-request`.
    pub fn request_read(&mut self, period: Duration) {
        self.begin(period);
        self.count_call();
        if !self.is_silent() {
            self.driver.request_read();
        }
        self.show_own();
    }

    /// The function `read_gpio`: the levels of all I/O pins, for a thread that is faster than the
    /// cycle's.
    pub fn read_gpio(&mut self) {
        if !self.has_io_error() {
            self.gpio.read(self.driver.bus_mut(), &mut self.memory);
        }
    }

    /// The function `write_gpio`: the plain outputs, while outputs of the board follow HAL. Their
    /// directions and inversions are written by `write`.
    pub fn write_gpio(&mut self) {
        let board = self.driver.pins().group_state(self.driver.group());
        let is_armed = board.is_some_and(|state| state.armed);
        if is_armed && !self.has_io_error() {
            self.gpio.write(self.driver.bus_mut(), &self.memory);
        }
    }

    /// Shows in HAL that the board is not driven any more, which the user cannot acknowledge.
    pub fn show_abandoned(&mut self) {
        self.show_as(false);
        if let Some(number) = self.io_error {
            self.memory.store(number, true.to_bits());
        }
    }

    /// Ends the cycle: outputs off, ports stopped.
    pub fn stop(mut self) {
        let now = self.now();
        let (stopped, result) = self.driver.shutdown();
        drop(stopped);
        if let Err(error) = result {
            self.log
                .print(now, Level::Error, format_args!("at the end, {error}"));
        }
    }

    /// In the first call: HAL has the period, and what the HAL file has set. A period that the
    /// driver does not take sets `io_error`, and is tried again when the user clears that; until
    /// then the reason is repeated.
    fn begin(&mut self, period: Duration) {
        if self.has_begun {
            return;
        }
        let now = self.now();
        let is_recent = |said: Duration| now.saturating_sub(said) < REPEAT;
        if self.has_io_error() && self.refused.is_some_and(is_recent) {
            return;
        }
        self.take_changes(Table::before_write);
        let frequency = self.dpll.frequency();
        let before = frequency.map(|id| self.driver.pins().bits_of(id));
        if let Err(error) = self.driver.set_period(period) {
            let (names, error) = (&self.names, &error);
            let text = RefusedPeriod { names, error };
            self.log.report(now, Level::Error, format_args!("{text}"));
            self.refused = Some(now);
            if let Some(number) = self.io_error {
                self.memory.store(number, true.to_bits());
            }
            return;
        }
        self.has_begun = true;
        self.dpll.begin(period, self.driver.pins());
        // As in hostmot2, HAL's pin gets the frequency; else HAL's old value would set it again.
        if let Some(id) = frequency {
            let bits = self.driver.pins().bits_of(id);
            if before != Some(bits) {
                self.memory.store(id.index(), bits);
            }
        }
    }

    /// Moves what HAL has changed to the driver.
    fn take_changes(
        &mut self,
        step: impl FnOnce(&mut Table, &mut Pins, &mut M, &mut dyn FnMut(Change)),
    ) {
        let Self {
            driver,
            memory,
            table,
            log,
            acknowledged,
            is_cleared,
            requests,
            ..
        } = self;
        let now = since_start(driver.bus_mut().now());
        step(
            table,
            driver.pins_mut(),
            memory,
            &mut |change| match change {
                Change::Set(id, bits) => {
                    *is_cleared |= bits == 0 && acknowledged.contains(&Some(id));
                }
                Change::Request(id, value) => {
                    requests.retain(|(other, _)| *other != id);
                    requests.push((id, value));
                }
                Change::Refused(error) => log.refuse(now, format_args!("{error}")),
            },
        );
    }

    /// Requests what HAL has for remotes; a value that they cannot have is put back.
    fn request_parameters(&mut self) {
        while let Some((id, value)) = self.requests.pop() {
            let mut all = self.in_remotes.iter();
            let Some(found) = all.find(|parameter| parameter.id == id) else {
                continue;
            };
            let driver = &mut self.driver;
            let requested = driver.request_remote_parameter(found.remote, &found.name, value);
            if let Err(error) = requested {
                self.table
                    .give_back(id, self.driver.pins(), &mut self.memory);
                let now = since_start(self.driver.bus_mut().now());
                self.log.refuse(now, format_args!("{error}"));
            }
        }
    }

    /// The remotes and the board, with the numbers of their bits.
    fn entries(&self) -> impl Iterator<Item = (usize, &GroupEntry)> + Clone {
        let remotes = self.remotes.iter().enumerate();
        remotes.chain(core::iter::once((BOARD, &self.board)))
    }

    /// The outputs that should follow. Says which ones stay off although the machine is switched
    /// on.
    fn wishes(&mut self) -> ArmRequest {
        let rearm = self.entries();
        let rearm = rearm.filter(|(_, entry)| self.memory.load(entry.rearm) != 0);
        let rearm = mask_of(rearm.map(|(number, _)| number));
        let [armed, waiting] = self.armed_and_waiting();
        let seen = Inputs {
            is_cleared: core::mem::take(&mut self.is_cleared),
            run: run_of(&self.run, &self.memory),
            rearm,
            waiting,
            in_use: self.outputs.in_use(armed, &self.memory),
            is_machine_on: self.outputs.is_machine_on(&self.memory),
        };
        let wishes = self.rearming.step(seen);
        if wishes.is_switched_on {
            self.say_left_off(wishes.left_off);
        }
        wishes
    }

    /// Lets these outputs follow.
    fn rearm(&mut self, wishes: ArmRequest) {
        if !wishes.all && wishes.remotes == 0 {
            return;
        }
        if wishes.all {
            let _ = self.driver.rearm_when_running();
        }
        for number in (0..self.remotes.len()).chain([BOARD]) {
            if wishes.remotes >> number & 1 == 1
                && let Err(error) = self.driver.rearm_group_when_running(self.group(number))
            {
                let now = since_start(self.driver.bus_mut().now());
                self.log.refuse(now, format_args!("{error}"));
            }
        }
        // Arming forgets what was set before.
        self.table.outputs(self.driver.pins_mut(), &self.memory);
    }

    /// Counts a call of another function than `read`.
    fn count_call(&mut self) {
        self.calls_since_read = self.calls_since_read.map(|calls| calls.saturating_add(1));
    }

    /// Shows the component's own pins. Each function does it each time: nothing else would make
    /// them FALSE when another function is not called any more.
    fn show_own(&mut self) {
        let calls = self.calls_since_read;
        let is_fresh = calls.is_some_and(|calls| calls <= FRESH_CALLS);
        self.show_as(is_fresh && !self.is_silent());
    }

    /// Shows the component's own pins, all FALSE unless the board `has_contact`.
    fn show_as(&mut self, has_contact: bool) {
        let pins = self.driver.pins();
        for entry in core::iter::once(&self.board).chain(&self.remotes) {
            let state = pins.group_state(entry.group).filter(|_| has_contact);
            let [is_valid, is_armed] = state.map_or([false; 2], |state| [state.valid, state.armed]);
            self.memory.store(entry.valid, is_valid.to_bits());
            self.memory.store(entry.armed, is_armed.to_bits());
        }
    }

    /// The group of a remote by its number, or of the board.
    fn group(&self, number: usize) -> GroupId {
        self.remotes.get(number).unwrap_or(&self.board).group
    }

    /// Those whose outputs follow, and those whose outputs are safe until the user does something.
    fn armed_and_waiting(&self) -> [RemoteMask; 2] {
        let pins = self.driver.pins();
        let (mut armed, mut waiting) = (0, 0);
        for (number, entry) in self.entries() {
            match pins.group_state(entry.group) {
                Some(GroupState { armed: true, .. }) => armed |= 1 << number,
                Some(GroupState {
                    rearm_pending: false,
                    ..
                }) => waiting |= 1 << number,
                _ => {}
            }
        }
        // After a fault of the board the user clears its flag.
        if self.driver.board_state() != BoardState::Running {
            waiting &= !(1 << BOARD);
        }
        [armed, waiting]
    }

    fn now(&mut self) -> Duration {
        since_start(self.driver.bus_mut().now())
    }
}

fn since_start(now: mesa_hal::bus::Instant) -> Duration {
    now.since(mesa_hal::bus::Instant::default())
}

/// The pins `run` that are on.
fn run_of(run: &[usize], memory: &impl Memory) -> u8 {
    let on = run.iter().enumerate();
    let on = on.filter(|&(_, &index)| memory.load(index) != 0);
    mask_of(on.map(|(port, _)| port)) as u8
}

fn mask_of(numbers: impl Iterator<Item = usize>) -> RemoteMask {
    numbers.fold(0, |mask, number| {
        mask | 1 << (number % RemoteMask::BITS as usize)
    })
}

#[cfg(test)]
mod tests;
