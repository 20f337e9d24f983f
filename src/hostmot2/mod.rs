//! HostMot2: cookie, IDROM, module and pin descriptors, and who drives which I/O pin.

mod error;
mod gtag;
mod identify;
mod idrom;
mod io_port;
mod module;
mod pin;

pub use error::{IdentifyError, IdromPart, LocateError, MissingModule, Warning};
pub use gtag::{Gtag, GtagList};
pub use identify::HostMot2;
pub use idrom::{Idrom, Name8};
pub use io_port::{GpioSetup, IoPinError, IoPorts, PinPlace, PortPlan, PortSetup};
pub use module::{ModuleClock, ModuleDescriptor, ModuleError, RegisterBlock};
pub use pin::PinDescriptor;
