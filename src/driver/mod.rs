//! The cycle: `read()` and `write()` on a planned image, faults, recovery, statistics.
