//! Encoders of the FPGA.

use alloc::format;

use super::Maker;
use crate::boards::Terminal;
use crate::hal::{GroupId, InOut, Input, Output, Param, PinError, PinStore, Rejection};
use crate::hostmot2::{Encoder, EncoderConfig, EncoderReading, EncoderSample, LatchRequest};

/// The pins of one encoder: `hm2_7i92.0.encoder.00.count` and so on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderPins {
    /// Counts since the start.
    pub rawcounts: Input<i32>,
    /// `rawcounts` at the last latch.
    pub rawlatch: Input<i32>,
    /// Counts since the last reset or index.
    pub count: Input<i32>,
    /// `count` at the last latch.
    pub count_latched: Input<i32>,
    /// `count / scale`.
    pub position: Input<f64>,
    /// `count-latched / scale`.
    pub position_latched: Input<f64>,
    /// Units of position per second.
    pub velocity: Input<f64>,
    /// Units of position per minute.
    pub velocity_rpm: Input<f64>,
    /// Keeps `count` at 0.
    pub reset: Output<bool>,
    /// Asks for `count` to become 0 at the index; turned off when that happened.
    pub index_enable: InOut<bool>,
    /// While on, each edge of the probe latches the count. Where the firmware has no probe, nothing
    /// is latched, and each cycle in which it is on is counted as a refused value.
    pub probe_enable: Output<bool>,
    /// The probe's rising edge counts, and not the falling one.
    pub probe_invert: Output<bool>,
    /// A quadrature sequence error was seen.
    pub quad_error: Input<bool>,
    /// The board was not heard for so long that the encoder may have turned further than its
    /// counter tells: `count` may be wrong by multiples of 65536. On until `reset` or index.
    pub count_unsure: Input<bool>,
    /// Watches for sequence errors; turning it off clears `quad-error`, and the error in the board.
    pub quad_error_enable: Output<bool>,
    /// The encoder turns at nine tenths or more of `max-count-rate`, beyond which counts are garbage
    /// and no error tells.
    pub near_max_count_rate: Input<bool>,
    /// A now.
    pub input_a: Input<bool>,
    /// B now.
    pub input_b: Input<bool>,
    /// Index now.
    pub input_index: Input<bool>,
    /// Counts for one unit of position. 0 is refused: it becomes 1, and is counted.
    pub scale: Param<f64>,
    /// The index counts at its rising edge, and not at its falling one.
    pub index_invert: Param<bool>,
    /// The index counts only while the index mask is active.
    pub index_mask: Param<bool>,
    /// The index mask is active low.
    pub index_mask_invert: Param<bool>,
    /// Step and direction, and not quadrature.
    pub counter_mode: Param<bool>,
    /// 15 samples of filter, and not 3, which costs four fifths of `max-count-rate`. The driver
    /// switches it off at first on multiplexed encoders, whose manuals promise rates that only the
    /// short filter comes near to; LinuxCNC has it on.
    pub filter: Param<bool>,
    /// The most counts in a second that are followed, by sample frequency and filter. It is told and
    /// can not be set.
    pub max_count_rate: Param<f64>,
    /// Seconds without a count after which velocity is 0.
    pub vel_timeout: Param<f64>,
}

impl EncoderPins {
    /// Makes the pins of encoder `number`, at these terminals.
    ///
    /// # Errors
    /// For names that are taken.
    pub fn new(
        pins: &mut PinStore,
        group: GroupId,
        board: &str,
        number: usize,
        terminals: &[Terminal],
    ) -> Result<Self, PinError> {
        let stem = format!("{board}.encoder.{number:02}.");
        let mut make = Maker::new(pins, group, stem).at(terminals);
        Ok(Self {
            rawcounts: make.input("rawcounts")?,
            rawlatch: make.input("rawlatch")?,
            count: make.input("count")?,
            count_latched: make.input("count-latched")?,
            position: make.input("position")?,
            position_latched: make.input("position-latched")?,
            velocity: make.input("velocity")?,
            velocity_rpm: make.input("velocity-rpm")?,
            reset: make.switch("reset", false)?,
            index_enable: make.inout("index-enable")?,
            probe_enable: make.switch("probe-enable", false)?,
            probe_invert: make.switch("probe-invert", false)?,
            quad_error: make.input("quad-error")?,
            count_unsure: make.input("count-unsure")?,
            quad_error_enable: make.switch("quad-error-enable", false)?,
            near_max_count_rate: make.input("near-max-count-rate")?,
            input_a: make.input("input-a")?,
            input_b: make.input("input-b")?,
            input_index: make.input("input-index")?,
            scale: make.setting("scale", 1.0)?,
            index_invert: make.setting("index-invert", false)?,
            index_mask: make.setting("index-mask", false)?,
            index_mask_invert: make.setting("index-mask-invert", false)?,
            counter_mode: make.setting("counter-mode", false)?,
            filter: make.setting("filter", true)?,
            max_count_rate: make.property("max-count-rate", 0.0)?,
            vel_timeout: make.setting("vel-timeout", 0.5)?,
        })
    }

    /// How the encoder is to count, by its parameters.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn config(&self, pins: &mut PinStore) -> EncoderConfig {
        EncoderConfig {
            scale: pins.param(self.scale),
            up_down: pins.param(self.counter_mode),
            filter: pins.param(self.filter),
            // Despite the name, true means the rising edge: manual page hostmot2(9), `index-invert`
            // and `probe-invert`.
            index_high: pins.param(self.index_invert),
            index_mask: pins.param(self.index_mask),
            index_mask_invert: pins.param(self.index_mask_invert),
            gate_index: false,
            probe_high: pins.fetch(self.probe_invert),
            idle_time: pins.param(self.vel_timeout),
        }
    }

    /// Before a write: what the pins ask of the encoder.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn command(&self, pins: &mut PinStore, encoder: &mut Encoder) {
        self.refuse(pins, encoder.has_probe());
        encoder.set_config(self.config(pins));
        pins.publish(self.max_count_rate, encoder.max_count_rate());
        if pins.fetch(self.reset) {
            encoder.reset();
        }
        if !pins.fetch(self.quad_error_enable) {
            encoder.clear_quadrature_error();
        }
        let request = if pins.fetch(self.index_enable) {
            LatchRequest::Index
        } else if pins.fetch(self.probe_enable) {
            LatchRequest::Probe
        } else {
            LatchRequest::None
        };
        encoder.request(request);
    }

    /// Counts what can not be done: a scale of 0, which becomes 1 as in LinuxCNC, and a probe that
    /// the firmware does not have.
    fn refuse(&self, pins: &mut PinStore, has_probe: bool) {
        if pins.param(self.scale) == 0.0 {
            pins.count_rejection(self.scale, Rejection::OutOfRange);
            pins.publish(self.scale, 1.0);
        }
        if !has_probe && pins.fetch(self.probe_enable) {
            pins.count_rejection(self.probe_enable, Rejection::OutOfRange);
        }
    }

    /// After a read: lets the encoder take its sample, and shows what it says. When an index that
    /// the encoder was asked for came, `index-enable` goes off; one that the application has
    /// switched on since the last write stays.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn take(&self, pins: &mut PinStore, encoder: &mut Encoder, sample: EncoderSample) {
        let before = encoder.requested();
        let reading = encoder.read(sample);
        let index_came =
            before == LatchRequest::Index && encoder.requested() != LatchRequest::Index;
        self.publish(pins, &reading, index_came);
    }

    fn publish(&self, pins: &mut PinStore, reading: &EncoderReading, index_came: bool) {
        let scale = self.config(pins).usable_scale();
        pins.publish(self.rawcounts, reading.rawcounts as i32);
        pins.publish(self.count_unsure, reading.is_unsure);
        pins.publish(self.count, reading.count as i32);
        pins.publish(self.position, reading.position);
        pins.publish(self.velocity, reading.velocity);
        pins.publish(self.velocity_rpm, reading.velocity * 60.0);
        if let Some(latched) = reading.latched {
            let zero = reading.rawcounts.wrapping_sub(reading.count);
            pins.publish(self.count_latched, latched as i32);
            pins.publish(self.rawlatch, latched.wrapping_add(zero) as i32);
            pins.publish(self.position_latched, latched as f64 / scale);
        }
        let watched = pins.fetch(self.quad_error_enable);
        let before = pins.read(self.quad_error).value;
        pins.publish(
            self.quad_error,
            watched && (before || reading.quadrature_error),
        );
        let [a, b, index] = reading.inputs;
        pins.publish(self.near_max_count_rate, reading.is_near_max);
        pins.publish(self.input_a, a);
        pins.publish(self.input_b, b);
        pins.publish(self.input_index, index);
        if index_came {
            pins.publish(self.index_enable, false);
        }
    }
}

/// The pins of all encoders together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderBankPins {
    /// Rate at which the inputs are sampled, in Hz; for muxed encoders the multiplex rate, twice
    /// what each of them is sampled at. What the clock can not be divided to becomes the next lower
    /// rate.
    pub sample_frequency: Output<u32>,
    /// Delay of the sample after the multiplex edge in ns, of muxed encoders of version 4; as many
    /// periods of the clock as are nearest, at most 15.
    pub muxed_skew: Option<Output<u32>>,
    /// Time stamps of about 10 MHz, and not 1 MHz: for frequencies, and periods up to 1 ms.
    /// Velocities begin anew when this changes.
    pub hires_timestamp: Output<bool>,
    /// What latches the counts: 0 the DPLL's reference, 1 to 4 its timers, -1 nothing. Only with a
    /// DPLL.
    pub timer_number: Option<Output<i32>>,
}

impl EncoderBankPins {
    /// Makes the pins of all encoders of a module, which samples at `sample_hz`. `muxed_version` is
    /// that of multiplexed ones.
    pub fn new(
        pins: &mut PinStore,
        group: GroupId,
        board: &str,
        sample_hz: u32,
        muxed_version: Option<u8>,
        dpll: bool,
    ) -> Result<Self, PinError> {
        let mut make = Maker::new(pins, group, format!("{board}.encoder."));
        let name = match muxed_version {
            Some(_) => "muxed-sample-frequency",
            None => "sample-frequency",
        };
        Ok(Self {
            sample_frequency: make.switch(name, sample_hz)?,
            muxed_skew: (muxed_version == Some(4))
                .then(|| make.switch("muxed-skew", 0))
                .transpose()?,
            hires_timestamp: make.switch("hires-timestamp", false)?,
            timer_number: dpll.then(|| make.switch("timer-number", -1)).transpose()?,
        })
    }
}
