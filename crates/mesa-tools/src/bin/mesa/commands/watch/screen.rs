//! The screen: keys, samples and drawing.

#[cfg(test)]
pub mod tests;

use std::time::Duration;

use mesa_hal::driver::BoardState;
use mesa_hal::runner::Snapshot;
use ratatui::Frame;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line as TextLine, Span};
use ratatui::widgets::{Block, Gauge, Paragraph};

use crate::board::place;
use crate::ui::colours::Palette;
use crate::ui::full_screen::{Scroll, Trend, Wish, fitting, short_time, wrapped};
use mesa_tools::Counted;

use super::columns::{Cells, Columns};
use super::view::{self, Line, Listing, RemoteLine};

/// Columns of the words in front of the lines about the board, and of the places of remotes.
const MARGIN: usize = 10;
/// Rows of the border of a part of the screen.
const BORDER: u16 = 2;
/// Rows of the gauge of the cycle.
const CYCLE: u16 = 3;

/// State of the screen.
#[derive(Debug)]
pub struct Pins {
    board: String,
    period: Duration,
    filter: String,
    /// Parameters and inverted pins are listed as well.
    is_all: bool,
    is_typing: bool,
    scroll: Scroll,
    seen: Option<Snapshot>,
    listing: Listing,
    /// Trend of each pin.
    trends: Vec<Trend>,
    palette: Palette,
}

impl Pins {
    pub fn new(board: &str, period: Duration, filter: String, is_all: bool) -> Self {
        Self {
            board: board.to_owned(),
            period,
            filter,
            is_all,
            is_typing: false,
            scroll: Scroll::default(),
            seen: None,
            listing: Listing::default(),
            trends: Vec::new(),
            palette: Palette::from_environment(),
        }
    }

    /// Takes the snapshot of a cycle.
    pub fn take(&mut self, snapshot: &Snapshot) {
        self.trends
            .resize_with(snapshot.infos().len(), Trend::default);
        for (trend, (_, reading)) in self.trends.iter_mut().zip(snapshot.pins()) {
            trend.push(reading.value.as_f64());
        }
        let is_first = self.seen.replace(snapshot.clone()).is_none();
        if is_first {
            self.choose();
        }
    }

    /// Handles a key press.
    pub fn key(&mut self, key: KeyEvent) -> Wish {
        let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
        match key.code {
            KeyCode::Enter | KeyCode::Esc if self.is_typing => self.is_typing = false,
            KeyCode::Char(character) if self.is_typing && !is_control => {
                self.filter.push(character);
                self.choose();
            }
            KeyCode::Backspace if self.is_typing => {
                self.filter.pop();
                self.choose();
            }
            KeyCode::Char('q') | KeyCode::Esc => return Wish::End,
            KeyCode::Char('/') => self.is_typing = true,
            KeyCode::Char('a') => {
                self.is_all = !self.is_all;
                self.choose();
            }
            other => self.scroll.key(other),
        }
        Wish::Continue
    }

    /// Applies a changed filter.
    fn choose(&mut self) {
        let Some(seen) = &self.seen else {
            return;
        };
        let Ok(pattern) = self.filter.parse();
        self.listing = Listing::of(seen, &pattern, self.is_all, &self.board);
        self.scroll.to(0);
    }

    pub fn draw(&mut self, frame: &mut Frame<'_>) {
        let Some(seen) = self.seen.clone() else {
            frame.render_widget(Paragraph::new("waiting for the first cycle"), frame.area());
            return;
        };
        let width = usize::from(frame.area().width.saturating_sub(BORDER));
        let state = wrapped(&self.state(&seen), width, MARGIN);
        let counts = counts(&seen).into_iter();
        let counts = counts
            .flat_map(|line| wrapped(&line, width, MARGIN))
            .collect();
        let mut remotes = self.remotes(&seen, width, false);
        let plan = Plan::new(frame.area().height, &[&state, &counts, &remotes]);
        if usize::from(plan.remotes) < remotes.len() + usize::from(BORDER) {
            remotes = self.remotes(&seen, width, true);
        }
        let areas = Layout::vertical([
            Constraint::Length(plan.board),
            Constraint::Length(plan.cycle),
            Constraint::Length(plan.remotes),
            Constraint::Min(3),
            Constraint::Length(1),
        ]);
        let [board, cycle, place_of_remotes, pins, keys] = areas.areas(frame.area());
        let about_board = [state, counts].concat();
        draw_lines(frame, board, format!(" {} ", self.board), about_board);
        self.draw_cycle(frame, cycle, &seen);
        draw_lines(frame, place_of_remotes, " remotes ".to_owned(), remotes);
        self.draw_pins(frame, pins, &seen);
        self.draw_keys(frame, keys);
    }

    /// The state of the board.
    fn state(&self, seen: &Snapshot) -> TextLine<'static> {
        let (state, since) = seen.board();
        let (words, color) = match state {
            BoardState::Running => ("running", Color::Green),
            BoardState::WatchdogBitten => ("WATCHDOG HAS BITTEN", Color::Red),
            BoardState::Reset => ("WAS RESET", Color::Red),
            BoardState::BusDown => ("NOT REACHED", Color::Red),
            BoardState::OtherFirmware => ("ANOTHER FIRMWARE ANSWERS", Color::Red),
            _ => ("?", Color::Red),
        };
        let since = short_time(seen.time().since(since));
        TextLine::from(vec![
            Span::raw("board     "),
            Span::styled(words, self.palette.style(color)),
            Span::raw(format!(" for {since}, cycle {}", seen.cycle())),
        ])
    }

    /// Lines about the remotes. Where the screen is too low for all, those that do not run come
    /// first.
    fn remotes(&self, seen: &Snapshot, width: usize, is_low: bool) -> Vec<TextLine<'static>> {
        let lines = seen.remotes().map(|remote| RemoteLine::of(&remote, seen));
        let mut lines: Vec<_> = lines.collect();
        if lines.is_empty() {
            return vec![TextLine::from("none takes part")];
        }
        if is_low {
            lines.sort_by_key(|line| line.runs);
        }
        let lines = lines.into_iter().flat_map(|line| {
            let color = if line.runs { Color::Green } else { Color::Red };
            let RemoteLine {
                place,
                state,
                since,
                rest,
                ..
            } = line;
            let line = TextLine::from(vec![
                Span::raw(format!("{place:<MARGIN$}")),
                Span::styled(format!("{state:<11}"), self.palette.style(color)),
                Span::raw(format!("{:<12} {rest}", format!("for {since}"))),
            ]);
            wrapped(&line, width, MARGIN)
        });
        lines.collect()
    }

    fn draw_cycle(&self, frame: &mut Frame<'_>, area: Rect, seen: &Snapshot) {
        let run = seen.run_statistics();
        let share = run.last_took.as_secs_f64() / self.period.as_secs_f64();
        let micros = |time: Duration| time.as_micros();
        let color = if share < 0.8 {
            Color::Green
        } else {
            Color::Red
        };
        let longest = format!(" cycle: longest {} us", micros(run.longest));
        let latest = format!("{longest}, at most {} us late", micros(run.latest));
        let skipped = Counted(run.skipped_periods, "period");
        let titles = vec![
            format!("{latest}, {skipped} skipped "),
            latest + " ",
            longest + " ",
        ];
        let title = fitting(usize::from(area.width.saturating_sub(BORDER)), titles);
        let label = format!("{} of {} us", micros(run.last_took), micros(self.period));
        let gauge = Gauge::default()
            .block(Block::bordered().title(title))
            .gauge_style(self.palette.style(color))
            .ratio(share.clamp(0.0, 1.0))
            .label(label);
        frame.render_widget(gauge, area);
    }

    fn draw_pins(&mut self, frame: &mut Frame<'_>, area: Rect, seen: &Snapshot) {
        let lines = self.pin_lines(seen, usize::from(area.width.saturating_sub(BORDER)));
        let rows = usize::from(area.height.saturating_sub(BORDER));
        self.scroll.fit(lines.len(), rows);
        let shown = lines.into_iter().skip(self.scroll.first).take(rows);
        let Listing {
            shown: count,
            hidden,
            ..
        } = self.listing;
        let title = match (self.is_all, hidden) {
            (true, _) => format!(" pins and parameters: {count}; a: less "),
            (false, 0) => format!(" pins: {count} "),
            (false, hidden) => format!(" pins: {count}; a: {hidden} more "),
        };
        draw_lines(frame, area, title, shown.collect());
    }

    /// Lines of all listed pins.
    fn pin_lines(&self, seen: &Snapshot, width: usize) -> Vec<TextLine<'static>> {
        let readings: Vec<_> = seen.pins().collect();
        let cells = |number: usize| {
            let (info, reading) = readings.get(number)?;
            Some(Cells {
                name: view::short(&info.name, &self.board),
                value: view::number(reading.value, &info.unit),
                note: view::note(info, *reading),
                trend: self.trends.get(number),
                place: place::short(&info.place),
            })
        };
        let lines = &self.listing.lines;
        let all: Vec<Option<Cells<'_>>> = lines
            .iter()
            .map(|line| match line {
                Line::Pin(number) => cells(*number),
                Line::Heading(_) => None,
            })
            .collect();
        let shown: Vec<_> = all.iter().flatten().collect();
        let columns = Columns::fit(width, &shown);
        let lines = lines.iter().zip(&all).flat_map(|(line, cells)| match line {
            Line::Heading(heading) => {
                let style = Style::new().add_modifier(Modifier::BOLD);
                vec![TextLine::styled(heading.clone(), style)]
            }
            Line::Pin(number) => {
                let is_on = readings
                    .get(*number)
                    .is_some_and(|(_, reading)| reading.value.bits != 0);
                let lines = cells.iter().flat_map(|cells| {
                    let color = match (&cells.note, is_on) {
                        (Some(_), _) => Color::Red,
                        (None, false) => Color::Reset,
                        (None, true) => Color::Green,
                    };
                    let style = self.palette.style(color);
                    let lines = columns.lines(cells).into_iter();
                    lines.map(move |line| TextLine::styled(line, style))
                });
                lines.collect()
            }
        });
        lines.collect()
    }

    fn draw_keys(&self, frame: &mut Frame<'_>, area: Rect) {
        let all = if self.is_all {
            "a: less"
        } else {
            "a: all pins"
        };
        let texts = if self.is_typing {
            vec![format!("filter: {}_   Enter: done", self.filter)]
        } else if self.filter.is_empty() {
            vec![
                format!("/ filter   {all}   arrows, PgUp, PgDn: scroll   q: end"),
                format!("/ filter  {all}  q: end"),
            ]
        } else {
            vec![
                format!("filter: {}   / change   {all}   q: end", self.filter),
                format!("filter: {}", self.filter),
            ]
        };
        let text = fitting(usize::from(area.width), texts);
        frame.render_widget(Paragraph::new(text), area);
    }
}

/// Counts of the board.
fn counts(seen: &Snapshot) -> [TextLine<'static>; 2] {
    let (bus, driver) = (seen.bus_statistics(), seen.driver_statistics());
    let times = |count| Counted(count, "time");
    [
        TextLine::from(format!(
            "packets   {}: {} lost, {} late, {} stale, {} duplicate, {} lost",
            Counted(bus.exchanges, "exchange"),
            bus.lost,
            bus.late,
            bus.stale,
            bus.duplicate,
            Counted(bus.lost_writes, "write")
        )),
        TextLine::from(format!(
            "watchdog  has bitten {}; board reset {}, not reached {}",
            times(driver.watchdog_bites),
            times(driver.resets),
            times(driver.bus_down)
        )),
    ]
}

/// Lines in a frame with a title.
fn draw_lines(frame: &mut Frame<'_>, area: Rect, title: String, lines: Vec<TextLine<'static>>) {
    let block = Block::bordered().title(title);
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

/// Rows of the parts of the screen above the pins; 0 for a part that is not shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Plan {
    board: u16,
    cycle: u16,
    remotes: u16,
}

impl Plan {
    /// Leaves a third of the screen to the pins. In the rest the state of the board comes first,
    /// then the remotes, the counts of the board and the cycle.
    fn new(height: u16, [state, counts, remotes]: &[&Vec<TextLine<'_>>; 3]) -> Self {
        let rows = |lines: &[TextLine<'_>]| u16::try_from(lines.len()).unwrap_or(u16::MAX);
        let mut room = height.saturating_sub((height / 3).max(5) + 1);
        let mut take = |least: u16, rows: u16| {
            let taken = if room < least { 0 } else { rows.min(room) };
            room -= taken;
            taken
        };
        let board = take(0, rows(state).saturating_add(BORDER));
        let remotes = take(BORDER + 1, rows(remotes).saturating_add(BORDER));
        let counts = rows(counts);
        Self {
            board: board + take(counts, counts),
            cycle: take(CYCLE, CYCLE),
            remotes,
        }
    }
}
