//! What is behind the registers: the modules, their pins, the world around them, and time.

use super::firmware::SimFirmware;
use super::plant::Plant;
use super::slots::Modules;
use crate::modules::{Effect, OutputChange, SimIoPorts, SimModule, SmartSerial};
use crate::wire::{Nanos, RemoteEnd};

/// The fabric of the simulated FPGA, as its modules see it: the time, the I/O pins, the other
/// modules, and drives and remotes outside.
#[derive(Debug)]
pub struct Fabric {
    pub(super) firmware: SimFirmware,
    pub(super) now: Nanos,
    pub(super) io: SimIoPorts,
    pub(super) modules: Modules,
    pub(super) plant: Plant,
    /// Time up to which the edges of the DPLL's timers have latched their modules.
    latched_to: Nanos,
    /// End of the reset: until then the FPGA ignores writes and every read returns all ones.
    pub(super) reset_until: Nanos,
}

impl Fabric {
    /// The fabric at power-up, with nothing plugged in.
    pub(super) fn new(firmware: SimFirmware) -> Self {
        let io = SimIoPorts::new(firmware.ports, firmware.port_width);
        let modules = Modules::new(&firmware, &io);
        let mut fabric = Self {
            firmware,
            now: 0,
            io,
            modules,
            plant: Plant::default(),
            latched_to: 0,
            reset_until: 0,
        };
        fabric.pins_changed();
        fabric
    }

    /// The firmware of the FPGA.
    pub fn firmware(&self) -> &SimFirmware {
        &self.firmware
    }

    /// Virtual time since power-up.
    pub fn now(&self) -> Nanos {
        self.now
    }

    /// The I/O ports: the set-up of the pins.
    pub fn io(&self) -> &SimIoPorts {
        &self.io
    }

    /// Mutable access to the I/O ports; [`pins_changed`](Self::pins_changed) afterwards.
    pub(crate) fn io_mut(&mut self) -> &mut SimIoPorts {
        &mut self.io
    }

    /// The level of an I/O pin. The signal of a module that is being accessed counts as 1.
    pub fn pin_level(&self, pin: usize) -> bool {
        self.io.level(pin, &|pin| self.module_level(pin))
    }

    /// The level that the FPGA or the outside drives on an I/O pin; `None` if it is only pulled up.
    pub(super) fn driven_level(&self, pin: usize) -> Option<bool> {
        self.io.driven_level(pin, &|pin| self.module_level(pin))
    }

    /// A module's present signal at a pin, regardless of the pin's set-up.
    pub(crate) fn module_level(&self, number: usize) -> bool {
        let pin = self.firmware.pins.get(number);
        // Without a module the alternate source is 0.
        let Some(&pin) = pin.filter(|pin| pin.secondary != 0) else {
            return false;
        };
        let module = self.modules.get(pin.secondary);
        module.is_none_or(|module| module.level(self.now, pin))
    }

    /// Passes the level of a pin to the module whose input it is.
    pub(super) fn pin_driven(&mut self, pin: usize) {
        let (level, now) = (self.pin_level(pin), self.now);
        if let Some(&found) = self.firmware.pins.get(pin)
            && let Some(module) = self.modules.get_mut(found.secondary)
        {
            module.set_input(now, found, level);
        }
    }

    /// The level of a timer of the DPLL, or of its reference (0), if the firmware has one.
    pub(crate) fn timer_level(&self, at: Nanos, timer: u8) -> Option<bool> {
        self.modules.dpll()?.level(at, timer)
    }

    /// Lets the stepper drives of a step generator follow its outputs.
    pub(crate) fn outputs_changed(&mut self, change: OutputChange) {
        let bank = self.modules.encoders_mut();
        self.plant.outputs_changed(change, bank);
    }

    /// Informs everything that depends on the set-up of the pins.
    pub(crate) fn pins_changed(&mut self) {
        self.modules.pins_changed(self.now, &self.io);
        let bank = self.modules.encoders_mut();
        self.plant.pins_changed(&self.io, bank);
        self.plant.take_all(&self.modules, &self.io);
    }

    /// Lets a module work with the others, which do not see it meanwhile.
    pub(super) fn with<R>(
        &mut self,
        slot: usize,
        work: impl FnOnce(&mut dyn SimModule, &mut Self) -> R,
    ) -> Option<R> {
        let mut module = self.modules.take(slot)?;
        let result = work(&mut *module, self);
        self.modules.put_back(slot, module);
        Some(result)
    }

    /// Time of the next event of any module, if it is not after `to`.
    pub(super) fn next_event(&mut self, to: Nanos) -> Option<Nanos> {
        self.modules.next_event(self.now, to)
    }

    /// Handles the event of the module in a slot, if it has one now.
    pub(super) fn event(&mut self, slot: usize) -> Effect {
        let now = self.now;
        if !self.modules.is_due(slot, now) {
            return Effect::Nothing;
        }
        let effect = self.with(slot, |module, _| module.event(now));
        let effect = effect.unwrap_or(Effect::Nothing);
        self.modules.accessed(slot, now);
        match effect {
            Effect::Nothing => {}
            Effect::Outputs => {
                self.settle();
                self.plant.take_from(slot, &self.modules, &self.io);
            }
            Effect::Bite => {
                self.settle();
                self.io.make_inputs();
                self.pins_changed();
            }
        }
        effect
    }

    /// Advances to `to`, before which no module has an event.
    pub(super) fn run_to(&mut self, to: Nanos) {
        self.visit_remotes(SmartSerial::is_touched);
        while self.now < to {
            let due = [self.modules.remotes_due(), self.next_latch()];
            let due = due.into_iter().flatten().min().unwrap_or(Nanos::MAX);
            let due = due.min(self.plant.due());
            let step = to.min(due.max(self.now + 1));
            self.run_ports(step);
            self.now = step;
            if step >= due {
                self.advance_plant();
                // Remotes have events of their own (their watchdogs bite), without any transmission
                // to them.
                self.visit_remotes(|port| port.remotes_due().is_some_and(|due| due <= step));
            }
        }
    }

    /// Advances the remotes of the selected ports, and applies their outputs.
    pub(super) fn visit_remotes(&mut self, which: impl Fn(&SmartSerial) -> bool) {
        if !self.modules.has_port(&which) {
            return;
        }
        let now = self.now;
        self.with_ports(|number, port, fabric| {
            if which(port) {
                fabric.move_to(now);
                port.visit_remotes(now, number, fabric);
            }
        });
    }

    /// Runs the ports that have an event up to `to`.
    fn run_ports(&mut self, to: Nanos) {
        let is_due = |port: &SmartSerial| port.next_event().is_some_and(|event| event <= to);
        if self.is_in_reset() || !self.modules.has_port(is_due) {
            return;
        }
        self.with_ports(|number, port, fabric| {
            if is_due(port) {
                port.advance(to, number, fabric);
            }
        });
    }

    /// Works with all serial ports and their numbers.
    fn with_ports(&mut self, mut work: impl FnMut(usize, &mut SmartSerial, &mut Self)) {
        let mut place = 0;
        while let Some((slot, first)) = self.modules.serial(place) {
            place += 1;
            self.with(slot, |module, fabric| {
                for (number, port) in (first..).zip(module.ports_mut()) {
                    work(number, port, fabric);
                }
            });
        }
    }

    /// Brings the motors up to date, and applies changes of remotes to them.
    pub(super) fn settle(&mut self) {
        self.advance_plant();
        self.visit_remotes(SmartSerial::is_touched);
    }

    /// Brings motors, encoders and step generators up to date, and latches them at the edges of
    /// their timers.
    fn advance_plant(&mut self) {
        while let Some(edge) = self.next_latch().filter(|&edge| edge <= self.now) {
            self.move_to(edge);
            self.latch(edge);
        }
        self.latched_to = self.now;
        self.move_to(self.now);
        self.plant.take_from_modules(&self.modules, &self.io);
        self.take_signals();
    }

    /// Moves motors, and all that they move, to `to`.
    fn move_to(&mut self, to: Nanos) {
        if to <= self.plant.now() {
            return;
        }
        let mut place = 0;
        while let Some(slot) = self.modules.advancing(place) {
            let advances = self.with(slot, |module, fabric| module.advance(fabric, to));
            if advances == Some(false) {
                self.modules.does_not_advance(place);
            } else {
                place += 1;
            }
        }
        let bank = self.modules.encoders_mut();
        self.plant.advance(to, bank);
    }

    /// The next time at which a timer latches a module. It counts from the last edge that has
    /// latched, not from the time of the plant, which other events advance as well.
    fn next_latch(&self) -> Option<Nanos> {
        let mut timers = self.modules.latching_timers().peekable();
        timers.peek()?;
        let dpll = self.modules.dpll()?;
        let edges = timers.filter_map(|timer| dpll.next_edge(self.latched_to, timer));
        edges.min()
    }

    /// Latches all modules whose timer rises at `edge`, the next edge of any.
    fn latch(&mut self, edge: Nanos) {
        let from = self.latched_to;
        if let Some(dpll) = self.modules.dpll().copied() {
            let rises = |timer| dpll.next_edge(from, timer) == Some(edge);
            self.modules.latch(edge, rises);
        }
        self.latched_to = edge;
    }

    /// Brings motors and inputs up to date before a remote that depends on them takes the
    /// transmission that ends at `at`.
    pub(crate) fn before_remote(
        &mut self,
        [port, channel]: [usize; 2],
        at: Nanos,
        remote: &mut dyn RemoteEnd,
    ) {
        let is_wired = self.plant.installation.is_wired_to(port, channel);
        if is_wired || self.plant.is_driven_by(port, channel) {
            self.move_to(at);
        }
        if is_wired {
            self.plant.put_on_remote(at, [port, channel], remote);
        }
    }

    /// Lets drives follow the outputs of a remote, after it has taken a transmission, or when
    /// something else may have changed what is plugged into the channel.
    pub(crate) fn after_remote(
        &mut self,
        [port, channel]: [usize; 2],
        remote: Option<&dyn RemoteEnd>,
    ) {
        self.plant.remote_changed([port, channel], remote);
    }

    /// True while the FPGA has no configuration.
    pub(super) fn is_in_reset(&self) -> bool {
        self.now < self.reset_until
    }
}
