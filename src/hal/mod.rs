//! Typed pins and parameters, and LinuxCNC names.
//!
//! Pins have two sides: [`PinStore`] is the driver's, which makes pins, publishes inputs and
//! fetches outputs, and [`Pins`] the application's, which reads inputs and sets outputs. An
//! application keeps handles, in which the direction and the type of a pin are part of the Rust
//! type:
//!
//! ```
//! use mesa_hal::hal::{PinMaker, PinStore, Pins, Place, Spec};
//! # fn main() -> Result<(), mesa_hal::hal::PinError> {
//! // The driver does this at set-up.
//! let mut store = PinStore::default();
//! let remote = store.add_group();
//! let place = Place { terminal: "TB8 pin 3".into(), signal: "INPUT2".into() };
//! let mut make = PinMaker::new(&mut store, remote, "card.").at(place);
//! let switch = make.input::<bool>("limit")?;
//! let volts = Spec { limits: Some((-10.0, 10.0)), unit: "V".into(), ..Spec::from("drive") };
//! let drive = make.output(volts, 0.0)?;
//!
//! // The application does this in the cycle.
//! let pins: &mut Pins = &mut store;
//! let limit = pins.read(switch);
//! let stop = limit.value || !limit.valid;
//! pins.set(drive, if stop { 0.0 } else { 1.5 });
//! assert!(stop, "no transfer yet, so nothing is valid");
//! # Ok(())
//! # }
//! ```

// Runs in the cycle.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod any;
mod arming;
mod axis;
mod catalog;
mod error;
mod groups;
mod handle;
mod id;
mod info;
mod io;
mod maker;
mod nearest;
mod own;
mod pins;
mod reading;
mod room;
mod row;
mod settable;
mod spec;
mod store;
mod terminals;
mod value;
mod values;

pub(crate) use arming::{ArmingCondition, ArmingEvent};
pub use axis::Axis;
pub use error::{PinError, ShortName};
pub use handle::kind::{Readable, Settable};
pub use handle::{GroupId, Handle, InOut, Input, Output, Param};
pub use id::PinId;
pub use info::{MAX_NAME, MAX_PINS, PinInfo, Role};
pub use io::{AnalogIn, AnalogOut, Counter, DigitalIn, DigitalOut};
pub use maker::PinMaker;
pub use pins::Pins;
use reading::Rejection;
pub use reading::{Age, GroupState, Reading, Rejections};
pub(crate) use row::InputRow;
pub(crate) use settable::is_scale;
pub use spec::{FullScale, Invert, Spec};
pub use store::PinStore;
pub use terminals::{Place, Terminals};
pub use value::{AnyValue, HalType, Value};
