//! The next step after an error or a remark, in the words of LinuxCNC's users.

use core::fmt;

use mesa_hal::Advice;

/// The form of an advice for a user of LinuxCNC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Words {
    /// There is nothing to do in LinuxCNC.
    Nothing,
    /// A command of HAL, or a word of the `loadrt` line.
    Own(&'static str),
    /// The text of the library, which names nothing of a program.
    OfLibrary,
}

impl Words {
    const fn of(advice: Advice) -> Self {
        Self::Own(match advice {
            // `config=` and HAL have nothing for these, and the component does the rest itself.
            Advice::SetWatchdog
            | Advice::SetBusErrorLimit
            | Advice::SetFaultPolicy
            | Advice::SetStaleAfter
            | Advice::SetPwm
            | Advice::SetEncoderRate
            | Advice::ChoosePhase
            | Advice::ChooseHostPace
            | Advice::ChooseOtherName
            | Advice::UseLayoutOfBoard
            | Advice::WriteBootBlock
            | Advice::WriteFallback
            | Advice::GiveStandardBitfile
            | Advice::AllowRealtime
            | Advice::CountCpus => return Self::Nothing,
            Advice::ListPins => "`halcmd show` lists the names",
            Advice::SetPwmFrequency => "set pwmgen.pwm_frequency",
            Advice::SetInstances => "change the word num_ of config=",
            Advice::WriteRemoteParameter => "set it, then set sserial.port-N.run to FALSE and TRUE",
            Advice::ListParameters => "`halcmd show param` lists them",
            Advice::LeaveDpll => {
                "choose another period of the thread, or add num_dplls=0 to config="
            }
            Advice::SetPeriodFirst | Advice::StartAnew => "load the component again",
            Advice::LengthenWatchdog => {
                "set a longer time (watchdog.timeout_ns is that of the board), or choose a shorter period of \
                 the thread"
            }
            Advice::LeavePortOut => "leave the word of the port out of config=",
            Advice::LeaveChannelOut => "put an x for the channel in config=",
            Advice::LookAtMissing => "a message at the load contains the reason, if there is one",
            Advice::AddTable => {
                "put an x for the channel in config=; if an update of its firmware was cut off, give `mesa \
                 update` again"
            }
            Advice::RearmFirst => "set watchdog.has_bit or io_error to FALSE",
            Advice::StopAll | Advice::StopAllFirst | Advice::IdentifyPort => {
                "load the component again; if that does not help, switch the board off and on"
            }
            _ => return Self::OfLibrary,
        })
    }
}

/// The facts of an error or a remark, and its advice: `facts; advice`.
///
/// # Real time
/// `Display` allocates if that of the facts does.
pub(crate) struct WithAdvice<'a> {
    facts: &'a dyn fmt::Display,
    advice: Option<Advice>,
}

impl<'a> WithAdvice<'a> {
    pub fn new(facts: &'a dyn fmt::Display, advice: Option<Advice>) -> Self {
        Self { facts, advice }
    }
}

impl fmt::Display for WithAdvice<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.facts.fmt(f)?;
        let Some(advice) = self.advice else {
            return Ok(());
        };
        match Words::of(advice) {
            Words::Nothing => Ok(()),
            Words::Own(text) => write!(f, "; {text}"),
            Words::OfLibrary => write!(f, "; {advice}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program that a user can start.
    fn is_typed(quoted: &str) -> bool {
        let first = quoted.split(' ').next().unwrap_or_default();
        ["mesa", "halcmd", "sudo"].contains(&first)
    }

    #[test]
    fn no_text_for_users_of_linuxcnc_names_an_item_of_the_library() {
        for advice in Advice::all() {
            if Words::of(advice) == Words::Nothing {
                continue;
            }
            let text = WithAdvice::new(&"a fact", Some(advice)).to_string();
            assert!(
                text.starts_with("a fact; ") && !text.contains("::"),
                "{text}"
            );
            for quoted in text.split('`').skip(1).step_by(2) {
                let is_of_system = ["rtprio", "memlock unlimited"].contains(&quoted);
                assert!(is_of_system || is_typed(quoted), "{text}");
            }
        }
    }

    #[test]
    fn what_cannot_be_done_in_linuxcnc_is_not_advised() {
        for advice in [None, Some(Advice::SetEncoderRate)] {
            assert_eq!(WithAdvice::new(&"a fact", advice).to_string(), "a fact");
        }
    }
}
