//! Ability of a computer to keep a period.

use super::{
    FigureVerdict, Finding, Host, HostLimits, IdleState, Interrupt, LinuxCncDrivers, NetworkCard,
    NetworkErrors,
};

/// Priority that a cycle needs to run before the interrupt threads of other devices.
const PRIORITY: u64 = 50;
/// Wake-up time of an idle state that does no harm, in microseconds.
const WAKE_US: u32 = 20;

/// Judges all figures that are readable without special rights. `interface` is that of the board.
pub fn all(host: &Host, interface: Option<&str>) -> Vec<Finding> {
    let mut findings = vec![
        kernel(host.is_realtime()),
        priority(host.limits()),
        memory(host.limits()),
        isolated(host.cpus().as_deref(), host.isolated().as_deref()),
        governor(&host.governors()),
        idle(&host.idle_states()),
        linuxcnc(host.linuxcnc()),
    ];
    if let Some(interface) = interface {
        let cpus = host.cpus().map_or(0, |cpus| cpus.len());
        findings.push(card(interface, host.network_card(interface).as_ref()));
        findings.push(errors(interface, host.network_errors(interface)));
        findings.push(interrupts(interface, &host.interrupts(interface), cpus));
        findings.push(coalescing(interface, host.held_back_ns(interface)));
    }
    findings
}

/// Judges the kernel.
pub fn kernel(is_realtime: Option<bool>) -> Finding {
    let check = "kernel";
    match is_realtime {
        Some(true) => Finding::good(check, "PREEMPT_RT"),
        Some(false) => Finding::new(
            FigureVerdict::Look,
            check,
            "not PREEMPT_RT",
            "delays of milliseconds are normal under load; install one that is (Debian: \
             linux-image-rt-amd64)",
        ),
        None => Finding::new(
            FigureVerdict::Unknown,
            check,
            "cannot be read",
            "is this Linux?",
        ),
    }
}

/// Judges LinuxCNC's drivers for Ethernet boards: one that runs is another master of the board.
pub fn linuxcnc(drivers: Option<LinuxCncDrivers>) -> Finding {
    let check = "LinuxCNC";
    match drivers {
        None => Finding::good(check, "not installed"),
        Some(LinuxCncDrivers {
            is_running: true,
            loaded,
            ..
        }) => Finding::new(
            FigureVerdict::Look,
            check,
            match loaded {
                Some(driver) => format!("runs with {driver}"),
                None => "runs; root can see with which driver".into(),
            },
            "end it before a command drives the board",
        ),
        Some(LinuxCncDrivers { has_mesa_eth, .. }) => {
            let component = if has_mesa_eth {
                "with mesa_eth"
            } else {
                "without mesa_eth"
            };
            Finding::good(check, format!("installed, {component}"))
        }
    }
}

/// Judges the highest realtime priority of a thread.
pub fn priority(limits: Option<HostLimits>) -> Finding {
    let check = "realtime priority";
    match limits {
        Some(limits) if limits.may_schedule => Finding::good(check, "CAP_SYS_NICE: up to 99"),
        Some(HostLimits { priority, .. }) if priority >= PRIORITY => {
            Finding::good(check, format!("up to {priority}"))
        }
        Some(HostLimits { priority, .. }) => Finding::new(
            FigureVerdict::Look,
            check,
            format!("up to {priority}, {PRIORITY} are needed"),
            "put `USER - rtprio 95` into a file in /etc/security/limits.d, and log in again",
        ),
        None => unknown(check, "ulimit -r"),
    }
}

/// Judges the limit of locked memory, which is never swapped out.
pub fn memory(limits: Option<HostLimits>) -> Finding {
    let check = "locked memory";
    match limits {
        Some(limits) if limits.may_lock => Finding::good(check, "CAP_IPC_LOCK: all of it"),
        Some(HostLimits { memory: None, .. }) => Finding::good(check, "all of it"),
        Some(HostLimits {
            memory: Some(bytes),
            ..
        }) => Finding::new(
            FigureVerdict::Look,
            check,
            format!(
                "up to {} KiB, and a controller locks all that it ever asks for",
                bytes >> 10
            ),
            "put `USER - memlock unlimited` into a file in /etc/security/limits.d, and log in again",
        ),
        None => unknown(check, "ulimit -l"),
    }
}

/// Judges the isolation of a CPU for the cycle.
pub fn isolated(cpus: Option<&[usize]>, isolated: Option<&[usize]>) -> Finding {
    let check = "isolated CPUs";
    match (cpus, isolated) {
        (_, Some([_, ..])) => Finding::good(check, format!("{:?}", isolated.unwrap_or_default())),
        (Some([_]), _) => Finding::new(
            FigureVerdict::Look,
            check,
            "none, there is only one CPU",
            "use a computer with two or more",
        ),
        (Some(cpus), Some([])) => {
            let last = cpus.last().copied().unwrap_or_default();
            let figure = format!("none of {}", cpus.len());
            let advice = format!(
                "add `isolcpus={last}` to the kernel's command line, and run the cycle on CPU {last}"
            );
            Finding::new(FigureVerdict::Look, check, figure, advice)
        }
        _ => unknown(check, "cat /sys/devices/system/cpu/isolated"),
    }
}

/// Judges the frequency control of the CPUs.
pub fn governor(governors: &[String]) -> Finding {
    let check = "CPU frequency";
    let Some(slow) = governors.iter().find(|governor| *governor != "performance") else {
        return match governors {
            [] => Finding::new(
                FigureVerdict::Unknown,
                check,
                "not set by the kernel",
                "a virtual machine, or a fixed frequency: look into the computer's set-up (BIOS)",
            ),
            _ => Finding::good(check, "performance on all CPUs"),
        };
    };
    Finding::new(
        FigureVerdict::Look,
        check,
        format!("governor {slow}"),
        "`sudo cpupower frequency-set --governor performance`",
    )
}

/// Judges the idle states of the CPUs.
pub fn idle(states: &[IdleState]) -> Finding {
    let check = "CPU idle states";
    let on = states.iter().filter(|state| !state.is_disabled);
    match on.max_by_key(|state| state.latency_us) {
        None => Finding::new(
            FigureVerdict::Unknown,
            check,
            "none is listed",
            "a virtual machine, or they are off: look into the computer's set-up (BIOS)",
        ),
        Some(IdleState {
            name, latency_us, ..
        }) if *latency_us <= WAKE_US => {
            Finding::good(check, format!("{name}, back after {latency_us} us"))
        }
        Some(IdleState {
            name, latency_us, ..
        }) => Finding::new(
            FigureVerdict::Look,
            check,
            format!("down to {name}, back after {latency_us} us"),
            format!("`sudo cpupower idle-set --disable-by-latency {WAKE_US}`"),
        ),
    }
}

/// Judges the network card by its driver.
pub fn card(interface: &str, card: Option<&NetworkCard>) -> Finding {
    /// Drivers of Intel's cards.
    const INTEL: [&str; 8] = [
        "e1000", "e1000e", "i40e", "ice", "igb", "igbvf", "igc", "ixgbe",
    ];
    let check = "NIC driver";
    let Some(NetworkCard { driver, is_usb }) = card else {
        return unknown(check, &format!("ethtool -i {interface}"));
    };
    let figure = format!("{interface}: {driver}");
    let (verdict, advice) = match driver.as_str() {
        _ if *is_usb => (
            FigureVerdict::Look,
            "a card on USB waits for the bus: use one on PCI Express for the board",
        ),
        "r8169" => (
            FigureVerdict::Look,
            "with some Realtek cards replies come milliseconds late: install the driver r8168 (Debian: \
             r8168-dkms), or use an Intel card",
        ),
        driver if INTEL.contains(&driver) => return Finding::good(check, figure),
        _ => (
            FigureVerdict::Unknown,
            "Intel cards are known to answer in time; `mesa latency` measures this one",
        ),
    };
    Finding::new(verdict, check, figure, advice)
}

/// Judges the packets that the network card has lost.
pub fn errors(interface: &str, errors: Option<NetworkErrors>) -> Finding {
    let check = "NIC errors";
    let Some(NetworkErrors { damaged, dropped }) = errors else {
        return unknown(check, &format!("ip -s link show {interface}"));
    };
    let figure = format!("{interface}: {damaged} received damaged, {dropped} dropped");
    let advice = match (damaged, dropped) {
        (0, 0) => return Finding::good(check, figure),
        (0, _) => {
            "the computer did not fetch packets in time: see kernel, priority, CPUs and interrupts"
        }
        (_, 1..) => {
            "damaged: check the cable, its plugs and its shield; dropped: the computer did not fetch packets \
             in time, see kernel, priority, CPUs and interrupts"
        }
        _ => "check the cable, its plugs and its shield, and where it runs beside motor cables",
    };
    Finding::new(FigureVerdict::Look, check, figure, advice)
}

/// Judges the CPUs of the network card's interrupts.
pub fn interrupts(interface: &str, interrupts: &[Interrupt], cpus: usize) -> Finding {
    let check = "NIC interrupts";
    let known: Vec<_> = interrupts
        .iter()
        .filter(|one| !one.cpus.is_empty())
        .collect();
    let Some(first) = known.first() else {
        return unknown(check, &format!("grep {interface} /proc/interrupts"));
    };
    let places: Vec<String> = known
        .iter()
        .map(|one| format!("{} on CPU {:?}", one.number, one.cpus))
        .collect();
    let figure = format!("{interface}: {}", places.join(", "));
    let is_anywhere = known
        .iter()
        .any(|one| one.cpus.len() > 1 && one.cpus.len() >= cpus);
    if !is_anywhere {
        return Finding::good(check, figure);
    }
    let advice = format!(
        "keep them on one CPU: stop irqbalance, `echo CPU | sudo tee /proc/irq/{}/smp_affinity_list`",
        first.number
    );
    Finding::new(FigureVerdict::Look, check, figure, advice)
}

/// Judges interrupt coalescing, which holds packets back to save interrupts.
pub fn coalescing(interface: &str, held_back_ns: Option<u64>) -> Finding {
    let check = "NIC interrupt coalescing";
    let own = format!(
        "what the card itself does needs `ethtool -c {interface}`: `sudo ethtool -C {interface} rx-usecs \
         0` switches it off"
    );
    match held_back_ns {
        Some(ns) if ns > 0 => Finding::new(
            FigureVerdict::Look,
            check,
            format!("the kernel holds packets back for {} us", ns / 1000),
            format!("`echo 0 | sudo tee /sys/class/net/{interface}/napi_defer_hard_irqs`; {own}"),
        ),
        Some(_) => Finding::new(FigureVerdict::Unknown, check, "none by the kernel", own),
        None => Finding::new(FigureVerdict::Unknown, check, "cannot be read", own),
    }
}

fn unknown(check: &str, command: &str) -> Finding {
    let advice = format!("`{command}` may show it");
    Finding::new(FigureVerdict::Unknown, check, "cannot be read", advice)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdicts<const N: usize>(findings: [Finding; N]) -> [FigureVerdict; N] {
        let is_told =
            |finding: &Finding| (finding.verdict == FigureVerdict::Ok) == finding.advice.is_none();
        assert!(findings.iter().all(is_told), "{findings:?}");
        findings.map(|finding| finding.verdict)
    }
    use FigureVerdict::{Look, Ok, Unknown};

    const LIMITS: HostLimits = HostLimits {
        priority: 0,
        memory: Some(8 << 20),
        may_schedule: false,
        may_lock: false,
    };

    #[test]
    fn computer_that_is_made_for_it_is_good() {
        let root = HostLimits {
            may_schedule: true,
            may_lock: true,
            ..LIMITS
        };
        let user = HostLimits {
            priority: 95,
            memory: None,
            ..LIMITS
        };
        let c1 = IdleState {
            name: "C1".into(),
            latency_us: 2,
            is_disabled: false,
        };
        let c6 = IdleState {
            name: "C6".into(),
            latency_us: 133,
            is_disabled: true,
        };
        let one = Interrupt {
            number: 24,
            cpus: vec![1],
        };
        let all = verdicts([
            kernel(Some(true)),
            priority(Some(root)),
            priority(Some(user)),
            memory(Some(root)),
            memory(Some(user)),
            isolated(Some(&[0, 1]), Some(&[1])),
            governor(&["performance".into(), "performance".into()]),
            idle(&[c1, c6]),
            interrupts("eth0", &[one], 4),
        ]);
        assert_eq!(all, [Ok; 9]);
    }

    #[test]
    fn causes_of_late_cycles_rate_look_and_missing_data_unknown() {
        let c6 = IdleState {
            name: "C6".into(),
            latency_us: 133,
            is_disabled: false,
        };
        let anywhere = Interrupt {
            number: 24,
            cpus: vec![0, 1],
        };
        let hidden = Interrupt {
            number: 24,
            cpus: vec![],
        };
        let all = verdicts([
            kernel(Some(false)),
            priority(Some(LIMITS)),
            memory(Some(LIMITS)),
            isolated(Some(&[0, 1]), Some(&[])),
            isolated(Some(&[0]), Some(&[])),
            governor(&["performance".into(), "powersave".into()]),
            idle(&[c6]),
            interrupts("eth0", &[anywhere], 2),
            coalescing("eth0", Some(20_000)),
        ]);
        assert_eq!(all, [Look; 9]);
        let all = verdicts([
            kernel(None),
            priority(None),
            memory(None),
            isolated(None, None),
            governor(&[]),
            idle(&[]),
            interrupts("eth0", &[hidden], 2),
            coalescing("eth0", None),
            coalescing("eth0", Some(0)),
        ]);
        assert_eq!(all, [Unknown; 9]);
    }

    #[test]
    fn network_cards_are_judged_by_what_is_known_of_their_drivers() {
        let of = |driver: &str, is_usb| NetworkCard {
            driver: driver.to_owned(),
            is_usb,
        };
        for (found, verdict, advice) in [
            (of("igc", false), Ok, ""),
            (of("r8169", false), Look, "r8168-dkms"),
            (of("r8168", false), Unknown, "mesa latency"),
            (of("ax88179_178a", true), Look, "on PCI Express"),
        ] {
            let finding = card("eth0", Some(&found));
            assert_eq!(finding.verdict, verdict, "{finding:?}");
            assert!(finding.advice.unwrap_or_default().contains(advice));
        }
        assert_eq!(card("eth0", None).verdict, Unknown);
    }

    #[test]
    fn damaged_packets_blame_the_cable_dropped_ones_the_computer() {
        let of = |damaged, dropped| errors("eth0", Some(NetworkErrors { damaged, dropped }));
        assert_eq!(of(0, 0).verdict, Ok);
        for (finding, advice) in [
            (of(3, 0), "cable"),
            (of(3, 1), "cable"),
            (of(3, 1), "in time"),
            (of(0, 1), "in time"),
        ] {
            assert_eq!(finding.verdict, Look, "{finding:?}");
            assert!(finding.advice.is_some_and(|told| told.contains(advice)));
        }
        assert_eq!(errors("eth0", None).verdict, Unknown);
    }
}
