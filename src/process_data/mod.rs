//! Process data: from a remote's descriptor to bits of interface registers, and between raw numbers
//! and engineering values.
//!
//! [`PackingPlan`] says where each element is; [`Field`] gets and puts its bits; [`Scaling`] makes a
//! value of them and bits of a value; [`CounterExtension`] continues short counters to 64 bits.

mod counter;
mod error;
mod field;
mod plan;
mod scaling;

pub use counter::CounterExtension;
pub use error::PlanError;
pub use field::Field;
pub use plan::{Element, ElementKind, InterfaceRegisters, PackingPlan};
pub use scaling::{Fit, Raw, Scaling, sign_extend};
