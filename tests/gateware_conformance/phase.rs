//! The transcripts in which some lines depend on the phase of the firmware loop.
//!
//! The recorder found them by moving all latencies and pauses by a few microseconds (index.txt,
//! "PHASE"). Only the following may differ in them:
//!
//! - `t01b`: the effect of a command that is written 20 to 24 us after the release of bit 14: lost,
//!   executed, or left standing.
//! - `t04c`: nothing. The state in which a channel without a remote gives up, 01 or 02, changes
//!   with moved pauses only (FACTS 11.17).
//! - `t06b`, `t25`: CS sampled during chatter: the states 3A and 3B alternate.
//! - `t09c`: the time until COMMAND sticks.
//! - `u10`: the times of the late replies, by up to 300 ns: one clock cycle decides whether one of
//!   their characters is an overrun (FACTS 11.8; index.txt, "Ties").

use mesa_hal_sim::sslbp::Register;
use mesa_hal_sim::wire::Nanos;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    None,
    EndOfReset,
    AbsentState,
    Chatter,
    Sticking,
    Overrun,
}

/// Permitted differences in one file.
#[derive(Clone, Copy, Debug)]
pub struct PhaseRule {
    kind: Kind,
    released: Option<Nanos>,
    in_reset: bool,
    uncertain: bool,
}

impl PhaseRule {
    /// The rule for the file `name`.
    pub fn of(name: &str) -> Self {
        let kind = match name.split('_').next().unwrap_or(name) {
            "t01b" => Kind::EndOfReset,
            "t04c" => Kind::AbsentState,
            "t06b" | "t25" => Kind::Chatter,
            "t09c" => Kind::Sticking,
            "u10" => Kind::Overrun,
            _ => Kind::None,
        };
        Self {
            kind,
            released: None,
            in_reset: false,
            uncertain: false,
        }
    }

    /// The rule of `t06b` and `t25`, for recordings whose phase was moved on purpose.
    pub fn chatter() -> Self {
        Self::of("t25")
    }

    /// True if the file has an overrun, which a clock cycle decides.
    pub fn has_overrun(&self) -> bool {
        self.kind == Kind::Overrun
    }

    /// True if the file is one of them.
    pub fn is_needed(&self) -> bool {
        self.kind != Kind::None
    }

    /// Processes a write of the host; finds the commands of `t01b` whose effect depends on the
    /// phase.
    pub fn saw_write(&mut self, register: Register, value: u32, now: Nanos) {
        if self.kind != Kind::EndOfReset || register != Register::Command {
            return;
        }
        let reset = value & 0x4000 != 0;
        if self.in_reset && !reset {
            self.released = Some(now);
        }
        self.in_reset = reset;
        let since = self.released.map(|released| now - released);
        self.uncertain = since.is_some_and(|since| (20_000..=24_000).contains(&since));
    }

    /// True if a value may be read in place of the recorded one.
    pub fn allows(&self, register: Register, expected: u32, actual: u32, _now: Nanos) -> bool {
        let states = [expected, actual].map(|cs| (cs >> 16) as u8);
        let only_state = (expected ^ actual) & !0x00FF_0000 == 0;
        let both = |low, high| states.iter().all(|state| (low..=high).contains(state));
        match (self.kind, register) {
            (Kind::EndOfReset, Register::Command | Register::Data) => self.uncertain,
            (Kind::Chatter, Register::Cs(_)) => only_state && both(0x3A, 0x3B),
            _ => false,
        }
    }

    /// True if a poll may take any time.
    pub fn allows_wait(&self, _now: Nanos) -> bool {
        match self.kind {
            Kind::EndOfReset => self.uncertain,
            Kind::Sticking => true,
            _ => false,
        }
    }

    /// Sampled values, with runs of alternating chatter states taken as one value.
    pub fn normalise(&self, samples: &[(u32, Nanos)]) -> Vec<(u32, Nanos)> {
        let mut values: Vec<(u32, Nanos)> = samples.to_vec();
        if self.kind == Kind::Chatter {
            for (value, _) in &mut values {
                if *value & 0x00FF_0000 == 0x003B_0000 {
                    *value ^= 0x0001_0000;
                }
            }
            values.dedup_by_key(|&mut (value, _)| value);
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_named_difference_is_allowed() {
        let chatter = PhaseRule::of("t25_chatter8");
        let cs = Register::Cs(0);
        assert!(chatter.allows(cs, 0x003A_0000, 0x003B_0000, 0));
        assert!(!chatter.allows(cs, 0x003A_0000, 0x003B_0001, 0));
        assert!(!chatter.allows(cs, 0x003A_0000, 0x0042_0000, 0));
        assert!(!PhaseRule::of("t08_stops").allows(cs, 0x003A_0000, 0x003B_0000, 0));
        assert!(!PhaseRule::of("t09b_stopall").allows_wait(0));
        let overrun = PhaseRule::of("u10_overrun_in_chatter");
        assert!(!overrun.allows(cs, 0x003B_201D, 0x003B_200D, 0));
        assert!(!overrun.allows(cs, 0x003B_201D, 0x003B_2019, 0));
        let absent = PhaseRule::of("t04c_normal_absent3");
        assert!(!absent.allows(cs, 0x0001_E188, 0x0002_E188, 0));
    }

    #[test]
    fn t01b_commands_are_uncertain_only_at_the_end_of_reset_time() {
        let mut rule = PhaseRule::of("t01b_reset_timeline");
        rule.saw_write(Register::Command, 0x4000, 0);
        rule.saw_write(Register::Command, 0, 1_000);
        rule.saw_write(Register::Command, 0x2003, 11_000);
        assert!(!rule.allows(Register::Data, 0xAA, 0x2B, 12_000));
        rule.saw_write(Register::Command, 0x2003, 23_500);
        assert!(rule.allows(Register::Data, 0xAA, 0x2B, 24_000));
        rule.saw_write(Register::Command, 0x2003, 61_000);
        assert!(!rule.allows_wait(61_000));
    }
}
