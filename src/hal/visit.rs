//! Listing what there is.

use super::{AnyValue, PinInfo, Pins};

/// Sees all pins and parameters of a store, one after the other.
pub trait Visitor {
    /// A pin, and what it holds now.
    fn pin(&mut self, info: &PinInfo, value: AnyValue);

    /// A parameter, and what it holds now.
    fn parameter(&mut self, info: &PinInfo, value: AnyValue);
}

impl Pins {
    /// Shows everything to a visitor, in the order of [`infos`](Pins::infos).
    pub fn visit(&self, visitor: &mut dyn Visitor) {
        for (position, info) in self.infos().iter().enumerate() {
            let Some(value) = self.value_at(position) else {
                continue;
            };
            if info.role.is_param() {
                visitor.parameter(info, value);
            } else {
                visitor.pin(info, value);
            }
        }
    }
}
