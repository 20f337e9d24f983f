//! The machine around the electronics: motors that follow an analog voltage.

mod motor;

pub use motor::{Motor, MotorConfig, Segment};
