//! Wiring of the machine's inputs: switches, handwheels, the emergency stop.

use std::collections::VecDeque;

use super::switch::{Change, SimTerminal, Switch, SwitchConfig};
use super::wheel::{Wheel, WheelConfig};
use crate::wire::Nanos;

/// Maximum number of pending changes. Above it, a new change replaces the last one of the same
/// input.
const MAX_CHANGES: usize = 4096;

/// An emergency-stop chain. While it is closed, its inputs are on; pressing it opens it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EstopConfig {
    /// Inputs that go off together.
    pub inputs: Vec<SimTerminal>,
    /// Cuts the power of all drives: their motors coast.
    pub cuts_drives: bool,
    /// Remotes, by port and channel, whose field power it cuts, and with it the supply of the
    /// switches and handwheels that are wired to them.
    pub cuts_field: Vec<(usize, usize)>,
}

/// All sources of signals at inputs.
#[derive(Debug, Default)]
pub(crate) struct Installation {
    pub(crate) switches: Vec<Switch>,
    pub(crate) wheels: Vec<Wheel>,
    pub(crate) estop: Option<EstopConfig>,
    pub(crate) pressed: bool,
    /// Pending changes, ordered by time.
    changes: VecDeque<Change>,
}

impl Installation {
    /// True if nothing is wired.
    pub(crate) fn is_empty(&self) -> bool {
        self.switches.is_empty() && self.wheels.is_empty() && self.estop.is_none()
    }

    /// Adds a switch on an axis at a position.
    pub(crate) fn add_switch(&mut self, now: Nanos, config: SwitchConfig, position: f64) -> usize {
        let switch = Switch::new(config, position);
        self.put(Change {
            at: now,
            terminal: config.terminal,
            on: switch.is_closed(),
        });
        self.switches.push(switch);
        self.switches.len() - 1
    }

    /// Adds a handwheel.
    pub(crate) fn add_wheel(&mut self, config: WheelConfig) -> usize {
        self.wheels.push(Wheel::new(config));
        self.wheels.len() - 1
    }

    /// Applies the movement of an axis to its switches.
    pub(crate) fn moved(&mut self, axis: usize, times: [Nanos; 2], positions: [f64; 2]) {
        let changes = &mut self.changes;
        for switch in &mut self.switches {
            if switch.config().axis == axis {
                switch.follow(times, positions, |change| put(changes, change));
            }
        }
    }

    /// Turns the wheels.
    pub(crate) fn advance(&mut self, to: Nanos) {
        let changes = &mut self.changes;
        for wheel in &mut self.wheels {
            wheel.advance(to, |change| put(changes, change));
        }
    }

    /// Opens or closes the chain, and queues the resulting changes.
    pub(crate) fn press(&mut self, now: Nanos, pressed: bool) {
        self.pressed = pressed;
        let Some(estop) = &self.estop else {
            return;
        };
        let inputs = estop.inputs.iter().map(|&terminal| (terminal, !pressed));
        let switches = self.switches.iter();
        let switches = switches.map(|switch| (switch.config().terminal, switch.is_closed()));
        let wheels = self.wheels.iter().flat_map(Wheel::signals);
        let contacts = switches.chain(wheels);
        let supplied = contacts.filter(|(terminal, _)| is_supplied_by(estop, *terminal));
        let all: Vec<_> = inputs.chain(supplied).collect();
        for (terminal, on) in all {
            self.put(Change {
                at: now,
                terminal,
                on,
            });
        }
    }

    /// Takes the next due change of any input.
    pub(crate) fn take(&mut self, now: Nanos) -> Option<Change> {
        self.take_of(now, |_| true)
    }

    /// Takes the next due change of an input of the remote on a channel.
    pub(crate) fn take_for(&mut self, now: Nanos, port: usize, channel: usize) -> Option<Change> {
        self.take_of(now, |terminal| is_on(terminal, port, channel))
    }

    fn take_of(&mut self, now: Nanos, is_wanted: impl Fn(SimTerminal) -> bool) -> Option<Change> {
        let mut due = self.changes.iter().take_while(|change| change.at <= now);
        let index = due.position(|change| is_wanted(change.terminal))?;
        let mut change = self.changes.remove(index)?;
        if self.pressed {
            let estop = self.estop.as_ref();
            change.on &= !estop.is_some_and(|estop| is_supplied_by(estop, change.terminal));
        }
        Some(change)
    }

    /// True if a signal is wired to the remote on a channel.
    pub(crate) fn is_wired_to(&self, port: usize, channel: usize) -> bool {
        let there = |terminal| is_on(terminal, port, channel);
        self.switches
            .iter()
            .any(|switch| there(switch.config().terminal))
            || self.wheels.iter().any(|wheel| {
                let config = wheel.config();
                there(config.a) || there(config.b)
            })
            || self
                .estop
                .iter()
                .flat_map(|estop| &estop.inputs)
                .any(|&terminal| there(terminal))
    }

    pub(crate) fn put(&mut self, change: Change) {
        put(&mut self.changes, change);
    }
}

/// True if the terminal is one of the remote on a channel.
fn is_on(terminal: SimTerminal, port: usize, channel: usize) -> bool {
    matches!(terminal, SimTerminal::Remote { port: p, channel: c, .. } if p == port && c == channel)
}

fn is_supplied_by(estop: &EstopConfig, terminal: SimTerminal) -> bool {
    match terminal {
        SimTerminal::Remote { port, channel, .. } => estop.cuts_field.contains(&(port, channel)),
        SimTerminal::Board { .. } | SimTerminal::Pin { .. } => false,
    }
}

/// Inserts a change in order of time.
fn put(changes: &mut VecDeque<Change>, change: Change) {
    if changes.len() >= MAX_CHANGES {
        let mut same = changes.iter_mut().rev();
        if let Some(last) = same.find(|other| other.terminal == change.terminal) {
            last.on = change.on;
            return;
        }
    }
    let index = changes.partition_point(|other| other.at <= change.at);
    changes.insert(index, change);
}
