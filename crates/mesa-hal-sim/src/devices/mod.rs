//! Simulated devices: remotes with terminals, made from a description.
//!
//! All of them are [`SimRemote`]s around a [`Device`]: a [`SimLayout`] from a [`Description`], and
//! a [`World`] at the terminals. A plugged device is accessible through [`find`] and [`find_mut`],
//! behind cables and wrappers.

mod analog;
mod cards;
mod description;
mod device;
mod drivers;
mod field_io;
mod i7i72;
mod image;
mod plain;
mod relatives;
mod spindle;
#[cfg(test)]
mod tests;

pub use analog::Analog;
pub use description::{Description, DescriptionError, Record, SimMode, SimParameter, Working};
pub use device::{Device, SignalValue, SimDevice, World, WorldError};
pub use field_io::FieldIo;
pub use i7i72::Outputs48;
pub use image::{SimElement, SimLayout};
pub use plain::Plain;

use core::any::Any;

use super::{
    remote::{Cable, SimRemote},
    wire::RemoteEnd,
};

/// The device at `end`, or behind its cables.
pub fn find(end: &dyn RemoteEnd) -> Option<&dyn SimDevice> {
    let any: &dyn Any = end;
    as_device::<FieldIo>(any)
        .or_else(|| as_device::<Analog>(any))
        .or_else(|| as_device::<Outputs48>(any))
        .or_else(|| as_device::<Plain>(any))
        .or_else(|| end.inner().and_then(find))
}

/// Mutable access to the device at `end`, or behind its cables.
pub fn find_mut(end: &mut dyn RemoteEnd) -> Option<&mut dyn SimDevice> {
    find(end)?;
    if as_device::<FieldIo>(end).is_some() {
        return as_device_mut::<FieldIo>(end);
    }
    if as_device::<Analog>(end).is_some() {
        return as_device_mut::<Analog>(end);
    }
    if as_device::<Outputs48>(end).is_some() {
        return as_device_mut::<Outputs48>(end);
    }
    if as_device::<Plain>(end).is_some() {
        return as_device_mut::<Plain>(end);
    }
    end.inner_mut().and_then(find_mut)
}

/// The outermost cable at `end`, to unplug it or to inject wire faults.
pub fn find_cable(end: &mut dyn RemoteEnd) -> Option<&mut Cable> {
    let any: &mut dyn Any = end;
    any.downcast_mut()
}

fn as_device<W: World>(any: &dyn Any) -> Option<&dyn SimDevice> {
    let remote: &SimRemote<Device<W>> = any.downcast_ref()?;
    Some(remote)
}

fn as_device_mut<W: World>(any: &mut dyn Any) -> Option<&mut dyn SimDevice> {
    let remote: &mut SimRemote<Device<W>> = any.downcast_mut()?;
    Some(remote)
}
