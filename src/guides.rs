//! Pages for authors of controllers, with code that runs.
//!
//! Faults and how to re-arm have [a page](crate::driver::faults) of their own.

// The targets of the page's links, which are files in the repository.
#[doc = "[README.md]: crate"]
#[doc = "[faults.md]: crate::driver::faults"]
#[doc = "[homing.md]: crate::driver::homing"]
#[doc = "[own_card.md]: crate::guides::own_card"]
#[doc = "[parameters.md]: crate::guides::parameters"]
#[doc = "[realtime.md]: crate::runner"]
#[doc = ""]
#[doc = include_str!("../docs/cycle.md")]
pub mod cycle {}

#[doc = include_str!("../docs/parameters.md")]
pub mod parameters {}

#[doc = include_str!("../docs/own_module.md")]
pub mod own_module {}

#[doc = include_str!("../docs/own_card.md")]
pub mod own_card {}

#[doc = include_str!("../docs/linuxcnc.md")]
pub mod linuxcnc {}
