//! Isolated inputs: InMux and InM, with their filters and MPG counters.

mod scanner;

use mesa_wire::bus::Direction;

use super::{Configuration, Settles, SimIoPorts, SimModule};
use crate::fpga::{Fabric, SimFirmware, SimPinDescriptor, gtag};
use crate::wire::Nanos;
use scanner::{MAX_INPUTS, Scanner};

const CONTROL: u8 = 0;
const FILTER: u8 = 1;
const FILTERED: u8 = 2;
const RAW: u8 = 3;
const MPG: u8 = 4;

/// The number of inputs of an instance, if a descriptor after the end of the list holds it: tags 1F
/// to 22 for InMux 0 to 3, and 24 to 27 for InM. FACTS 9.1.
fn width(firmware: &SimFirmware, multiplexed: bool, instance: u8) -> Option<usize> {
    let first = if multiplexed {
        gtag::IN_MUX_WIDTH
    } else {
        0x24
    };
    let tag = instance.checked_add(first)?;
    let mut hints = firmware.behind_end.iter().map(|(_, module)| module);
    let hint = hints.find(|hint| hint.gtag == tag && hint.instances == 0)?;
    Some(hint.multiple as usize)
}

/// Secondary pin of the first address line.
const FIRST_LINE: u8 = 0x81;
const MAX_ADDRESS_LINES: usize = 5;

const SECOND: u128 = 1_000_000_000;

/// An input module. FACTS 12.9, 13.6.
///
/// Opto-isolators in front of InMux pull its line low while current flows: without the global
/// invert bit, an input reads 1 while no current flows. LinuxCNC always sets that bit. InM keeps
/// the bit without any effect, and its inputs are 1 while current flows.
///
/// Inputs are scanned one after the other, the last first. A raw level reaches the filtered
/// register when the input's filter has counted up or down to its end, and the MPG counters count
/// on filtered inputs. After configuration every input reads 0 until its turn comes.
///
/// The simulation is exact to the clock, and its cost is proportional to the changes of the inputs.
#[derive(Clone, Debug)]
pub struct Inputs {
    multiplexed: bool,
    clock: u32,
    count: usize,
    /// Current at the terminals, one bit for each input.
    terminals: u32,
    scanner: Scanner,
    address: [Option<usize>; MAX_ADDRESS_LINES],
    /// Address bits that stay at 1 because their lines are not driven.
    stuck_address: usize,
}

impl SimModule for Inputs {
    fn read(&mut self, fabric: &Fabric, register: u8, instance: u8) -> u32 {
        let clocks = self.next_clock(fabric.now());
        self.run_to(clocks);
        match register {
            CONTROL => self.control(fabric.firmware(), instance),
            FILTER => self.scanner.long_filter,
            FILTERED => self.scanner.filtered(),
            RAW => self.scanner.raw(),
            MPG => u32::from_le_bytes(self.scanner.mpgs.map(|mpg| mpg.count)),
            _ => 0,
        }
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, _: u8, value: u32) {
        let clocks = self.next_clock(fabric.now()) + 1;
        self.run_to(clocks);
        match register {
            CONTROL => self.scanner.set_control(value),
            FILTER => self.scanner.long_filter = value & self.all(),
            MPG => {
                for (mpg, byte) in self.scanner.mpgs.iter_mut().zip(value.to_le_bytes()) {
                    mpg.times_four = byte & 1 != 0;
                }
            }
            _ => {}
        }
    }

    /// The current into the inputs stays.
    fn reload(&mut self, configuration: &Configuration<'_>) {
        let mut fresh = Self::new(configuration);
        for input in 0..self.count {
            fresh.set_terminal(configuration.now, input, self.terminal(input));
        }
        *self = fresh;
    }

    fn settles(&self, _: Direction) -> Settles {
        Settles::Signals
    }

    fn level(&self, now: Nanos, pin: SimPinDescriptor) -> bool {
        let line = pin.pin.checked_sub(FIRST_LINE);
        let line = line.filter(|_| self.multiplexed);
        line.is_none_or(|line| self.address_line(now, line))
    }

    /// Updates the stuck address lines: a line is driven only while its pin is set up for it.
    fn pins_changed(&mut self, now: Nanos, io: &SimIoPorts) {
        if !self.multiplexed {
            return;
        }
        let lines = self.address.iter().enumerate();
        let stuck = lines
            .filter(|(_, pin)| !io.module_drives(**pin))
            .fold(0, |stuck, (line, _)| stuck | 1 << line);
        if stuck != self.stuck_address {
            let clocks = self.next_clock(now);
            self.run_to(clocks);
            self.stuck_address = stuck;
        }
    }
}

impl Inputs {
    pub(super) fn new(configuration: &Configuration<'_>) -> Self {
        let Configuration {
            firmware, module, ..
        } = *configuration;
        let multiplexed = module.gtag == gtag::IN_MUX;
        let pin = |number: u8| firmware.pin(module.gtag, 0, number);
        let address = core::array::from_fn(|line| {
            let number = FIRST_LINE + line as u8;
            if multiplexed { pin(number) } else { None }
        });
        let count = if multiplexed {
            1 << address.iter().flatten().count()
        } else {
            (0x01..=0x20)
                .filter(|&number| pin(number).is_some())
                .count()
        };
        let count = width(firmware, multiplexed, 0).unwrap_or(count);
        let count = count.clamp(1, MAX_INPUTS);
        Self {
            multiplexed,
            clock: configuration.clock(),
            count,
            terminals: 0,
            scanner: Scanner::new(count, multiplexed),
            address,
            stuck_address: if multiplexed { usize::MAX } else { 0 },
        }
    }

    /// The control register of an instance: instances differ only in the number of their inputs.
    fn control(&self, firmware: &SimFirmware, instance: u8) -> u32 {
        const LAST_INPUT: u32 = 0x1F;
        let word = self.scanner.control();
        match width(firmware, self.multiplexed, instance) {
            Some(count) if instance > 0 => {
                word & !LAST_INPUT | (count.clamp(1, MAX_INPUTS) as u32 - 1)
            }
            _ => word,
        }
    }

    /// Number of inputs.
    pub fn count(&self) -> usize {
        self.count
    }

    /// True if current flows into an input.
    pub fn terminal(&self, input: usize) -> bool {
        input < MAX_INPUTS && self.terminals >> input & 1 != 0
    }

    /// Scans of the whole module per second.
    pub fn scan_rate(&self) -> f64 {
        f64::from(self.clock) / (self.scanner.slot_clocks() as f64 * self.count as f64)
    }

    /// The level of InMux's address line `line`, 0 to 4, at `now`.
    pub fn address_line(&self, now: Nanos, line: u8) -> bool {
        let passed = u128::from(now) * u128::from(self.clock) / SECOND;
        self.scanner.address_at(passed as u64 + 1) >> (line & 7) & 1 != 0
    }

    pub(crate) fn set_terminal(&mut self, now: Nanos, input: usize, on: bool) {
        if input < MAX_INPUTS && self.terminal(input) != on {
            let clocks = self.next_clock(now);
            self.run_to(clocks);
            self.terminals ^= 1 << input;
        }
    }

    /// Advances to `clocks` clocks in all.
    fn run_to(&mut self, clocks: u64) {
        let lines = self.lines();
        self.scanner.run_to(clocks, lines);
    }

    /// The levels that the module samples at its inputs.
    fn lines(&self) -> u32 {
        if !self.multiplexed {
            return self.terminals & self.all();
        }
        let lines = self.count.next_power_of_two();
        let selected = |input: usize| (input | self.stuck_address) & (lines - 1);
        (0..self.count).fold(0, |lines, input| {
            lines | u32::from(!self.terminal(selected(input))) << input
        })
    }

    fn all(&self) -> u32 {
        u32::MAX >> (MAX_INPUTS - self.count)
    }

    /// The number of the first clock edge that is not before `now`.
    fn next_clock(&self, now: Nanos) -> u64 {
        let clocks = u128::from(now) * u128::from(self.clock);
        clocks.div_ceil(SECOND) as u64
    }
}
