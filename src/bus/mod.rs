//! The register bus of `mesa-wire`, and the process image: all reads and writes of a cycle.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod image;

pub use mesa_wire::bus::*;

pub use image::{
    CycleLists, ImageError, ImagePlan, Phase, ReadSlot, Setting, Stage, Words, WriteSlot,
};
pub(crate) use image::{CycleWrites, Exchanges, HORIZON, ReadRequest, ReadsBeside};
