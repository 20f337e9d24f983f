//! The reason of a verdict, with advice that depends on what was given and measured.

use std::time::Duration;

use mesa_hal::driver::Pace;
use mesa_hal::runner::{Latency as Recorder, RateVerdict};
use mesa_tools::Counted;
use mesa_tools::diagnosis::Packets;

use super::measure::Measured;
use super::setting::Setting;

impl Setting {
    /// The options that the thread has not: neither given, nor from the program that started it.
    fn missing(&self) -> Vec<&'static str> {
        let Some(thread) = &self.thread else {
            return Vec::new();
        };
        let options = [
            (thread.priority.is_none(), "--realtime 40"),
            (self.cpus > 1 && thread.cpus.len() >= self.cpus, "--cpu N"),
            (!thread.has_locked_memory, "--lock-memory"),
        ];
        let missing = options.into_iter().filter(|(is_missing, _)| *is_missing);
        missing.map(|(_, option)| option).collect()
    }

    /// Advice for a thread that is not run in time.
    fn for_thread(&self) -> String {
        let missing = self.missing();
        if let [firsts @ .., last] = &missing[..] {
            let options = match firsts {
                [] => (*last).to_owned(),
                _ => format!("{} and {last}", firsts.join(", ")),
            };
            return format!("give it {options}");
        }
        let cpus = self.thread.iter().flat_map(|thread| &thread.cpus);
        let shared = cpus.filter(|cpu| !self.isolated.contains(cpu));
        let shared: Vec<String> = shared.map(ToString::to_string).collect();
        let has = "it has a realtime priority, CPUs of its own and locked memory";
        if !self.has_realtime_kernel {
            format!("{has}, but this kernel is not PREEMPT_RT")
        } else if !shared.is_empty() {
            let shared = shared.join(",");
            format!("{has}, but other programs run on CPU {shared} as well: isolcpus={shared}")
        } else {
            format!(
                "{has}: `mesa doctor` shows idle states, frequency and interrupts; the computer's set-up (BIOS) \
                 is left"
            )
        }
    }
}

/// The reason of a verdict. The verdict has the facts; what to do depends on what was given.
pub fn reason(verdict: &RateVerdict, measured: &Measured) -> String {
    let Some(period) = Duration::from_secs(1).checked_div(verdict.rate) else {
        return verdict.to_string();
    };
    if verdict.cycles == 0 || verdict.transfer >= period {
        return verdict.to_string();
    }
    let micros = |time: Duration| time.as_nanos().div_ceil(1000);
    let (limit, needs) = (micros(period), micros(verdict.needs));
    let mut text = if verdict.late == 0 {
        format!("no cycle needs more than {needs} us of {limit}")
    } else if verdict.usually > period {
        let usually = micros(verdict.usually);
        let parts = parts(&measured.recorder);
        format!("half of all cycles need more than {usually} us of {limit}: {parts}")
    } else {
        let of = Counted(verdict.cycles, "cycle");
        let need = if verdict.late == 1 { "needs" } else { "need" };
        format!(
            "{} of {of} {need} more than {limit} us, the longest {needs}: {}",
            verdict.late,
            cause(&measured.recorder, &measured.setting)
        )
    };
    if verdict.failed > 0 {
        text += &failed(verdict.failed, &measured.packets);
    }
    text
}

/// Parts of a usual cycle that is too long.
fn parts(recorder: &Recorder) -> String {
    let micros = |time: Duration| time.as_nanos().div_ceil(1000);
    let late = micros(recorder.late().quantile(0.5).unwrap_or_default());
    let transfer = micros(recorder.transfer());
    let trip = recorder.round_trip().quantile(0.5).map(micros);
    let trip = trip.map_or_else(String::new, |trip| {
        format!(", {trip} us for the round trip")
    });
    format!(
        "usually it begins {late} us late{trip}, and the transfers to the remotes need {transfer} us"
    )
}

/// What makes single cycles too long, and what to do about it.
fn cause(recorder: &Recorder, setting: &Setting) -> String {
    let micros = |time: Duration| time.as_nanos().div_ceil(1000);
    let (late, trip) = (recorder.late().max(), recorder.round_trip().max());
    if recorder.pace() == Pace::Board || late >= trip {
        let thread = setting.for_thread();
        return format!("the thread is not run in time; {thread}");
    }
    let begun = format!(
        "replies take up to {} us, and cycles begin at most {} us late",
        micros(trip),
        micros(late)
    );
    if setting.missing().is_empty() {
        format!("{begun}: `mesa doctor` shows the network card's driver, interrupts and coalescing")
    } else {
        // A reply is taken late too by a thread that is not run in time.
        format!("{begun}; {}", setting.for_thread())
    }
}

/// Reads that failed, and why.
fn failed(count: u64, packets: &Packets) -> String {
    let reads = Counted(count, "read");
    let why = packets.trouble();
    let why = why.as_deref().unwrap_or("no reply came in time");
    format!("; {reads} failed: {why}")
}

#[cfg(test)]
mod tests {
    use mesa_tools::diagnosis::ThreadSettings;

    use super::*;

    fn setting(priority: Option<u32>, cpus: &[usize], has_locked_memory: bool) -> Setting {
        Setting {
            thread: Some(ThreadSettings {
                priority,
                cpus: cpus.to_vec(),
                has_locked_memory,
            }),
            cpus: 4,
            isolated: vec![3],
            has_realtime_kernel: true,
        }
    }

    #[test]
    fn advice_names_what_is_missing_and_nothing_that_was_given() {
        let all = [0, 1, 2, 3];
        for (setting, said) in [
            (
                setting(None, &all, false),
                "give it --realtime 40, --cpu N and --lock-memory",
            ),
            (setting(Some(40), &[3], false), "give it --lock-memory"),
            (setting(None, &[3], true), "give it --realtime 40"),
            (setting(Some(40), &all, true), "give it --cpu N"),
        ] {
            assert_eq!(setting.for_thread(), said);
        }
    }

    #[test]
    fn advice_names_the_computer_if_all_options_are_given() {
        let given = setting(Some(40), &[3], true);
        let advice = given.for_thread();
        assert!(advice.contains("`mesa doctor` shows"), "{advice}");
        assert!(!advice.contains("--"), "{advice}");
        let shared = setting(Some(40), &[2], true).for_thread();
        assert!(shared.ends_with("on CPU 2 as well: isolcpus=2"), "{shared}");
        let ordinary = Setting {
            has_realtime_kernel: false,
            ..given
        };
        let advice = ordinary.for_thread();
        assert!(advice.ends_with("is not PREEMPT_RT"), "{advice}");
    }

    #[test]
    fn failed_reads_are_named_with_the_packets() {
        let packets = Packets {
            sent: 100,
            lost: 1,
            lost_to_board: Some(0),
            ..Packets::default()
        };
        let said = "; 1 read failed: 1 of 100 packets lost, all on the way back from the board";
        assert_eq!(failed(1, &packets), said);
        let said = "; 2 reads failed: no reply came in time";
        assert_eq!(failed(2, &Packets::default()), said);
    }
}
