//! Values that an application may set.

use super::{AnyValue, PinError, PinInfo, Role, ShortName};

impl PinInfo {
    /// Checks that an application may set the pin or parameter to this value. An output accepts
    /// every value of its type: a value that cannot go out is replaced in the cycle by the safe
    /// value or the nearest limit, see [`Pins::set`](super::Pins::set). A setting rejects such a
    /// value and keeps its own.
    ///
    /// # Errors
    /// [`PinError::NotSettable`], [`PinError::ReadOnly`], [`PinError::InRemote`],
    /// [`PinError::WrongType`]; for a setting also [`PinError::BadValue`] and
    /// [`PinError::BadScale`].
    pub fn check_settable(&self, value: AnyValue) -> Result<(), PinError> {
        let name = || ShortName::new(&self.name);
        match self.role {
            Role::Output | Role::InOut | Role::Setting => {}
            Role::Input => return Err(PinError::NotSettable { name: name() }),
            Role::Property => return Err(PinError::ReadOnly { name: name() }),
            Role::InRemote => return Err(PinError::InRemote { name: name() }),
        }
        if self.hal_type != value.hal_type {
            return Err(PinError::WrongType {
                name: name(),
                expected: self.hal_type,
                value,
                limits: self.limits,
            });
        }
        if self.role != Role::Setting {
            return Ok(());
        }
        let number = value.as_f64();
        let is_within = self
            .limits
            .is_none_or(|(min, max)| min <= number && number <= max);
        if self.is_scale && !is_scale(number) {
            Err(PinError::BadScale {
                name: name(),
                value,
            })
        } else if !value.is_finite() || !is_within {
            Err(PinError::BadValue {
                name: name(),
                value,
                limits: self.limits,
            })
        } else {
            Ok(())
        }
    }
}

/// True if a number can be a scale: any count or voltage divided or multiplied by it stays finite.
pub(crate) fn is_scale(number: f64) -> bool {
    (1e-100..=1e100).contains(&number.abs())
}
