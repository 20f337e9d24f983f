//! Events: their causes, order, texts and number.

pub mod by_fault;
mod occurrences;
