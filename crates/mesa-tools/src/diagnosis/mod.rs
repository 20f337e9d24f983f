//! Diagnosis of a board, its network and its computer: figures and verdicts on them.
//!
//! [`Host`] reads the figures of a Linux computer, [`RoundTrips::measure`] and [`Packets`] have those
//! of the connection to a board; the functions of [`computer`], [`network`] and [`board`] are pure: they turn figures
//! into [`Finding`]s. [`wiring`] guides an operator through a check of a cabinet's wires.

pub mod board;
pub mod computer;
mod host;
pub mod network;
mod packets;
mod round_trips;
pub mod wiring;

pub use host::{
    Host, HostLimits, IdleState, Interrupt, NetworkCard, NetworkErrors, ThreadSettings,
};
pub use packets::{BoardCounts, PacketMark, Packets};
pub use round_trips::RoundTrips;

/// Verdict on a figure, from good to bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum FigureVerdict {
    /// In order.
    Ok,
    /// The figure could not be determined.
    Unknown,
    /// A machine runs with this figure, but could run better: worth a look.
    Look,
    /// A machine does not run with this figure, or not safely.
    Bad,
}

/// A figure and its meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Finding {
    /// Name of the check.
    pub check: String,
    /// Figure found.
    pub figure: String,
    /// Verdict on the figure.
    pub verdict: FigureVerdict,
    /// Advice; `None` for a good figure.
    pub advice: Option<String>,
}

impl Finding {
    /// Creates the finding for a figure that is in order.
    pub fn good(check: impl Into<String>, figure: impl Into<String>) -> Self {
        Self {
            check: check.into(),
            figure: figure.into(),
            verdict: FigureVerdict::Ok,
            advice: None,
        }
    }

    /// Creates the finding for a figure that needs attention.
    pub fn new(
        verdict: FigureVerdict,
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

/// Returns the worst of several verdicts; [`FigureVerdict::Ok`] without any.
pub fn worst<'a>(findings: impl IntoIterator<Item = &'a Finding>) -> FigureVerdict {
    let verdicts = findings.into_iter().map(|finding| finding.verdict);
    verdicts.max().unwrap_or(FigureVerdict::Ok)
}
