//! The number of instances of each kind of module that is used.

use alloc::format;
#[cfg(feature = "serde")]
use alloc::string::String;

use super::{Defaults, NotedWord, Settings, refused};
use crate::advice::Advice;
use crate::hostmot2::{Gtag, HostMot2};
use crate::modules::RegisterError;
use crate::modules::led::LEDS;
use crate::modules::undriven::check;
use crate::sslbp::PortLayout;

/// A kind of module of which an application may use fewer instances than the firmware has.
#[derive(Debug)]
pub(crate) struct CountedKind {
    /// LinuxCNC's name, as in the names of pins.
    pub name: &'static str,
    /// The modules of this kind, whose instances are counted together; the first is the key in
    /// [`Settings::instances`].
    gtags: &'static [Gtag],
}

impl CountedKind {
    /// All kinds.
    pub const ALL: [Self; 10] = [
        Self::new("encoder", &[Gtag::ENCODER, Gtag::MUXED_ENCODER]),
        Self::new("pwmgen", &[Gtag::PWM]),
        Self::new("stepgen", &[Gtag::STEPGEN]),
        Self::new("sserial", &[Gtag::SSERIAL, Gtag::SSERIAL_B]),
        Self::new("dpll", &[Gtag::HM2DPLL]),
        Self::new("inmux", &[Gtag::IN_MUX]),
        Self::new("inm", &[Gtag::IN_M]),
        Self::new("ssr", &[Gtag::SSR]),
        Self::new("outm", &[Gtag::OUT_M]),
        Self::new("led", &[Gtag::LED]),
    ];

    const fn new(name: &'static str, gtags: &'static [Gtag]) -> Self {
        Self { name, gtags }
    }

    /// The kind to which a module belongs.
    pub fn of(gtag: Gtag) -> Option<&'static Self> {
        Self::ALL.iter().find(|kind| kind.gtags.contains(&gtag))
    }

    /// The kind with LinuxCNC's name.
    pub fn named(name: &str) -> Option<&'static Self> {
        Self::ALL.iter().find(|kind| kind.name == name)
    }

    /// The key in [`Settings::instances`].
    pub fn key(&self) -> Gtag {
        self.gtags.first().copied().unwrap_or_default()
    }

    /// Number of instances that a firmware has and this crate drives.
    fn available(&self, firmware: &HostMot2) -> usize {
        if self.key() == Gtag::SSERIAL {
            return PortLayout::ports(firmware).len();
        }
        let modules = firmware.modules.iter();
        let driven =
            modules.filter(|module| self.gtags.contains(&module.gtag) && check(module).is_ok());
        let all: usize = driven.map(|module| usize::from(module.instances)).sum();
        match self.key() {
            Gtag::LED if all > 0 => LEDS,
            Gtag::HM2DPLL => all.min(1),
            _ => all,
        }
    }

    /// True if a number beyond the [available](Self::available) one means all of them: in LinuxCNC
    /// a module that the firmware does not have, the LEDs, and the phase-locked loop.
    fn is_lenient(&self, available: usize) -> bool {
        available == 0 || matches!(self.key(), Gtag::LED | Gtag::HM2DPLL)
    }
}

impl Settings {
    /// Number of instances of the kind of this module that are used; `None` for all.
    pub(crate) fn limit(&self, gtag: Gtag) -> Option<u8> {
        let key = CountedKind::of(gtag)?.key();
        self.instances.get(&key).copied()
    }

    /// Refuses kinds that cannot be counted, and ports that are set up and not used.
    pub(super) fn check_instances(&self) -> Result<(), RegisterError> {
        let is_key = |gtag: Gtag| CountedKind::of(gtag).is_some_and(|kind| kind.key() == gtag);
        if let Some(gtag) = self.instances.keys().find(|gtag| !is_key(**gtag)) {
            let keys = CountedKind::ALL.map(|kind| format!("{}", kind.key()));
            return refused(
                Advice::SetInstances,
                "module of which instances are counted",
                format!("{gtag}"),
                &keys.join(", "),
            );
        }
        let ports = self.limit(Gtag::SSERIAL);
        let unused = ports.and_then(|ports| self.serial_ports.range(ports..).next());
        match (ports, unused) {
            (Some(ports), Some((port, _))) => refused(
                Advice::SetInstances,
                "serial port that is set up",
                format!("{port}"),
                &format!("less than {ports}, the number of ports in use"),
            ),
            _ => Ok(()),
        }
    }

    /// Refuses to use more instances than a firmware has, and words for modules that it has and this
    /// crate does not drive.
    pub(crate) fn check_firmware(&self, firmware: &HostMot2) -> Result<(), RegisterError> {
        self.check_words(firmware)?;
        for (&gtag, &count) in &self.instances {
            let Some(kind) = CountedKind::of(gtag) else {
                continue;
            };
            let available = kind.available(firmware);
            let is_allowed = self.defaults == Defaults::LinuxCnc && kind.is_lenient(available);
            if usize::from(count) > available && !is_allowed {
                return refused(
                    Advice::SetInstances,
                    "instances of a module in use",
                    format!("{} {count}", kind.name),
                    &format!("at most {available}, which this firmware has"),
                );
            }
        }
        Ok(())
    }

    fn check_words(&self, firmware: &HostMot2) -> Result<(), RegisterError> {
        for noted in &self.words {
            let NotedWord::OfModules { word, what, gtags } = noted else {
                continue;
            };
            let modules = firmware
                .modules
                .iter()
                .filter(|module| module.instances > 0);
            let mut asked = modules.filter(|module| gtags.contains(&module.gtag));
            if let Some(module) = asked.next() {
                let gtag = module.gtag;
                return refused(
                    Advice::LeaveWordOut,
                    "hostmot2 configuration word",
                    format!("'{word}'"),
                    &format!(
                        "none for {what}, because this crate does not drive those of the firmware ({gtag})"
                    ),
                );
            }
        }
        Ok(())
    }

    /// LinuxCNC's names of the kinds that can be counted, for error texts.
    #[cfg(feature = "serde")]
    pub(crate) fn counted_names() -> String {
        CountedKind::ALL.map(|kind| kind.name).join("', '")
    }
}
