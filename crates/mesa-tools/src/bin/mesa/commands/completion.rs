//! Completion of values in a shell: machines for `--sim`, and the pins, terminals and signals of
//! the machine on the line. Nothing is sent to a board.

use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};

use clap::{Command, ValueEnum};
use clap_complete::CompleteEnv;
use clap_complete::engine::{
    ArgValueCompleter, CompletionCandidate, PathCompleter, ValueCompleter,
};
use clap_complete::env::Shells;
use mesa_hal::hal::{PinInfo, Role};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal::{Board, Settings};

use crate::board::bus::Bus;
use crate::board::hazard::{Hazard, hazard};
use crate::board::link::BoardLink;
use crate::machine::boards::Board as SimulatedBoard;
use crate::machine::built::Machine;
use crate::machine::description::Description;
use crate::machine::embedded::Simulated;

/// Variable that scripts of shells set to ask for candidates.
const VARIABLE: &str = "MESA_COMPLETE";

/// Answers a shell that asks for candidates, and ends the process then.
pub fn answer(command_line: impl Fn() -> Command) {
    let complete = CompleteEnv::with_factory(|| with_completers(command_line()));
    complete.var(VARIABLE).complete();
}

/// The script with which a shell asks for candidates; `None` for an unknown shell.
pub fn script(shell: &str) -> Option<String> {
    let shells = Shells::builtins();
    let shell = shells.completer(shell)?;
    let mut script = Vec::new();
    let written = shell.write_registration(VARIABLE, "mesa", "mesa", "mesa", &mut script);
    written.ok()?;
    String::from_utf8(script).ok()
}

/// An argument whose values are pins of the machine.
struct PinArgument {
    command: &'static str,
    argument: &'static str,
    is_candidate: fn(&PinInfo) -> bool,
}

const PIN_ARGUMENTS: [PinArgument; 6] = [
    PinArgument {
        command: "set",
        argument: "pin",
        is_candidate: is_output,
    },
    PinArgument {
        command: "pins",
        argument: "pattern",
        is_candidate: |_| true,
    },
    PinArgument {
        command: "watch",
        argument: "pattern",
        is_candidate: |_| true,
    },
    PinArgument {
        command: "wiring",
        argument: "pattern",
        is_candidate: |pin| !pin.role.is_param(),
    },
    PinArgument {
        command: "scope",
        argument: "pins",
        is_candidate: |_| true,
    },
    PinArgument {
        command: "scope",
        argument: "trigger",
        is_candidate: |_| true,
    },
];

/// An output that `mesa set` drives.
fn is_output(pin: &PinInfo) -> bool {
    let hazard = hazard(pin);
    pin.role == Role::Output && !matches!(hazard, Hazard::Making | Hazard::Watchdog)
}

/// Adds the completers to the arguments of all commands.
fn with_completers(command: Command) -> Command {
    command.mut_subcommands(|command| {
        let command = with_completers(command);
        let name = command.get_name().to_owned();
        let command = with(command, "sim", machines);
        let own = PIN_ARGUMENTS.iter().filter(|pins| pins.command == name);
        own.fold(command, |command, pins| {
            let is_candidate = pins.is_candidate;
            with(command, pins.argument, move |current: &OsStr| {
                candidates(current, is_candidate)
            })
        })
    })
}

/// Adds a completer to an argument, if the command has it. `Command::mut_arg` would move the
/// argument behind the others.
fn with(command: Command, argument: &str, completer: impl ValueCompleter + 'static) -> Command {
    let mut completer = Some(ArgValueCompleter::new(completer));
    command.mut_args(|one| {
        let own = completer.take_if(|_| one.get_id() == argument);
        match own {
            Some(completer) => one.add(completer),
            None => one,
        }
    })
}

/// Simulated boards, and files that describe a machine or a firmware.
fn machines(current: &OsStr) -> Vec<CompletionCandidate> {
    let typed = current.to_string_lossy();
    let boards = <&SimulatedBoard>::value_variants().iter();
    let boards = boards.filter_map(ValueEnum::to_possible_value);
    let boards = boards.filter(|board| board.get_name().starts_with(&*typed));
    let boards = boards.map(|board| {
        let help = board.get_help().cloned();
        CompletionCandidate::new(board.get_name().to_owned()).help(help)
    });
    let files = PathCompleter::file().filter(|path| {
        let end = path.extension();
        end.is_some_and(|end| end == "toml" || end == "txt")
    });
    boards.chain(files.complete(current)).collect()
}

/// Names, terminals and signals of pins of the machine on the line that begin as typed.
fn candidates(current: &OsStr, is_candidate: fn(&PinInfo) -> bool) -> Vec<CompletionCandidate> {
    let machine = words_of_line().and_then(machine);
    let pins = machine.and_then(|machine| pins(&machine));
    let pins = pins.unwrap_or_default();
    let typed = current.to_string_lossy().to_lowercase();
    let pins = pins.iter().filter(|pin| is_candidate(pin));
    let texts = pins.flat_map(|pin| {
        let name = without_board(&pin.name).to_owned();
        let terminals = pin.place.terminal.split(", ");
        let terminals = terminals.map(|terminal| terminal.replace(" pin ", "-"));
        let signals = pin.place.signal.split(", ").map(str::to_owned);
        std::iter::once(name).chain(terminals).chain(signals)
    });
    let fits = |text: &String| !text.is_empty() && text.to_lowercase().starts_with(&typed);
    // A word with a blank would need quotation marks.
    let texts = texts.filter(|text| fits(text) && !text.contains(' '));
    let texts: BTreeSet<String> = texts.collect();
    texts.into_iter().map(CompletionCandidate::new).collect()
}

/// A pin's name without the two parts that name the board.
fn without_board(name: &str) -> &str {
    let mut parts = name.splitn(3, '.');
    parts.nth(2).unwrap_or(name)
}

/// Words of the line that is completed, which a shell passes after `--`.
fn words_of_line() -> Option<Vec<OsString>> {
    let mut words = std::env::args_os();
    words.find(|word| word == "--")?;
    Some(words.collect())
}

/// The machine of `--sim` among the words of a line.
fn machine(words: Vec<OsString>) -> Option<Description> {
    let mut words = words
        .into_iter()
        .map(|word| word.to_string_lossy().into_owned());
    let value = words.find_map(|word| word.strip_prefix("--sim").map(str::to_owned))?;
    let value = match value.strip_prefix('=') {
        Some(value) => value.to_owned(),
        // Bash makes a word of its own of each `=`.
        None => words.find(|word| word != "=")?,
    };
    value.trim_matches(['\'', '"']).parse().ok()
}

/// All pins of a simulated machine, which no cycle has driven.
fn pins(machine: &Description) -> Option<Vec<PinInfo>> {
    let is_on_pci = machine.board.is_on_pci;
    let simulated = Simulated::new(Machine::new(machine).ok()?.board);
    let bus = if is_on_pci {
        Bus::Embedded(simulated.on_pci())
    } else {
        let link = BoardLink::Simulated(simulated.link());
        Bus::Ethernet(UdpBus::new(link, UdpConfig::default()).ok()?.into())
    };
    let board = Board::identify(bus, Settings::default()).ok()?;
    let board = board.discover().ok()?;
    Some(board.pins().infos().to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_argument_with_pins_exists() {
        let all = crate::command_line();
        for PinArgument {
            command, argument, ..
        } in &PIN_ARGUMENTS
        {
            let found = all.find_subcommand(command).expect("a command");
            let mut arguments = found.get_arguments();
            assert!(
                arguments.any(|one| one.get_id() == argument),
                "{command} {argument}"
            );
        }
    }

    #[test]
    fn machine_of_a_line_is_found() {
        let machine = |words: &[&str]| machine(words.iter().map(OsString::from).collect());
        let plain = machine(&["mesa", "set", "--sim", "7i92-7i77", "TB"]);
        assert!(plain.is_some());
        assert_eq!(machine(&["mesa", "set", "--sim=7i92-7i77"]), plain);
        assert_eq!(machine(&["mesa", "set", "--sim", "=", "7i92-7i77"]), plain);
        assert_eq!(machine(&["mesa", "set", "--sim", "'7i92-7i77'"]), plain);
        assert_eq!(machine(&["mesa", "set", "--addr", "10.10.10.10"]), None);
        assert_eq!(machine(&["mesa", "set", "--sim", "no-machine"]), None);
    }
}
