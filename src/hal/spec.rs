//! Properties of a new pin or parameter.

use alloc::string::String;

use super::handle::Key;
use super::{Output, Param, Place};

/// Properties of a new pin or parameter apart from its type. A name alone makes a pin at the
/// maker's terminal, without unit or limits:
///
/// ```
/// use mesa_hal::hal::Spec;
/// let volts = Spec {
///     unit: "V".into(),
///     limits: Some((-10.0, 10.0)),
///     ..Spec::from("volts")
/// };
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spec {
    /// Its name, without the maker's stem.
    pub name: String,
    /// Terminal of a pin; empty for that of the maker. Ignored for a parameter.
    pub place: Place,
    /// Its unit, for example `V`.
    pub unit: String,
    /// The smallest and the largest value. On an output they are enforced: a value outside is
    /// replaced by the nearest limit, as in LinuxCNC, because the command of a saturating servo
    /// loop means "as much as possible", and dropping it to the safe value at that point would let
    /// the axis go. On a setting they are enforced as well; on an input they are informational.
    pub limits: Option<(f64, f64)>,
    /// Usual limits, informational and not enforced: for an output whose scale is adjustable and
    /// whose limits are parameters.
    pub range: Option<(f64, f64)>,
    /// `-invert`: a truth value goes out as its opposite, including its safe value, because the
    /// parameter describes the wiring.
    pub invert: Option<Invert>,
    /// `-maxlim`: no larger value goes out.
    pub max_limit: Option<Param<f64>>,
    /// `-minlim`: no smaller value goes out.
    pub min_limit: Option<Param<f64>>,
    /// `-scalemax`: the real number goes out in other units.
    pub full_scale: Option<FullScale>,
}

impl<S: Into<String>> From<S> for Spec {
    fn from(name: S) -> Self {
        Self {
            name: name.into(),
            ..Self::default()
        }
    }
}

/// Inverter of a digital output: a parameter, or a pin that faults do not affect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Invert {
    /// A parameter, as in LinuxCNC for outputs of remotes and for I/O pins.
    Setting(Param<bool>),
    /// A pin, as in LinuxCNC for SSR and OutM.
    Pin(Output<bool>),
}

impl Invert {
    pub(super) fn key(self) -> Key {
        match self {
            Self::Setting(param) => param.key,
            Self::Pin(pin) => pin.key,
        }
    }
}

/// The range of an output on the wire, and the parameter that gives its end in the application's
/// units.
///
/// A value beyond the range goes out as the nearest end, and is counted. If the scale does not
/// yield a finite number, the safe value goes out and is counted as not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FullScale {
    /// The value that goes out as `max`.
    pub scale: Param<f64>,
    /// The other end of the range on the wire.
    pub min: f64,
    /// The value on the wire for the value of `scale`.
    pub max: f64,
}
