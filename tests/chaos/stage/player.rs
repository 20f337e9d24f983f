//! Changes the inputs all the time, and carries the faults out.

use std::collections::{BTreeMap, BTreeSet};

use mesa_hal::lbp::RemoteFaults;
use mesa_hal_sim::devices::{
    Analog, Device, FieldIo, Outputs48, SignalValue, World, find_cable, find_mut,
};
use mesa_hal_sim::remote::{Cable, SimRemote, Toward, WireFault};
use mesa_hal_sim::wire::{Nanos, RemoteEnd};
use mesa_hal_sim::{ChangeCause, Director, FaultKind, FaultPlace, SimFpga};

use super::super::journal::{Journal, Level, Outputs, PARTS, Parts, What, parts, recorder};
use super::super::machine::{Gpio, end};
use super::super::plan::{Board, Card, MICRO, MILLI, Moment, Plan, Planned, scrambled};
use super::{Act, Begun, History, Stage};
use crate::common::chance::Chance;

/// Shortest time for an exchange of cards by hand: longer than any START takes from its look at a
/// card to the end.
const EXCHANGE: u64 = 5 * MILLI;

/// Plays a plan on a machine.
#[derive(Debug)]
pub struct Player {
    stage: Stage,
    plan: Plan,
    gpio: Gpio,
    outputs: Outputs,
    journal: Journal,
    chance: Chance,
    /// Outputs of the board at the last look.
    seen: Parts,
    /// True if the board drove any pin then.
    is_open: bool,
    /// Cards that are unplugged, because another one comes.
    leaving: BTreeSet<usize>,
    /// Time at which the own card can be plugged in again, where the other one is unplugged
    /// already.
    returning: BTreeMap<usize, Nanos>,
    /// Cards that were swapped.
    aside: BTreeMap<usize, Box<dyn RemoteEnd>>,
}

impl Player {
    pub fn new(stage: &Stage, plan: &Plan, gpio: &Gpio, journal: &Journal) -> Self {
        Self {
            stage: stage.clone(),
            plan: plan.clone(),
            gpio: gpio.clone(),
            outputs: gpio.driven(),
            journal: journal.clone(),
            chance: Chance(scrambled(plan.seed ^ 0x57A6E)),
            seen: [Level::OFF; PARTS],
            is_open: false,
            leaving: BTreeSet::new(),
            returning: BTreeMap::new(),
            aside: BTreeMap::new(),
        }
    }

    /// Changes all inputs.
    fn change(&mut self, fpga: &mut SimFpga) {
        let now = SimFpga::now(fpga);
        let next = now + MICRO * (200 + self.chance.below(2_500));
        for card in self.aside.values_mut() {
            card.advance(now);
        }
        let stage = self.stage.clone();
        let mut agenda = stage.lock();
        agenda.push(next, Act::Change);
        for remote in 0..self.plan.remotes() {
            if self.plan.card(remote).is_field() {
                let pattern = self.chance.below(1 << 32) as u32 ^ self.chance.below(1 << 32) as u32;
                if !self.aside.contains_key(&remote) {
                    set_field(self.end(fpga, remote), pattern);
                    self.note_mpgs(fpga, remote, &mut agenda.truth.mpgs[remote]);
                }
                agenda.truth.fields[remote].push((now, pattern));
            }
        }
        let levels = self.chance.below(1 << 31) ^ self.chance.below(1 << 31) << 20;
        for (n, pin) in self.gpio.inputs.iter().enumerate() {
            fpga.drive_pin(*pin, Some(levels >> n & 1 != 0));
        }
        agenda.truth.gpio.push((now, levels));
        if self.plan.board == Board::I7i97 {
            let inputs = self.chance.below(1 << 16) as u32;
            for input in 0..16 {
                fpga.set_input(input, inputs >> input & 1 != 0);
            }
            agenda.truth.isolated.push((now, inputs));
        }
        let part = if self.chance.one_in(3) { 0.5 } else { 1.0 };
        for axis in 0..fpga.axes() {
            let speed = part * self.plan.speed(axis);
            let Some(motor) = fpga.motor(axis) else {
                continue;
            };
            motor.turn_by_hand(Some(speed / motor.config().counts_per_unit));
            agenda.truth.motors[axis].push((now, (motor.counts(), speed)));
        }
    }

    /// Records the current MPG counters of a remote.
    fn note_mpgs(&self, fpga: &mut SimFpga, remote: usize, history: &mut History<[u8; 2]>) {
        if !self.plan.card(remote).is_field() || self.plan.field_mode != 3 {
            return;
        }
        let now = SimFpga::now(fpga);
        let Some(device) = find_mut(self.end(fpga, remote)) else {
            return;
        };
        let mut counts = device
            .inputs()
            .into_iter()
            .filter_map(|(_, value)| match value {
                SignalValue::Count(count) => Some(count as u8),
                _ => None,
            });
        let counts = [(); 2].map(|()| counts.next().unwrap_or_default());
        if history.last().is_none_or(|(_, last)| *last != counts) {
            history.push((now, counts));
        }
    }

    fn end<'a>(&self, fpga: &'a mut SimFpga, remote: usize) -> &'a mut dyn RemoteEnd {
        let (port, channel) = self.plan.place(remote);
        fpga.remote_mut(port, channel).expect("plugged")
    }

    fn cable<'a>(&self, fpga: &'a mut SimFpga, remote: usize) -> &'a mut Cable {
        find_cable(self.end(fpga, remote)).expect("every card is at a cable")
    }

    fn begin(&mut self, fpga: &mut SimFpga, place: usize) {
        let now = SimFpga::now(fpga);
        let stage = self.stage.clone();
        let planned = stage.lock().planned[place];
        let moment = self.moment(fpga);
        self.carry_out(fpga, planned);
        let mut agenda = stage.lock();
        self.note_mpgs(fpga, planned.target, &mut agenda.truth.mpgs[planned.target]);
        agenda.begun[place] = Some(Begun {
            planned,
            ended: None,
        });
        agenda.happened.push((planned.kind, moment));
        agenda.story.push((
            now,
            format!(
                "{} of remote {} for {} us ({moment:?}, {:#x})",
                planned.kind,
                planned.target,
                planned.lasts / MICRO,
                planned.dice
            ),
        ));
    }

    fn moment(&self, fpga: &mut SimFpga) -> Moment {
        let well = self.stage.lock().all_is_well;
        match well {
            Some(true) => Moment::Running,
            Some(false) => Moment::Recovery,
            None => {
                let spoken_to = (0..self.plan.remotes())
                    .any(|n| recorder(self.end(fpga, n)).is_some_and(|r| r.spoken_to));
                if spoken_to {
                    Moment::Discovery
                } else {
                    Moment::Start
                }
            }
        }
    }

    fn carry_out(&mut self, fpga: &mut SimFpga, planned: Planned) {
        let now = SimFpga::now(fpga);
        let Planned {
            kind,
            target,
            dice,
            lasts,
            ..
        } = planned;
        match kind {
            FaultKind::WireLost
            | FaultKind::WireCorrupted
            | FaultKind::WireShort
            | FaultKind::WireLong
            | FaultKind::WireBreak
            | FaultKind::WireLate => self.spoil_wire(fpga, planned),
            FaultKind::WireUnplugged => self.cable(fpga, target).unplug(),
            FaultKind::WireLow => {
                let cable = self.cable(fpga, target);
                cable.set_low_when_unplugged(true);
                cable.unplug();
            }
            FaultKind::WireSwapped => {
                self.cable(fpga, target).unplug();
                self.leaving.insert(target);
                self.stage
                    .lock()
                    .push(now + EXCHANGE, Act::Swap(target, dice));
            }
            FaultKind::RemoteOverTemperature | FaultKind::RemoteOverCurrent => {
                let n = (dice % 16) as usize;
                let device = find_mut(self.end(fpga, target)).expect("a device");
                let done = if kind == FaultKind::RemoteOverCurrent {
                    device.set_over_current(n, true)
                } else {
                    device.set_over_temperature(n, true)
                };
                if done.is_err() {
                    self.set_fault_bit(fpga, planned);
                }
            }
            FaultKind::RemoteHighVoltage | FaultKind::RemoteLowVoltage => {
                let low = [0.0, 3.0][(dice & 1) as usize];
                let volts = if kind == FaultKind::RemoteHighVoltage {
                    36.0
                } else {
                    low
                };
                let device = find_mut(self.end(fpga, target)).expect("a device");
                if device.set_field_volts(now, volts).is_err() {
                    self.set_fault_bit(fpga, planned);
                }
            }
            FaultKind::RemoteWatchdog
            | FaultKind::RemoteNoEnable
            | FaultKind::RemoteIllegalMode
            | FaultKind::RemoteCommunication => self.set_fault_bit(fpga, planned),
            FaultKind::RemotePowerOff | FaultKind::RemotePowerGlitch => {
                let device = find_mut(self.end(fpga, target)).expect("a device");
                device.set_power(now, false);
                if kind == FaultKind::RemotePowerGlitch {
                    device.set_power(now, true);
                }
            }
            FaultKind::FpgaReset | FaultKind::FpgaResetLong if !self.plan.is_network => {
                if kind == FaultKind::FpgaReset {
                    fpga.reload();
                } else {
                    fpga.reset_for(lasts);
                }
                self.drives(fpga, ChangeCause::Reset);
            }
            FaultKind::FpgaWatchdog => {
                fpga.write_register(0x0C00, 1);
            }
            FaultKind::FpgaPortStuck => {
                let (port, _) = self.plan.place(target);
                // Of no channel: a transfer would feed a remote's watchdog.
                fpga.write_register(0x5B00 + 0x40 * port as u16, 0x3000);
            }
            // The other faults are played by the network, the bus, the host, and on Ethernet the
            // board.
            _ => {}
        }
        if let Some(recorder) = recorder(self.end(fpga, target)) {
            recorder.look(now);
        }
    }

    fn spoil_wire(&mut self, fpga: &mut SimFpga, planned: Planned) {
        let Planned {
            kind,
            target,
            dice,
            lasts,
            ..
        } = planned;
        let mut chance = Chance(dice);
        let period = self.plan.period;
        let few = 1 + chance.below(3);
        let mut single = false;
        let fault = match kind {
            FaultKind::WireLost => WireFault::Lost,
            FaultKind::WireCorrupted => WireFault::Corrupted,
            FaultKind::WireShort => WireFault::Short(few as u8),
            FaultKind::WireLong => WireFault::Long(few as u8),
            FaultKind::WireBreak => WireFault::Break,
            // Several replies in a row that are late by a whole period cannot be distinguished from
            // replies in time: nothing on the wire numbers them.
            _ => {
                single = chance.one_in(4);
                let most = if single { 2 * period } else { period * 7 / 10 };
                WireFault::Late(10 * MICRO + chance.below(most))
            }
        };
        let toward = if kind != FaultKind::WireLate && chance.one_in(3) {
            Toward::Remote
        } else {
            Toward::Fpga
        };
        let probability = chance.of(&[0.02, 0.2, 1.0]);
        let cable = self.cable(fpga, target);
        if single {
            cable.inject(toward, fault, 1);
            if self.plan.more.is_late_again {
                // Far enough from the first one that each of them is a single one.
                let at = SimFpga::now(fpga) + 15 * period;
                self.stage.lock().push(at, Act::Again(target));
            }
        } else if lasts < 2 * MILLI {
            cable.inject(toward, fault, few as u32);
        } else {
            cable.inject_by_chance(toward, fault, probability);
        }
    }

    /// Another card on the channel: one of another kind, or the same with another unit number.
    fn swap(&mut self, fpga: &mut SimFpga, target: usize, dice: u64) {
        if !self.leaving.remove(&target) {
            return;
        }
        let (port, channel) = self.plan.place(target);
        let card = match (self.plan.card(target), dice & 1) {
            (card, 0) => card,
            (Card::Field | Card::Field76, _) => Card::Outputs,
            (_, _) => Card::Field,
        };
        let stranger = end(card, (self.plan.remotes(), 100 + target), 50, &self.journal);
        if let Some(before) = fpga.plug(port, channel, Some(stranger)) {
            self.aside.entry(target).or_insert(before);
        }
    }

    fn set_fault_bit(&self, fpga: &mut SimFpga, planned: Planned) {
        let bit = planned.kind.fault_bit().unwrap_or_default();
        let (port, channel) = self.plan.place(planned.target);
        match self.plan.card(planned.target) {
            Card::Field | Card::Field76 => set_bit::<FieldIo>(fpga, (port, channel), bit),
            Card::Analog => set_bit::<Analog>(fpga, (port, channel), bit),
            Card::Outputs => set_bit::<Outputs48>(fpga, (port, channel), bit),
        }
    }

    fn finish(&mut self, fpga: &mut SimFpga, place: usize) {
        let now = SimFpga::now(fpga);
        let stage = self.stage.clone();
        let swapped = stage.lock().begun[place].map(|begun| begun.planned);
        if let Some(Planned { kind, target, .. }) = swapped
            && kind == FaultKind::WireSwapped
            && !self.can_come_back(fpga, place, target)
        {
            return;
        }
        let planned = {
            let mut agenda = stage.lock();
            let Some(begun) = &mut agenda.begun[place] else {
                return;
            };
            if begun.ended.replace(now).is_some() {
                return;
            }
            begun.planned
        };
        let Planned {
            kind, target, dice, ..
        } = planned;
        match kind {
            FaultKind::WireSwapped => self.swap_back(fpga, target),
            FaultKind::RemoteOverTemperature | FaultKind::RemoteOverCurrent => {
                let n = (dice % 16) as usize;
                let device = find_mut(self.end(fpga, target)).expect("a device");
                let _ = device.set_over_current(n, false);
                let _ = device.set_over_temperature(n, false);
            }
            FaultKind::RemoteHighVoltage | FaultKind::RemoteLowVoltage => {
                let device = find_mut(self.end(fpga, target)).expect("a device");
                let _ = device.set_field_volts(now, 24.0);
                self.set_newest(fpga, target);
            }
            FaultKind::RemotePowerOff => {
                let device = find_mut(self.end(fpga, target)).expect("a device");
                device.set_power(now, true);
            }
            kind if kind.place() == FaultPlace::Wire => self.mend_cable(fpga, target),
            _ => {}
        }
        if let Some(recorder) = recorder(self.end(fpga, target)) {
            recorder.look(now);
        }
        self.note_mpgs(fpga, target, &mut stage.lock().truth.mpgs[target]);
        stage.tell(now, format!("{kind} of remote {target} is over"));
    }

    fn mend_cable(&self, fpga: &mut SimFpga, target: usize) {
        if self.leaving.contains(&target) {
            return;
        }
        let cable = self.cable(fpga, target);
        cable.heal();
        cable.replug();
        cable.set_low_when_unplugged(false);
    }

    fn repair(&self, fpga: &mut SimFpga, target: usize) {
        let now = SimFpga::now(fpga);
        self.mend_cable(fpga, target);
        let device = find_mut(self.end(fpga, target)).expect("a device");
        device.set_power(now, true);
        let _ = device.set_field_volts(now, 24.0);
        for n in 0..16 {
            let _ = device.set_over_current(n, false);
            let _ = device.set_over_temperature(n, false);
        }
    }

    /// True if the own card can be plugged in again; if not, the other one is unplugged, and the
    /// fault ends later.
    fn can_come_back(&mut self, fpga: &mut SimFpga, place: usize, target: usize) -> bool {
        let now = SimFpga::now(fpga);
        if !self.aside.contains_key(&target) {
            return true;
        }
        self.cable(fpga, target).unplug();
        // Its own watchdog has bitten when it is plugged in again.
        let away = EXCHANGE + self.plan.extras.remote_watchdog * MILLI;
        let at = *self.returning.entry(target).or_insert(now + away);
        if now < at {
            self.stage.lock().push(at, Act::End(place));
        }
        now >= at
    }

    fn swap_back(&mut self, fpga: &mut SimFpga, target: usize) {
        let (port, channel) = self.plan.place(target);
        self.leaving.remove(&target);
        self.returning.remove(&target);
        let Some(own) = self.aside.remove(&target) else {
            self.mend_cable(fpga, target);
            return;
        };
        fpga.plug(port, channel, Some(own));
        let now = SimFpga::now(fpga);
        self.end(fpga, target).advance(now);
        // Faults that ended meanwhile ended for the card that is on the channel.
        self.repair(fpga, target);
        self.set_newest(fpga, target);
    }

    /// Sets the inputs of a card to their current levels, at the current field power, which the
    /// switches are wired to.
    fn set_newest(&self, fpga: &mut SimFpga, target: usize) {
        if self.plan.card(target).is_field() && !self.aside.contains_key(&target) {
            let newest = self.stage.lock().truth.fields[target].last().copied();
            let pattern = newest.map_or(0, |(_, pattern)| pattern);
            set_field(self.end(fpga, target), pattern);
        }
    }
}

fn set_bit<T: World>(fpga: &mut SimFpga, (port, channel): (usize, usize), bit: RemoteFaults) {
    if let Some(remote) = fpga.device_mut::<SimRemote<Device<T>>>(port, channel) {
        let faults = remote.faults() | bit;
        remote.set_faults(faults);
    }
}

fn set_field(end: &mut dyn RemoteEnd, pattern: u32) {
    if let Some(device) = find_mut(end) {
        for n in 0..32 {
            let _ = device.set_input(n, pattern >> n & 1 != 0);
        }
    }
}

impl Director for Player {
    fn due(&self) -> Option<Nanos> {
        self.stage
            .lock()
            .acts
            .first_key_value()
            .map(|(key, _)| key.0)
    }

    fn act(&mut self, fpga: &mut SimFpga) {
        let act = self.stage.lock().acts.pop_first();
        match act {
            Some((_, Act::Change)) => self.change(fpga),
            Some((_, Act::Begin(place))) => self.begin(fpga, place),
            Some((_, Act::Again(target))) => {
                let late = WireFault::Late(self.plan.period * 3 / 2);
                self.cable(fpga, target).inject(Toward::Fpga, late, 1);
            }
            Some((_, Act::Swap(target, dice))) => self.swap(fpga, target, dice),
            Some((_, Act::End(place))) => self.finish(fpga, place),
            None => {}
        }
    }

    fn drives(&mut self, fpga: &SimFpga, cause: ChangeCause) {
        let now = SimFpga::now(fpga);
        match cause {
            ChangeCause::Bite => self.journal.note(now, What::Bite),
            ChangeCause::Reset => self.journal.note(now, What::Reset),
            // While all is well the sender of a write is irrelevant.
            ChangeCause::Write if self.stage.lock().all_is_well != Some(true) => {
                self.journal.note(now, What::Written);
            }
            ChangeCause::Write => {}
        }
        let is_open = (0..fpga.firmware().pins.len()).any(|pin| fpga.is_driven(pin));
        if std::mem::replace(&mut self.is_open, is_open) != is_open {
            let what = if is_open { What::Opened } else { What::Closed };
            self.journal.note(now, what);
        }
        let driven = parts(fpga, &self.outputs);
        for (part, (seen, level)) in self.seen.iter_mut().zip(driven).enumerate() {
            if *seen != level {
                *seen = level;
                self.journal.note(now, What::Part(part, level));
            }
        }
    }
}
