//! Typed pins and parameters, LinuxCNC names, and the visitor that lists them.
//!
//! They have two sides: [`PinStore`] is the driver's, which makes pins, publishes inputs and takes
//! outputs, and [`Pins`] the application's, which reads inputs and sets outputs. An application
//! keeps handles, in which the direction and the type of a pin are part of the Rust type:
//!
//! ```
//! use mesa_hal::hal::{OutputRule, PinStore, Pins, Spec};
//! # fn main() -> Result<(), mesa_hal::hal::PinError> {
//! // A driver does this at set-up ...
//! let mut store = PinStore::new();
//! let remote = store.add_group();
//! let switch = store.add_input::<bool>(remote, Spec::new("limit").at("TB8 pin 3", "INPUT2"))?;
//! let spec = Spec::new("drive").unit("V").limits(-10.0, 10.0);
//! let drive = store.add_output(remote, spec, OutputRule::safe_at(0.0))?;
//!
//! // ... and an application this in the cycle.
//! let pins: &mut Pins = &mut store;
//! let limit = pins.read(switch);
//! let stop = limit.value || !limit.valid;
//! pins.set(drive, if stop { 0.0 } else { 1.5 });
//! assert!(stop, "no transfer yet, so nothing is valid");
//! # Ok(())
//! # }
//! ```

mod cycle;
mod error;
mod handle;
mod info;
mod io;
mod maker;
mod pins;
mod reading;
mod rule;
mod store;
mod terminals;
mod value;
mod visit;

pub use error::PinError;
pub use handle::{GroupId, Handle, InOut, Input, Output, Param, Publishable, Readable, Settable};
pub use info::{MAX_NAME, MAX_PINS, PinInfo, Role, Spec};
pub use io::{AnalogIn, AnalogOut, Counter, DigitalIn, DigitalOut};
pub use maker::PinMaker;
pub use pins::Pins;
pub use reading::{Age, AnyValue, GroupState, OutOfRange, Reading, Rejections};
pub use rule::{FullScale, Invert, OutputModifiers, OutputRule};
pub use store::PinStore;
pub use terminals::{Place, Terminals};
pub use value::{HalType, Rejection, Value};
pub use visit::Visitor;
