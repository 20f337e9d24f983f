//! Discovery of remotes: PTOC and GTOC, process-data and mode records.

mod descriptor;

pub use descriptor::{
    DataDirection, DataRecord, DataType, ModeRecord, ModeType, RemoteDescriptor, RemoteName,
};
