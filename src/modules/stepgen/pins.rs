//! The pins of step generators, and what their parameters ask for.

use super::firmware::{Firmware, SWAP};
use super::latch::bits;
use super::timing::{PulseTicks, PulseTimes};
use crate::hal::{Axis, InOut, Input, InputRow, Output, Param, PinError, PinMaker, PinStore, Spec};
use crate::modules::latch::LatchRequest;

/// The pins of one generator: `hm2_7i92.0.stepgen.00.position-cmd` and so on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct StepgenPins {
    /// The commanded position, in units of `position-scale` steps. A value that is not finite is
    /// counted, and the command of before stays. After a fault the command is the position of the
    /// generator, so that nothing moves when it is enabled again.
    pub position_cmd: Output<f64>,
    /// The commanded speed, in units per second, with `control-type` true.
    pub velocity_cmd: Output<f64>,
    /// The position: the steps that went out, with the fraction of the next one.
    pub position_fb: Input<f64>,
    /// The speed that was written last, in units per second; not measured.
    pub velocity_fb: Input<f64>,
    /// Whole steps, rounded down.
    pub counts: Input<i32>,
    /// While false, the generator stands still: at once, or along `maxaccel` with `disable-ramp`.
    pub enable: Output<bool>,
    /// False for positions, true for speeds.
    pub control_type: Output<bool>,
    /// While true, `position-fb` is 0 after each read.
    pub position_reset: Output<bool>,
    /// A rising edge turns `position-unsure` off: the axis has been homed, whatever homed it.
    pub homed: Output<bool>,
    /// The motor may stand elsewhere: the board was set up again after a bite of its watchdog or a
    /// reset; or too much time passed between two reads; or a packet was lost, late or repeated
    /// while it moved, within 100 reads of such a set-up or of a change of its pulses; or its
    /// accumulator did not follow its rate. Kept until the next `position-reset`, index, or rising
    /// edge of `homed`.
    pub position_unsure: Input<bool>,
    /// The generator has nine tenths or more of the highest rate that `steplen` and `stepspace`
    /// allow. Beyond that rate the gateware loses no step: the position lags.
    pub near_max_rate: Input<bool>,
    /// Distance of `position-fb` behind the command of the period before, in units: 0 for a command
    /// that the limits allow, but for what the time from read to write costs. 0 with `control-type`
    /// true, or `enable` false.
    pub position_lag: Input<f64>,
    /// The position at the last edge of the probe. Only in version C2, as the next four pins.
    pub position_latch: Option<Input<f64>>,
    /// Set to true: at the next edge of the index the position becomes 0 there, and the pin false.
    pub index_enable: Option<InOut<bool>>,
    /// Set to true: at the next edge of the probe the position is latched, and the pin becomes
    /// false.
    pub probe_enable: Option<InOut<bool>>,
    /// The index is taken at its rising edge, instead of its falling one.
    pub index_invert: Option<Output<bool>>,
    /// The probe is taken at its rising edge, instead of its falling one.
    pub probe_invert: Option<Output<bool>>,
    /// Steps for one unit of position; may be negative.
    pub position_scale: Param<f64>,
    /// The highest speed in units per second; 0 for the highest that the gateware can make. The
    /// sign has no meaning.
    pub maxvel: Param<f64>,
    /// The acceleration in units per second squared; 0 for no limit. The sign has no meaning.
    pub maxaccel: Param<f64>,
    /// Length of a pulse in ns. This and the other parameters of the pulses take effect when the
    /// generator rests.
    pub steplen: Param<u32>,
    /// Least time between two pulses in ns.
    pub stepspace: Param<u32>,
    /// Least time from a change of the direction to the next pulse in ns.
    pub dirsetup: Param<u32>,
    /// Least time from the end of a pulse to a change of the direction in ns.
    pub dirhold: Param<u32>,
    /// 0: step and direction; 1: up and down; 2: quadrature; 3 to 16: a table of that length, only
    /// in firmware with pins for one.
    pub step_type: Param<u32>,
    /// Exchanges the two outputs. Only in versions 42 and C2.
    pub swap_step_dir: Option<Param<bool>>,
    /// The outputs of a table, four entries each, the lowest byte first. Only in firmware with pins
    /// for them.
    pub table_data: Option<[Param<u32>; 4]>,
    /// With `enable` false, brake along `maxaccel`; else stop at once, as LinuxCNC.
    pub disable_ramp: Param<bool>,
    pub(super) debug: DebugPins,
}

/// Values of the control law, with the names of LinuxCNC.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct DebugPins {
    /// The speed of the command.
    pub ff_vel: Input<f64>,
    /// The position less the command of the period before.
    pub pos_minus_prev_cmd: Input<f64>,
    /// Time to reach the speed of the command.
    pub s_to_match: Input<f64>,
    /// The speed of the generator less that of the command.
    pub vel_error: Input<f64>,
    /// The distance that this time adds to that from the command.
    pub err_at_match: Input<f64>,
    /// The rate register.
    pub step_rate: Input<i32>,
}

/// The inputs of a generator that are published together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows {
    /// `position-fb`, `counts`, `position-unsure`.
    pub read: InputRow<3>,
    /// `velocity-fb`, `near-max-rate`, `position-lag`, `dbg_step_rate`.
    pub written: InputRow<4>,
    /// `dbg_ff_vel`, `dbg_pos_minus_prev_cmd`, `dbg_s_to_match`, `dbg_vel_error`,
    /// `dbg_err_at_match`.
    pub debug: InputRow<5>,
}

impl Rows {
    pub fn of(pins: &StepgenPins, store: &PinStore) -> Result<Self, PinError> {
        let debug = &pins.debug;
        Ok(Self {
            read: store.input_row([
                pins.position_fb.into(),
                pins.counts.into(),
                pins.position_unsure.into(),
            ])?,
            written: store.input_row([
                pins.velocity_fb.into(),
                pins.near_max_rate.into(),
                pins.position_lag.into(),
                debug.step_rate.into(),
            ])?,
            debug: store.input_row([
                debug.ff_vel.into(),
                debug.pos_minus_prev_cmd.into(),
                debug.s_to_match.into(),
                debug.vel_error.into(),
                debug.err_at_match.into(),
            ])?,
        })
    }
}

/// The switches of a generator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a pin")]
pub(super) struct Switches {
    /// `enable`.
    pub is_on: bool,
    /// `control-type`.
    pub by_speed: bool,
    /// `position-reset`.
    pub resets: bool,
    /// `homed`.
    pub is_homed: bool,
    pub request: LatchRequest,
    /// The bits of the edges for the MODE register.
    pub edges: u32,
}

/// The type of a table.
const TABLE: u32 = 3;

/// Everything about the pulses that changes only at rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PulseSetup {
    pub ticks: PulseTicks,
    /// The MODE register, without the latch.
    pub mode: u32,
    /// The entries of the table.
    pub table: [u8; 16],
    /// The last entry in use.
    pub table_max: u32,
}

impl PulseSetup {
    /// True if the outputs follow the table.
    pub(super) const fn is_table(&self) -> bool {
        self.mode & TABLE == TABLE
    }
}

impl StepgenPins {
    /// The generator as an axis that follows speeds: in units per second, with `position_scale` as
    /// the steps for one unit. It never changes its speed by more than `maxaccel` allows.
    pub const fn axis(&self) -> Axis {
        Axis::steps(
            [self.enable, self.control_type, self.position_reset],
            self.velocity_cmd,
            self.position_fb,
            self.position_unsure,
            self.index_enable,
        )
    }

    /// Makes the pins; the parameters belong to `settings`.
    pub(super) fn new(mut make: PinMaker<'_>, firmware: Firmware) -> Result<Self, PinError> {
        let mut pins = Self {
            position_cmd: make.output("position-cmd", 0.0)?,
            velocity_cmd: make.output("velocity-cmd", 0.0)?,
            // In the order of the rows.
            position_fb: make.input("position-fb")?,
            counts: make.input("counts")?,
            position_unsure: make.input("position-unsure")?,
            velocity_fb: make.input("velocity-fb")?,
            near_max_rate: make.input("near-max-rate")?,
            position_lag: make.input("position-lag")?,
            debug: DebugPins {
                step_rate: make.input("dbg_step_rate")?,
                ff_vel: make.input("dbg_ff_vel")?,
                pos_minus_prev_cmd: make.input("dbg_pos_minus_prev_cmd")?,
                s_to_match: make.input("dbg_s_to_match")?,
                vel_error: make.input("dbg_vel_error")?,
                err_at_match: make.input("dbg_err_at_match")?,
            },
            ..Self::default()
        };
        if firmware.has_latch {
            pins.position_latch = Some(make.input("position-latch")?);
        }
        Ok(pins)
    }

    /// Makes parameters and switches except `enable`, in a part of their own, so that only their
    /// changes are looked at.
    pub(super) fn add_parameters(
        &mut self,
        mut make: PinMaker<'_>,
        firmware: Firmware,
    ) -> Result<(), PinError> {
        let longest = PulseTimes::longest(firmware.clock_hz);
        let time = |name: &str| Spec {
            unit: "ns".into(),
            ..Spec::from(name)
        };
        self.control_type = make.switch("control-type", false)?;
        self.position_reset = make.switch("position-reset", false)?;
        self.homed = make.switch("homed", false)?;
        if firmware.has_latch {
            self.index_enable = Some(make.inout("index-enable")?);
            self.probe_enable = Some(make.inout("probe-enable")?);
            self.index_invert = Some(make.switch("index-invert", false)?);
            self.probe_invert = Some(make.switch("probe-invert", false)?);
        }
        self.position_scale = make.scale("position-scale", 1.0)?;
        self.maxvel = make.setting("maxvel", 0.0)?;
        self.maxaccel = make.setting("maxaccel", 1.0)?;
        self.steplen = make.setting(time("steplen"), longest)?;
        self.stepspace = make.setting(time("stepspace"), longest)?;
        self.dirsetup = make.setting(time("dirsetup"), longest)?;
        self.dirhold = make.setting(time("dirhold"), longest)?;
        // Without outputs for a table there is none, and the motor would not turn.
        let last = if firmware.has_table { 16.0 } else { 2.0 };
        let step_type = Spec {
            limits: Some((0.0, last)),
            ..Spec::from("step_type")
        };
        self.step_type = make.setting(step_type, 0)?;
        self.disable_ramp = make.setting("disable-ramp", false)?;
        if firmware.has_swap {
            self.swap_step_dir = Some(make.setting("swap_step_dir", false)?);
        }
        if firmware.has_table {
            let mut table = [Param::default(); 4];
            for (number, param) in (0..).zip(&mut table) {
                *param = make.setting(alloc::format!("table-data-{number}"), 0)?;
            }
            self.table_data = Some(table);
        }
        Ok(())
    }

    /// The switches as they are now.
    pub(super) fn switches(&self, pins: &mut PinStore) -> Switches {
        let mut fetch = |pin: Option<Output<bool>>| pin.is_some_and(|pin| pins.fetch(pin));
        let index = fetch(self.index_enable.map(InOut::as_output));
        let probe = fetch(self.probe_enable.map(InOut::as_output));
        let request = LatchRequest::of(index, probe);
        let edge = |rises: bool, bit| if rises { bit } else { 0 };
        Switches {
            is_on: fetch(Some(self.enable)),
            by_speed: fetch(Some(self.control_type)),
            resets: fetch(Some(self.position_reset)),
            is_homed: fetch(Some(self.homed)),
            request,
            edges: edge(fetch(self.index_invert), bits::INDEX_RISES)
                | edge(fetch(self.probe_invert), bits::PROBE_RISES),
        }
    }

    /// The times that the parameters ask for.
    pub(super) fn times(&self, pins: &PinStore) -> PulseTimes {
        PulseTimes {
            step_len: pins.param(self.steplen),
            step_space: pins.param(self.stepspace),
            dir_setup: pins.param(self.dirsetup),
            dir_hold: pins.param(self.dirhold),
        }
    }

    /// Replaces the times that a register does not hold by the longest one. Returns the first of
    /// them, in ns.
    pub(super) fn clip_times(&self, pins: &mut PinStore, clock_hz: u32) -> Option<u32> {
        let longest = PulseTimes::longest(clock_hz);
        let times = [self.steplen, self.stepspace, self.dirsetup, self.dirhold];
        let mut found = None;
        for time in times {
            let asked = pins.param(time);
            if asked > longest && pins.set_param(time, longest).is_ok() {
                found = found.or(Some(asked));
            }
        }
        found
    }

    /// The set-up of the pulses that the parameters ask for.
    pub(super) fn pulses(&self, pins: &PinStore, clock_hz: u32) -> PulseSetup {
        let step_type = pins.param(self.step_type);
        let swap = self.swap_step_dir.is_some_and(|swap| pins.param(swap));
        let mut table = [0; 16];
        for (four, param) in table.chunks_mut(4).zip(self.table_data.iter().flatten()) {
            let bytes = pins.param(*param).to_le_bytes();
            for (entry, byte) in four.iter_mut().zip(bytes) {
                *entry = byte;
            }
        }
        PulseSetup {
            ticks: PulseTicks::new(self.times(pins).clipped(clock_hz), clock_hz),
            // The length of a table is no part of the mode: it would exchange outputs.
            mode: step_type.min(TABLE) | if swap { SWAP } else { 0 },
            table,
            table_max: step_type.clamp(1, 16).saturating_sub(1),
        }
    }
}
