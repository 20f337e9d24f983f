//! Diagnosis of a board, its network and its computer: figures and verdicts on them.
//!
//! [`Host`] reads the figures of a Linux computer, [`RoundTrips::measure`] and [`Packets`] have
//! those of the connection to a board; the functions of [`computer`], [`network`] and [`board`] are
//! pure: they turn figures into [`Finding`]s. [`wiring`] guides an operator through a check of a
//! cabinet's wires.

pub mod board;
pub mod computer;
mod host;
pub mod network;
mod packets;
mod round_trips;
mod routes;
pub mod wiring;

pub use host::{
    Host, HostLimits, IdleState, Interrupt, LinuxCncDrivers, NetworkCard, NetworkErrors,
    ThreadSettings,
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
    /// Figure found, in words if there is none.
    pub figure: String,
    /// Verdict on the figure.
    pub verdict: FigureVerdict,
    /// Advice; `None` for a good figure.
    pub advice: Option<String>,
}

impl Finding {
    /// Creates the finding for a figure that is in order.
    pub fn good(check: impl Into<String>, figure: impl Into<String>) -> Self {
        let figure = Some(figure.into()).filter(|figure| has_words(figure));
        Self {
            check: check.into(),
            figure: figure.unwrap_or_else(|| "not known".to_owned()),
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
            advice: Some(advice.into()).filter(|advice| has_words(advice)),
            ..Self::good(check, figure)
        }
    }
}

fn has_words(text: &str) -> bool {
    !text.trim().is_empty()
}

/// Returns the worst of several verdicts; [`FigureVerdict::Ok`] without any.
pub fn worst<'a>(findings: impl IntoIterator<Item = &'a Finding>) -> FigureVerdict {
    let verdicts = findings.into_iter().map(|finding| finding.verdict);
    verdicts.max().unwrap_or(FigureVerdict::Ok)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finding_has_words_or_no_advice() {
        let blank = Finding::new(FigureVerdict::Look, "fuse", " ", "");
        assert_eq!((&*blank.figure, blank.advice), ("not known", None));
        let whole = Finding::new(FigureVerdict::Bad, "fuse", "blown", "replace it");
        assert_eq!(
            (&*whole.figure, whole.advice.as_deref()),
            ("blown", Some("replace it"))
        );
    }
}
