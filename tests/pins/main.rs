//! Pins and parameters: their names, and their conversion from and to registers.

#[path = "../common/mod.rs"]
mod common;
mod packing_plan;
mod remote;

use mesa_hal::hal::PinStore;
use mesa_hal::remote::RemotePins;

/// Takes the inputs of a good transfer, as a port does.
fn take_inputs(remote: &mut RemotePins, pins: &mut PinStore, words: &[u32]) {
    remote.take_inputs(pins, words);
    pins.group_good(remote.group);
}
