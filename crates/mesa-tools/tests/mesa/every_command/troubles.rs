//! `docs/troubles.md`: what the page shows is what the commands print.

use std::net::Ipv4Addr;

use crate::interop::Process;
use crate::interop::board::Board;
use crate::run::{command, run};

const PAGE: &str = include_str!("../../../../../docs/troubles.md");

/// What a block of the page runs: a simulated board, a program beside it.
#[derive(Default)]
struct Stage {
    board: Option<Board>,
    beside: Vec<Process>,
    printed: String,
}

impl Stage {
    /// Runs a line of a block, or looks for it in what the last command printed.
    fn play(&mut self, line: &str) {
        if let Some(arguments) = line.strip_prefix("$ mesa sim ") {
            let arguments: Vec<&str> = arguments.split(' ').collect();
            let port = [&arguments[..], &["--port", "0"]].concat();
            self.board = Some(Board::start(Ipv4Addr::LOCALHOST, &port));
        } else if let Some(arguments) = line.strip_prefix("$ mesa ") {
            self.run(arguments);
        } else if let Some(command) = line.strip_prefix("> ") {
            let board = self.board.as_mut().expect("a board before its console");
            board.console.run(command);
        } else if line != "..." {
            let known = self.printed.lines().map(masked);
            let mut known = known.filter(|known| known.contains(&masked(line)));
            assert!(known.next().is_some(), "no `{line}` in\n{}", self.printed);
        }
    }

    fn run(&mut self, arguments: &str) {
        let address = self.board.as_ref().map(|board| board.address.to_string());
        let of_page = |word: &str| match word {
            "127.0.0.1" => address.clone().expect("a board"),
            word => word.to_owned(),
        };
        let words: Vec<String> = arguments.split(' ').map(of_page).collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        if let [words @ .., "&"] = &words[..] {
            let child = command(words).spawn().expect("mesa starts");
            self.beside.push(Process::new(child));
            let board = self.board.as_mut().expect("a board");
            board.wait_for_packets(1000);
        } else {
            let ended = run(&words);
            self.printed = ended.out + &ended.err;
        }
    }
}

/// A line with `#` in place of each number, which may differ from run to run, and without the
/// blanks at its ends.
fn masked(line: &str) -> String {
    let mut masked = String::new();
    let mut was_digit = false;
    for letter in line.trim().chars() {
        let is_digit = letter.is_ascii_digit() || was_digit && letter == '.';
        match is_digit {
            true if was_digit => {}
            true => masked.push('#'),
            false => masked.push(letter),
        }
        was_digit = is_digit;
    }
    // A measured time may have another unit.
    masked.replace("# us", "# ms").replace("# ns", "# ms")
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn commands_print_the_text_of_the_troubleshooting_page() {
    let blocks = PAGE.split("```console\n").skip(1);
    let blocks = blocks.map(|block| block.split_once("```").expect("an end").0);
    let mut commands = 0;
    for block in blocks {
        let mut stage = Stage::default();
        block.lines().for_each(|line| stage.play(line));
        commands += 1;
    }
    assert!(commands >= 9, "{commands} blocks");
}

#[test]
fn every_trouble_has_a_command_that_finds_it() {
    let troubles: Vec<&str> = PAGE.split("\n## ").skip(1).collect();
    let troubles = troubles
        .iter()
        .filter(|one| !one.starts_with("What destroys"));
    assert_eq!(troubles.clone().count(), 10);
    for trouble in troubles {
        let (heading, text) = trouble.split_once('\n').expect("a text");
        assert!(text.contains("$ mesa "), "{heading}");
    }
}
