//! Pictures of the screen, on virtual time.

mod faults;

use super::*;
use mesa_hal::runner::SnapshotWriter;
use mesa_hal::{Clock, Driver};
use mesa_hal_sim::devices::find_mut;
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
    let mut screen = Pins::new("hm2_7i92.0", PERIOD, filter.to_owned(), false);
    screen.take(&snapshot());
    screen
}

/// Lines of a picture within the frame, without the spaces around.
fn lines(picture: &str) -> Vec<&str> {
    let lines = picture
        .lines()
        .map(|line| line.trim_matches(['"', '│', ' ']));
    lines.collect()
}

#[test]
fn screen_shows_board_packets_watchdog_cycle_remotes_and_pins() {
    let picture = picture(&mut screen(""));
    for text in [
        " hm2_7i92.0 ",
        "board     running for",
        "packets   ",
        "0 lost",
        "watchdog  has bitten 0 times",
        " of 1000 us",
        "7i77.0.0  running",
        "7i77.0.1  running",
        " pins: ",
        "/ filter   a: all pins   arrows",
    ] {
        assert!(picture.contains(text), "{text}\n{picture}");
    }
}

/// The value of a pin in a picture.
fn value<'a>(picture: &'a str, pin: &str) -> Option<&'a str> {
    let mut lines = lines(picture).into_iter();
    let rest = lines.find_map(|line| line.strip_prefix(pin)?.strip_prefix(' '));
    rest?.split_whitespace().next()
}

#[test]
fn value_of_an_input_follows_its_switch() {
    let mut driver = driver();
    let mut screen = screen("7i77.0.0.input-0");
    for (level, shown) in [(true, "ON"), (false, "off"), (true, "ON")] {
        let field = driver.bus_mut().remote_mut(0, 0).unwrap();
        find_mut(field).unwrap().set_input(7, level).unwrap();
        screen.take(&run(&mut driver, 20));
        let picture = picture(&mut screen);
        assert_eq!(
            value(&picture, "7i77.0.0.input-07"),
            Some(shown),
            "{picture}"
        );
        assert_eq!(
            value(&picture, "7i77.0.0.input-06"),
            Some("off"),
            "{picture}"
        );
    }
}

#[test]
fn typed_text_filters_at_once_and_q_is_a_letter_in_the_filter() {
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
fn small_terminal_shows_pins_with_their_terminals() {
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
fn pins_without_terminals_come_last_and_a_key_adds_parameters() {
    let mut screen = screen("");
    let first = picture(&mut screen);
    let heading = lines(&first)
        .into_iter()
        .find(|line| line.starts_with("TB"));
    let title = first.lines().find(|line| line.contains(" pins: "));
    let title = title.expect("the list has a title").to_owned();
    let at = |text: &str| first.lines().position(|line| line.contains(text));
    let heading = heading.expect("a terminal block");
    assert_eq!(at(heading), at(" pins: ").map(|title| title + 1), "{first}");
    let whole = picture_of(&mut screen, 120, 2000);
    assert!(!whole.contains("-not "), "{whole}");
    press(&mut screen, &[KeyCode::Char('a')]);
    let all = picture(&mut screen);
    let count = snapshot().infos().len();
    assert!(
        all.contains(&format!(" pins and parameters: {count}; a: less ")),
        "{all}"
    );
    let whole = picture_of(&mut screen, 120, 2000);
    for hidden in ["encoder.00.scale ", "7i77.0.0.input-00-not "] {
        assert!(whole.contains(hidden), "{whole}");
    }
    press(&mut screen, &[KeyCode::Char('a')]);
    assert!(picture(&mut screen).contains(&title));
    // In a filter it is a letter.
    type_text(&mut screen, "/a");
    assert!(picture(&mut screen).contains("filter: a_"));
}

#[test]
fn hidden_pins_are_counted() {
    let mut screen = screen("input-02");
    assert!(picture(&mut screen).contains(" pins: 1; a: 1 more "));
}

/// The text at three widths: a terminal is whole at each of them.
#[test]
fn line_of_a_pin_fits_narrow_screens() {
    let mut screen = screen("7i77.0.0.input-02");
    let name = "7i77.0.0.input-02";
    let line = |trend: usize| {
        format!(
            "{name}          off {:11} {:trend$} TB8 pin 3 INPUT2",
            "", "▁"
        )
    };
    for (columns, wanted) in [
        (120, vec![line(24)]),
        (80, vec![line(17)]),
        (
            40,
            vec![
                format!("{name}          off"),
                "TB8 pin 3 INPUT2".to_owned(),
            ],
        ),
    ] {
        let picture = picture_of(&mut screen, columns, 30);
        let found = lines(&picture);
        let at = found.iter().position(|line| line.starts_with(name));
        let at = at.unwrap_or_else(|| panic!("{columns}: {picture}"));
        assert_eq!(found[at..at + wanted.len()], wanted, "{columns}: {picture}");
    }
}

#[test]
fn every_terminal_is_whole_at_any_width() {
    let snapshot = snapshot();
    for columns in [40, 80, 120] {
        let mut screen = screen("");
        press(&mut screen, &[KeyCode::Char('a')]);
        let picture = picture_of(&mut screen, columns, 2000);
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let text = words(&lines(&picture).join(" "));
        for info in snapshot.infos() {
            let place = place::short(&info.place);
            assert!(text.contains(&place), "{columns}: {place}: {picture}");
        }
    }
}

#[test]
fn board_and_remote_lines_are_not_truncated() {
    for columns in [40, 80, 120] {
        let picture = picture_of(&mut screen(""), columns, 60);
        let text = lines(&picture).join(" ");
        for wanted in [
            "0 duplicate, 0 writes lost",
            "not reached 0 times",
            "7i77.0.1  running",
            "0 failed",
        ] {
            assert!(text.contains(wanted), "{columns}: {wanted}: {picture}");
        }
    }
}

#[test]
fn screen_of_any_size_is_drawn() {
    let mut screen = screen("");
    for (width, height) in [(1, 1), (10, 5), (20, 12), (300, 100)] {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| screen.draw(frame)).unwrap();
    }
}
