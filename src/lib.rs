//! Mesa Electronics' motion I/O from Rust.
#![cfg_attr(not(feature = "std"), no_std)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

extern crate alloc;

pub mod boards;
pub mod bus;
pub mod discovery;
pub mod driver;
pub mod ethernet;
pub mod hal;
pub mod hostmot2;
pub mod lbp;
pub mod lbp16;
pub mod process_data;
#[cfg(feature = "std")]
pub mod sim;
pub mod sslbp;
#[cfg(feature = "std")]
pub mod transport;
