//! What is wrong with a board, its network and its computer: figures, and what they mean.
//!
//! [`Host`] reads the figures of a Linux computer, [`RoundTrips::measure`] those of the way to a board;
//! the functions of [`computer`], [`network`] and [`board`] are pure: they take figures, and give
//! [`Finding`]s. [`wiring`] guides whoever checks the wires of a cabinet.

pub mod board;
pub mod computer;
mod host;
pub mod network;
mod round_trips;
pub mod wiring;

pub use host::{Host, IdleState, Interrupt, Limits};
pub use round_trips::RoundTrips;

/// How a figure is judged, from good to bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Verdict {
    /// As it should be.
    Ok,
    /// It could not be found out.
    Unknown,
    /// A machine can run so, but worse than it could: worth a look.
    Look,
    /// A machine does not run so, or not safely.
    Bad,
}

/// One figure, and what it means.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Finding {
    /// What was looked at.
    pub check: String,
    /// What was found.
    pub figure: String,
    /// What it means.
    pub verdict: Verdict,
    /// What to do; none if it is good.
    pub advice: Option<String>,
}

impl Finding {
    /// A figure that is as it should be.
    pub fn good(check: impl Into<String>, figure: impl Into<String>) -> Self {
        Self {
            check: check.into(),
            figure: figure.into(),
            verdict: Verdict::Ok,
            advice: None,
        }
    }

    /// A figure that something should be done about.
    pub fn new(
        verdict: Verdict,
        check: impl Into<String>,
        figure: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        Self {
            verdict,
            advice: Some(advice.into()),
            ..Self::good(check, figure)
        }
    }
}

/// The worst of several verdicts; [`Verdict::Ok`] of none.
pub fn worst<'a>(findings: impl IntoIterator<Item = &'a Finding>) -> Verdict {
    let verdicts = findings.into_iter().map(|finding| finding.verdict);
    verdicts.max().unwrap_or(Verdict::Ok)
}
