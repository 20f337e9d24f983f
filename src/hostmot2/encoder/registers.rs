//! Addresses and layouts of the encoder registers.

use crate::bus::RegisterBus;
use crate::hostmot2::io_port::WriteList;
use crate::hostmot2::{Gtag, HostMot2, LocateError, ModuleDescriptor, ModuleError, RegisterBlock};
pub use crate::modules::encoder::registers::{
    ControlWord, CountWord, EncoderConfig, LatchTimer, MuxSkew, TickRate,
};

/// The registers of all encoders of a kind.
///
/// Source: REGISTERS.md, "Encoder / muxed encoder"; FACTS 9.4, 9.5.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoders {
    /// Read: [`CountWord`]. Written: clears the count.
    pub count: RegisterBlock,
    /// [`ControlWord`].
    pub control: RegisterBlock,
    /// Rate of the time stamps, one for all: a [`TickRate`].
    pub timestamp_divider: u16,
    /// The time stamp counter, one for all, in its low 16 bits.
    pub timestamp: u16,
    /// Rate of the multiplexer, or of the filters, one for all: a [`TickRate`]; of multiplexed
    /// encoders of version 4 also [`MuxSkew`].
    pub rate: u16,
    /// Which timer of the DPLL latches the counts, one for all: a [`LatchTimer`]. Descriptors do
    /// not count it; firmware without it ignores what is written there. `None` if it would lie
    /// outside of the address space.
    pub timer: Option<u16>,
    gtag: Gtag,
    version: u8,
    has_probe: bool,
    clock_hz: u32,
}

impl Encoders {
    /// Set in the version of multiplexed encoders that have a probe.
    const WITH_PROBE: u8 = 0x80;
    /// Secondary pin of the probe.
    const PROBE_PIN: u8 = 0x05;
    const REGISTERS: u8 = 5;
    const MULTIPLE: u32 = 0x3;

    /// The encoders of a firmware, `gtag` being [`Gtag::ENCODER`] or [`Gtag::MUXED_ENCODER`].
    ///
    /// # Errors
    /// If the firmware has none, or none of a version that is known: 2 and 3, multiplexed ones 2
    /// to 4, and 0x82 to 0x84 with a probe.
    pub fn locate(firmware: &HostMot2, gtag: Gtag) -> Result<Self, LocateError> {
        let module = firmware.require(gtag)?;
        let mut pins = firmware.pins().iter();
        let has_pin = pins.any(|pin| pin.secondary == gtag && pin.secondary_pin == Self::PROBE_PIN);
        Ok(Self::new(module, has_pin)?)
    }

    fn new(module: &ModuleDescriptor, has_probe_pin: bool) -> Result<Self, ModuleError> {
        module.expect(
            &[Gtag::MUXED_ENCODER, Gtag::ENCODER],
            Self::REGISTERS,
            Self::MULTIPLE,
        )?;
        let is_muxed = module.gtag == Gtag::MUXED_ENCODER;
        let newest = if is_muxed { 4 } else { 3 };
        let probe = if is_muxed {
            module.version & Self::WITH_PROBE
        } else {
            0
        };
        let version = module.version & !probe;
        if !(2..=newest).contains(&version) {
            return Err(ModuleError::UnknownVersion {
                gtag: module.gtag,
                version: module.version,
                oldest: 2,
                newest,
            });
        }
        let rate = module.block(4)?.first();
        Ok(Self {
            count: module.block(0)?,
            control: module.block(1)?,
            timestamp_divider: module.block(2)?.first(),
            timestamp: module.block(3)?.first(),
            rate,
            timer: rate.checked_add(module.register_stride),
            gtag: module.gtag,
            version,
            has_probe: has_probe_pin || probe != 0,
            clock_hz: module.clock_hz,
        })
    }

    /// Number of encoders.
    pub const fn instances(&self) -> u8 {
        self.count.count()
    }

    /// Whether they share pins.
    pub fn is_muxed(&self) -> bool {
        self.gtag == Gtag::MUXED_ENCODER
    }

    /// Whether the sample can be delayed: [`MuxSkew`].
    pub fn has_skew(&self) -> bool {
        self.is_muxed() && self.version == 4
    }

    /// Whether time stamps are wrong in this version, so that velocities would be: version 2 of
    /// the multiplexed encoder (FACTS 9.5).
    pub fn has_unreliable_velocity(&self) -> bool {
        self.is_muxed() && self.version == 2
    }

    /// The clock that the rates divide, in Hz.
    pub const fn clock_hz(&self) -> u32 {
        self.clock_hz
    }

    /// Whether the firmware has a probe input. Without it nothing is ever latched on a probe, and
    /// its bits of the control register read 0 whatever was written (FACTS 12.5).
    pub const fn has_probe(&self) -> bool {
        self.has_probe
    }

    /// The version without the mark of a probe.
    pub const fn version(&self) -> u8 {
        self.version
    }

    /// The most counts in a second that are followed at this rate of multiplexer or filters: each
    /// level of A and B lasts for two counts, and has to last for as many samples as the filter is
    /// long. For multiplexed encoders that is clock / (3 (n + 2)), or clock / (15 (n + 2)) with the
    /// long filter. Beyond it counts are garbage, and no error tells (FACTS 12.6).
    pub fn max_count_rate(&self, rate: TickRate, long_filter: bool) -> f64 {
        rate.max_count_rate(self.clock_hz, self.is_muxed(), long_filter)
    }

    /// How often a second each encoder is sampled at this rate of multiplexer or filters.
    pub fn sample_rate(&self, rate: TickRate) -> f64 {
        rate.sample_rate(self.clock_hz, self.is_muxed())
    }

    /// Sets all encoders up, in one exchange: time-stamp rate, multiplexer or filter rate, and
    /// the control words. Counts are cleared. Instances beyond `configs` are left alone.
    ///
    /// # Real time
    /// For set-up: allocates.
    pub fn set_up<B: RegisterBus>(
        &self,
        bus: &mut B,
        timestamps: TickRate,
        rate: TickRate,
        configs: &[EncoderConfig],
    ) -> Result<(), B::Error> {
        let mut list = WriteList::default();
        list.push(self.timestamp_divider, timestamps.0);
        list.push(self.rate, rate.0);
        for (config, address) in configs.iter().zip(self.control.addresses()) {
            list.push(address, config.control().0);
        }
        for (_, address) in configs.iter().zip(self.count.addresses()) {
            list.push(address, 0);
        }
        list.run(bus)
    }
}
