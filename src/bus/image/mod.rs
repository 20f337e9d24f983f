//! The process image of a cycle: every register that is read and written, planned once.
//!
//! Modules register their reads and writes in an [`ImagePlan`]. [`ImagePlan::freeze`] sorts and
//! merges it into lists that the bus prepares, on one buffer of words. Registers that start
//! something (DOIT) come after all data by construction, because they are registered as
//! [`Phase::Trigger`].
//!
//! # The set-up
//! The image contains the complete set-up of the board: *settings*, whose words may change, and
//! steps, whose words stay, in the order of their [`Stage`]. A changed setting goes with the next
//! write, and is repeated until its arrival is certain. A setting that drives a pin
//! ([`Stage::Drive`], [`Stage::Enable`]) is only written between two reads of the evidence that the
//! board is set up, because it could drive what the rest of a lost set-up protected. A lost set-up
//! is written again as a whole, in one exchange with the evidence after it, or not at all: no
//! exchange contains a part that enables what another part protects.

mod exchange;
mod layout;
mod plan;
mod words;

pub(crate) use exchange::ReadsBeside;
pub use exchange::{CycleLists, CycleWrites, Exchanges, ReadRequest};
pub use plan::{ImageError, ImagePlan, Phase, ReadSlot, Setting, Stage, WriteSlot};
pub(crate) use words::HORIZON;
pub use words::Words;

#[cfg(test)]
mod tests;
