//! Connectors that several boards have.

/// The pins of a DB25 connector of 17 I/O pins, in their order (manuals 7I77 and 7I97).
pub const DB25: [u8; 17] = [1, 14, 2, 15, 3, 16, 4, 17, 5, 6, 7, 8, 9, 10, 11, 12, 13];
