//! Events: their causes, order, texts and number.

mod by_fault;
mod occurrences;
