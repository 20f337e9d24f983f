//! All boards of a process, and the commands of their clients.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::answer::{Answer, line, wrong};
use super::console::HELP;
use super::station::{Link, Shared};
use crate::ui::files::bounded;

/// Maximum nesting of files of commands.
const DEEPEST: usize = 4;

/// Board of the commands that name none.
const FIRST: &str = "0";

/// Size limit of a file of commands; no real one comes near it.
const MAX_BYTES: u64 = 1 << 20;

/// All boards, as the clients on standard input and on the control sockets see them.
#[derive(Clone)]
pub struct Network {
    pub boards: Arc<[Link]>,
    pub shared: Arc<Shared>,
}

/// A command as JSON.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JsonCommand {
    command: String,
}

/// The answer to a JSON command: `sim` in `docs/mesa.schema.json`.
#[derive(Serialize)]
struct JsonAnswer {
    ok: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    values: Option<Map<String, Value>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    text: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl Network {
    /// Executes a line of a client: a command, or JSON, which is answered in JSON.
    pub fn answer(&self, line: &str) -> Answer {
        if line.trim_start().starts_with('{') {
            return self.answer_json(line);
        }
        self.command(line, FIRST, 0)
    }

    /// Executes a command, on `board` unless the command names another.
    fn command(&self, line: &str, board: &str, depth: usize) -> Answer {
        let (board, command) = match line.trim_start().strip_prefix('@') {
            Some(rest) => rest.split_once(char::is_whitespace).unwrap_or((rest, "")),
            None => (board, line),
        };
        let link = match self.board(board) {
            Ok(link) => link,
            Err(reason) => return Answer::refused(reason),
        };
        let words: Vec<&str> = command.split_whitespace().collect();
        match words[..] {
            ["quit"] => Answer::quit(),
            ["help"] => Answer::of(Ok(HELP.to_owned())),
            ["boards"] => Answer::of(Ok(self.list())),
            ["at", time, ref later @ ..] => link.put(time, &later.join(" ")),
            ["source", path] => Answer::of(self.source(path, board, depth)),
            ["quit" | "help" | "boards" | "source", ..] => Answer::refused(wrong(words[0])),
            _ => link.ask(command),
        }
    }

    fn board(&self, word: &str) -> Result<&Link, String> {
        let by_name = self.boards.iter().find(|link| link.name == word);
        let by_number = || self.boards.get(word.parse::<usize>().ok()?);
        by_name.or_else(by_number).ok_or_else(|| {
            let boards = self.boards.iter().enumerate();
            let names: Vec<_> = boards
                .map(|(number, link)| format!("{number} ({})", link.name))
                .collect();
            format!("no board `{word}`; expected {}", names.join(" or "))
        })
    }

    fn list(&self) -> String {
        let mut text = String::new();
        for link in self.boards.iter() {
            line(&mut text, &format!("board.{}", link.name), &link.address);
        }
        text
    }

    /// Executes the lines of a file on a board, up to the first refused one.
    fn source(&self, path: &str, board: &str, depth: usize) -> Result<String, String> {
        if depth == DEEPEST {
            return Err(format!(
                "files that name files: no more than {DEEPEST} deep"
            ));
        }
        let bytes =
            bounded(path.as_ref(), MAX_BYTES).map_err(|error| format!("{path}: {error}"))?;
        let mut text = String::new();
        for (number, line) in (1..).zip(String::from_utf8_lossy(&bytes).lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            if self.shared.ends() {
                return Err(format!("{path} line {number}: it ends"));
            }
            let answer = self.command(line, board, depth + 1);
            if let Some(reason) = answer.reason() {
                return Err(format!("{path} line {number}: {reason}"));
            }
            if answer.quit {
                self.shared.end();
            }
            text.push_str(answer.text.strip_suffix("ok\n").unwrap_or(&answer.text));
            if text.len() as u64 > MAX_BYTES {
                return Err(format!("{path} line {number}: the answer is too long"));
            }
        }
        Ok(text)
    }

    fn answer_json(&self, line: &str) -> Answer {
        let (answer, quit) = match serde_json::from_str::<JsonCommand>(line) {
            Ok(JsonCommand { command }) => {
                let answer = self.command(&command, FIRST, 0);
                let quit = answer.quit;
                (in_json(&command, &answer), quit)
            }
            Err(error) => {
                let error = format!("expected {{\"command\": \"...\"}}: {error}");
                (JsonAnswer::refused(error), false)
            }
        };
        let text = serde_json::to_string(&answer).unwrap_or_default();
        Answer {
            text: text + "\n",
            quit,
        }
    }
}

impl JsonAnswer {
    fn refused(error: String) -> Self {
        Self {
            ok: false,
            values: None,
            text: None,
            error: Some(error),
        }
    }
}

fn in_json(command: &str, answer: &Answer) -> JsonAnswer {
    if let Some(reason) = answer.reason() {
        return JsonAnswer::refused(reason.to_owned());
    }
    let lines = answer.text.strip_suffix("ok\n").unwrap_or_default();
    let is_text = command.trim() == "help";
    let values = lines.lines().map(|line| {
        let (name, value) = line.split_once(' ').unwrap_or((line, ""));
        let number = value.parse().ok().and_then(serde_json::Number::from_f64);
        let whole = value.parse::<i64>().ok().map(Value::from);
        let value = whole.or_else(|| number.map(Value::Number));
        let value =
            value.unwrap_or_else(|| Value::from(line.split_once(' ').map_or("", |pair| pair.1)));
        (name.to_owned(), value)
    });
    JsonAnswer {
        ok: true,
        values: (!is_text).then(|| values.collect()),
        text: is_text.then(|| lines.to_owned()),
        error: None,
    }
}
