//! A look at a running machine: registers of a board that another program drives, read beside it.
//!
//! A [`PassiveBus`] has a socket of its own, writes nothing, reads no register that a read changes,
//! and sends few packets: no cycle of the program that drives the board fails because of it.
//! LinuxCNC does not notice it. A driver of `mesa-hal` cannot know what a packet of another program
//! did: for each, it leaves the inputs of remotes as they are in at most two cycles. `mesa info
//! --passive`, `mesa watch --passive` and `mesa peek` use it.
//!
//! | rule | limit |
//! |---|---|
//! | writes | none: neither registers nor scratch registers, in which other programs number their packets |
//! | registers | those of which it is known that a read changes nothing ([`RegisterMap`](mesa_hal::transport::RegisterMap)) |
//! | packets | at most one in [`PassiveBus::INTERVAL`], never two in flight |
//! | size of a request or a reply | at most [`PassiveBus::MAX_BYTES`] |

mod bus;
mod inventory;
mod received;
mod watch;

pub use bus::{PassiveBus, PassiveError, PassiveStatistics, Read};
pub use inventory::PassiveInventory;
pub use watch::{Sample, Value, Watched};
