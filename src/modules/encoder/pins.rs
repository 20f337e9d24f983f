//! The pins of encoders, and their translation to commands and settings.

use super::command::EncoderCommand;
use super::registers::{bits, latch_timer, mux_skew};
use super::state::{EncoderConfig, EncoderRates, EncoderReading, EncoderState};
use crate::hal::{Counter, Input, Output, Param, PinError, PinMaker, PinStore, Place, Spec};
use crate::hostmot2::TickRate;
use crate::modules::ListenCycle;
use crate::modules::latch::LatchRequest;

/// The pins of one encoder: `hm2_7i92.0.encoder.00.count` and so on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct EncoderPins {
    /// Count, position, index and reset.
    pub counter: Counter,
    /// `rawcounts` at the last latch.
    pub rawlatch: Input<i32>,
    /// `count` at the last latch.
    pub count_latched: Input<i32>,
    /// `count-latched / scale`.
    pub position_latched: Input<f64>,
    /// `position`, and what the encoder has gone since its last count if its velocity is still that
    /// of before: less than a count. At standstill it is `position`.
    pub position_interpolated: Input<f64>,
    /// Units of position per second.
    pub velocity: Input<f64>,
    /// Units of position per minute.
    pub velocity_rpm: Input<f64>,
    /// While true, an index that `index-enable` has asked for latches the count as a probe does,
    /// and leaves `count` as it is.
    pub no_clear_on_index: Output<bool>,
    /// While true, each edge of the probe latches the count. In firmware without a probe nothing is
    /// latched, and each cycle in which the pin is true is counted as a refused value.
    pub probe_enable: Output<bool>,
    /// The rising edge of the probe latches, instead of the falling one.
    pub probe_invert: Output<bool>,
    /// A rising edge turns `count-unsure` off: the axis has been homed, whatever homed it.
    pub homed: Output<bool>,
    /// A quadrature sequence error was detected.
    pub quad_error: Input<bool>,
    /// Detects sequence errors; turning it off clears `quad-error`, and the error in the board.
    pub quad_error_enable: Output<bool>,
    /// The encoder turns at nine tenths or more of `max-count-rate`, beyond which counts are
    /// garbage and no error is indicated.
    pub near_max_count_rate: Input<bool>,
    /// Level of A.
    pub input_a: Input<bool>,
    /// Level of B.
    pub input_b: Input<bool>,
    /// Level of the index.
    pub input_index: Input<bool>,
    /// The index is taken at its rising edge, instead of its falling one.
    pub index_invert: Param<bool>,
    /// The index is taken only while the index mask is active.
    pub index_mask: Param<bool>,
    /// The index mask is active low.
    pub index_mask_invert: Param<bool>,
    /// Counts step and direction, instead of quadrature.
    pub counter_mode: Param<bool>,
    /// Filters over 15 samples instead of 3, which costs four fifths of `max-count-rate`. Initially
    /// off for multiplexed encoders, because only the short filter comes near to the rates in their
    /// manuals; on with [`Defaults::LinuxCnc`](crate::driver::Defaults::LinuxCnc).
    pub filter: Param<bool>,
    /// The highest count rate that can be followed, in counts per second, from sample frequency and
    /// filter.
    pub max_count_rate: Param<f64>,
    /// Seconds without a count after which velocity is 0: 0 to 3600.
    pub vel_timeout: Param<f64>,
}

/// The largest `vel-timeout`, in seconds.
const LONGEST_IDLE: f64 = 3600.0;

impl EncoderPins {
    /// Makes the pins, each at the terminals of its signal: `places` are those of A, B and index.
    /// Most pins belong to A and B together; pins without a signal have no terminal.
    pub(super) fn new(
        make: PinMaker<'_>,
        places: [Place; 3],
        has_filter: bool,
    ) -> Result<Self, PinError> {
        let [a, b, index] = places;
        let at = |place: &Place, name: &str| Spec {
            place: place.clone(),
            ..Spec::from(name)
        };
        let mut make = make.at([a.clone(), b.clone()].into_iter().collect());
        let mut pins = Self {
            counter: Counter {
                rawcounts: make.input("rawcounts")?,
                count: make.input("count")?,
                position: make.input("position")?,
                index_enable: make.inout(at(&index, "index-enable"))?,
                reset: make.switch("reset", false)?,
                scale: make.scale("scale", 1.0)?,
                counts_per_rev: None,
                count_unsure: Some(make.input("count-unsure")?),
            },
            rawlatch: make.input("rawlatch")?,
            count_latched: make.input("count-latched")?,
            position_latched: make.input("position-latched")?,
            position_interpolated: make.input("position-interpolated")?,
            velocity: make.input("velocity")?,
            velocity_rpm: make.input("velocity-rpm")?,
            quad_error: make.input("quad-error")?,
            quad_error_enable: make.switch("quad-error-enable", false)?,
            near_max_count_rate: make.input("near-max-count-rate")?,
            input_a: make.input(at(&a, "input-a"))?,
            input_b: make.input(at(&b, "input-b"))?,
            input_index: make.input(at(&index, "input-index"))?,
            no_clear_on_index: make.switch(at(&index, "no_clear_on_index"), false)?,
            index_invert: make.setting("index-invert", false)?,
            index_mask: make.setting("index-mask", false)?,
            index_mask_invert: make.setting("index-mask-invert", false)?,
            counter_mode: make.setting("counter-mode", false)?,
            filter: make.setting("filter", has_filter)?,
            max_count_rate: make.property("max-count-rate", 0.0)?,
            vel_timeout: make.setting(vel_timeout(), 0.5)?,
            ..Self::default()
        };
        let mut make = make.at(Place::default());
        pins.probe_enable = make.switch("probe-enable", false)?;
        pins.probe_invert = make.switch("probe-invert", false)?;
        pins.homed = make.switch("homed", false)?;
        Ok(pins)
    }

    /// The configuration that the parameters and `probe-invert` ask for.
    pub(super) fn config(&self, pins: &mut PinStore) -> EncoderConfig {
        // Despite the name, true means the rising edge: manual page hostmot2(9), `index-invert`
        // and `probe-invert`.
        let flags = [
            (self.counter_mode, bits::UP_DOWN),
            (self.filter, bits::FILTER),
            (self.index_invert, bits::INDEX_POLARITY),
            (self.index_mask, bits::USE_INDEX_MASK),
            (self.index_mask_invert, bits::INDEX_MASK_POLARITY),
        ];
        let mut mode = if pins.fetch(self.probe_invert) {
            bits::PROBE_POLARITY
        } else {
            0
        };
        for (param, bit) in flags {
            mode |= if pins.param(param) { bit } else { 0 };
        }
        EncoderConfig {
            mode,
            scale: pins.param(self.counter.scale),
            idle_time: pins.param(self.vel_timeout),
        }
    }

    /// The command that the pins ask for. A request for a probe that does not exist is not made: in
    /// the control register it would look as if it had happened at once (FACTS 12.5).
    pub(super) fn command(
        &self,
        pins: &mut PinStore,
        state: &mut EncoderState,
        has_probe: bool,
    ) -> EncoderCommand {
        state.config = self.config(pins);
        state.watches_errors = pins.fetch(self.quad_error_enable);
        state.index_keeps_count = pins.fetch(self.no_clear_on_index);
        state.is_awake = true;
        pins.publish(self.max_count_rate, state.max_count_rate());
        let probes = pins.fetch(self.probe_enable);
        let index = pins.fetch(self.counter.index_enable);
        let request = LatchRequest::of(index, probes && has_probe);
        EncoderCommand {
            reset: pins.fetch(self.counter.reset),
            homed: pins.fetch(self.homed),
            request,
            refuses_probe: probes && !has_probe,
        }
    }

    /// Shows the lines and the state of the counter.
    pub(super) fn listen(&self, cycle: &mut ListenCycle<'_>, control: u32) {
        for (pin, bit) in [
            (self.input_a, bits::A),
            (self.input_b, bits::B),
            (self.input_index, bits::INDEX),
            (self.quad_error, bits::QUADRATURE_ERROR),
        ] {
            cycle.show(pin, control & bit != 0);
        }
        cycle.show(
            self.counter.index_enable,
            control & bits::LATCH_ON_INDEX != 0,
        );
    }

    /// Publishes a reading. When the index was latched, `index-enable` goes off, unless the
    /// application has switched it on since the last write.
    pub(super) fn publish(&self, pins: &mut PinStore, reading: &EncoderReading) {
        pins.publish(self.counter.rawcounts, reading.rawcounts as i32);
        if let Some(pin) = self.counter.count_unsure {
            pins.publish(pin, reading.is_unsure);
        }
        pins.publish(self.counter.count, reading.count as i32);
        pins.publish(self.counter.position, reading.position);
        pins.publish(self.position_interpolated, reading.interpolated);
        pins.publish(self.velocity, reading.velocity);
        pins.publish(self.velocity_rpm, reading.velocity * 60.0);
        pins.publish(self.quad_error, reading.quadrature_error);
        if let Some(latched) = reading.latched {
            let zero = reading.rawcounts.wrapping_sub(reading.count);
            pins.publish(self.count_latched, latched as i32);
            pins.publish(self.rawlatch, latched.wrapping_add(zero) as i32);
            pins.publish(self.position_latched, latched as f64 / reading.scale);
        }
        let [a, b, index] = reading.inputs;
        pins.publish(self.near_max_count_rate, reading.is_near_max);
        pins.publish(self.input_a, a);
        pins.publish(self.input_b, b);
        pins.publish(self.input_index, index);
        if reading.index_came {
            pins.publish(self.counter.index_enable, false);
        }
    }
}

fn vel_timeout() -> Spec {
    Spec {
        unit: "s".into(),
        limits: Some((0.0, LONGEST_IDLE)),
        ..Spec::from("vel-timeout")
    }
}

/// The pins that all encoders share.
#[derive(Clone, Copy, Debug)]
pub(super) struct EncoderBankPins {
    pub sample_frequency: Output<u32>,
    pub muxed_skew: Option<Output<u32>>,
    pub hires_timestamp: Output<bool>,
    pub timer_number: Option<Output<i32>>,
}

/// The settings that all encoders share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CommonPins {
    /// Rate of the multiplexer or of the filters.
    pub rate: TickRate,
    /// Delay after the multiplex edge; part of the rate register.
    pub skew: u32,
    /// Rate of the time stamps.
    pub timestamps: TickRate,
    /// Word of the timer register: the source that latches the counts.
    pub timer: u32,
}

impl CommonPins {
    /// The rates of an encoder that is sampled `samples` times per tick of the rate.
    pub fn rates(&self, clock_hz: u32, samples: f64) -> EncoderRates {
        EncoderRates {
            tick_hz: self.timestamps.hz(clock_hz),
            sample_hz: self.rate.hz(clock_hz) * samples,
        }
    }
}

impl EncoderBankPins {
    /// Makes the pins; `muxed_version` is the module version of multiplexed encoders, `None` for
    /// others.
    pub(super) fn new(
        mut make: PinMaker<'_>,
        sample_hz: u32,
        muxed_version: Option<u8>,
        has_timer: bool,
    ) -> Result<Self, PinError> {
        let name = match muxed_version {
            Some(_) => "muxed-sample-frequency",
            None => "sample-frequency",
        };
        let has_skew = muxed_version == Some(4);
        Ok(Self {
            sample_frequency: make.switch(name, sample_hz)?,
            muxed_skew: has_skew.then(|| make.switch("muxed-skew", 0)).transpose()?,
            hires_timestamp: make.switch("hires-timestamp", false)?,
            timer_number: has_timer
                .then(|| make.switch("timer-number", -1))
                .transpose()?,
        })
    }

    /// The settings that the pins ask for. `usual` is the rate of the set-up, which its rounded
    /// frequency need not lead back to.
    pub(super) fn common(&self, pins: &mut PinStore, clock_hz: u32, usual: TickRate) -> CommonPins {
        let sample_hz = pins.fetch(self.sample_frequency);
        let is_usual = sample_hz == usual.hz(clock_hz) as u32;
        // Microseconds wrap after 65 ms; fine time stamps after 6.5 ms.
        let is_fine = pins.fetch(self.hires_timestamp);
        let timestamp_hz = if is_fine { 10_000_000 } else { 1_000_000 };
        CommonPins {
            rate: if is_usual {
                usual
            } else {
                TickRate::for_hz(clock_hz, sample_hz)
            },
            skew: self
                .muxed_skew
                .map_or(0, |skew| mux_skew(clock_hz, pins.fetch(skew))),
            timestamps: TickRate::for_hz(clock_hz, timestamp_hz),
            timer: self
                .timer_number
                .map_or(0, |timer| latch_timer(pins.fetch(timer))),
        }
    }
}
