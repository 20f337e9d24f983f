//! HostMot2: cookie, IDROM, module and pin descriptors, and one file for each kind of module.

mod error;
mod gtag;
mod identify;
mod idrom;
mod module;
mod pin;

pub use error::{IdentifyError, IdromPart, MissingModule, Warning};
pub use gtag::{Gtag, GtagList};
pub use identify::HostMot2;
pub use idrom::{Idrom, Name8};
pub use module::{ModuleClock, ModuleDescriptor, ModuleError, RegisterBlock};
pub use pin::PinDescriptor;
