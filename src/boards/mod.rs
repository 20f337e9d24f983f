//! The boards: which remote or module is which pin.
