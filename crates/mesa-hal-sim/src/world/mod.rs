//! The machine around the electronics: motors that follow an analog voltage between hard stops,
//! stepper motors, and the wiring of inputs: switches at positions, handwheels, an emergency-stop
//! chain.

mod installation;
mod motion;
mod motor;
mod stepper;
mod switch;
mod wheel;

pub use installation::EstopConfig;
pub(crate) use installation::Installation;
pub use motor::{Motor, MotorConfig, MotorError, Segment};
pub use stepper::{Stepper, StepperConfig};
pub(crate) use switch::Change;
pub use switch::{SimTerminal, Switch, SwitchConfig};
pub use wheel::{Wheel, WheelConfig};
