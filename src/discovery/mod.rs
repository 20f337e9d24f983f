//! Discovery of remotes: PTOC and GTOC, process-data and mode records, and the layout of the
//! process data.
//!
//! Source: manual 7I77, "PROCESS DATA DISCOVERY" to "DISCOVERY SEQUENCE"; FACTS 7, which takes
//! precedence.

mod descriptor;
mod plan;
mod port;
mod problem;
mod record;
mod table;
mod walk;

pub use descriptor::{DataDirection, DataRecord, DataType, ModeRecord, ModeType, RemoteDescriptor};
pub use plan::{Element, PackingPlan};
pub use port::discover_port;
pub use problem::{Problem, ProblemKind, Table};
pub use table::{ElementTable, RemoteTable, TableAddresses};
pub use walk::{Discovery, DiscoveryOptions, discover};

pub(crate) use descriptor::hal_name;
