//! The next step after an error, a remark or an event, in the words of the command line.

use std::fmt::Display;

use mesa_hal::{Advice, AdviceTopic, MesaError, WithAdvice};

/// The text for a user of the command line; `None` if there is nothing to do there.
///
/// Where the texts of a topic name items of the library, these name a command or an option. All
/// other advice has the text of the library.
pub fn in_command_words(advice: Advice) -> Option<&'static str> {
    Some(match advice.topic() {
        // The command has no option for these, and no second board.
        AdviceTopic::Settings
        | AdviceTopic::PwmFrequency
        | AdviceTopic::Module
        | AdviceTopic::Calls
        | AdviceTopic::StartPeriod => return None,
        AdviceTopic::PinNames => "`mesa pins` lists them",
        AdviceTopic::RemoteParameter => "`mesa param set` writes it",
        AdviceTopic::ParameterNames => "`mesa param list` lists those that it has",
        AdviceTopic::Instances => "load a firmware that has more",
        AdviceTopic::Dpll => "choose another period or rate",
        AdviceTopic::HostPace => "let the host pace it (`--pace host`)",
        AdviceTopic::WatchdogTime => "choose a longer time for the watchdog, or a shorter period",
        AdviceTopic::Rearm | AdviceTopic::Restart => "give the command again",
        AdviceTopic::WatchdogBite => {
            "find out why this computer was late, or which other program lets the watchdog bite, then give \
             the command again"
        }
        AdviceTopic::BoardReset => {
            "check the board's supply, end other programs that write to it, then give the command again"
        }
        AdviceTopic::ConnectionLost => {
            "check cable and power of the board, then give the command again"
        }
        AdviceTopic::Missing => "a line `MISSING` contains the reason, if there is one",
        AdviceTopic::NoTable => {
            "the remote takes no part; if an update of its firmware was cut off, give `mesa update` again"
        }
        AdviceTopic::PortState => {
            "give the command again; if that does not help, switch the board off and on"
        }
        AdviceTopic::FlashLayout => "use the layout of the board that answers",
        AdviceTopic::BootBlock => "`--fix-boot-block` of `mesa flash write` writes it",
        AdviceTopic::StandardBitfile => {
            "give a standard bitfile, built without multiboot features; `mesa flash restore` writes an \
             image of the whole memory"
        }
        AdviceTopic::Fallback => {
            "write the fallback first, or, if there is no user configuration either, allow this \
             (`--without-fallback`)"
        }
        _ => advice.text(),
    })
}

/// The facts of a remark, and its advice in the words of the command line: `facts; advice`.
pub fn with_advice(facts: impl Display, advice: Option<Advice>) -> String {
    let text = WithAdvice::new(&facts, advice).in_words(in_command_words);
    text.to_string()
}

/// The facts of an error and its advice in the words of the command line.
pub fn told(error: &dyn MesaError) -> String {
    let text = WithAdvice::of(error).in_words(in_command_words);
    text.to_string()
}

/// The advice of an error alone, in the words of the command line, if there is any.
pub fn advice_of(error: &dyn MesaError) -> Option<String> {
    let text = WithAdvice::of(error).in_words(in_command_words).alone();
    Some(text.to_string()).filter(|text| !text.is_empty())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;
    use mesa_hal::DriverError;
    use mesa_hal::advice;

    /// All advice that a user of the command line may read.
    fn every_advice() -> impl Iterator<Item = Advice> {
        let of_tools = crate::setup::advice::ALL.iter();
        advice::all().chain(of_tools.chain(mesa_pci::advice::ALL).copied())
    }

    /// True for a quotation that an operator types, or finds in a file of the system.
    fn is_typed(quoted: &str) -> bool {
        let first = quoted.split(' ').next().unwrap_or_default();
        let of_system = [
            "nproc", "rtprio", "memlock", "MISSING", "dmesg", "lspci", "setpci",
        ];
        let of_shell = ["mesa", "sudo", "echo", "halrun"];
        let is_rule = first.starts_with("ACTION==");
        of_system.contains(&first)
            || of_shell.contains(&first)
            || is_rule
            || first.starts_with("--")
    }

    #[test]
    fn no_text_for_the_command_line_names_an_item_of_the_library() {
        for advice in every_advice() {
            let Some(text) = in_command_words(advice) else {
                continue;
            };
            assert!(!text.contains("::"), "{text}");
            for quoted in text.split('`').skip(1).step_by(2) {
                assert!(is_typed(quoted), "{text}");
            }
        }
    }

    fn code_below(folder: &Path, text: &mut String) {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                code_below(&path, text);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let file = fs::read_to_string(&path).expect("a file");
                let lines = file.lines().map(str::trim_start);
                let code = lines.filter(|line| !line.starts_with("//"));
                code.for_each(|line| text.extend([line, "\n"]));
            }
        }
    }

    /// The facts that a user sees have no items of the library either.
    #[test]
    fn no_fact_of_the_library_names_one_of_its_items() {
        let mut library = String::new();
        for sources in [
            "src",
            "../../src",
            "../mesa-wire/src",
            "../mesa-hal-sim/src",
        ] {
            let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join(sources);
            code_below(&sources, &mut library);
        }
        let library = library.replace("\\\n", "");
        let texts: Vec<_> = every_advice()
            .map(|advice| format!("\"{advice}\""))
            .collect();
        for line in library.lines() {
            if texts.iter().any(|text| line.contains(text)) {
                continue;
            }
            let mut words = line.split('`').skip(1).step_by(2);
            let item = words.find(|word| {
                let is_type = word.starts_with(|letter: char| letter.is_ascii_uppercase());
                // Shown only to programs that add modules of their own.
                let is_own = word.starts_with("Phase::");
                is_type && !is_own && word.contains("::") && !word.contains(' ')
            });
            assert_eq!(item, None, "{line}");
        }
    }

    #[test]
    fn errors_have_their_advice_in_words_that_can_be_typed() {
        let error = DriverError::NotPaced { why: "too slow" };
        assert_eq!(
            told(&error),
            "the board cannot pace the cycle: too slow; let the host pace it (`--pace host`)"
        );
        assert_eq!(told(&std::fmt::Error), std::fmt::Error.to_string());
        let hidden = with_advice("a fact", Some(advice::SET_WATCHDOG));
        assert_eq!(hidden, "a fact");
    }
}
