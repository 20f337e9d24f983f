//! The screen: keys, samples and drawing.

use std::time::Duration;

use mesa_hal::driver::{BoardState, RemoteState};
use mesa_hal::hal::{AnyValue, PinInfo, Reading};
use mesa_hal::runner::Snapshot;
use ratatui::Frame;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line as TextLine, Span};
use ratatui::widgets::{Block, Gauge, Paragraph};

use crate::full_screen::{Palette, SAMPLES, Scroll, Trend, Wish, short_time};
use crate::place;

use super::view::{self, Line};

/// Terminals with fewer rows have no room for the cycle and the remotes.
const LOW: u16 = 20;
/// With fewer columns, the terminal of a pin comes before its trend.
const NARROW: u16 = 120;
/// Columns of a narrow screen that are not for names: value, state, terminal, and the border.
const OTHERS_NARROW: usize = 53;
/// Columns of a wide screen that are not for names: the trend as well.
const OTHERS: usize = 59 + SAMPLES;

/// State of the screen.
#[derive(Debug)]
pub struct Pins {
    board: String,
    period: Duration,
    filter: String,
    is_typing: bool,
    scroll: Scroll,
    seen: Option<Snapshot>,
    lines: Vec<Line>,
    /// Trend of each pin.
    trends: Vec<Trend>,
    palette: Palette,
}

impl Pins {
    pub fn new(board: &str, period: Duration, filter: String) -> Self {
        Self {
            board: board.to_owned(),
            period,
            filter,
            is_typing: false,
            scroll: Scroll::default(),
            seen: None,
            lines: Vec::new(),
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
            KeyCode::Up => self.scroll.to(self.scroll.first.saturating_sub(1)),
            KeyCode::Down => self.scroll.to(self.scroll.first + 1),
            KeyCode::PageUp => self.scroll.page_up(),
            KeyCode::PageDown => self.scroll.page_down(),
            KeyCode::Home => self.scroll.to(0),
            KeyCode::End => self.scroll.to(usize::MAX),
            _ => {}
        }
        Wish::Continue
    }

    /// Applies a changed filter.
    fn choose(&mut self) {
        let Some(seen) = &self.seen else {
            return;
        };
        let Ok(pattern) = self.filter.parse();
        self.lines = view::lines(seen, &pattern, &self.board);
        self.scroll.to(0);
    }

    pub fn draw(&mut self, frame: &mut Frame<'_>) {
        let Some(seen) = self.seen.clone() else {
            frame.render_widget(Paragraph::new("waiting for the first cycle"), frame.area());
            return;
        };
        let remotes = seen.remotes().count() as u16;
        // A low terminal shows pins instead of the cycle and the remotes.
        let [cycle, remotes] = if frame.area().height < LOW {
            [0, 0]
        } else {
            [3, remotes.clamp(1, 8) + 2]
        };
        let areas = Layout::vertical([
            Constraint::Length(if cycle == 0 { 3 } else { 5 }),
            Constraint::Length(cycle),
            Constraint::Length(remotes),
            Constraint::Min(3),
            Constraint::Length(1),
        ]);
        let [board, cycle, remotes, pins, keys] = areas.areas(frame.area());
        self.draw_board(frame, board, &seen);
        self.draw_cycle(frame, cycle, &seen);
        self.draw_remotes(frame, remotes, &seen);
        self.draw_pins(frame, pins, &seen);
        self.draw_keys(frame, keys);
    }

    fn draw_board(&self, frame: &mut Frame<'_>, area: Rect, seen: &Snapshot) {
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
        let (bus, driver) = (seen.bus_statistics(), seen.driver_statistics());
        let text = vec![
            TextLine::from(vec![
                Span::raw("board     "),
                Span::styled(words, self.palette.style(color)),
                Span::raw(format!(" for {since}, cycle {}", seen.cycle())),
            ]),
            TextLine::from(format!(
                "packets   {} exchanges: {} lost, {} late, {} stale, {} duplicate, {} writes lost",
                bus.exchanges, bus.lost, bus.late, bus.stale, bus.duplicate, bus.lost_writes
            )),
            TextLine::from(format!(
                "watchdog  has bitten {} times; board reset {} times, not reached {} times",
                driver.watchdog_bites, driver.resets, driver.bus_down
            )),
        ];
        let title = format!(" {} ", self.board);
        frame.render_widget(
            Paragraph::new(text).block(Block::bordered().title(title)),
            area,
        );
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
        let title = format!(
            " cycle: longest {} us, at most {} us late, {} periods skipped ",
            micros(run.longest),
            micros(run.latest),
            run.skipped_periods
        );
        let label = format!("{} of {} us", micros(run.last_took), micros(self.period));
        let gauge = Gauge::default()
            .block(Block::bordered().title(title))
            .gauge_style(self.palette.style(color))
            .ratio(share.clamp(0.0, 1.0))
            .label(label);
        frame.render_widget(gauge, area);
    }

    fn draw_remotes(&self, frame: &mut Frame<'_>, area: Rect, seen: &Snapshot) {
        let lines = seen.remotes().map(|remote| {
            let [place, state, since, rest] = view::remote(&remote, seen);
            let color = match remote.state {
                RemoteState::Running => Color::Green,
                _ => Color::Red,
            };
            TextLine::from(vec![
                Span::raw(format!("{place:<10}")),
                Span::styled(format!("{state:<11}"), self.palette.style(color)),
                Span::raw(format!("{:<12} {rest}", format!("for {since}"))),
            ])
        });
        let mut lines: Vec<_> = lines.collect();
        if lines.is_empty() {
            lines.push(TextLine::from("none takes part"));
        }
        let block = Block::bordered().title(" remotes ");
        frame.render_widget(Paragraph::new(lines).block(block), area);
    }

    fn draw_pins(&mut self, frame: &mut Frame<'_>, area: Rect, seen: &Snapshot) {
        let rows = usize::from(area.height.saturating_sub(2));
        self.scroll.fit(self.lines.len(), rows);
        let readings: Vec<_> = seen.pins().collect();
        let width = self.name_width(area, &readings);
        let lines = self.lines.iter().skip(self.scroll.first).take(rows);
        let lines = lines.map(|line| match line {
            Line::Heading(heading) => {
                let style = Style::new().add_modifier(Modifier::BOLD);
                TextLine::styled(heading.clone(), style)
            }
            Line::Pin(number) => match (readings.get(*number), self.trends.get(*number)) {
                (Some((info, reading)), Some(trend)) => {
                    let state = view::state(info, *reading);
                    let color = match (state.is_empty(), reading.value.bits) {
                        (false, _) => Color::Red,
                        (true, 0) => Color::Reset,
                        (true, _) => Color::Green,
                    };
                    let value = view::number(reading.value, &info.unit);
                    let name = view::short(&info.name, &self.board);
                    let place = place::short(&info.place);
                    let name = view::shortened(name, width);
                    let text = if area.width < NARROW {
                        format!(" {name:<width$} {value:>12} {state:<9} {place:<26} {trend}")
                    } else {
                        format!(
                            "  {name:<width$} {value:>14} {state:<10} {trend:SAMPLES$}  {place}"
                        )
                    };
                    TextLine::styled(text, self.palette.style(color))
                }
                _ => TextLine::default(),
            },
        });
        let lines: Vec<_> = lines.collect();
        let pins = self
            .lines
            .iter()
            .filter(|line| matches!(line, Line::Pin(_)))
            .count();
        let title = format!(" {pins} of {} pins and parameters ", readings.len());
        let block = Block::bordered().title(title);
        frame.render_widget(Paragraph::new(lines).block(block), area);
    }

    /// Width of the column of names: that of the longest one, as far as the other columns have
    /// room beside it.
    fn name_width(&self, area: Rect, readings: &[(&PinInfo, Reading<AnyValue>)]) -> usize {
        let names = self.lines.iter().filter_map(|line| match line {
            Line::Pin(number) => readings.get(*number).map(|(info, _)| &*info.name),
            Line::Heading(_) => None,
        });
        let widths = names.map(|name| view::short(name, &self.board).chars().count());
        let [least, others] = if area.width < NARROW {
            [25, OTHERS_NARROW]
        } else {
            [34, OTHERS]
        };
        let room = usize::from(area.width).saturating_sub(others).max(least);
        widths.max().unwrap_or(0).clamp(least, room)
    }

    fn draw_keys(&self, frame: &mut Frame<'_>, area: Rect) {
        let text = if self.is_typing {
            format!("filter: {}_   Enter: done", self.filter)
        } else if self.filter.is_empty() {
            "/ filter   arrows, PgUp, PgDn: scroll   q: end".to_owned()
        } else {
            format!("filter: {}   / change   q: end", self.filter)
        };
        frame.render_widget(Paragraph::new(text), area);
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use mesa_hal::runner::SnapshotWriter;
    use mesa_hal::{Clock, Driver};
    use mesa_hal_sim::{SimFpga, machines};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    const PERIOD: Duration = Duration::from_millis(1);

    fn driver() -> Driver<SimFpga> {
        let board = machines::six_axes_7i92(mesa_hal_sim::Motor::default());
        Driver::start(board, mesa_hal::Settings::default()).unwrap()
    }

    fn run(driver: &mut Driver<SimFpga>, cycles: u32) -> Snapshot {
        let mut writer = SnapshotWriter::new(driver);
        for _ in 0..cycles {
            let _ = driver.read();
            driver.write().unwrap();
            driver.bus_mut().wait(PERIOD);
            writer.publish(driver).unwrap();
        }
        writer.reader().read().unwrap()
    }

    /// Snapshot of a running machine with a 7I77.
    pub fn snapshot() -> Snapshot {
        run(&mut driver(), 20)
    }

    fn picture(screen: &mut Pins) -> String {
        picture_of(screen, 120, 40)
    }

    fn picture_of(screen: &mut Pins, width: u16, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| screen.draw(frame)).unwrap();
        terminal.backend().to_string()
    }

    fn press(screen: &mut Pins, codes: &[KeyCode]) -> Wish {
        let keys = codes
            .iter()
            .map(|&code| KeyEvent::new(code, KeyModifiers::NONE));
        keys.map(|key| screen.key(key))
            .last()
            .unwrap_or(Wish::Continue)
    }

    fn type_text(screen: &mut Pins, text: &str) {
        let codes: Vec<_> = text.chars().map(KeyCode::Char).collect();
        assert_eq!(press(screen, &codes), Wish::Continue);
    }

    fn screen(filter: &str) -> Pins {
        let mut screen = Pins::new("hm2_7i92.0", PERIOD, filter.to_owned());
        screen.take(&snapshot());
        screen
    }

    #[test]
    fn board_packets_watchdog_cycle_remotes_and_pins_are_on_the_screen() {
        let picture = picture(&mut screen(""));
        for text in [
            " hm2_7i92.0 ",
            "board     running for",
            "packets   ",
            "0 lost",
            "watchdog  has bitten 0 times",
            " of 1000 us",
            "0.0 7I77  running",
            "0.1 7I77  running",
            "pins and parameters",
            "/ filter",
        ] {
            assert!(picture.contains(text), "{text}\n{picture}");
        }
    }

    #[test]
    fn what_is_typed_filters_at_once_and_q_is_a_letter_there() {
        let mut screen = screen("");
        type_text(&mut screen, "/inq");
        assert!(picture(&mut screen).contains("filter: inq_"));
        assert!(picture(&mut screen).contains(" 0 of "));
        press(&mut screen, &[KeyCode::Backspace]);
        type_text(&mut screen, "put-02");
        press(&mut screen, &[KeyCode::Enter]);
        let shown = picture(&mut screen);
        assert!(shown.contains("TB8 of 7i77.0.0"), "{shown}");
        assert!(shown.contains("7i77.0.0.input-02  "), "{shown}");
        assert!(shown.contains("TB8 pin 3 INPUT2"), "{shown}");
        assert!(!shown.contains("input-03"), "{shown}");
        assert_eq!(press(&mut screen, &[KeyCode::Char('q')]), Wish::End);
    }

    #[test]
    fn q_and_escape_end_it() {
        let mut screen = screen("");
        assert_eq!(press(&mut screen, &[KeyCode::Esc]), Wish::End);
        let keys = [KeyCode::Char('/'), KeyCode::Esc];
        assert_eq!(
            press(&mut screen, &keys),
            Wish::Continue,
            "it ends the filter"
        );
        assert_eq!(press(&mut screen, &[KeyCode::Char('q')]), Wish::End);
    }

    #[test]
    fn scrolling_stays_within_the_list() {
        let mut screen = screen("");
        let first = picture(&mut screen);
        press(&mut screen, &[KeyCode::Up, KeyCode::PageUp]);
        assert_eq!(picture(&mut screen), first);
        press(&mut screen, &[KeyCode::End]);
        let last = picture(&mut screen);
        assert_ne!(last, first);
        press(&mut screen, &[KeyCode::PageDown, KeyCode::Down]);
        assert_eq!(picture(&mut screen), last);
        press(&mut screen, &[KeyCode::Home]);
        assert_eq!(picture(&mut screen), first);
    }

    #[test]
    fn a_remote_that_is_pulled_out_is_shown_with_its_reason() {
        let mut driver = driver();
        let _ = run(&mut driver, 20);
        drop(driver.bus_mut().plug(0, 0, None));
        let mut screen = Pins::new("hm2_7i92.0", PERIOD, "input-02".to_owned());
        screen.take(&run(&mut driver, 200));
        let shown = picture(&mut screen);
        assert!(shown.contains("0.0 7I77  OFFLINE"), "{shown}");
        assert!(shown.contains("too many failed transfers"), "{shown}");
        assert!(shown.contains("old "), "{shown}");
        assert!(shown.contains("0.1 7I77  running"), "{shown}");
    }

    #[test]
    fn a_small_terminal_shows_pins_with_their_terminals() {
        let mut screen = screen("input-02");
        let narrow = picture_of(&mut screen, 80, 24);
        let pin = narrow.lines().find(|line| line.contains("input-02 "));
        assert!(
            pin.is_some_and(|line| line.contains("TB8 pin 3 INPUT2")),
            "{narrow}"
        );
        let low = picture_of(&mut screen, 80, 12);
        assert!(
            low.contains("TB8 pin 3 INPUT2") && low.contains("running for"),
            "{low}"
        );
    }

    #[test]
    fn the_column_of_names_is_as_wide_as_the_longest_one_if_there_is_room() {
        let snapshot = snapshot();
        let names = snapshot.infos().iter();
        let names = names.map(|info| view::short(&info.name, "hm2_7i92.0").to_owned());
        let longest = names.max_by_key(String::len).unwrap();
        assert!(longest.len() > 80 - OTHERS_NARROW, "{longest}");
        let (module, _) = longest.rsplit_once('.').unwrap();
        let mut screen = screen(module);
        let shortened = view::shortened(&longest, 80 - OTHERS_NARROW);
        for (columns, shown) in [(160, &longest), (100, &longest), (80, &shortened)] {
            let picture = picture_of(&mut screen, columns, 60);
            assert!(picture.contains(&format!(" {shown} ")), "{picture}");
            let width = match columns {
                160 => 35,
                _ => shown.chars().count(),
            };
            let pins = format!("{module}.");
            let lines = picture.lines().filter(|line| line.contains(&pins));
            let after: Vec<_> = lines.map(|line| line.chars().nth(3 + width)).collect();
            assert!(after.len() > 5, "{picture}");
            assert!(after.iter().all(|after| *after == Some(' ')), "{picture}");
        }
    }

    #[test]
    fn a_screen_of_any_size_is_drawn() {
        let mut screen = screen("");
        for (width, height) in [(1, 1), (10, 5), (20, 12), (300, 100)] {
            let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
            terminal.draw(|frame| screen.draw(frame)).unwrap();
        }
    }
}
