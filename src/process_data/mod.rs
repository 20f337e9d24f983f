//! Process data: from a remote's descriptor to bits of interface registers, and between raw numbers
//! and engineering values.
//!
//! [`PackingPlan`] says where each element is; [`Field`] gets and puts its bits; [`Scaling`] makes a
//! value of them and bits of a value; [`CounterExtension`] continues short counters to 64 bits.
//!
//! Parameters are read and written by their record:
//! [`DataRecord::read_parameter`](crate::discovery::DataRecord::read_parameter).

mod counter;
mod error;
mod field;
mod parameter;
mod plan;
mod scaling;

pub use counter::CounterExtension;
pub use error::PlanError;
pub use field::Field;
pub use parameter::{ParameterError, ParameterValue};
pub use plan::{Element, ElementKind, InterfaceRegisters, PackingPlan};
pub use scaling::{Fit, Raw, Scaling, sign_extend};
