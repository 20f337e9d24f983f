//! Checks of the settings of an application: on their own, and against a firmware.

use alloc::format;
use alloc::string::String;
use core::time::Duration;

use super::{Defaults, Settings};
use crate::advice::{self, Advice};
use crate::hal::is_scale;
use crate::hostmot2::{CountedKind, Gtag, HostMot2};
use crate::modules::led::LEDS;
use crate::modules::{RegisterError, built_in};
use crate::sslbp::PortLayout;

/// Greatest number of cycles for which old inputs may count as valid.
const LONGEST_STALE: u32 = 1_000;

/// Greatest value of the parameter `watchdog.timeout_ns`.
const LONGEST_WATCHDOG: Duration = Duration::from_nanos(u32::MAX as u64);

impl Settings {
    /// Refuses values that are invalid for any board.
    pub(crate) fn check(&self) -> Result<(), RegisterError> {
        let watchdog = self.watchdog_time();
        if watchdog > LONGEST_WATCHDOG {
            return refused(
                advice::SET_WATCHDOG,
                "the board's watchdog",
                format!("{watchdog:?}"),
                "at most 4.29 s, as many nanoseconds as its parameter holds",
            );
        }
        if self.bus_error_limit == 0 {
            return refused(
                advice::SET_BUS_ERROR_LIMIT,
                "failures in a row that make everything safe",
                "0".into(),
                "at least 1",
            );
        }
        self.check_fault_policy()?;
        self.check_instances()?;
        let mut scales = self.pwm.values().filter_map(|config| config.scale);
        if let Some(scale) = scales.find(|&scale| !is_scale(scale)) {
            return refused(
                advice::SET_PWM,
                "the scale of a PWM generator",
                format!("{scale}"),
                "a number other than 0, its size from 1e-100 to 1e100",
            );
        }
        Ok(())
    }

    fn check_fault_policy(&self) -> Result<(), RegisterError> {
        let policy = &self.fault_policy;
        if policy.fault_lim == 0 || policy.fault_inc == 0 {
            return refused(
                advice::SET_FAULT_POLICY,
                "counters of failed transfers",
                format!(
                    "fault_inc {}, fault_lim {}",
                    policy.fault_inc, policy.fault_lim
                ),
                "both at least 1: else a remote goes offline without a failure, or never",
            );
        }
        if !(1..=LONGEST_STALE).contains(&policy.stale_after) {
            return refused(
                advice::SET_STALE_AFTER,
                "cycles after which inputs are no longer valid",
                format!("{}", policy.stale_after),
                "1 to 1000",
            );
        }
        Ok(())
    }

    /// Refuses kinds that cannot be counted, and ports that are set up and not used.
    fn check_instances(&self) -> Result<(), RegisterError> {
        let is_key = |gtag: Gtag| CountedKind::of(gtag).is_some_and(|kind| kind.key() == gtag);
        if let Some(gtag) = self.instances.keys().find(|gtag| !is_key(**gtag)) {
            let keys = CountedKind::ALL.map(|kind| format!("{}", kind.key()));
            return refused(
                advice::SET_INSTANCES,
                "module of which instances are counted",
                format!("{gtag}"),
                &keys.join(", "),
            );
        }
        let ports = self.limit(Gtag::SSERIAL);
        let unused = ports.and_then(|ports| self.serial_ports.range(ports..).next());
        match (ports, unused) {
            (Some(ports), Some((port, _))) => refused(
                advice::SET_INSTANCES,
                "serial port that is set up",
                format!("{port}"),
                &format!("less than {ports}, the number of ports in use"),
            ),
            _ => Ok(()),
        }
    }

    /// Refuses to use more instances than a firmware has.
    pub(super) fn check_firmware(&self, firmware: &HostMot2) -> Result<(), RegisterError> {
        for (&gtag, &count) in &self.instances {
            let Some(kind) = CountedKind::of(gtag) else {
                continue;
            };
            let available = available(kind, firmware);
            let is_allowed = self.defaults == Defaults::LinuxCnc && is_lenient(kind, available);
            if usize::from(count) > available && !is_allowed {
                return refused(
                    advice::SET_INSTANCES,
                    "instances of a module in use",
                    format!("{} {count}", kind.name),
                    &format!("at most {available}, which this firmware has"),
                );
            }
        }
        Ok(())
    }
}

fn refused(
    advice: Advice,
    what: &'static str,
    found: String,
    expected: &str,
) -> Result<(), RegisterError> {
    let expected = expected.into();
    Err(RegisterError::Setting {
        what,
        found,
        expected,
        advice,
    })
}

/// Number of instances of a kind that a firmware has and this crate drives.
fn available(kind: &CountedKind, firmware: &HostMot2) -> usize {
    if kind.key() == Gtag::SSERIAL {
        return PortLayout::ports(firmware).len();
    }
    let modules = firmware.modules.iter();
    let driven = modules
        .filter(|module| kind.gtags.contains(&module.gtag) && built_in::check(module).is_ok());
    let all: usize = driven.map(|module| usize::from(module.instances)).sum();
    match kind.key() {
        Gtag::LED if all > 0 => LEDS,
        Gtag::HM2DPLL => all.min(1),
        _ => all,
    }
}

/// True if a number beyond the [available](available) one means all of them: in LinuxCNC a module
/// that the firmware does not have, the LEDs, and the phase-locked loop.
fn is_lenient(kind: &CountedKind, available: usize) -> bool {
    available == 0 || matches!(kind.key(), Gtag::LED | Gtag::HM2DPLL)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::advice::MesaError;
    use crate::driver::PwmConfig;

    #[test]
    fn numbers_that_mean_nothing_are_refused_and_named() {
        type Change = fn(&mut Settings);
        let with = |change: Change| {
            let mut settings = Settings::default();
            change(&mut settings);
            settings.check().map_err(|error| {
                let advice = error.advice().expect("the setting");
                format!("{error}; {advice}")
            })
        };
        assert_eq!(with(|_| {}), Ok(()));
        assert_eq!(with(|s| s.fault_policy.fault_lim = u32::MAX), Ok(()));
        assert_eq!(with(|s| s.fault_policy.stale_after = 1_000), Ok(()));
        let wrong: [(Change, &str); 8] = [
            (|s| s.bus_error_limit = 0, "Settings::bus_error_limit"),
            (|s| s.fault_policy.fault_lim = 0, "fault_lim 0"),
            (|s| s.fault_policy.fault_inc = 0, "fault_inc 0"),
            (|s| s.fault_policy.stale_after = 0, "1 to 1000"),
            (|s| s.fault_policy.stale_after = u32::MAX, "4294967295"),
            (|s| s.watchdog = Some(Duration::from_secs(5)), "4.29 s"),
            (|s| spindle(s, 0.0), "Settings::pwm"),
            (|s| spindle(s, f64::NAN), "NaN"),
        ];
        for (change, named) in wrong {
            let refused = with(change).unwrap_err();
            assert!(refused.contains(named), "{refused}");
        }
    }

    fn spindle(settings: &mut Settings, scale: f64) {
        let config = PwmConfig {
            scale: Some(scale),
            ..PwmConfig::default()
        };
        settings.pwm.insert(6, config);
    }
}
