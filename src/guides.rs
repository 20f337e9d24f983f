//! Guides: a page for each task of a controller's author, most with code that runs.

// The targets of the page's links, which are files in the repository.
#[doc = "[README.md]: crate"]
#[doc = "[faults.md]: crate::guides::faults"]
#[doc = "[homing.md]: crate::guides::homing"]
#[doc = "[own_card.md]: crate::guides::own_card"]
#[doc = "[parameters.md]: crate::guides::parameters"]
#[doc = "[realtime.md]: crate::guides::realtime"]
#[doc = ""]
#[doc = include_str!("../docs/cycle.md")]
pub mod cycle {}

#[doc = include_str!("../docs/faults.md")]
pub mod faults {}

#[doc = include_str!("../docs/neighbours.md")]
pub mod neighbours {}

#[doc = include_str!("../docs/homing.md")]
pub mod homing {}

#[doc = include_str!("../docs/several_boards.md")]
pub mod several_boards {}

#[cfg(all(feature = "realtime", target_os = "linux"))]
#[doc = include_str!("../docs/realtime.md")]
pub mod realtime {}

#[doc = include_str!("../docs/parameters.md")]
pub mod parameters {}

#[doc = include_str!("../docs/own_card.md")]
pub mod own_card {}

#[doc = include_str!("../docs/own_module.md")]
pub mod own_module {}

#[doc = include_str!("../docs/microcontroller.md")]
pub mod microcontroller {}

#[doc = include_str!("../docs/linuxcnc.md")]
pub mod linuxcnc {}
