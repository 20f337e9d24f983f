//! The pins of a port.

use alloc::format;

use super::remotes::Remotes;
use super::schedule::{Schedule, is_stopping};
use crate::bus::Instant;
use crate::hal::{GroupId, Input, Output, Param, PinMaker, PinStore};
use crate::modules::{RegisterError, Registrar};
use crate::settings::Defaults;
use crate::sslbp::PortMachine;

/// The pins that LinuxCNC has for a port.
///
/// Source: FACTS 8.6.
#[derive(Debug)]
pub(super) struct PortPins {
    run: Output<bool>,
    fault_count: Input<u32>,
    port_state: Input<u32>,
    /// LinuxCNC's step within a state: 1 while remotes are being stopped for a restart, 2 while
    /// they are being started, else 0.
    port_state2: Input<u32>,
    /// LinuxCNC's step within a parameter access; 0 here, as in LinuxCNC outside of one.
    port_state3: Input<u32>,
    /// Of LinuxCNC, in nanoseconds: what is left of the longest time that the port's present
    /// command can take; 0 for none, and for transfers. Only with LinuxCNC's values.
    debug: Option<Input<i32>>,
    transfers: Input<u64>,
    too_short: Input<u32>,
    fault_inc: Param<u32>,
    fault_dec: Param<u32>,
    fault_lim: Param<u32>,
    /// The group of the pins that the application sets: a part of the driver's own group, whose
    /// version changes when a pin is set.
    part: GroupId,
    fetched: Option<u64>,
    /// The last published values that rarely change: fault count, state, step, too short, debug.
    shown: Option<(u32, u32, u32, u64, i32)>,
}

/// The value of `port_state`, with LinuxCNC's meaning (sserial(9): 3 in normal operation, 0 when
/// `run` is false; the others as observed with LinuxCNC 2.9).
fn port_state(schedule: &Schedule, remotes: &Remotes, machine: &PortMachine) -> u32 {
    let running = remotes.running();
    let has_transferred = |channel| machine.link(channel).good > 0;
    match (schedule.run, running.is_empty()) {
        // Normal operation. Single remotes may be offline: see their `running`.
        (true, false) if running.iter().any(has_transferred) => 3,
        // Remotes have been started, and none of them has transferred yet.
        (true, false) => 2,
        // Switched off: the remotes get safe values,
        (false, false) => 4,
        // and are being stopped.
        (false, true) if is_stopping(machine) => 5,
        // Nothing is transferred: switched off, or no remote runs.
        (_, true) => 0,
    }
}

/// The largest `fault-count` of the remotes.
fn fault_count(remotes: &Remotes) -> u32 {
    if remotes.with_failures().is_empty() {
        return 0;
    }
    let counts = remotes.iter().map(|remote| remote.failures.count());
    counts.max().unwrap_or(0)
}

impl PortPins {
    pub fn register(r: &mut Registrar<'_>, port: u8) -> Result<Self, RegisterError> {
        let policy = r.settings.fault_policy;
        let (status, board) = (r.status, r.name);
        let part = r.pins.add_part(status)?;
        let stem = format!("{board}.sserial.port-{port}.");
        let mut make = PinMaker::new(r.pins, part, stem.clone());
        let run = make.switch("run", true)?;
        let fault_inc = make.setting("fault-inc", policy.fault_inc)?;
        let fault_dec = make.setting("fault-dec", policy.fault_dec)?;
        let fault_lim = make.setting("fault-lim", policy.fault_lim)?;
        let debug = (r.settings.defaults == Defaults::LinuxCnc)
            .then(|| PinMaker::new(r.pins, status, format!("{board}.{port}.")).input("debug"))
            .transpose()?;
        let mut make = PinMaker::new(r.pins, status, stem);
        Ok(Self {
            debug,
            run,
            fault_count: make.input("fault-count")?,
            port_state: make.input("port_state")?,
            port_state2: make.input("port_state2")?,
            port_state3: make.input("port_state3")?,
            transfers: make.input("transfers")?,
            too_short: make.input("too-short")?,
            fault_inc,
            fault_dec,
            fault_lim,
            part,
            fetched: None,
            shown: None,
        })
    }

    pub fn publish(
        &mut self,
        pins: &mut PinStore,
        schedule: &Schedule,
        remotes: &Remotes,
        machine: &PortMachine,
        now: Instant,
    ) {
        pins.publish(self.transfers, schedule.statistics.transfers);
        let (fault_count, too_short) = (fault_count(remotes), schedule.statistics.too_short);
        let (state, step) = (
            port_state(schedule, remotes, machine),
            schedule.restart_step(machine),
        );
        let left = machine.time_left(now).as_nanos();
        let debug = self
            .debug
            .map_or(0, |_| i32::try_from(left).unwrap_or(i32::MAX));
        let shown = (fault_count, state, step, too_short, debug);
        if self.shown.replace(shown) == Some(shown) {
            return;
        }
        pins.publish(self.fault_count, fault_count);
        pins.publish(self.port_state, state);
        pins.publish(self.port_state2, step);
        pins.publish(self.port_state3, 0);
        if let Some(pin) = self.debug {
            pins.publish(pin, debug);
        }
        let too_short = u32::try_from(too_short).unwrap_or(u32::MAX);
        pins.publish(self.too_short, too_short);
    }

    /// True if the application has the port switched on.
    pub fn is_on(&self, pins: &PinStore) -> bool {
        pins.commanded(self.run)
    }

    pub fn fetch(&mut self, pins: &mut PinStore, schedule: &mut Schedule, remotes: &mut Remotes) {
        let version = pins.output_version(self.part);
        if version.is_some() && version == self.fetched {
            return;
        }
        self.fetched = version;
        schedule.switch(pins.fetch(self.run));
        remotes.policy.fault_inc = pins.param(self.fault_inc);
        remotes.policy.fault_dec = pins.param(self.fault_dec);
        remotes.policy.fault_lim = pins.param(self.fault_lim);
    }
}
