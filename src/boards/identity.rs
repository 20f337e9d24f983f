//! A remote of another identity.

use alloc::string::String;

use crate::advice::{Advice, MesaError};

/// A remote that differs from the requested one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{actual}, expected {expected}")]
#[non_exhaustive]
pub struct IdentityError {
    /// The actual remote.
    pub actual: String,
    /// The expected remote.
    pub expected: String,
    /// The next step.
    pub advice: Advice,
}

impl MesaError for IdentityError {
    fn advice(&self) -> Option<Advice> {
        Some(self.advice)
    }
}
