//! Field power and the output driver chips that it supplies.

use super::WorldError;
use mesa_wire::lbp::RemoteFaults;

/// Outputs of one driver chip.
const OUTPUTS_OF_CHIP: usize = 8;

/// The field supply of a card.
///
/// Manual: 7I77, "VIN AND FIELD POWER SUPPLY": 5 to 32 V; a voltage outside this range causes a
/// fault. VIN, which supplies the card's processor, needs 8 V; it may be connected to field power
/// or be separate.
#[derive(Clone, Copy, Debug)]
pub(super) struct FieldPower {
    pub(super) volts: f64,
    pub(super) separate_vin: bool,
}

impl FieldPower {
    pub(super) const fn new() -> Self {
        Self {
            volts: 24.0,
            separate_vin: true,
        }
    }

    pub(super) fn supplies_processor(self) -> bool {
        self.separate_vin || self.volts >= 8.0
    }

    pub(super) fn faults(self) -> RemoteFaults {
        if self.volts < 5.0 {
            RemoteFaults::LOW_VOLTAGE
        } else if self.volts > 32.0 {
            RemoteFaults::HIGH_VOLTAGE
        } else {
            RemoteFaults::empty()
        }
    }
}

/// The switches that each output uses, as masks: to field power, and to ground.
///
/// Manual: 7I76EU, "OUTPUT TRUTH TABLE": with both an output is push-pull, with none it is off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Switches {
    pub(super) source: u64,
    pub(super) sink: u64,
}

impl Switches {
    pub(super) const SOURCING: Self = Self {
        source: u64::MAX,
        sink: 0,
    };
    pub(super) const SINKING: Self = Self {
        source: 0,
        sink: u64::MAX,
    };

    /// True if an output with these switches is at field power while it is `on` or off: its load
    /// goes to ground if it has the switch to field power, else to field power.
    pub(super) const fn is_high(self, n: usize, on: bool) -> bool {
        if self.source >> n & 1 != 0 {
            on
        } else {
            self.sink >> n & 1 != 0 && !on
        }
    }

    /// True if an output with these switches lets current through its load while it is on.
    pub(super) const fn conducts(self, n: usize) -> bool {
        (self.source | self.sink) >> n & 1 != 0
    }
}

/// Field outputs with their protection.
///
/// Manual: 7I77, "SHORT CIRCUIT PROTECTION", "OVER-TEMPERATURE PROTECTION": a shorted output, and a
/// chip that is too hot, is switched off, and a fault is set.
#[derive(Clone, Debug)]
pub(super) struct Drivers {
    count: usize,
    commanded: u64,
    shorted: u64,
    tripped: u64,
    hot: u64,
}

impl Drivers {
    pub(super) const fn new(count: usize) -> Self {
        Self {
            count,
            commanded: 0,
            shorted: 0,
            tripped: 0,
            hot: 0,
        }
    }

    pub(super) const fn count(&self) -> usize {
        self.count
    }

    pub(super) const fn command(&mut self, outputs: u64) {
        self.commanded = outputs;
        self.trip();
    }

    pub(super) const fn off(&mut self) {
        self.commanded = 0;
    }

    pub(super) const fn faults_cleared(&mut self) {
        self.tripped = 0;
    }

    /// Trips outputs that are both on and shorted.
    const fn trip(&mut self) {
        self.tripped |= self.commanded & self.shorted;
    }

    pub(super) fn set_shorted(&mut self, n: usize, shorted: bool) -> Result<(), WorldError> {
        let bit = self.bit(n)?;
        self.shorted = if shorted {
            self.shorted | bit
        } else {
            self.shorted & !bit
        };
        self.trip();
        Ok(())
    }

    pub(super) fn set_hot(&mut self, n: usize, hot: bool) -> Result<(), WorldError> {
        self.bit(n)?;
        let chip = 0xFF << (n / OUTPUTS_OF_CHIP * OUTPUTS_OF_CHIP);
        self.hot = if hot {
            self.hot | chip
        } else {
            self.hot & !chip
        };
        Ok(())
    }

    pub(super) fn faults(&self) -> RemoteFaults {
        let mut faults = RemoteFaults::empty();
        faults.set(RemoteFaults::OVER_CURRENT, self.tripped != 0);
        faults.set(RemoteFaults::OVER_TEMPERATURE, self.hot != 0);
        faults
    }

    /// True if output `n` is on: its switch conducts, protection considered.
    pub(super) fn is_on(&self, n: usize) -> Option<bool> {
        let bit = self.bit(n).ok()?;
        Some(self.commanded & !self.tripped & !self.hot & bit != 0)
    }

    fn bit(&self, index: usize) -> Result<u64, WorldError> {
        if index < self.count {
            Ok(1 << index)
        } else {
            Err(WorldError::NoSuchOutput {
                index,
                count: self.count,
            })
        }
    }
}
