//! LBP16 packets as bytes: command words, eight spaces, info areas. Pure, no I/O.
