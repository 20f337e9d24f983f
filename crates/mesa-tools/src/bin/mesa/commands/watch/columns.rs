//! Columns of the list of pins. A terminal is never cut: other columns shrink or go first.

use std::fmt::Write;

use super::view::shortened;
use crate::ui::full_screen::{SAMPLES, Trend, wrapped_text};

/// Columns in front of a pin, whose heading has none.
const INDENT: usize = 1;
/// Least width of a shortened name beside its terminal.
const SHORTEST_NAME: usize = 16;
/// Widths that values and notes usually have; a longer one makes its column wider.
const VALUE: usize = 12;
const NOTE: usize = 11;
/// Least width of a trend.
const SHORTEST_TREND: usize = 8;

/// The parts of a pin's line.
#[derive(Clone, Debug)]
pub struct Cells<'a> {
    pub name: &'a str,
    pub value: String,
    /// Note about a value that is not valid.
    pub note: Option<String>,
    pub trend: Option<&'a Trend>,
    pub place: String,
}

/// Widths of the columns; those of 0 are not shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Columns {
    width: usize,
    name: usize,
    value: usize,
    /// Without this column a note takes the place of its value.
    note: usize,
    trend: usize,
    /// Longer places are on lines of their own.
    place: usize,
}

impl Columns {
    /// Columns for these pins, in lines of `width` characters.
    pub fn fit(width: usize, pins: &[&Cells<'_>]) -> Self {
        let widest = |part: fn(&Cells<'_>) -> usize| {
            let widths = pins.iter().map(|cells| part(cells));
            widths.max().unwrap_or(0)
        };
        let name = widest(|cells| count(cells.name));
        let value = widest(|cells| count(&cells.value)).max(VALUE);
        let note = widest(|cells| cells.note.as_deref().map_or(0, count));
        // Without a column of notes, they are in that of the values.
        let both = value.max(note);
        let room = width.saturating_sub(INDENT + both + 1);
        let room_for_places = room.saturating_sub(SHORTEST_NAME.min(name) + 1);
        let places = pins.iter().map(|cells| count(&cells.place));
        let place = places.filter(|&place| place <= room_for_places).max();
        let place = place.unwrap_or(0);
        let room = room.saturating_sub(if place > 0 { place + 1 } else { 0 });
        let name = name.min(room);
        let (note, spare) = (note.max(NOTE), room - name + both - value);
        let columns = Self {
            width,
            name,
            place,
            ..Self::default()
        };
        if spare <= note {
            return Self {
                value: both,
                ..columns
            };
        }
        let trend = spare.saturating_sub(note + 2).min(SAMPLES);
        Self {
            value,
            note,
            trend: if trend < SHORTEST_TREND { 0 } else { trend },
            ..columns
        }
    }

    /// The lines of a pin.
    pub fn lines(&self, cells: &Cells<'_>) -> Vec<String> {
        let (name_width, value_width, note_width) = (self.name, self.value, self.note);
        let name = shortened(cells.name, name_width);
        let note = cells.note.as_deref();
        let value = match note {
            Some(note) if note_width == 0 => note,
            _ => &cells.value,
        };
        let mut line = format!(" {name:<name_width$} {value:>value_width$}");
        if note_width > 0 {
            let note = note.unwrap_or_default();
            let _ = write!(line, " {note:<note_width$}");
        }
        let trend = self.trend;
        if let Some(samples) = cells.trend.filter(|_| trend > 0) {
            let _ = write!(line, " {samples:trend$.trend$}");
        }
        let place = &cells.place;
        if count(place) <= self.place {
            return vec![format!("{line} {place}").trim_end().to_owned()];
        }
        let place = wrapped_text(&format!("   {place}"), self.width, 5);
        std::iter::once(line).chain(place).collect()
    }
}

fn count(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells<'a>(name: &'a str, value: &str, note: Option<&str>, place: &str) -> Cells<'a> {
        Cells {
            name,
            value: value.to_owned(),
            note: note.map(str::to_owned),
            trend: None,
            place: place.to_owned(),
        }
    }

    /// The pins of a 7I77, and the widest terminals.
    fn pins() -> Vec<Cells<'static>> {
        vec![
            cells("7i77.0.0.input-02", "ON", None, "TB8 pin 3 INPUT2"),
            cells(
                "7i77.0.0.input-03",
                "off",
                Some("old 12 min 3 s"),
                "TB8 pin 4 INPUT3",
            ),
            cells(
                "encoder.00.position-interpolated",
                "-12345678.1234 mm",
                Some("never read"),
                "TB3 pin 1, 2, 4, 5 QA0, /QA0, QB0, /QB0",
            ),
            cells("watchdog.has_bit", "off", None, ""),
        ]
    }

    #[test]
    fn terminal_is_whole_at_any_width_and_so_are_values_and_notes() {
        let pins = pins();
        for width in 20..200 {
            let columns = Columns::fit(width, &pins.iter().collect::<Vec<_>>());
            for pin in &pins {
                let lines = columns.lines(pin);
                let text = lines.join("\n");
                let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
                assert!(words.contains(&pin.place), "{width}: {text}");
                match &pin.note {
                    Some(note) => assert!(text.contains(note), "{width}: {text}"),
                    None => assert!(text.contains(&pin.value), "{width}: {text}"),
                }
                let fits = lines
                    .iter()
                    .all(|line| line.trim_end().chars().count() <= width);
                assert!(fits, "{width}: {text}");
            }
        }
    }

    #[test]
    fn trend_goes_first_then_the_note_then_a_part_of_the_name() {
        let pins = pins();
        let shown = |width| {
            let columns = Columns::fit(width, &pins.iter().collect::<Vec<_>>());
            (columns.name, columns.note > 0, columns.trend, columns.place)
        };
        assert_eq!(shown(160), (32, true, 24, 39));
        assert_eq!(shown(120), (32, true, 13, 39));
        assert_eq!(shown(110), (32, true, 0, 39));
        assert_eq!(shown(100), (32, false, 0, 39));
        assert_eq!(shown(80), (21, false, 0, 39));
        assert_eq!(shown(60), (24, false, 0, 16), "the longest is below");
        assert_eq!(shown(40), (21, false, 0, 0), "all are below");
    }

    #[test]
    fn terminals_that_fit_stay_beside_the_names() {
        let pins = &pins()[..2];
        let columns = Columns::fit(78, &pins.iter().collect::<Vec<_>>());
        let beside = format!(" 7i77.0.0.input-02 {:>12} {:14} TB8 pin 3 INPUT2", "ON", "");
        assert_eq!(columns.lines(&pins[0]), [beside]);
        assert!(columns.lines(&pins[1])[0].contains("off old 12 min 3 s TB8 pin 4"));
    }
}
