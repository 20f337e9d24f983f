//! Remotes: conversion of a descriptor and process data to engineering values and pins.
//!
//! [`RemotePins`] makes the pins of any remote from its descriptor and its
//! [`PackingPlan`](crate::discovery::PackingPlan); [`Scaling`] converts between the bits of an
//! element and a value. Parameters are read and written by their record:
//! [`DataRecord::read_parameter`](crate::discovery::DataRecord::read_parameter).

// Runs in the cycle.
#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

mod baud_rate;
mod binding;
mod counter;
mod field;
mod make;
mod parameter;
mod scaling;

use crate::advice::{Advice, MesaError};
use crate::sslbp::{Channel, RemoteLabel};
pub use baud_rate::{BAUD_RATE_PARAMETER, operate_baud_rate};
pub(crate) use parameter::ParameterWrite;
pub use parameter::{ParameterError, ParameterValue, RemoteParameter};
pub use scaling::Scaling;

use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;

use self::binding::{Binding, BitInputs};
use self::counter::CounterPins;
use crate::hal::{GroupId, PinError, PinStore};

/// The pins of a remote, and the transfer of their values from and to the interface registers.
///
/// The pins are made from the remote's own descriptor and therefore fit any remote; a
/// [`RemoteTable`](crate::discovery::RemoteTable) adds terminals and safe values, which a
/// descriptor does not contain.
///
/// A driver calls [`take_inputs`](Self::take_inputs) and [`PinStore::group_good_since`] after a
/// successful transfer,
/// [`PinStore::fault`] of the group when the remote has failed, and
/// [`put_outputs`](Self::put_outputs) before each transfer.
#[derive(Debug)]
pub struct RemotePins {
    /// The remote.
    pub label: RemoteLabel,
    /// Common start of the names, for example `hm2_7i92.0.7i77.0.0`.
    pub prefix: String,
    /// Group of the pins: for validity, age and arming.
    pub group: GroupId,
    /// The remote's parameters, which are not process data: read and written in setup mode.
    pub parameters: Vec<RemoteParameter>,
    inputs: Vec<Binding>,
    bit_inputs: Vec<BitInputs>,
    counters: Vec<CounterPins>,
    outputs: Vec<Binding>,
}

/// Error in the construction of a remote's pins.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name}: {source}")]
#[non_exhaustive]
pub struct RemoteError {
    /// Start of the names of the element's pins, or the name of the parameter.
    pub name: String,
    /// The cause.
    pub source: Box<PinError>,
}

impl MesaError for RemoteError {
    fn advice(&self) -> Option<Advice> {
        self.source.advice()
    }
}

impl RemotePins {
    /// The parameter with that name, as spelled by the remote or, in lower case, by LinuxCNC.
    pub fn parameter(&self, name: &str) -> Option<&RemoteParameter> {
        let mut parameters = self.parameters.iter();
        parameters.find(|parameter| parameter.record.is_named(name))
    }

    /// The write of a parameter of the remote on `channel`; `None` if it does not have one with
    /// that name.
    pub(crate) fn write_of(
        &self,
        channel: Channel,
        name: &str,
        raw: u64,
    ) -> Option<ParameterWrite> {
        let mut parameters = (0..).zip(&self.parameters);
        let named = parameters.find(|(_, parameter)| parameter.record.is_named(name));
        let (number, parameter) = named?;
        parameter.record.write_of(channel, number, raw)
    }

    /// Publishes the present value of a parameter.
    pub(crate) fn publish_parameter(&mut self, pins: &mut PinStore, name: &str, raw: u64) {
        let mut parameters = self.parameters.iter_mut();
        if let Some(parameter) = parameters.find(|parameter| parameter.record.is_named(name)) {
            parameter.publish(pins, raw);
        }
    }

    /// Publishes the inputs of a good transfer: `words` are the interface registers, from 0 on.
    /// They are valid when the caller declares the group good: [`PinStore::group_good_since`].
    ///
    /// # Real time
    /// Grows with the number of pins; no allocation, no panic. Missing words count as zero: pass at
    /// least as many as the inputs occupy.
    pub fn take_inputs(&mut self, pins: &mut PinStore, words: &[u32]) {
        for bits in &mut self.bit_inputs {
            bits.take(pins, words);
        }
        for binding in &self.inputs {
            binding.take(pins, words);
        }
        for counter in &mut self.counters {
            counter.take(pins, words);
        }
    }

    /// Fills the interface registers with the present values of the outputs; bits that belong to no
    /// output become zero.
    ///
    /// While the group is not armed, the outputs have their safe values.
    ///
    /// # Real time
    /// Grows with the number of pins; no allocation, no panic.
    pub fn put_outputs(&self, pins: &mut PinStore, words: &mut [u32]) {
        words.fill(0);
        for binding in &self.outputs {
            binding.put(pins, words);
        }
    }

    /// Handles a restart of the remote: its counters may have any value, so the next reading moves
    /// no count.
    pub fn restarted(&mut self) {
        for counter in &mut self.counters {
            counter.resynchronise();
        }
    }
}
