//! A simulated FPGA with its remote bus, on a virtual clock.
//!
//! The simulator shares the pure wire formats ([`crate::lbp`], [`crate::lbp16`]) and register
//! addresses with the driver, and nothing else: its behaviour comes from the manuals, from what
//! the gateware was seen to do and from its recorded transcripts.

pub mod sslbp;
pub mod wire;
