//! Faults of an exchange, for buses that fail on purpose.

use super::BusErrorKind;

/// A fault of an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The request never arrives: nothing is executed, and the error has this kind. Real faults of
    /// this sort are `Lost`, `Refused`, `Unreachable` and `Invalid`.
    NotExecuted(BusErrorKind),
    /// Everything is executed, and the reply is unusable: the error has this kind. Real faults of
    /// this sort are `Late`, `Stale`, `Short`, `Device`, and `Lost` if the reply was lost.
    Executed(BusErrorKind),
    /// An exchange that only writes never arrives. As on Ethernet, the [`Reply`](super::Reply) of
    /// the next exchange that reads is the first evidence of it. Exchanges that read are not
    /// affected.
    AckedButLost,
}
