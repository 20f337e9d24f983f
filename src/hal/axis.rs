//! An axis with a command and a feedback, whatever moves it.

use super::{AnalogOut, Counter, InOut, Input, Output, Pins, Reading};

/// An axis: a speed as its command, and a position as its feedback. An application that takes one
/// runs on an analog drive with its encoder and on a step generator alike:
///
/// ```
/// use mesa_hal::hal::{Axis, Pins};
///
/// /// A position loop. Units are those of the scales: millimetres, for example.
/// fn approach(pins: &mut Pins, axis: Axis, target: f64) {
///     let place = axis.position(pins).within(25).filter(|_| !axis.is_unsure(pins));
///     axis.enable(pins, place.is_some());
///     axis.set_speed(pins, place.map_or(0.0, |place| 40.0 * (target - place)));
/// }
/// ```
///
/// The scales belong to the machine, and are set once: [`servo`](Self::servo) and
/// [`StepgenPins::axis`](crate::modules::stepgen::StepgenPins::axis) name them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    speed: Output<f64>,
    enable: AxisEnable,
    position: Input<f64>,
    unsure: Option<Input<bool>>,
    index_enable: Option<InOut<bool>>,
    reset: Output<bool>,
}

/// The way in which an axis is enabled.
#[derive(Clone, Copy, Debug, PartialEq)]
enum AxisEnable {
    /// An analog output, which may share its enable with others.
    Analog(AnalogOut),
    /// A step generator: its enable, and the pin that lets it follow speeds.
    Steps {
        enable: Output<bool>,
        by_speed: Output<bool>,
    },
}

impl Axis {
    /// An analog drive that follows speeds, and the encoder of its motor. The command is in units
    /// per second if [`AnalogOut::set_full_scale`] was called with the speed at the end of the
    /// range; the position is in units if [`Counter::scale`] has the counts for one.
    pub const fn servo(drive: AnalogOut, encoder: Counter) -> Self {
        Self {
            speed: drive.volts,
            enable: AxisEnable::Analog(drive),
            position: encoder.position,
            unsure: encoder.count_unsure,
            index_enable: Some(encoder.index_enable),
            reset: encoder.reset,
        }
    }

    /// A step generator.
    pub(crate) const fn steps(
        [enable, by_speed, reset]: [Output<bool>; 3],
        speed: Output<f64>,
        position: Input<f64>,
        unsure: Input<bool>,
        index_enable: Option<InOut<bool>>,
    ) -> Self {
        Self {
            speed,
            enable: AxisEnable::Steps { enable, by_speed },
            position,
            unsure: Some(unsure),
            index_enable,
            reset,
        }
    }

    /// Enables or disables the axis. After a fault it must be enabled again.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn enable(self, pins: &mut Pins, on: bool) {
        match self.enable {
            AxisEnable::Analog(drive) => drive.enable(pins, on),
            AxisEnable::Steps { enable, by_speed } => {
                pins.set(by_speed, true);
                pins.set(enable, on);
            }
        }
    }

    /// Commands a speed in units per second. While the axis is not enabled it stands still.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn set_speed(self, pins: &mut Pins, speed: f64) {
        pins.set(self.speed, speed);
    }

    /// Reads the position in units.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn position(self, pins: &Pins) -> Reading<f64> {
        pins.read(self.position)
    }

    /// True if the zero of the position may be lost: home the axis again. Counters of remotes never
    /// report it.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn is_unsure(self, pins: &Pins) -> bool {
        self.unsure.is_some_and(|unsure| pins.read(unsure).value)
    }

    /// Requests that the position becomes 0 at the next index. Returns false if the axis has none:
    /// a step generator without the input for it.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn request_index(self, pins: &mut Pins) -> bool {
        if let Some(index_enable) = self.index_enable {
            pins.set(index_enable, true);
        }
        self.index_enable.is_some()
    }

    /// True while a requested index has not come.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn awaits_index(self, pins: &Pins) -> bool {
        self.index_enable
            .is_some_and(|index_enable| pins.read(index_enable).value)
    }

    /// Keeps the position at 0 while `on`: homing without an index.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn reset(self, pins: &mut Pins, on: bool) {
        pins.set(self.reset, on);
    }
}
