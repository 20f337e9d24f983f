//! What can go wrong with an exchange: for buses that fail on purpose.

use super::BusErrorKind;

/// What goes wrong with an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The request never arrives: nothing is executed, and the error has this kind.
    /// `Lost`, `Refused`, `Unreachable` and `Invalid` are like that in real life.
    NotExecuted(BusErrorKind),
    /// All is executed, and the reply is no good: the error has this kind. `Late`, `Stale`,
    /// `Short`, `Device`, and a `Lost` of which the reply was lost, are like that in real life.
    Executed(BusErrorKind),
    /// An exchange that only writes never arrives, which nothing reports before the [`Reply`](super::Reply) of the
    /// next that reads, as on Ethernet.
    /// Exchanges that read are not concerned.
    SilentWrite,
}
