//! Quadrature counters, on pins of their own or multiplexed.
//!
//! [`Encoders`] are the registers, [`CountWord`] and [`ControlWord`] their layouts, and [`Encoder`]
//! the state machine that makes counts, positions and velocities of them, once per cycle.

mod channel;
mod latch;
mod registers;
mod velocity;

pub use channel::{Encoder, EncoderReading, EncoderSample};
pub use latch::LatchRequest;
pub use registers::{
    ControlWord, CountWord, EncoderConfig, Encoders, LatchTimer, MuxSkew, TickRate,
};
pub use velocity::VelocityEstimator;
