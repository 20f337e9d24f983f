//! `mesa sim --watch`: boards and machines on the whole screen, with the console below.

mod board;
mod command_line;
mod messages;
mod values;

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, channel, sync_channel};
use std::thread;

use ratatui::Frame;
use ratatui::crossterm::event::{KeyCode, KeyEvent};
use ratatui::layout::{Constraint, Layout, Position, Rect};
use ratatui::style::{Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph};

use super::network::Network;
use super::station::Running;
use crate::ui::colours::Palette;
use crate::ui::full_screen::{Screen, Scroll, Wish, wrapped};
use crate::ui::output;
use board::BoardView;
use command_line::CommandLine;
use messages::Messages;

/// Maximum number of queued commands; the one in progress may be a `wait until`.
const MAX_COMMANDS: usize = 16;

/// Columns and rows of the borders of a part of the screen.
const BORDER: u16 = 2;
/// Indentation of the continuation of a line that does not fit.
const INDENT: usize = 4;
/// Maximum number of lines about the boards.
const MAX_BOARD_LINES: usize = 17;

/// The screen: a view of each board, and the console.
pub struct Watch<'a> {
    network: &'a Network,
    running: &'a Running,
    boards: Vec<BoardView>,
    /// Index of the board whose machine is shown; commands without a board name go to it.
    chosen: usize,
    scroll: Scroll,
    messages: Messages,
    line: CommandLine,
    commands: SyncSender<String>,
    answers: Receiver<String>,
    palette: Palette,
}

impl<'a> Watch<'a> {
    pub fn new(network: &'a Network, running: &'a Running) -> Self {
        let boards = network.boards.iter();
        let boards = boards.map(|link| BoardView::new(&link.name, link.address.clone()));
        let (commands, answers) = answer_commands(network.clone());
        Self {
            network,
            running,
            boards: boards.collect(),
            chosen: 0,
            scroll: Scroll::default(),
            messages: Messages::default(),
            line: CommandLine::default(),
            commands,
            answers,
            palette: Palette::from_environment(),
        }
    }

    /// Queues a command, for the shown board unless the command names another.
    fn command(&mut self, line: String) {
        self.messages.is_large = false;
        self.messages.command(format!("{}{line}", self.prompt()));
        let line = if line.starts_with('@') {
            line
        } else {
            format!("@{} {line}", self.chosen)
        };
        match self.commands.try_send(line) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => {
                let why = "error: the command before is not done yet".to_owned();
                self.messages.complaint(why);
            }
            Err(TrySendError::Disconnected(_)) => {
                self.messages
                    .complaint("error: the console has ended".to_owned());
            }
        }
    }

    fn prompt(&self) -> String {
        let board = self.boards.get(self.chosen);
        format!("{}> ", board.map_or("", |board| &board.name))
    }

    /// The part of the screen that the page keys scroll.
    fn scrolled(&mut self) -> &mut Scroll {
        if self.messages.is_large {
            &mut self.messages.scroll
        } else {
            &mut self.scroll
        }
    }

    fn choose(&mut self, board: usize) {
        self.chosen = board % self.boards.len().max(1);
        self.scroll.to(0);
    }

    /// Lines about the boards.
    fn board_lines(&self, width: usize) -> Vec<Line<'static>> {
        let boards = self.boards.iter().enumerate();
        let lines = boards.map(|(number, board)| {
            let line = board.line(self.palette, width);
            if number == self.chosen && self.boards.len() > 1 {
                line.patch_style(Style::new().add_modifier(Modifier::BOLD))
            } else {
                line
            }
        });
        let chosen = self.boards.get(self.chosen);
        let network = chosen.map(|board| Line::raw(board.network()));
        let lines = lines.chain(network);
        lines
            .flat_map(|line| wrapped(&line, width, INDENT))
            .collect()
    }

    fn draw_machine(&mut self, frame: &mut Frame<'_>, area: Rect) {
        let Some(board) = self.boards.get(self.chosen) else {
            return;
        };
        let width = usize::from(area.width.saturating_sub(BORDER));
        let lines = board.machine(self.palette, width).into_iter();
        let lines: Vec<_> = lines
            .flat_map(|line| wrapped(&line, width, INDENT))
            .collect();
        let rows = usize::from(area.height.saturating_sub(2));
        self.scroll.fit(lines.len(), rows);
        let shown = lines.into_iter().skip(self.scroll.first).take(rows);
        let block = Block::bordered().title(format!(" {} ", board.name));
        let shown: Vec<_> = shown.collect();
        frame.render_widget(Paragraph::new(shown).block(block), area);
    }

    fn draw_line(&self, frame: &mut Frame<'_>, area: Rect) {
        let text = self.prompt() + self.line.text();
        // Of a line that is too long, the end is visible, where the operator types.
        let room = usize::from(area.width.saturating_sub(1));
        let line = Line::raw(text);
        let hidden = line.width().saturating_sub(room) as u16;
        let end = area.x + (line.width() as u16).saturating_sub(hidden);
        frame.render_widget(Paragraph::new(line).scroll((0, hidden)), area);
        if !area.is_empty() {
            frame.set_cursor_position(Position::new(end, area.y));
        }
    }
}

impl Screen for Watch<'_> {
    fn refresh(&mut self) -> Wish {
        for (board, link) in self.boards.iter_mut().zip(self.network.boards.iter()) {
            let answer = link.ask("show");
            if answer.reason().is_none() {
                board.take(&answer.text);
            }
        }
        for answer in self.answers.try_iter() {
            self.messages.answer(&answer);
        }
        for complaint in output::take_held() {
            self.messages.complaint(complaint);
        }
        if self.running.goes_on() {
            Wish::Continue
        } else {
            Wish::End
        }
    }

    fn key(&mut self, key: KeyEvent) -> Wish {
        match key.code {
            KeyCode::Char('q') | KeyCode::Esc
                if self.messages.is_large && self.line.text().is_empty() =>
            {
                self.messages.is_large = false;
            }
            // `quit` is the only command that begins with q.
            KeyCode::Char('q') if self.line.text().is_empty() => return Wish::End,
            KeyCode::Tab => self.choose(self.chosen + 1),
            KeyCode::BackTab => self.choose(self.chosen + self.boards.len() - 1),
            // The arrow keys belong to the line.
            other @ (KeyCode::PageUp | KeyCode::PageDown | KeyCode::Home | KeyCode::End) => {
                self.scrolled().key(other);
            }
            _ => {
                if let Some(command) = self.line.key(key) {
                    self.command(command);
                }
            }
        }
        Wish::Continue
    }

    fn draw(&mut self, frame: &mut Frame<'_>) {
        let Rect { width, height, .. } = frame.area();
        let boards = self.board_lines(usize::from(width.saturating_sub(BORDER)));
        let rows = boards.len().min(MAX_BOARD_LINES) as u16 + BORDER;
        let [place, rest, line] = Layout::vertical([
            Constraint::Length(rows.min(height / 2)),
            Constraint::Min(3),
            Constraint::Length(1),
        ])
        .areas(frame.area());
        let block = Block::bordered().title(" simulated boards ");
        frame.render_widget(Paragraph::new(boards).block(block), place);
        self.draw_line(frame, line);
        if self.messages.is_large {
            self.messages.draw(frame, rest, self.palette);
            return;
        }
        let messages = Constraint::Length((height / 4).clamp(3, 12));
        let [machine, messages] = Layout::vertical([Constraint::Min(3), messages]).areas(rest);
        self.draw_machine(frame, machine);
        self.messages.draw(frame, messages, self.palette);
    }
}

/// Starts a thread that executes commands one after the other, so that none of them blocks the
/// screen. Returns the channel of the commands and that of their answers.
fn answer_commands(network: Network) -> (SyncSender<String>, Receiver<String>) {
    let (commands, lines) = sync_channel::<String>(MAX_COMMANDS);
    let (sender, answers) = channel();
    thread::spawn(move || {
        for line in lines {
            let answer = network.answer(&line);
            let sent = sender.send(answer.text);
            if answer.quit {
                network.shared.end();
            }
            if sent.is_err() || answer.quit {
                return;
            }
        }
    });
    (commands, answers)
}
