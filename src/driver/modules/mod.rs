//! The modules of the FPGA in the cycle.

mod encoder;

pub use encoder::EncoderSetup;
pub(super) use encoder::{EncoderBuildError, EncoderModule};
