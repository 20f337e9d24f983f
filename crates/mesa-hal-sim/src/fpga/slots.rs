//! The modules of an FPGA, each in a slot.

use core::any::Any;

use super::firmware::{SimFirmware, SimModuleDescriptor};
use super::plant::DriveSignal;
use crate::modules::{
    Configuration, EncoderBank, RegisterAddress, SimDpll, SimIoPorts, SimModule, SmartSerial,
    Unsimulated, built_in,
};
use crate::wire::Nanos;

/// Value in the index of a GTAG without a module.
const NONE: u8 = u8::MAX;

/// All modules of a firmware, in the order of their descriptors, and those that were added.
#[derive(Debug)]
pub(crate) struct Modules {
    slots: Vec<Slot>,
    /// Number of the slot for each GTAG of a module or of a pin.
    by_gtag: Box<[u8; 256]>,
    /// The slots with smart serial ports, each with the number of its first port.
    serial: Vec<(usize, usize)>,
    /// The slots whose modules advance with time.
    advancing: Vec<usize>,
    /// The slots of the first encoder module and of the DPLL.
    encoders: Option<usize>,
    dpll: Option<usize>,
    /// The next event of any module.
    next_event: Nanos,
    /// True if a timer latches a module.
    is_latched: bool,
    /// True if a module was handed out, so that the fields above may be out of date.
    is_stale: bool,
}

#[derive(Debug)]
struct Slot {
    descriptor: SimModuleDescriptor,
    /// The module; `None` while it works with the others.
    module: Option<Box<dyn SimModule>>,
    next_event: Nanos,
    latching_timer: Option<u8>,
}

impl Modules {
    /// The modules after power-up.
    pub(super) fn new(firmware: &SimFirmware, io: &SimIoPorts) -> Self {
        let mut modules = Self {
            slots: Vec::new(),
            by_gtag: Box::new([NONE; 256]),
            serial: Vec::new(),
            advancing: Vec::new(),
            encoders: None,
            dpll: None,
            next_event: Nanos::MAX,
            is_latched: false,
            is_stale: true,
        };
        // A descriptor without instances has no hardware.
        for module in firmware.modules.iter().filter(|one| one.instances > 0) {
            let kind = built_in(module.gtag);
            let is_part = kind.is_some_and(|kind| kind.gtags.first() != Some(&module.gtag));
            if is_part {
                continue;
            }
            let configuration = Configuration {
                firmware,
                module,
                io,
                now: 0,
                complete: 0,
            };
            let made = kind.map(|kind| (kind.new)(&configuration));
            let gtags = kind.map_or(core::slice::from_ref(&module.gtag), |kind| kind.gtags);
            modules.push(
                *module,
                made.unwrap_or_else(|| Box::new(Unsimulated)),
                gtags,
            );
        }
        modules.index();
        modules
    }

    fn push(&mut self, descriptor: SimModuleDescriptor, module: Box<dyn SimModule>, gtags: &[u8]) {
        let Ok(number) = u8::try_from(self.slots.len()) else {
            return;
        };
        self.slots.push(Slot {
            descriptor,
            module: Some(module),
            next_event: Nanos::MAX,
            latching_timer: None,
        });
        for &gtag in gtags {
            // The first module with a GTAG has its pins.
            if let Some(first) = self.by_gtag.get_mut(usize::from(gtag))
                && *first == NONE
            {
                *first = number;
            }
        }
    }

    /// Finds the modules that the others and the world ask for often.
    fn index(&mut self) {
        let mut ports = 0;
        self.serial.clear();
        for (number, slot) in self.slots.iter().enumerate() {
            if !slot.ports().is_empty() {
                self.serial.push((number, ports));
                ports += slot.ports().len();
            }
        }
        self.advancing = (0..self.slots.len()).collect();
        self.encoders = self.position::<EncoderBank>();
        self.dpll = self.position::<SimDpll>();
    }

    fn position<T: SimModule>(&self) -> Option<usize> {
        let is_type = |module: &dyn SimModule| (module as &dyn Any).is::<T>();
        let mut slots = self.slots.iter();
        slots.position(|slot| slot.module.as_deref().is_some_and(is_type))
    }

    /// Puts a module in the place of the one with this GTAG, or after the others; returns its slot.
    pub(super) fn replace(&mut self, gtag: u8, module: Box<dyn SimModule>) -> usize {
        let number = self.number_of(gtag);
        if let Some(slot) = number.and_then(|number| self.slots.get_mut(number)) {
            slot.module = Some(module);
        } else {
            let descriptor = SimModuleDescriptor {
                gtag,
                instances: 0,
                ..SimModuleDescriptor::default()
            };
            self.push(descriptor, module, &[gtag]);
        }
        self.is_stale = true;
        self.index();
        number.unwrap_or(self.slots.len() - 1)
    }

    /// The registers of a module with their addresses.
    pub(super) fn addresses(
        &self,
        number: usize,
        firmware: &SimFirmware,
        io: &SimIoPorts,
    ) -> Vec<RegisterAddress> {
        let Some(slot) = self.slots.get(number) else {
            return Vec::new();
        };
        let configuration = Configuration {
            firmware,
            module: &slot.descriptor,
            io,
            now: 0,
            complete: 0,
        };
        let module = slot.module.as_deref();
        module.map_or_else(Vec::new, |module| module.addresses(&configuration))
    }

    /// Resets all modules.
    pub(super) fn reload(
        &mut self,
        firmware: &SimFirmware,
        io: &SimIoPorts,
        [now, complete]: [Nanos; 2],
    ) {
        for slot in &mut self.slots {
            if let Some(module) = slot.module.as_deref_mut() {
                module.reload(&Configuration {
                    firmware,
                    module: &slot.descriptor,
                    io,
                    now,
                    complete,
                });
            }
        }
        self.refresh(now);
    }

    pub(super) fn len(&self) -> usize {
        self.slots.len()
    }

    /// Number of the slot whose module has this GTAG, or pins with it.
    pub(super) fn number_of(&self, gtag: u8) -> Option<usize> {
        let number = self.by_gtag.get(usize::from(gtag)).copied();
        number.filter(|&number| number != NONE).map(usize::from)
    }

    /// GTAG of the module in a slot.
    pub(super) fn gtag(&self, number: usize) -> Option<u8> {
        Some(self.slots.get(number)?.descriptor.gtag)
    }

    /// GTAGs of the modules that the simulator does not implement.
    pub(super) fn unsimulated(&self) -> Vec<u8> {
        let slots = self.slots.iter();
        let others = slots.filter(|slot| {
            let module = slot.module.as_deref();
            module.is_some_and(|module| (module as &dyn Any).is::<Unsimulated>())
        });
        others.map(|slot| slot.descriptor.gtag).collect()
    }

    /// The module in a slot.
    pub(super) fn at(&self, number: usize) -> Option<&dyn SimModule> {
        self.slots.get(number)?.module.as_deref()
    }

    /// The module with this GTAG, or with pins that have it.
    pub(super) fn get(&self, gtag: u8) -> Option<&dyn SimModule> {
        self.at(self.number_of(gtag)?)
    }

    /// The signal of a module's output to a drive; the default signal if there is no module.
    pub(super) fn drive_signal(
        &self,
        gtag: u8,
        now: Nanos,
        output: u8,
        io: &SimIoPorts,
    ) -> DriveSignal {
        let module = self.get(gtag);
        module.map_or(DriveSignal::default(), |module| {
            module.drive_signal(now, output, io)
        })
    }

    /// Mutable access to the module with this GTAG, or with pins that have it.
    pub(super) fn get_mut(&mut self, gtag: u8) -> Option<&mut (dyn SimModule + 'static)> {
        let number = self.number_of(gtag)?;
        self.is_stale = true;
        self.slots.get_mut(number)?.module.as_deref_mut()
    }

    /// The first module of a type.
    pub(super) fn first<T: SimModule>(&self) -> Option<&T> {
        let mut modules = self.slots.iter().filter_map(|slot| slot.module.as_deref());
        modules.find_map(|module| (module as &dyn Any).downcast_ref())
    }

    /// Mutable access to the first module of a type, for changes from outside of the FPGA: they
    /// move no event, and select no timer.
    pub(super) fn first_mut<T: SimModule>(&mut self) -> Option<&mut T> {
        let slots = self.slots.iter_mut();
        let mut modules = slots.filter_map(|slot| slot.module.as_deref_mut());
        modules.find_map(|module| (module as &mut dyn Any).downcast_mut())
    }

    /// The first encoder module.
    pub(super) fn encoders_mut(&mut self) -> Option<&mut EncoderBank> {
        let module = self.slots.get_mut(self.encoders?)?.module.as_deref_mut()?;
        (module as &mut dyn Any).downcast_mut()
    }

    /// The DPLL.
    pub(super) fn dpll(&self) -> Option<&SimDpll> {
        (self.at(self.dpll?)? as &dyn Any).downcast_ref()
    }

    /// The slot in a place of the list of modules that advance with time.
    pub(super) fn advancing(&self, place: usize) -> Option<usize> {
        self.advancing.get(place).copied()
    }

    /// Takes the module in a place out of that list.
    pub(super) fn does_not_advance(&mut self, place: usize) {
        self.advancing.remove(place);
    }

    /// Takes a module out of its slot, so that it can work with the others;
    /// [`put_back`](Self::put_back) it afterwards.
    pub(super) fn take(&mut self, number: usize) -> Option<Box<dyn SimModule>> {
        self.slots.get_mut(number)?.module.take()
    }

    /// Puts a module back into its slot.
    #[inline]
    pub(super) fn put_back(&mut self, number: usize, module: Box<dyn SimModule>) {
        if let Some(slot) = self.slots.get_mut(number) {
            slot.module = Some(module);
        }
    }

    /// Takes over the next event and the timer of a module after an access.
    pub(super) fn accessed(&mut self, number: usize, now: Nanos) {
        let changed = self
            .slots
            .get_mut(number)
            .is_some_and(|slot| slot.look(now));
        if changed {
            self.sum_up();
        }
    }

    fn refresh(&mut self, now: Nanos) {
        for slot in &mut self.slots {
            slot.look(now);
        }
        self.sum_up();
        self.is_stale = false;
    }

    fn sum_up(&mut self) {
        let events = self.slots.iter().map(|slot| slot.next_event);
        self.next_event = events.min().unwrap_or(Nanos::MAX);
        self.is_latched = self.slots.iter().any(|slot| slot.latching_timer.is_some());
    }

    /// Time of the next event of any module, if it is not after `to`.
    pub(super) fn next_event(&mut self, now: Nanos, to: Nanos) -> Option<Nanos> {
        if self.is_stale {
            self.refresh(now);
        }
        (self.next_event <= to).then_some(self.next_event)
    }

    /// True if a module has an event up to `now`.
    pub(super) fn is_due(&self, number: usize, now: Nanos) -> bool {
        let slot = self.slots.get(number);
        slot.is_some_and(|slot| slot.next_event <= now)
    }

    /// The timers that latch modules; 0 is the reference.
    pub(super) fn latching_timers(&self) -> impl Iterator<Item = u8> {
        let slots = if self.is_latched { &*self.slots } else { &[] };
        slots.iter().filter_map(|slot| slot.latching_timer)
    }

    /// Latches all modules whose timer `rises` at `edge`.
    pub(super) fn latch(&mut self, edge: Nanos, rises: impl Fn(u8) -> bool) {
        for slot in &mut self.slots {
            if slot.latching_timer.is_some_and(&rises)
                && let Some(module) = &mut slot.module
            {
                module.latch(edge);
            }
        }
    }

    /// Informs all modules of the set-up of the pins.
    pub(super) fn pins_changed(&mut self, now: Nanos, io: &SimIoPorts) {
        for module in self
            .slots
            .iter_mut()
            .filter_map(|slot| slot.module.as_mut())
        {
            module.pins_changed(now, io);
        }
    }

    /// A slot with smart serial ports, and the number of its first port, by its place in the list.
    pub(super) fn serial(&self, place: usize) -> Option<(usize, usize)> {
        self.serial.get(place).copied()
    }

    /// All smart serial ports.
    pub(super) fn ports(&self) -> impl Iterator<Item = &SmartSerial> {
        let slots = self.serial.iter();
        let slots = slots.filter_map(|&(number, _)| self.slots.get(number));
        slots.flat_map(Slot::ports)
    }

    /// True if a smart serial port is one of the selected.
    pub(super) fn has_port(&self, which: impl Fn(&SmartSerial) -> bool) -> bool {
        let mut slots = self.serial.iter();
        slots.any(|&(number, _)| {
            let slot = self.slots.get(number);
            slot.is_some_and(|slot| slot.ports().iter().any(&which))
        })
    }

    /// Time of the next event of a remote that needs no transmission to it.
    pub(super) fn remotes_due(&self) -> Option<Nanos> {
        let slots = self.serial.iter();
        let due = slots.filter_map(|&(number, _)| {
            let ports = self.slots.get(number)?.ports().iter();
            ports.filter_map(SmartSerial::remotes_due).min()
        });
        due.min()
    }

    /// Mutable access to a smart serial port.
    pub(super) fn port_mut(&mut self, port: usize) -> Option<&mut SmartSerial> {
        let slots = self.slots.iter_mut();
        let modules = slots.filter_map(|slot| slot.module.as_deref_mut());
        modules.flat_map(SimModule::ports_mut).nth(port)
    }
}

impl Slot {
    fn ports(&self) -> &[SmartSerial] {
        self.module.as_deref().map_or(&[], SimModule::ports)
    }

    /// Asks the module for its next event and its timer; true if they have changed.
    fn look(&mut self, now: Nanos) -> bool {
        let Some(module) = &self.module else {
            return false;
        };
        let next = module.next_event(now);
        let next = next.map_or(Nanos::MAX, |next| next.max(now.saturating_add(1)));
        let seen = (next, module.latching_timer());
        let changed = seen != (self.next_event, self.latching_timer);
        (self.next_event, self.latching_timer) = seen;
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fpga::{Fabric, gtag};
    use crate::machines;
    use crate::modules::Effect;

    /// Counts its events, one each microsecond.
    #[derive(Debug, Default)]
    struct Ticker {
        ticks: u32,
        level: bool,
    }

    impl SimModule for Ticker {
        fn read(&mut self, _: &Fabric, register: u8, _: u8) -> u32 {
            if register == 0 { self.ticks } else { 0xAB }
        }

        fn write(&mut self, _: &mut Fabric, _: u8, _: u8, value: u32) {
            self.ticks = value;
        }

        fn reload(&mut self, _: &Configuration<'_>) {
            self.ticks = 0;
        }

        fn addresses(&self, configuration: &Configuration<'_>) -> Vec<RegisterAddress> {
            configuration.addresses(2)
        }

        fn next_event(&self, now: Nanos) -> Option<Nanos> {
            Some(now / 1_000 * 1_000 + 1_000)
        }

        fn event(&mut self, _: Nanos) -> Effect {
            self.ticks += 1;
            self.level = !self.level;
            Effect::Outputs
        }
    }

    #[test]
    fn added_module_takes_the_place_of_a_built_in_one() {
        let mut fpga = machines::i7i97(1);
        assert_eq!(fpga.read_register(0x0200), u32::MAX, "LEDs");
        assert_eq!(fpga.counters().unknown_reads, 0);
        fpga.add_module(gtag::LED, Box::<Ticker>::default());
        fpga.advance_to(10_500);
        assert_eq!(fpga.read_register(0x0200), 10);
        assert_eq!(fpga.read_register(0x0300), 0xAB, "a register more");
        fpga.write_register(0x0200, 100);
        fpga.advance_to(12_000);
        assert_eq!(fpga.module::<Ticker>(gtag::LED).unwrap().ticks, 102);
        fpga.reload();
        assert_eq!(fpga.read_register(0x0200), 0);
        assert!(!fpga.leds().is_lit(0));
    }

    #[test]
    fn module_that_no_descriptor_has_gets_no_register() {
        let mut fpga = machines::i7i97(1);
        fpga.add_module(0x98, Box::<Ticker>::default());
        fpga.advance_to(3_000);
        assert_eq!(fpga.module::<Ticker>(0x98).unwrap().ticks, 3);
        assert_eq!(fpga.read_register(0x0000), 0);
        assert_eq!(fpga.counters().unknown_reads, 1);
    }
}
