//! The wire formats of Mesa Electronics' motion I/O, and the register bus.
//!
//! The common part of the driver (`mesa-hal`) and the simulated board (`mesa-hal-sim`), and nothing
//! else: bytes and addresses, no behaviour. [`lbp`] is the protocol of remotes, [`lbp16`] that of
//! Ethernet boards; a [`bus::RegisterBus`] carries 32-bit registers over any transport.
#![cfg_attr(not(any(feature = "std", test)), no_std)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::indexing_slicing
    )
)]

extern crate alloc;

mod advice;
pub mod bus;
pub mod lbp;
pub mod lbp16;
pub mod time;

mod rounded;

pub use advice::{Advice, AdviceTopic, MesaError, WithAdvice};
pub use rounded::Rounded;
