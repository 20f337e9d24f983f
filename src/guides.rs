//! Pages for who writes a controller, with code that runs.
//!
//! Faults and how to re-arm have [a page](crate::driver::faults) of their own.

#[doc = include_str!("../docs/parameters.md")]
pub mod parameters {}

#[doc = include_str!("../docs/own_module.md")]
pub mod own_module {}

#[doc = include_str!("../docs/own_card.md")]
pub mod own_card {}

#[doc = include_str!("../docs/linuxcnc.md")]
pub mod linuxcnc {}
