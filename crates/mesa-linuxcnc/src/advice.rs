//! The next step after an error, a remark or an event, in the words of LinuxCNC's users.

use mesa_hal::{Advice, AdviceTopic};

/// Words for a user of LinuxCNC: a command of HAL, or a word of the `loadrt` line; `None` if there
/// is nothing to do there.
pub(crate) fn words(advice: Advice) -> Option<&'static str> {
    Some(match advice.topic() {
        // `config=` and HAL have nothing for these, and the component does the rest itself.
        AdviceTopic::Settings
        | AdviceTopic::Module
        | AdviceTopic::HostPace
        | AdviceTopic::FlashLayout
        | AdviceTopic::BootBlock
        | AdviceTopic::Fallback
        | AdviceTopic::StandardBitfile
        | AdviceTopic::Realtime => return None,
        AdviceTopic::PinNames => "`halcmd show` lists the names",
        AdviceTopic::PwmFrequency => "set pwmgen.pwm_frequency",
        AdviceTopic::Instances => "change the word num_ of config=",
        AdviceTopic::RemoteParameter => "set it, then set sserial.port-N.run to FALSE and TRUE",
        AdviceTopic::ParameterNames => "`halcmd show param` lists them",
        AdviceTopic::Dpll => "choose another period of the thread, or add num_dplls=0 to config=",
        AdviceTopic::StartPeriod | AdviceTopic::Restart => "load the component again",
        AdviceTopic::WatchdogTime => {
            "set a longer time (watchdog.timeout_ns is that of the board), or choose a shorter period of \
             the thread"
        }
        AdviceTopic::SerialPort => "leave the word of the port out of config=",
        AdviceTopic::Channel => "put an x for the channel in config=",
        AdviceTopic::Missing => "a message at the load contains the reason, if there is one",
        AdviceTopic::NoTable => {
            "put an x for the channel in config=; if an update of its firmware was cut off, give `mesa \
             update` again"
        }
        AdviceTopic::Rearm => "set watchdog.has_bit or io_error to FALSE",
        AdviceTopic::WatchdogBite => {
            "find out why the thread was late, or which other program drives the board, then set \
             watchdog.has_bit to FALSE"
        }
        AdviceTopic::BoardReset => "check the board's supply, then set watchdog.has_bit to FALSE",
        AdviceTopic::ConnectionLost => "check cable and power, then set io_error to FALSE",
        AdviceTopic::Calls => "add the function read of the board to the thread",
        AdviceTopic::PortSwitch => "check the cable, then set sserial.port-N.run to FALSE and TRUE",
        AdviceTopic::PortState => {
            "load the component again; if that does not help, switch the board off and on"
        }
        // The texts of the other topics name nothing of a program.
        _ => advice.text(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesa_hal::{WithAdvice, advice};

    /// A program that a user can start.
    fn is_typed(quoted: &str) -> bool {
        let first = quoted.split(' ').next().unwrap_or_default();
        [
            "mesa", "halcmd", "sudo", "halrun", "lspci", "setpci", "dmesg", "echo",
        ]
        .contains(&first)
    }

    #[test]
    fn no_text_for_users_of_linuxcnc_names_an_item_of_the_library() {
        for advice in advice::all().chain(mesa_pci::advice::ALL.iter().copied()) {
            let Some(text) = words(advice) else {
                continue;
            };
            assert!(!text.contains("::"), "{text}");
            for quoted in text.split('`').skip(1).step_by(2) {
                let is_of_system = quoted.starts_with("ACTION==");
                assert!(is_of_system || is_typed(quoted), "{text}");
            }
        }
    }

    #[test]
    fn advice_impossible_in_linuxcnc_is_not_shown() {
        for advice in [None, Some(advice::SET_ENCODER_RATE)] {
            let text = WithAdvice::new(&"a fact", advice).in_words(words);
            assert_eq!(text.to_string(), "a fact");
        }
    }
}
