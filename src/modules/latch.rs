//! One-shot requests of a latch, by the modules that have one.

/// A one-shot latch request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(super) enum LatchRequest {
    /// Nothing.
    #[default]
    None,
    /// At the index: `index-enable` of LinuxCNC.
    Index,
    /// At the edge of the probe.
    Probe,
}

impl LatchRequest {
    /// The request of two pins, of which the index comes first.
    pub const fn of(index: bool, probe: bool) -> Self {
        match (index, probe) {
            (true, _) => Self::Index,
            (false, true) => Self::Probe,
            (false, false) => Self::None,
        }
    }
}

/// Progress of a request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum LatchStage {
    /// The register still shows an earlier request, or its content is unknown: nothing is written
    /// until that request is gone, so that its end is not taken for the end of this one.
    #[default]
    Settling,
    /// Not seen in the register yet.
    Asked,
    /// Seen in the register.
    Armed,
}
