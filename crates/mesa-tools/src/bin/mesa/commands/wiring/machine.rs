//! The machine whose wiring is checked: its cycle runs in a thread of its own, and drives one output at a
//! time if it gets the order.

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

use crate::commands::set::jog::Jog;
use crate::context::{Context, Failure};
use crate::link::Bus;
use crate::running::{self, Keeper};

/// How long an output may take until it can be driven: whoever agreed to it is at the wires. A single
/// transfer may fail, and the host be late.
const PATIENCE: Duration = Duration::from_secs(1);

/// What becomes of an output.
pub enum Driven {
    /// It was seen to be on.
    On,
    /// It is off again.
    Off,
    /// Why it was off before its time, or never on.
    Failed(String),
}

/// A running machine. Whoever drops it stops it, with all outputs off.
pub struct Machine {
    pub reader: SnapshotReader,
    is_over: Arc<AtomicBool>,
    orders: SyncSender<PinId>,
    requests: SyncSender<(PinId, bool)>,
    done: Receiver<Driven>,
    cycle: Option<JoinHandle<Result<(), Failure>>>,
}

impl Machine {
    /// `time` is how long an output is on.
    pub fn start(driver: Driver<Bus>, context: &Context, time: Duration) -> Self {
        let mut runner = Runner::new(driver).stop_on(context.stop.clone());
        let reader = runner.snapshot();
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        let (orders, wanted) = sync_channel(1);
        let (requests, requested) = sync_channel(8);
        let (tell, done) = sync_channel(4);
        let mut keeper = Keeper::default();
        let mut jog: Option<Jog> = None;
        let mut is_told = false;
        let work = move |cycle: &mut Cycle<'_, Bus>| {
            let is_alone = running::check_alone(cycle.driver.bus()).is_ok();
            if over.load(Ordering::Relaxed) || !is_alone {
                return ControlFlow::Break(());
            }
            while let Ok((pin, on)) = requested.try_recv() {
                // One that is refused is never seen to be on, and no index is told to have come.
                let _ = cycle.pins_mut().set_any(pin, AnyValue::from(on));
            }
            let Some(running) = &mut jog else {
                keeper.look_after(cycle.driver);
                // Everything is off: what a fault has disarmed may be driven again.
                cycle.pins_mut().rearm_all();
                let order: Option<PinId> = wanted.try_recv().ok();
                let values = |pin| (pin, true.into(), false.into());
                jog = order.map(|pin| Jog::new(cycle.driver, values(pin), (time, PATIENCE)));
                is_told = false;
                return ControlFlow::Continue(());
            };
            let is_over = running.step(cycle).is_break();
            if running.is_confirmed() && !is_told {
                is_told = true;
                let _ = tell.try_send(Driven::On);
            }
            if is_over {
                let failure = running.failure().map(str::to_owned);
                let _ = tell.try_send(match failure {
                    Some(reason) => Driven::Failed(reason),
                    None if is_told => Driven::Off,
                    None => Driven::Failed("nothing has shown that it was on".to_owned()),
                });
                jog = None;
            }
            ControlFlow::Continue(())
        };
        let cycle = std::thread::spawn(move || {
            let ended = runner.run(work);
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

    /// Lets an output be on for its time. Not before the one before is off.
    pub fn drive(&self, pin: PinId) {
        // If nobody takes it any more, the reader has ended.
        let _ = self.orders.try_send(pin);
    }

    /// Arms the latch of an encoder's index, or takes that back.
    pub fn set_index_enable(&self, pin: PinId, on: bool) {
        // What no cycle takes is requested again.
        let _ = self.requests.try_send((pin, on));
    }

    /// What has become of the output; told once.
    pub fn driven(&self) -> Option<Driven> {
        self.done.try_recv().ok()
    }

    /// Stops it.
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

/// Whether an output can be driven.
pub fn is_ready(snapshot: &Snapshot, info: &PinInfo) -> bool {
    let mut remotes = snapshot.remotes();
    let remote = remotes.find(|remote| remote.group == info.group);
    let runs = remote
        .is_none_or(|remote| remote.state == RemoteState::Running && remote.first_fault.is_none());
    runs && running::trouble(snapshot.board().0).is_none()
}

/// Why what a pin shows is not valid.
pub fn reason(snapshot: &Snapshot, info: &PinInfo) -> String {
    if let Some(trouble) = running::trouble(snapshot.board().0) {
        return trouble.to_string();
    }
    let mut remotes = snapshot.remotes();
    let Some(remote) = remotes.find(|remote| remote.group == info.group) else {
        return "the board has not shown it yet".to_owned();
    };
    let place = format!("the {} on {}", remote.name, remote.id);
    let reason = match remote.state {
        RemoteState::Offline { reason, .. } | RemoteState::Restarting { reason } => Some(reason),
        _ => None,
    };
    match reason.or(remote.first_fault) {
        Some(reason) => format!("{place} is offline: {reason}"),
        None => format!("{place} does not answer"),
    }
}
