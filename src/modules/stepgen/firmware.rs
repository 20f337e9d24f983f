//! What the generators of a firmware can do.

/// MODE bit: exchanges the first two outputs.
pub(super) const SWAP: u32 = 1 << 2;

/// What the generators of a firmware can do.
#[derive(Clone, Copy, Debug)]
pub(super) struct Firmware {
    pub clock_hz: u32,
    pub has_swap: bool,
    pub has_latch: bool,
    /// There are pins for tables.
    pub has_table: bool,
}
