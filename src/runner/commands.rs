//! What other threads ask of the thread of a cycle.

use crate::hostmot2::RemoteId;
use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::bus::{Clock, RegisterBus};
use crate::driver::Driver;
use crate::hal::kind::Settable;
use crate::hal::{
    AnyValue, GroupId, HalType, Handle, Param, PinError, PinId, PinInfo, Pins, Role, Value,
};
use crate::tally::Tally;

/// The most commands that one cycle takes.
pub const COMMANDS_IN_A_CYCLE: u32 = 16;

/// The largest queue.
const LARGEST: usize = 1 << 16;

/// Commands of other threads, for the thread of the cycle, which takes a bounded number in each.
///
/// A [`Runner`](super::Runner) has one when [`Runner::commands`](super::Runner::commands) was asked
/// for, and takes commands after the read of a cycle, before the application's own work, which has the
/// last word. Who has a loop of his own calls [`take`](Self::take) there.
///
/// ```
/// use mesa_hal::{Driver, Settings, runner::CommandQueue};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let board = machines::six_axes_7i92(Default::default());
/// let mut driver = Driver::start(board, Settings::default())?;
/// let lamp = driver.pins().output::<bool>("hm2_7i92.0.7i77.0.0.output-00")?;
/// let mut queue = CommandQueue::new(&driver, 64);
/// let sender = queue.sender(); // `Clone`, and goes to any thread
/// std::thread::spawn(move || sender.set(lamp, true)).join().unwrap()?;
/// let _ = driver.read()?;
/// queue.take(&mut driver);
/// assert!(driver.pins().commanded(lamp));
/// driver.write()?;
/// # Ok(())
/// # }
/// ```
///
/// # Real time
/// [`take`](Self::take) waits for nobody: senders wait for each other only. Nothing allocates but
/// [`new`](Self::new).
#[derive(Debug)]
pub struct CommandQueue {
    shared: Arc<Shared>,
    /// How often faults have disarmed groups, when it was looked at last.
    faults: u64,
    /// How often that was more than before: what re-arms counts only if it was sent after the last.
    epoch: u64,
}

/// Asks the thread of the cycle to do something; in any other thread.
///
/// # Errors
/// Each function: [`CommandError`]. Nothing is asked then.
///
/// # Real time
/// For other threads than that of the cycle: it may wait for another sender, not for the cycle. What
/// was sent is done in the next cycle, or, where more than 16 commands wait, 16 in each.
#[derive(Clone, Debug)]
pub struct CommandSender {
    shared: Arc<Shared>,
}

/// Why a command was not sent.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CommandError {
    /// As many commands wait as the queue holds.
    #[error(
        "{capacity} commands wait already, as many as the queue holds: does the cycle run? Each takes \
         up to {COMMANDS_IN_A_CYCLE}"
    )]
    Full {
        /// As many as it holds.
        capacity: usize,
    },
    /// The queue is gone.
    #[error("the cycle has ended: nobody takes commands any more")]
    Ended,
    /// The pin can not be set to that.
    #[error(transparent)]
    Pin(#[from] PinError),
    /// There is no remote to restart.
    #[error("no remote takes part on {remote}")]
    NoRemote {
        /// The remote.
        remote: RemoteId,
    },
}

/// What became of commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct CommandStatistics {
    /// Sent.
    pub sent: u64,
    /// Taken by the cycle.
    pub taken: u64,
    /// Of those, commands that had no effect: an output whose group is not armed, a group that does not
    /// run and can not be armed, and what was sent before the last fault but re-arms, or sets an output
    /// that this fault made safe to something else.
    pub refused: u64,
}

/// Words of a command.
const WORDS: usize = 4;

/// What the cycle is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Command {
    /// After so many faults of its group.
    Set(PinId, AnyValue, u64),
    /// After so many epochs of faults.
    Rearm(u64),
    RearmGroup(GroupId, u64),
    Restart(RemoteId),
}

/// A ring: senders write behind a lock of their own, the cycle reads without one.
#[derive(Debug)]
struct Shared {
    slots: Box<[[AtomicU64; WORDS]]>,
    /// Commands that were sent, and of them those that were taken.
    sent: AtomicU64,
    taken: AtomicU64,
    refused: AtomicU64,
    /// The epoch that senders know of.
    epoch: AtomicU64,
    /// How often faults have disarmed each group, as far as senders know.
    faults: Box<[(GroupId, AtomicU64)]>,
    /// Held by senders only.
    sending: Mutex<()>,
    has_ended: AtomicBool,
    infos: Vec<PinInfo>,
    /// Any pin, to tell whose pins they are.
    pin: PinId,
    remotes: Vec<RemoteId>,
}

impl CommandQueue {
    /// For a driver. It holds `capacity` commands: 1 to 65,536, or else the nearest of these.
    pub fn new<B: RegisterBus + Clock>(driver: &Driver<B>, capacity: usize) -> Self {
        let slots = (0..capacity.clamp(1, LARGEST)).map(|_| <[AtomicU64; WORDS]>::default());
        let pins = driver.pins();
        let remotes = driver.ports().iter().flat_map(|port| {
            let number = port.layout().instance;
            port.remotes()
                .map(move |remote| RemoteId::new(number, remote.started.channel.index()))
        });
        let groups = pins.groups().map(|group| {
            let faults = pins.group_state(group).map_or(0, |state| state.faults);
            (group, AtomicU64::new(faults))
        });
        Self {
            shared: Arc::new(Shared {
                slots: slots.collect(),
                faults: groups.collect(),
                sent: AtomicU64::new(0),
                taken: AtomicU64::new(0),
                refused: AtomicU64::new(0),
                epoch: AtomicU64::new(0),
                sending: Mutex::new(()),
                has_ended: AtomicBool::new(false),
                infos: pins.infos().to_vec(),
                pin: pins.ids().next().unwrap_or_default(),
                remotes: remotes.collect(),
            }),
            faults: faults(driver),
            epoch: 0,
        }
    }

    /// A sender for another thread. Allocates nothing.
    pub fn sender(&self) -> CommandSender {
        CommandSender {
            shared: Arc::clone(&self.shared),
        }
    }

    /// Does what was asked for, between the read and the write of a cycle: at most 16 commands, and
    /// none after one that re-arms everything. How many it were.
    ///
    /// A re-arming that was sent before a fault is void after it, and counted as refused: it was meant
    /// for a fault before. So is what sets an output whose group is not armed, which nobody would
    /// follow, or one that a fault made safe since it was sent, whoever has re-armed it meanwhile; and
    /// what was sent for another driver. Everything else is done whatever has failed: what switches an
    /// output off (sets it to its safe value) must not be lost because something failed.
    ///
    /// # Real time
    /// Bounded, no allocation. Re-arming a board that has lost its set-up takes the time of
    /// [`Driver::rearm`].
    pub fn take<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>) -> u32 {
        let is_other = driver.pins().ids().next().unwrap_or_default() != self.shared.pin;
        if is_other {
            self.shared.refuse_all();
            return 0;
        }
        self.look(driver);
        let mut count = 0;
        while count < COMMANDS_IN_A_CYCLE
            && let Some(command) = self.shared.next()
        {
            count.tally(1);
            let is_done = match command {
                Command::Set(pin, value, faults) => set(driver.pins_mut(), (pin, value), faults),
                Command::Rearm(epoch) => epoch == self.epoch && driver.rearm().is_ok(),
                Command::RearmGroup(group, epoch) => {
                    epoch == self.epoch && driver.pins_mut().rearm(group).is_ok()
                }
                Command::Restart(remote) => {
                    // What this disarms was asked for, and is no fault.
                    let before = faults(driver);
                    driver.restart(remote);
                    let more = faults(driver).wrapping_sub(before);
                    self.faults = self.faults.wrapping_add(more);
                    true
                }
            };
            if !is_done {
                self.shared.refused.fetch_add(1, Ordering::Relaxed);
            }
            if matches!(command, Command::Rearm(_)) {
                break;
            }
        }
        self.look(driver);
        count
    }

    /// Looks for faults since the last look: what re-arms is void if it was sent before now. A
    /// [`Runner`](super::Runner) looks after its write, before others can see what the write has
    /// found; [`take`](Self::take) looks by itself.
    pub(super) fn look<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) {
        let faults = faults(driver);
        if core::mem::replace(&mut self.faults, faults) != faults {
            self.epoch = self.epoch.wrapping_add(1);
            self.shared.epoch.store(self.epoch, Ordering::Release);
        }
        for (group, known) in &self.shared.faults {
            if let Some(state) = driver.pins().group_state(*group) {
                known.store(state.faults, Ordering::Release);
            }
        }
    }
}

/// Sets a pin or a setting, if that has an effect. `faults`: how often faults had disarmed its group when
/// it was sent.
fn set(pins: &mut Pins, (pin, value): (PinId, AnyValue), faults: u64) -> bool {
    let is_output = pins
        .info_of(pin)
        .is_some_and(|info| info.role == Role::Output);
    let is_meant = match pins.faults_against(pin, value) {
        Some(now) => now == faults && (!is_output || pins.follows(pin)),
        None => true,
    };
    is_meant && pins.set_any(pin, value).is_ok()
}

/// How often faults have disarmed groups of pins.
fn faults<B: RegisterBus + Clock>(driver: &Driver<B>) -> u64 {
    let pins = driver.pins();
    let states = pins.groups().filter_map(|group| pins.group_state(group));
    states.fold(0, |sum, state| sum.wrapping_add(state.faults))
}

/// Senders learn that nobody takes anything any more.
impl Drop for CommandQueue {
    fn drop(&mut self) {
        self.shared.has_ended.store(true, Ordering::Release);
    }
}

impl CommandSender {
    /// Sets an output, or a pin that both sides set. A value out of range is limited and counted, as
    /// always. The cycle refuses an output whose group is not armed then, and counts that.
    pub fn set<K: Settable, T: Value>(
        &self,
        pin: Handle<K, T>,
        value: T,
    ) -> Result<(), CommandError> {
        self.set_any(pin.into(), value.into())
    }

    /// Changes a setting.
    pub fn set_param<T: Value>(&self, param: Param<T>, value: T) -> Result<(), CommandError> {
        self.set_any(param.into(), value.into())
    }

    /// Sets a pin or a setting of any type.
    pub fn set_any(&self, pin: PinId, value: AnyValue) -> Result<(), CommandError> {
        let shared = &*self.shared;
        let info = shared.infos.get(pin.index());
        let info = info.filter(|_| pin.is_beside(shared.pin));
        let info = info.ok_or(PinError::ForeignHandle)?;
        info.check_settable(value)?;
        let mut faults = shared.faults.iter();
        let faults = faults.find(|(group, _)| *group == info.group);
        let faults = faults.map_or(0, |(_, faults)| faults.load(Ordering::Acquire));
        self.send(Command::Set(pin, value, faults))
    }

    /// Re-arms everything: [`Driver::rearm`].
    pub fn rearm(&self) -> Result<(), CommandError> {
        self.send(Command::Rearm(self.epoch()))
    }

    /// Re-arms one group: [`Pins::rearm`](crate::hal::Pins::rearm).
    pub fn rearm_group(&self, group: GroupId) -> Result<(), CommandError> {
        if !PinId::from_word(group.to_word()).is_beside(self.shared.pin) {
            return Err(PinError::ForeignHandle.into());
        }
        self.send(Command::RearmGroup(group, self.epoch()))
    }

    /// Restarts a remote: [`Driver::restart`].
    pub fn restart(&self, remote: impl Into<RemoteId>) -> Result<(), CommandError> {
        let remote = remote.into();
        if !self.shared.remotes.contains(&remote) {
            return Err(CommandError::NoRemote { remote });
        }
        self.send(Command::Restart(remote))
    }

    /// What became of the commands of all senders so far.
    pub fn statistics(&self) -> CommandStatistics {
        let shared = &*self.shared;
        // In this order, so that never more are taken than sent.
        let refused = shared.refused.load(Ordering::Acquire);
        let taken = shared.taken.load(Ordering::Acquire);
        CommandStatistics {
            sent: shared.sent.load(Ordering::Acquire),
            taken,
            refused,
        }
    }

    fn epoch(&self) -> u64 {
        self.shared.epoch.load(Ordering::Acquire)
    }

    fn send(&self, command: Command) -> Result<(), CommandError> {
        let shared = &*self.shared;
        // What it guards is whole at every moment.
        let _one_at_a_time = shared
            .sending
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if shared.has_ended.load(Ordering::Acquire) {
            return Err(CommandError::Ended);
        }
        let sent = shared.sent.load(Ordering::Relaxed);
        let waiting = sent.saturating_sub(shared.taken.load(Ordering::Acquire));
        let slot = shared.slot(sent);
        let Some(slot) = slot.filter(|_| waiting < shared.slots.len() as u64) else {
            let capacity = shared.slots.len();
            return Err(CommandError::Full { capacity });
        };
        for (slot, word) in slot.iter().zip(command.to_words()) {
            slot.store(word, Ordering::Relaxed);
        }
        // After it the words are the cycle's, ...
        shared.sent.store(sent.wrapping_add(1), Ordering::Release);
        Ok(())
    }
}

impl Shared {
    /// Takes a command. Called in one thread only.
    fn next(&self) -> Option<Command> {
        let taken = self.taken.load(Ordering::Relaxed);
        if taken == self.sent.load(Ordering::Acquire) {
            return None;
        }
        let words = self.slot(taken)?.each_ref();
        let words = words.map(|word| word.load(Ordering::Relaxed));
        // ... and after this the senders' again.
        self.taken.store(taken.wrapping_add(1), Ordering::Release);
        Some(Command::from_words(words))
    }

    /// Takes all that wait and does none of it. Called in the thread that takes.
    fn refuse_all(&self) {
        let sent = self.sent.load(Ordering::Acquire);
        let waiting = sent.saturating_sub(self.taken.load(Ordering::Relaxed));
        self.refused.fetch_add(waiting, Ordering::Relaxed);
        self.taken.store(sent, Ordering::Release);
    }

    fn slot(&self, number: u64) -> Option<&[AtomicU64; WORDS]> {
        let index = number.checked_rem(self.slots.len() as u64)?;
        self.slots.get(index as usize)
    }
}

const TYPES: [HalType; 6] = [
    HalType::Bit,
    HalType::Float,
    HalType::S32,
    HalType::U32,
    HalType::S64,
    HalType::U64,
];

impl Command {
    fn to_words(self) -> [u64; WORDS] {
        match self {
            Self::Rearm(epoch) => [0, 0, epoch, 0],
            Self::RearmGroup(group, epoch) => [1, group.to_word(), epoch, 0],
            Self::Restart(RemoteId { port, channel }) => [2, port.into(), channel.into(), 0],
            Self::Set(pin, value, faults) => {
                let number = TYPES.iter().position(|&other| other == value.hal_type);
                let number = number.unwrap_or_default() as u64;
                [number.wrapping_add(3), pin.to_word(), value.bits, faults]
            }
        }
    }

    fn from_words([kind, one, other, faults]: [u64; WORDS]) -> Self {
        match kind {
            0 => Self::Rearm(other),
            1 => Self::RearmGroup(GroupId::from_word(one), other),
            2 => Self::Restart(RemoteId::new(one as u8, other as u8)),
            _ => {
                let hal_type = TYPES.get(kind.wrapping_sub(3) as usize);
                let value = AnyValue {
                    hal_type: hal_type.copied().unwrap_or(HalType::Bit),
                    bits: other,
                };
                Self::Set(PinId::from_word(one), value, faults)
            }
        }
    }
}

#[cfg(test)]
mod tests;
