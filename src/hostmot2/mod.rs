//! HostMot2: cookie, IDROM, module and pin descriptors, sources of I/O pins, and the layout of the
//! tables with data about boards that a firmware does not contain.

pub(crate) mod board_table;
mod error;
mod gtag;
mod identify;
mod idrom;
mod io_port;
mod kinds;
mod module;
mod pin;
mod pin_roles;
mod remote_id;
mod tick_rate;
mod trailing;

pub use error::{HostMot2Error, IdentifyError};
pub use gtag::Gtag;
pub use identify::HostMot2;
pub(crate) use identify::{COOKIE, COOKIE_ADDRESS, FirmwareCheck};
pub use idrom::Idrom;
pub use io_port::{GpioConfig, IoPorts};
pub(crate) use io_port::{IoPort, PinPlace, PortRegisters};
pub use kinds::CountedKind;
pub use module::{ModuleDescriptor, ModuleInstance};
pub use pin::PinDescriptor;
pub(crate) use pin::list_of;
pub use remote_id::RemoteId;
pub use tick_rate::TickRate;
pub use trailing::TrailingEntry;
