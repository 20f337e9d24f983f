//! `mesa watch --passive`: live pins of a board that another program drives.

use std::time::Duration;

use mesa_hal::bus::{Clock, Instant};
use mesa_tools::passive::{Sample, Value, Watched};
use ratatui::Frame;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};

use crate::board::link::BoardLink;
use crate::board::look;
use crate::board::pattern::Pattern;
use crate::board::target::Found;
use crate::ui::colours::Palette;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::full_screen::{self, Screen, Scroll, Wish, wrapped};
use crate::ui::output;

/// Columns of the indented parts of long lines.
const INDENT: usize = 10;
/// Rows of the border of a part of the screen.
const BORDER: u16 = 2;

pub fn run(
    found: &Found,
    context: &Context,
    filter: &str,
    every: Duration,
) -> Result<Ending, Failure> {
    if !context.json {
        full_screen::check(context, "`--json` prints the values, one object per line")?;
    }
    let watched = Watched::new(found.look()?);
    let watched = watched.map_err(|error| look::failed(found.address, &error))?;
    let mut live = Live {
        title: format!(" {} at {} ", watched.listener().name(), found.address),
        watched,
        every,
        next: Instant::default(),
        filter: filter.to_owned(),
        is_typing: false,
        seen: None,
        lost: None,
        scroll: Scroll::default(),
        palette: Palette::from_environment(),
    };
    if context.json {
        live.print(context, found)?;
    } else {
        full_screen::show(context, &mut live)?;
        let look = live.watched.bus().packets();
        output::complain(format_args!(
            "mesa: {} read, {} not answered; nothing was written",
            mesa_tools::Counted(look.packets, "packet"),
            look.lost
        ));
    }
    Ok(context.ending())
}

/// A look that is repeated.
struct Live {
    title: String,
    watched: Watched<BoardLink>,
    every: Duration,
    /// Time of the next look.
    next: Instant,
    filter: String,
    is_typing: bool,
    seen: Option<Sample>,
    /// Error of the last look.
    lost: Option<String>,
    scroll: Scroll,
    palette: Palette,
}

impl Live {
    /// Prints samples as lines of JSON until a signal comes.
    fn print(&mut self, context: &Context, found: &Found) -> Result<(), Failure> {
        loop {
            let now = self.watched.bus().now();
            let sample = self.watched.sample();
            let mut sample = sample.map_err(|error| look::failed(found.address, &error))?;
            let pattern = Pattern::from(&*self.filter);
            sample.values.retain(|value| fits(&pattern, value));
            let line = serde_json::to_string(&sample).map_err(Failure::refused)?;
            output::say(format_args!("{line}\n"));
            if !look::wait(context, self.watched.bus(), now.after(self.every))
                || output::is_closed()
            {
                return Ok(());
            }
        }
    }

    /// Lines about the look itself.
    fn head(&mut self) -> Vec<Line<'static>> {
        let look = self.watched.bus().packets();
        let rate = self.seen.as_ref().and_then(|seen| seen.others_per_second);
        let others = match rate {
            Some(rate) => format!("{rate:.0} packets a second from other programs"),
            None => "other programs: not counted yet".to_owned(),
        };
        let state = match &self.lost {
            Some(error) => Span::styled(
                format!("NO ANSWER: {error}"),
                self.palette.style(Color::Red),
            ),
            None => Span::styled("answers", self.palette.style(Color::Green)),
        };
        let every = self.every.as_millis();
        vec![
            Line::from(vec![
                Span::raw("board     "),
                state,
                Span::raw(format!("; {others}")),
            ]),
            Line::from(format!(
                "look      every {every} ms, at most 20 packets a second; {} so far, {} not answered; \
                 nothing is written",
                look.packets, look.lost
            )),
        ]
    }

    fn draw_values(&mut self, frame: &mut Frame<'_>, area: Rect) {
        let pattern = Pattern::from(&*self.filter);
        let values = self.seen.iter().flat_map(|seen| &seen.values);
        let shown: Vec<&Value> = values.filter(|value| fits(&pattern, value)).collect();
        let prefix = format!("{}.", self.watched.listener().name());
        let own = |value: &&Value| {
            value
                .name
                .strip_prefix(&*prefix)
                .map_or(value.name.len(), str::len)
        };
        let names = shown.iter().map(own);
        let texts = shown.iter().map(|value| value.to_string().len());
        let (name, text) = (names.max().unwrap_or(0), texts.max().unwrap_or(0).min(40));
        let width = usize::from(area.width.saturating_sub(BORDER));
        let lines = shown.iter().flat_map(|value| {
            let style = match value.value.as_bool() {
                Some(true) => self.palette.style(Color::Green),
                _ => Style::new(),
            };
            let own = value.name.strip_prefix(&*prefix).unwrap_or(&value.name);
            let line = format!("{own:<name$}  {value:<text$}  {}", value.place);
            wrapped(&Line::styled(line, style), width, INDENT)
        });
        let lines: Vec<_> = lines.collect();
        let rows = usize::from(area.height.saturating_sub(BORDER));
        self.scroll.fit(lines.len(), rows);
        let lines: Vec<_> = lines
            .into_iter()
            .skip(self.scroll.first)
            .take(rows)
            .collect();
        let title = format!(" {} values ", shown.len());
        let block = Block::bordered().title(title);
        frame.render_widget(Paragraph::new(lines).block(block), area);
    }
}

fn fits(pattern: &Pattern, value: &Value) -> bool {
    pattern.fits_text(&value.name) || pattern.fits_text(&value.place)
}

impl Screen for Live {
    fn refresh(&mut self) -> Wish {
        let now = self.watched.bus().now();
        if now >= self.next {
            self.next = now.after(self.every);
            match self.watched.sample() {
                Ok(sample) => (self.seen, self.lost) = (Some(sample), None),
                // Values of before would look like those of now.
                Err(error) => (self.seen, self.lost) = (None, Some(error.to_string())),
            }
        }
        Wish::Continue
    }

    fn key(&mut self, key: KeyEvent) -> Wish {
        let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
        match key.code {
            KeyCode::Enter | KeyCode::Esc if self.is_typing => self.is_typing = false,
            KeyCode::Char(letter) if self.is_typing && !is_control => self.filter.push(letter),
            KeyCode::Backspace if self.is_typing => drop(self.filter.pop()),
            KeyCode::Char('q') | KeyCode::Esc => return Wish::End,
            KeyCode::Char('/') => self.is_typing = true,
            other => self.scroll.key(other),
        }
        Wish::Continue
    }

    fn draw(&mut self, frame: &mut Frame<'_>) {
        let width = usize::from(frame.area().width.saturating_sub(BORDER));
        let head = self.head().into_iter();
        let head: Vec<_> = head
            .flat_map(|line| wrapped(&line, width, INDENT))
            .collect();
        let rows = u16::try_from(head.len()).unwrap_or(u16::MAX);
        let areas = Layout::vertical([
            Constraint::Length(rows.saturating_add(BORDER)),
            Constraint::Min(3),
            Constraint::Length(1),
        ]);
        let [about, values, keys] = areas.areas(frame.area());
        let block = Block::bordered().title(self.title.clone());
        frame.render_widget(Paragraph::new(head).block(block), about);
        self.draw_values(frame, values);
        let text = if self.is_typing {
            format!("filter: {}_   Enter: done", self.filter)
        } else if self.filter.is_empty() {
            "/ filter   arrows, PgUp, PgDn: scroll   q: end".to_owned()
        } else {
            format!("filter: {}   / change   q: end", self.filter)
        };
        frame.render_widget(Paragraph::new(text), keys);
    }
}
