//! Discovery of remotes: PTOC and GTOC, process-data and mode records.
//!
//! Source: manual 7I77, "PROCESS DATA DISCOVERY" to "DISCOVERY SEQUENCE"; FACTS 7, which wins.

mod built_in;
mod descriptor;
mod inventory;
mod memory;
mod modes;
mod problem;
mod reader;
mod record;
mod walk;

pub use descriptor::{
    DataDirection, DataRecord, DataType, ModeRecord, ModeType, RemoteDescriptor, RemoteName,
};
pub use inventory::{DiscoveredRemote, Inventory, discover_port};
pub use memory::{PortMemory, RemoteMemory, RemoteParameters};
pub use modes::ModeSet;
pub use problem::{Flow, Problem, ProblemKind, StringField, Table};
pub use reader::DiscoveryLimits;
pub use walk::{Discovered, RemoteIdentity, Source, discover};
