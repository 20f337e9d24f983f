//! Figures of a Linux computer, from its `/proc` and `/sys`.

use std::fs;
use std::path::{Path, PathBuf};

/// A Linux computer: reads `/proc` and `/sys` below a root directory, without special rights.
#[derive(Clone, Debug)]
pub struct Host {
    root: PathBuf,
}

/// Scheduling and memory limits of a program. Source: `/proc/self/limits` and `/proc/self/status`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostLimits {
    /// Highest `SCHED_FIFO` priority, 0 to 99.
    pub priority: u64,
    /// Maximum number of locked bytes; `None`: unlimited.
    pub memory: Option<u64>,
    /// True with the capability `CAP_SYS_NICE`: any priority.
    pub may_schedule: bool,
    /// True with the capability `CAP_IPC_LOCK`: any number of bytes.
    pub may_lock: bool,
}

/// Idle state of a CPU. Source: `cpuidle` of `/sys/devices/system/cpu/cpu0`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdleState {
    /// Name of the state: `C6`.
    pub name: String,
    /// Wake-up time of the CPU, in microseconds.
    pub latency_us: u32,
    /// True if the state is switched off.
    pub is_disabled: bool,
}

/// An interrupt of a network card. Source: `/proc/interrupts`, `/proc/irq`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interrupt {
    /// Number of the interrupt.
    pub number: u32,
    /// CPUs that the interrupt may run on; empty if unreadable.
    pub cpus: Vec<usize>,
}

/// The card of a network interface. Source: `/sys/class/net`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkCard {
    /// Name of its driver: `igb`.
    pub driver: String,
    /// True if it is plugged into USB.
    pub is_usb: bool,
}

/// LinuxCNC's drivers for Ethernet boards. Source: `/usr/lib/linuxcnc/modules`, `/proc/PID/maps`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinuxCncDrivers {
    /// The component `mesa_eth` is installed.
    pub has_mesa_eth: bool,
    /// LinuxCNC runs.
    pub is_running: bool,
    /// The driver that it has loaded; `None` if it has neither, or hides it from this user.
    pub loaded: Option<&'static str>,
}

/// Packets that a network interface has lost. Source: `statistics` of `/sys/class/net`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NetworkErrors {
    /// Received damaged: the cable.
    pub damaged: u64,
    /// Dropped for lack of room: the computer did not fetch them in time.
    pub dropped: u64,
}

/// Settings of a thread that decide when it runs. Source: `/proc/thread-self`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ThreadSettings {
    /// Realtime priority, 1 to 99; `None` for an ordinary thread.
    pub priority: Option<u32>,
    /// CPUs that it may run on.
    pub cpus: Vec<usize>,
    /// True if memory of its process is locked.
    pub has_locked_memory: bool,
}

const CAP_IPC_LOCK: u32 = 14;
const CAP_SYS_NICE: u32 = 23;

impl Host {
    /// This computer.
    pub fn here() -> Self {
        Self::below("/")
    }

    /// A computer whose files are below a directory.
    pub fn below(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// Root directory of the files.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn text(&self, path: &str) -> Option<String> {
        let text = fs::read_to_string(self.root.join(path)).ok()?;
        Some(text.trim().to_owned())
    }

    /// LinuxCNC's drivers for Ethernet boards; `None` if LinuxCNC is not installed.
    pub fn linuxcnc(&self) -> Option<LinuxCncDrivers> {
        let modules = self.root.join("usr/lib/linuxcnc/modules");
        let has = |name: &str| modules.join(name).exists();
        let programs = fs::read_dir(self.root.join("proc")).into_iter().flatten();
        let maps = programs.flatten().filter_map(|program| {
            let name = fs::read_to_string(program.path().join("comm")).ok()?;
            let is_linuxcnc = name.starts_with("rtapi_app");
            // It belongs to root, and others may not read them.
            is_linuxcnc.then(|| fs::read_to_string(program.path().join("maps")).unwrap_or_default())
        });
        let maps: Vec<_> = maps.collect();
        let is_loaded = |name: &&str| {
            let file = format!("/{name}.so");
            maps.iter().any(|maps| maps.contains(&file))
        };
        modules.is_dir().then(|| LinuxCncDrivers {
            has_mesa_eth: has("mesa_eth.so"),
            is_running: !maps.is_empty(),
            loaded: ["mesa_eth", "hm2_eth"].into_iter().find(is_loaded),
        })
    }

    /// True if the kernel is fully preemptible (`PREEMPT_RT`).
    pub fn is_realtime(&self) -> Option<bool> {
        if let Some(text) = self.text("sys/kernel/realtime") {
            return Some(text == "1");
        }
        let version = self.text("proc/version")?;
        Some(version.contains("PREEMPT_RT") || version.contains("PREEMPT RT"))
    }

    /// Limits of this program.
    pub fn limits(&self) -> Option<HostLimits> {
        let limits = self.text("proc/self/limits")?;
        let soft = |name: &str| {
            let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
            line.split_whitespace().next()
        };
        let capabilities = self.text("proc/self/status").and_then(|status| {
            let line = status
                .lines()
                .find_map(|line| line.strip_prefix("CapEff:"))?;
            u64::from_str_radix(line.trim(), 16).ok()
        });
        let may = |bit: u32| capabilities.is_some_and(|bits| bits >> bit & 1 != 0);
        Some(HostLimits {
            priority: match soft("Max realtime priority")? {
                "unlimited" => 99,
                number => number.parse().ok()?,
            },
            memory: match soft("Max locked memory")? {
                "unlimited" => None,
                number => Some(number.parse().ok()?),
            },
            may_schedule: may(CAP_SYS_NICE),
            may_lock: may(CAP_IPC_LOCK),
        })
    }

    /// Settings of the calling thread, given by an option or by the program that started it.
    pub fn thread(&self) -> Option<ThreadSettings> {
        const PRIORITY: usize = 37;
        let stat = self.text("proc/thread-self/stat")?;
        // The name in parentheses may contain anything.
        let (_, fields) = stat.rsplit_once(')')?;
        let priority = fields.split_whitespace().nth(PRIORITY)?.parse().ok()?;
        let status = self.text("proc/thread-self/status")?;
        let line = |name: &str| status.lines().find_map(|line| line.strip_prefix(name));
        let locked = line("VmLck:").and_then(|text| text.split_whitespace().next());
        Some(ThreadSettings {
            priority: Some(priority).filter(|priority| *priority > 0),
            cpus: list(line("Cpus_allowed_list:")?),
            has_locked_memory: locked.is_some_and(|kilobytes| kilobytes != "0"),
        })
    }

    /// CPUs that are online.
    pub fn cpus(&self) -> Option<Vec<usize>> {
        Some(list(&self.text("sys/devices/system/cpu/online")?))
    }

    /// CPUs that the kernel keeps free of programs that did not request them.
    pub fn isolated(&self) -> Option<Vec<usize>> {
        Some(list(&self.text("sys/devices/system/cpu/isolated")?))
    }

    /// Frequency governor of each CPU; empty without frequency control.
    pub fn governors(&self) -> Vec<String> {
        let cpus = self.cpus().unwrap_or_default().into_iter();
        let governors = cpus.filter_map(|cpu| {
            self.text(&format!(
                "sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor"
            ))
        });
        governors.collect()
    }

    /// Idle states of a CPU; empty if it has none.
    pub fn idle_states(&self) -> Vec<IdleState> {
        let states = (0..16).map_while(|state| {
            let text = |name: &str| {
                self.text(&format!(
                    "sys/devices/system/cpu/cpu0/cpuidle/state{state}/{name}"
                ))
            };
            Some(IdleState {
                name: text("name")?,
                latency_us: text("latency")?.parse().ok()?,
                is_disabled: text("disable").is_some_and(|disable| disable != "0"),
            })
        });
        states.collect()
    }

    /// Interrupts of a network interface: those with its name, and those of its device.
    pub fn interrupts(&self, interface: &str) -> Vec<Interrupt> {
        let device = format!("sys/class/net/{interface}/device/msi_irqs");
        let of_device = fs::read_dir(self.root.join(device)).into_iter().flatten();
        let of_device =
            of_device.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
        let mut numbers: Vec<u32> = of_device.collect();
        let all = self.text("proc/interrupts").unwrap_or_default();
        numbers.extend(all.lines().filter_map(|line| {
            let (number, rest) = line.split_once(':')?;
            let mut words = rest
                .split_whitespace()
                .skip_while(|word| word.parse::<u64>().is_ok());
            let is_its = |word: &str| {
                let behind = word.strip_prefix(interface);
                behind.is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
            };
            let number = number.trim().parse::<u32>().ok();
            number.filter(|_| words.any(is_its))
        }));
        numbers.sort_unstable();
        numbers.dedup();
        let interrupts = numbers.into_iter().map(|number| Interrupt {
            number,
            cpus: self
                .text(&format!("proc/irq/{number}/smp_affinity_list"))
                .map(|text| list(&text))
                .unwrap_or_default(),
        });
        interrupts.collect()
    }

    /// Driver of a network interface, and whether its card is on USB; `None` without a device.
    pub fn network_card(&self, interface: &str) -> Option<NetworkCard> {
        let device = self.root.join(format!("sys/class/net/{interface}/device"));
        let driver = fs::read_link(device.join("driver")).ok()?;
        let place = fs::canonicalize(&device).ok();
        let place = place.unwrap_or_default().to_string_lossy().into_owned();
        Some(NetworkCard {
            driver: driver.file_name()?.to_str()?.to_owned(),
            is_usb: place.contains("/usb"),
        })
    }

    /// Packets that a network card has received damaged, or that this computer has dropped, since
    /// the interface exists.
    pub fn network_errors(&self, interface: &str) -> Option<NetworkErrors> {
        let count = |name: &str| -> Option<u64> {
            self.text(&format!("sys/class/net/{interface}/statistics/{name}"))?
                .parse()
                .ok()
        };
        let damaged = count("rx_crc_errors")?.saturating_add(count("rx_frame_errors")?);
        let dropped = count("rx_missed_errors")?.saturating_add(count("rx_fifo_errors")?);
        Some(NetworkErrors { damaged, dropped })
    }

    /// Time for which the kernel itself holds packets back, in nanoseconds: `gro_flush_timeout`,
    /// which applies only while `napi_defer_hard_irqs` is not 0.
    pub fn held_back_ns(&self, interface: &str) -> Option<u64> {
        let number = |name: &str| -> Option<u64> {
            self.text(&format!("sys/class/net/{interface}/{name}"))?
                .parse()
                .ok()
        };
        let deferred = number("napi_defer_hard_irqs")?;
        Some(if deferred == 0 {
            0
        } else {
            number("gro_flush_timeout")?
        })
    }
}

/// Parses a list of numbers such as `0-2,5`; skips parts that are not numbers.
fn list(text: &str) -> Vec<usize> {
    /// Limit of a CPU's number, above that of any computer.
    const MAX: usize = 4096;
    let parts = text.split(',').filter_map(|part| {
        let (first, last) = part
            .trim()
            .split_once('-')
            .unwrap_or((part.trim(), part.trim()));
        Some(first.parse().ok()?..=last.parse::<usize>().ok()?.min(MAX))
    });
    parts.flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cpus_are_as_the_kernel_writes_them() {
        assert_eq!(list("0-2,5"), [0, 1, 2, 5]);
        assert_eq!(list(""), [0_usize; 0]);
        assert_eq!(list("7,x,3-1"), [7]);
        assert_eq!(list("0-99999999999").len(), 4097);
    }

    #[test]
    fn host_reports_cpus_and_limits_and_a_missing_root_reports_none() {
        let host = Host::here();
        assert!(!host.cpus().unwrap().is_empty());
        assert!(host.limits().unwrap().priority <= 99);
        assert!(host.is_realtime().is_some());
        let thread = host.thread().unwrap();
        assert!(!thread.cpus.is_empty(), "{thread:?}");
        let nothing = Host::below("/nowhere");
        assert_eq!((nothing.limits(), nothing.cpus()), (None, None));
        assert_eq!(nothing.thread(), None);
        assert_eq!((nothing.is_realtime(), nothing.isolated()), (None, None));
        assert!(nothing.governors().is_empty() && nothing.idle_states().is_empty());
        assert!(nothing.interrupts("eth0").is_empty());
        assert_eq!(nothing.held_back_ns("eth0"), None);
        assert_eq!(nothing.network_card("eth0"), None);
        assert_eq!(nothing.network_errors("eth0"), None);
    }
}
