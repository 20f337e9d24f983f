use alloc::vec::Vec;
use core::fmt;
use std::io;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

use crate::advice::{self, Advice, MesaError};

/// Settings of Linux for the thread of a cycle; independent of each other, none by default.
///
/// A refused setting is an error with the reason, never ignored: a cycle without its rights misses
/// periods under load.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Realtime {
    /// The priority of `SCHED_FIFO`, 1 to 99: the thread runs before all those with lower priority.
    /// Interrupt threads of a kernel with `PREEMPT_RT` have 50; a cycle over Ethernet must stay
    /// below that of its network card.
    pub priority: Option<u8>,
    /// Keeps all memory of the process in RAM, including later allocations: the cycle never waits
    /// for a page.
    ///
    /// Refused where the number of lockable bytes is limited, even if the current memory fits:
    /// later allocations would fail then, which ends most programs.
    pub lock_memory: bool,
    /// The CPUs that the thread may run on, by number; empty: any. Best is one that the kernel
    /// keeps free of other threads (`isolcpus`).
    pub cpus: Vec<usize>,
}

/// A setting that Linux refuses to the thread of a cycle.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RealtimeError {
    /// The priority.
    #[error("SCHED_FIFO with priority {priority}: {source}")]
    Priority {
        /// The requested priority.
        priority: u8,
        /// The reason.
        source: io::Error,
    },
    /// The number is not a priority.
    #[error("priority {priority}: SCHED_FIFO has priorities from 1 to 99")]
    NoPriority {
        /// The requested priority.
        priority: u8,
    },
    /// The locking of memory.
    #[error("locking the memory: {source}")]
    Memory {
        /// The reason.
        source: io::Error,
    },
    /// The size of lockable memory is limited.
    #[error(
        "locking the memory: no more than {} KiB may be locked (ulimit -l), and requests of the \
         program beyond that would be refused while it runs", bytes >> 10
    )]
    MemoryLimit {
        /// The limit in bytes.
        bytes: u64,
    },
    /// Several settings, each with its reason.
    #[error("{}", Lines(.0))]
    Several(Vec<RealtimeError>),
    /// The CPUs.
    #[error("running on the CPUs {cpus:?}: {source}")]
    Cpus {
        /// The requested CPUs.
        cpus: Vec<usize>,
        /// The reason.
        source: io::Error,
    },
}

impl MesaError for RealtimeError {
    /// The next step, if there is one. [`AllowRealtime`](advice::ALLOW_REALTIME) contains all steps
    /// for settings that were refused for several reasons.
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Priority { .. } => Some(advice::ALLOW_PRIORITY),
            Self::NoPriority { .. } => None,
            Self::Memory { .. } | Self::MemoryLimit { .. } => Some(advice::ALLOW_LOCKED_MEMORY),
            Self::Several(errors) => {
                let mut all = errors.iter().filter_map(Self::advice);
                let first = all.next()?;
                let is_same = all.all(|other| other == first);
                Some(if is_same {
                    first
                } else {
                    advice::ALLOW_REALTIME
                })
            }
            Self::Cpus { .. } => Some(advice::COUNT_CPUS),
        }
    }
}

impl Realtime {
    /// Applies all settings to the calling thread; locked memory is that of the whole process.
    ///
    /// # Errors
    /// [`RealtimeError`]: the refused setting, [`Several`](RealtimeError::Several) for more than
    /// one. Granted settings stay in effect.
    ///
    /// # Real time
    /// Before the cycle.
    pub fn apply(&self) -> Result<(), RealtimeError> {
        let memory = if self.lock_memory {
            lock_memory()
        } else {
            Ok(())
        };
        let results = [
            self.priority.map_or(Ok(()), set_priority),
            memory,
            self.set_cpus(),
        ];
        let mut refused: Vec<_> = results.into_iter().filter_map(Result::err).collect();
        match refused.len() {
            0 => Ok(()),
            1 => refused.pop().map_or(Ok(()), Err),
            _ => Err(RealtimeError::Several(refused)),
        }
    }

    fn set_cpus(&self) -> Result<(), RealtimeError> {
        if self.cpus.is_empty() {
            return Ok(());
        }
        let refused = |source| RealtimeError::Cpus {
            cpus: self.cpus.clone(),
            source,
        };
        let mut set = CpuSet::new();
        for &cpu in &self.cpus {
            if cpu >= CpuSet::MAX_CPU {
                return Err(refused(io::ErrorKind::InvalidInput.into()));
            }
            set.set(cpu);
        }
        sched_setaffinity(None, &set).map_err(|error| refused(error.into()))?;
        // The kernel silently drops CPUs that do not exist.
        let granted = sched_getaffinity(None).map_err(|error| refused(error.into()))?;
        match self.cpus.iter().find(|&&cpu| !granted.is_set(cpu)) {
            Some(cpu) => Err(refused(io::Error::other(std::format!(
                "CPU {cpu} is not there"
            )))),
            None => Ok(()),
        }
    }
}

/// Errors, one after the other.
struct Lines<'a>(&'a [RealtimeError]);

impl fmt::Display for Lines<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, error) in self.0.iter().enumerate() {
            let separator = if n > 0 { "; and " } else { "" };
            write!(f, "{separator}{error}")?;
        }
        Ok(())
    }
}

fn lock_memory() -> Result<(), RealtimeError> {
    let refused = |error: rustix::io::Errno| RealtimeError::Memory {
        source: error.into(),
    };
    if let Some(bytes) = getrlimit(Resource::Memlock).current {
        let own = capabilities(None).map_err(refused)?.effective;
        if !own.contains(CapabilitySet::IPC_LOCK) {
            return Err(RealtimeError::MemoryLimit { bytes });
        }
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(refused)
}

fn set_priority(priority: u8) -> Result<(), RealtimeError> {
    let value = match priority {
        1..=99 => priority.try_into().ok(),
        _ => None,
    };
    let value = value.ok_or(RealtimeError::NoPriority { priority })?;
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let asked = ThreadPriority::Crossplatform(value);
    set_thread_priority_and_policy(thread_native_id(), asked, fifo).map_err(|error| {
        let source = match error {
            thread_priority::Error::OS(code) => io::Error::from_raw_os_error(code),
            other => io::Error::other(std::format!("{other}")),
        };
        RealtimeError::Priority { priority, source }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs `work` in a thread of its own, because granted settings stay with the thread.
    fn in_a_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|scope| scope.spawn(work).join().expect("no panic"))
    }

    #[test]
    fn cpu_that_is_granted_is_the_only_one() {
        in_a_thread(|| {
            let before = rustix::thread::sched_getaffinity(None).expect("readable");
            let cpu = (0..CpuSet::MAX_CPU).find(|&cpu| before.is_set(cpu));
            let cpus = std::vec![cpu.expect("one")];
            let asked = Realtime {
                cpus,
                ..Realtime::default()
            };
            asked.apply().expect("it is allowed already");
            let after = rustix::thread::sched_getaffinity(None).expect("readable");
            assert_eq!(after.count(), 1);
            assert!(after.is_set(asked.cpus[0]));
        });
    }

    #[test]
    fn unavailable_settings_are_refused_with_the_reason() {
        in_a_thread(|| {
            for priority in [0, 100] {
                let asked = Realtime {
                    priority: Some(priority),
                    ..Realtime::default()
                };
                let error = asked.apply().expect_err("no priority").to_string();
                assert!(error.contains("from 1 to 99"), "{error}");
            }
            for cpu in [CpuSet::MAX_CPU - 1, CpuSet::MAX_CPU] {
                let asked = Realtime {
                    cpus: std::vec![cpu],
                    ..Realtime::default()
                };
                let error = asked.apply().expect_err("no such CPU");
                let advice = error.advice().expect("advice").to_string();
                assert!(advice.contains("nproc"), "{error}: {advice}");
            }
        });
    }

    #[test]
    fn granted_settings_apply_and_every_refusal_is_reported() {
        in_a_thread(|| {
            let before = sched_getaffinity(None).expect("readable");
            let cpu = (0..CpuSet::MAX_CPU).rfind(|&cpu| before.is_set(cpu));
            let cpu = cpu.expect("one");
            let mut asked = Realtime {
                priority: Some(100),
                lock_memory: false,
                cpus: std::vec![cpu],
            };
            let error = asked.apply().expect_err("no priority");
            assert!(matches!(error, RealtimeError::NoPriority { .. }), "{error}");
            let after = sched_getaffinity(None).expect("readable");
            assert_eq!(after.count(), 1, "it runs there all the same");
            asked.cpus.push(CpuSet::MAX_CPU - 1);
            let error = asked.apply().expect_err("two things");
            assert_eq!(error.advice(), Some(advice::COUNT_CPUS));
            let error = error.to_string();
            let parts: Vec<_> = error.split("; and ").collect();
            assert_eq!(parts.len(), 2, "{error}");
            assert!(parts[0].contains("from 1 to 99"), "{error}");
            let last = std::format!("CPU {} is not there", CpuSet::MAX_CPU - 1);
            assert!(parts[1].contains(&last), "{error}");
        });
    }

    /// The limit is that of the whole process, and no other test locks memory; the capability is
    /// that of the thread.
    #[test]
    fn memory_is_not_locked_if_only_a_part_may_be_locked() {
        use rustix::process::{Rlimit, setrlimit};
        in_a_thread(|| {
            let before = getrlimit(Resource::Memlock);
            let bytes = before.maximum.map_or(1 << 40, |most| most.min(1 << 40));
            let limit = Rlimit {
                current: Some(bytes),
                ..before
            };
            setrlimit(Resource::Memlock, limit).expect("less is always granted");
            let mut own = capabilities(None).expect("readable");
            own.effective.remove(CapabilitySet::IPC_LOCK);
            rustix::thread::set_capabilities(None, own).expect("less is always granted");
            let asked = Realtime {
                lock_memory: true,
                ..Realtime::default()
            };
            let refused = asked.apply();
            setrlimit(Resource::Memlock, before).expect("as it was");
            let error = refused.expect_err("though a terabyte would do");
            assert!(
                matches!(error, RealtimeError::MemoryLimit { bytes: told } if told == bytes),
                "{error}"
            );
            assert!(error.to_string().contains("KiB may be locked"), "{error}");
            let advice = error.advice().expect("advice").to_string();
            for said in ["memlock unlimited", "CAP_IPC_LOCK"] {
                assert!(advice.contains(said), "{advice}");
            }
        });
    }

    #[test]
    fn priority_is_granted_or_refused_and_never_ignored() {
        in_a_thread(|| {
            let asked = Realtime {
                priority: Some(1),
                ..Realtime::default()
            };
            match asked.apply() {
                Ok(()) => {
                    let is = thread_priority::thread_schedule_policy().expect("readable");
                    let fifo = RealtimeThreadSchedulePolicy::Fifo;
                    assert_eq!(is, ThreadSchedulePolicy::Realtime(fifo));
                }
                Err(error) => {
                    assert!(error.to_string().contains("priority 1:"), "{error}");
                    assert_eq!(error.advice(), Some(advice::ALLOW_PRIORITY));
                }
            }
        });
    }
}
