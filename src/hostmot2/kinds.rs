//! Kinds of modules whose instances are counted, with LinuxCNC's names.

use super::Gtag;

/// A kind of module of which an application may use fewer instances than the firmware has.
///
/// Source: manual page hostmot2(9), "config modparam".
#[derive(Debug)]
pub struct CountedKind {
    /// LinuxCNC's name, as in the names of pins.
    pub name: &'static str,
    /// LinuxCNC's word in `config=` for the number of instances; `None` for serial ports, which
    /// have a word of another form.
    pub word: Option<&'static str>,
    /// The modules of this kind, whose instances are counted together; the first is the key in
    /// [`Settings::instances`](crate::Settings::instances).
    pub gtags: &'static [Gtag],
}

impl CountedKind {
    /// All kinds.
    pub const ALL: [Self; 10] = [
        Self::new("encoder", &[Gtag::ENCODER, Gtag::MUXED_ENCODER]).by("num_encoders"),
        Self::new("pwmgen", &[Gtag::PWM]).by("num_pwmgens"),
        Self::new("stepgen", &[Gtag::STEPGEN]).by("num_stepgens"),
        Self::new("sserial", &[Gtag::SSERIAL, Gtag::SSERIAL_B]),
        Self::new("dpll", &[Gtag::HM2DPLL]).by("num_dplls"),
        Self::new("inmux", &[Gtag::IN_MUX]).by("num_inmuxs"),
        Self::new("inm", &[Gtag::IN_M]).by("num_inms"),
        Self::new("ssr", &[Gtag::SSR]).by("num_ssrs"),
        Self::new("outm", &[Gtag::OUT_M]).by("num_outms"),
        Self::new("led", &[Gtag::LED]).by("num_leds"),
    ];

    const fn new(name: &'static str, gtags: &'static [Gtag]) -> Self {
        Self {
            name,
            word: None,
            gtags,
        }
    }

    const fn by(self, word: &'static str) -> Self {
        Self {
            word: Some(word),
            ..self
        }
    }

    /// The kind to which a module belongs.
    pub fn of(gtag: Gtag) -> Option<&'static Self> {
        Self::ALL.iter().find(|kind| kind.gtags.contains(&gtag))
    }

    /// The kind with LinuxCNC's name.
    pub fn named(name: &str) -> Option<&'static Self> {
        Self::ALL.iter().find(|kind| kind.name == name)
    }

    /// The kind that a word of `config=` counts.
    pub fn counted_by(word: &str) -> Option<&'static Self> {
        Self::ALL.iter().find(|kind| kind.word == Some(word))
    }

    /// The key in [`Settings::instances`](crate::Settings::instances).
    pub fn key(&self) -> Gtag {
        self.gtags.first().copied().unwrap_or_default()
    }
}
