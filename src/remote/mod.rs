//! Remotes: from what one says of itself to bits of interface registers, engineering values and
//! pins.
//!
//! [`PackingPlan`] says where each element of the process data is; [`Field`] gets and puts its bits;
//! [`Scaling`] makes a value of them and bits of a value. [`RemotePins`] makes the pins of any
//! remote from its descriptor. Parameters are read and written by their record:
//! [`DataRecord::read_parameter`](crate::discovery::DataRecord::read_parameter).

mod binding;
mod counter;
mod field;
mod make;
mod parameter;
mod plan;
mod scaling;

pub use field::Field;
pub use parameter::{ParameterError, ParameterValue, ParameterValueError, RemoteParameter};
pub use plan::{Element, ElementKind, PackingPlan};
pub use scaling::{Fit, Raw, Scaling, sign_extend};

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use self::make::{Bindings, Maker};
use crate::boards::RemoteTable;
use crate::discovery::RemoteDescriptor;
use crate::hal::{GroupId, PinError, PinStore};

/// The pins of a remote, and the way of their values from and to the interface registers.
///
/// It is made from the remote's own descriptor, so it fits any remote; a [`RemoteTable`] adds what a
/// descriptor does not tell: terminals and safe values.
///
/// A driver calls [`take_inputs`](Self::take_inputs) when a transfer succeeded,
/// [`fault`](Self::fault) when the remote failed, and [`put_outputs`](Self::put_outputs) before
/// each transfer.
#[derive(Debug)]
pub struct RemotePins {
    prefix: String,
    group: GroupId,
    plan: PackingPlan,
    bindings: Bindings,
    parameters: Vec<RemoteParameter>,
}

/// Why the pins of a remote were not made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RemoteError {
    /// A pin of it can not be made.
    #[error("element {element} of the process data: {source}")]
    Element {
        /// The place of the record in the descriptor's `process_data`.
        element: usize,
        /// Why.
        source: PinError,
    },
    /// A parameter of it can not be made.
    #[error("parameter {parameter}: {source}")]
    Parameter {
        /// The place of the record in the descriptor's `parameters`.
        parameter: usize,
        /// Why.
        source: PinError,
    },
}

/// Where a remote is: what its pins are named after.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RemoteLocation<'a> {
    /// The board's name, for example `hm2_7i92.0`.
    pub board: &'a str,
    /// The port.
    pub port: u8,
    /// The channel of the port.
    pub channel: u8,
}

impl RemotePins {
    /// Makes the pins and parameters of a remote, in a group of their own. `plan` is the
    /// descriptor's.
    ///
    /// Names follow LinuxCNC: `hm2_7i92.0.7i77.0.0.input-07`.
    ///
    /// # Errors
    /// [`RemoteError`] with the element or parameter that did not fit; pins made before it stay in
    /// the store, never valid.
    pub fn new(
        pins: &mut PinStore,
        location: RemoteLocation<'_>,
        descriptor: &RemoteDescriptor,
        plan: PackingPlan,
        table: Option<&RemoteTable>,
    ) -> Result<Self, RemoteError> {
        let group = pins.add_group();
        let prefix = make::prefix(location, descriptor.name);
        let mut bindings = Bindings::default();
        for element in plan.elements() {
            let Some(record) = descriptor.process_data.get(element.record) else {
                debug_assert!(false, "the plan is of this descriptor");
                continue;
            };
            let known = table.and_then(|table| table.element(&record.name, record.direction));
            let made = Maker {
                pins,
                group,
                stem: format!("{prefix}.{}", make::lower(&record.name)),
                element,
                record,
                known,
                bindings: &mut bindings,
            }
            .make();
            made.map_err(|source| RemoteError::Element {
                element: element.record,
                source,
            })?;
        }
        let parameters = parameter::make(pins, group, &prefix, &descriptor.parameters)?;
        Ok(Self {
            prefix,
            group,
            plan,
            bindings,
            parameters,
        })
    }

    /// What its pins' names begin with, for example `hm2_7i92.0.7i77.0.0`.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Its pins' group: for validity, age and arming.
    pub fn group(&self) -> GroupId {
        self.group
    }

    /// Where its process data is.
    pub fn plan(&self) -> &PackingPlan {
        &self.plan
    }

    /// Its parameters, which are no process data: read and written in setup mode.
    pub fn parameters(&self) -> &[RemoteParameter] {
        &self.parameters
    }

    /// The parameter of that name, as the remote spells it or LinuxCNC does (in lower case).
    pub fn parameter(&self, descriptor: &RemoteDescriptor, name: &str) -> Option<&RemoteParameter> {
        self.parameters.iter().find(|parameter| {
            let record = descriptor.parameters.get(parameter.record);
            record.is_some_and(|record| record.is_named(name))
        })
    }

    /// Its parameters, to publish what was read.
    pub fn parameters_mut(&mut self) -> &mut [RemoteParameter] {
        &mut self.parameters
    }

    /// Publishes what a good transfer brought: `words` are the interface registers, from 0 on. The
    /// group is valid afterwards, of age 0.
    ///
    /// # Real time
    /// Grows with the number of pins; no allocation, no panic. Missing words count as zero: read as
    /// many as the inputs take.
    pub fn take_inputs(&mut self, pins: &mut PinStore, words: &[u32]) {
        for bits in &mut self.bindings.bit_inputs {
            bits.take(pins, words);
        }
        for binding in &self.bindings.inputs {
            binding.take(pins, words);
        }
        for counter in &mut self.bindings.counters {
            counter.take(pins, words);
        }
        pins.group_good(self.group);
    }

    /// Fills the interface registers with what the outputs must be now; bits that belong to no
    /// output become zero.
    ///
    /// While the group is not armed these are the safe values.
    ///
    /// # Real time
    /// Grows with the number of pins; no allocation, no panic.
    pub fn put_outputs(&self, pins: &mut PinStore, words: &mut [u32]) {
        words.fill(0);
        for binding in &self.bindings.outputs {
            binding.put(pins, words);
        }
    }

    /// The remote failed: inputs are no longer valid, outputs are safe until the application
    /// re-arms the group.
    pub fn fault(&self, pins: &mut PinStore) {
        pins.fault(self.group);
    }

    /// The remote was started again: its counters may stand anywhere, so the next reading moves
    /// no count.
    pub fn restarted(&mut self) {
        for counter in &mut self.bindings.counters {
            counter.resynchronise();
        }
    }
}
