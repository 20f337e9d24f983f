//! The host's side of a port: which registers there are.

/// One 32-bit register of a port, as the host sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Register {
    /// COMMAND, one for the port.
    Command,
    /// DATA, one for the port.
    Data,
    /// CS of a channel.
    Cs(u8),
    /// Interface register `.1` of channel `.0`.
    Interface(u8, u8),
}
