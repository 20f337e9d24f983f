//! A snapshot in the form that external programs read.

use serde::ser::{Serialize, SerializeStruct, Serializer};

use super::{RemoteSnapshot, Snapshot};
use crate::hal::{GroupId, GroupState};

/// The state of a group, with its number.
#[derive(serde::Serialize)]
struct GroupForm {
    group: GroupId,
    #[serde(flatten)]
    state: GroupState,
}

/// The pins by their names.
struct PinForms<'a>(&'a Snapshot);

impl Serialize for PinForms<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.pins().map(|(info, reading)| (&info.name, reading)))
    }
}

impl Serialize for Snapshot {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (board, since) = self.board();
        let remotes: alloc::vec::Vec<RemoteSnapshot> = self.remotes().collect();
        let groups = self
            .groups()
            .map(|(group, state)| GroupForm { group, state });
        let groups: alloc::vec::Vec<_> = groups.collect();
        let mut form = serializer.serialize_struct("Snapshot", 12)?;
        form.serialize_field("cycle", &self.cycle())?;
        form.serialize_field("time", &self.time())?;
        form.serialize_field("age", &self.age().as_secs_f64())?;
        form.serialize_field("fresh", &self.is_fresh())?;
        form.serialize_field("board", &board)?;
        form.serialize_field("board_since", &since)?;
        form.serialize_field("run", &self.run_statistics())?;
        form.serialize_field("driver", &self.driver_statistics())?;
        form.serialize_field("bus", &self.bus_statistics())?;
        form.serialize_field("groups", &groups)?;
        form.serialize_field("remotes", &remotes)?;
        form.serialize_field("pins", &PinForms(self))?;
        form.end()
    }
}
