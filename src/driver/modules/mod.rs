//! The modules of the FPGA in the cycle.

mod encoder;

pub(super) use encoder::{EncoderBuildError, EncoderModule};
pub use encoder::EncoderSetup;
