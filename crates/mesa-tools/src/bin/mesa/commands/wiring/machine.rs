//! The machine under check: its cycle runs in a thread of its own, and drives one output at a time
//! on request.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use mesa_hal::Driver;
use mesa_hal::driver::RemoteState;
use mesa_hal::hal::{AnyValue, PinId, PinInfo};
use mesa_hal::runner::{Cycle, Runner, Snapshot, SnapshotReader};

use crate::board::bus::Bus;
use crate::board::reason::{self, Reason};
use crate::board::running::{self, Keeper};
use crate::commands::set::jog::Jog;
use crate::commands::set::plan::{JogPlan, Step};
use crate::ui::context::{Context, Failure};

/// Time within which an output must become ready to be driven. Short, because the person who agreed
/// to it is at the wires; long enough for a failed transfer and a late host.
const PATIENCE: Duration = Duration::from_secs(1);

/// Progress of an output that is driven.
pub enum Driven {
    /// Confirmed to be on.
    On,
    /// Off again.
    Off,
    /// Off before its time, or never on, with the reason.
    Failed(Reason),
}

/// A running machine. Dropping it stops the machine, with all outputs off.
pub struct Machine {
    pub reader: SnapshotReader,
    is_over: Arc<AtomicBool>,
    orders: SyncSender<PinId>,
    requests: SyncSender<(PinId, bool)>,
    done: Receiver<Driven>,
    cycle: Option<JoinHandle<Result<(), Failure>>>,
}

impl Machine {
    /// Starts the cycle. `time` is the time for which an output is on.
    pub fn start(driver: Driver<Bus>, context: &Context, time: Duration) -> Self {
        let mut runner = Runner::new(driver).stop_on(context.stop.clone());
        let reader = runner.snapshot();
        let is_over = Arc::new(AtomicBool::new(false));
        let (orders, wanted) = sync_channel(1);
        let (requests, requested) = sync_channel(8);
        let (tell, done) = sync_channel(4);
        let mut work = Work {
            is_over: Arc::clone(&is_over),
            orders: wanted,
            requests: requested,
            tell,
            time,
            keeper: Keeper::default(),
            jog: None,
            is_told: false,
        };
        let cycle = std::thread::spawn(move || {
            let ended = runner.run(|cycle| work.cycle(cycle));
            running::check_end(&ended)
        });
        Self {
            reader,
            is_over,
            orders,
            requests,
            done,
            cycle: Some(cycle),
        }
    }

    /// Switches an output on for its time. Only valid once the previous output is off.
    pub fn drive(&self, pin: PinId) {
        // Without a receiver the cycle has ended, which the reader shows.
        let _ = self.orders.try_send(pin);
    }

    /// Arms the latch of an encoder's index, or disarms it.
    pub fn set_index_enable(&self, pin: PinId, on: bool) {
        // A request that no cycle takes is repeated by the check.
        let _ = self.requests.try_send((pin, on));
    }

    /// Progress of the output; each step is returned once.
    pub fn driven(&self) -> Option<Driven> {
        self.done.try_recv().ok()
    }

    /// Stops the machine.
    pub fn end(mut self) -> Result<(), Failure> {
        self.stop()
    }

    fn stop(&mut self) -> Result<(), Failure> {
        self.is_over.store(true, Ordering::Relaxed);
        let Some(cycle) = self.cycle.take() else {
            return Ok(());
        };
        let ended = cycle.join();
        ended.map_err(|_| Failure::refused("the cycle's thread panicked"))?
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = self.stop();
    }
}

/// The machine's part of a cycle.
struct Work {
    is_over: Arc<AtomicBool>,
    orders: Receiver<PinId>,
    requests: Receiver<(PinId, bool)>,
    tell: SyncSender<Driven>,
    /// Time for which an output is on.
    time: Duration,
    keeper: Keeper,
    jog: Option<Jog>,
    /// True once the output of the jog was reported as on.
    is_told: bool,
}

impl Work {
    fn cycle(&mut self, cycle: &mut Cycle<'_, Bus>) -> ControlFlow<()> {
        let is_alone = running::check_alone(cycle.driver.bus()).is_ok();
        if self.is_over.load(Ordering::Relaxed) || !is_alone {
            return ControlFlow::Break(());
        }
        while let Ok((pin, on)) = self.requests.try_recv() {
            // A refused request is never seen to be on, so no index is reported for it.
            let _ = cycle.pins_mut().set_any(pin, AnyValue::from(on));
        }
        match self.jog.take() {
            Some(jog) => self.jog = self.go_on(jog, cycle),
            None => self.rest(cycle),
        }
        ControlFlow::Continue(())
    }

    /// Without a jog: keeps the machine ready, and begins the jog that is ordered.
    fn rest(&mut self, cycle: &mut Cycle<'_, Bus>) {
        self.keeper.look_after(cycle.driver);
        // All outputs are off: groups that a fault disarmed may be driven again.
        cycle.pins_mut().rearm_all();
        let order = self.orders.try_recv().ok();
        self.jog = order.map(|pin| {
            let output = Step {
                pin,
                value: true.into(),
                safe: false.into(),
            };
            let plan = JogPlan {
                output,
                time: self.time,
                patience: PATIENCE,
            };
            Jog::new(cycle.driver, plan)
        });
        self.is_told = false;
    }

    /// Runs a jog for a cycle and reports its progress; returns it unless it is over.
    fn go_on(&mut self, mut jog: Jog, cycle: &mut Cycle<'_, Bus>) -> Option<Jog> {
        let is_over = jog.step(cycle).is_break();
        if jog.is_confirmed() && !self.is_told {
            self.is_told = true;
            let _ = self.tell.try_send(Driven::On);
        }
        if !is_over {
            return Some(jog);
        }
        let failure = jog.failure().cloned();
        let _ = self.tell.try_send(match failure {
            Some(reason) => Driven::Failed(reason),
            None if self.is_told => Driven::Off,
            None => Driven::Failed(Reason::new("nothing has shown that it was on")),
        });
        None
    }
}

/// True if an output can be driven.
pub fn is_ready(snapshot: &Snapshot, info: &PinInfo) -> bool {
    let mut remotes = snapshot.remotes();
    let remote = remotes.find(|remote| remote.group == info.group);
    let runs = remote
        .is_none_or(|remote| remote.state == RemoteState::Running && remote.first_fault.is_none());
    runs && running::trouble(snapshot.board().0).is_none()
}

/// Reason why the value of a pin is not valid.
pub fn reason(snapshot: &Snapshot, info: &PinInfo) -> Reason {
    if let Some(trouble) = running::trouble(snapshot.board().0) {
        return trouble.into();
    }
    let mut remotes = snapshot.remotes();
    let Some(remote) = remotes.find(|remote| remote.group == info.group) else {
        return Reason::new("the board has not shown it yet");
    };
    reason::of_remote(remote.label, remote.state, remote.first_fault)
}
