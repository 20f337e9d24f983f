//! Lines that fit a narrow screen: nothing of a text is cut.

use ratatui::style::Style;
use ratatui::text::{Line, Span};

/// The first of several texts that fits, or else the last one.
pub fn fitting(width: usize, mut texts: Vec<String>) -> String {
    let last = texts.pop().unwrap_or_default();
    let mut texts = texts.into_iter();
    let fitting = texts.find(|text| text.chars().count() <= width);
    fitting.unwrap_or(last)
}

/// Breaks a line that is too long at spaces, and a word that is too long anywhere. Continuations
/// are indented, by half of the width at most.
pub fn wrapped(line: &Line<'_>, width: usize, indent: usize) -> Vec<Line<'static>> {
    let letters = letters(line);
    let indent = indent.min(width / 2);
    let mut lines = Vec::new();
    let mut left = &letters[..];
    let mut room = width.max(1);
    while left.len() > room {
        let (now, rest) = left.split_at(breaking(left, room));
        lines.push(joined(now, indent * usize::from(!lines.is_empty())));
        let blanks = rest.iter().take_while(|(letter, _)| *letter == ' ');
        left = rest.get(blanks.count()..).unwrap_or_default();
        room = width.saturating_sub(indent).max(1);
    }
    if !left.is_empty() || lines.is_empty() {
        lines.push(joined(left, indent * usize::from(!lines.is_empty())));
    }
    lines
}

/// As [`wrapped`], for a text.
pub fn wrapped_text(text: &str, width: usize, indent: usize) -> Vec<String> {
    let lines = wrapped(&Line::raw(text), width, indent).into_iter();
    lines.map(|line| line.to_string()).collect()
}

type Letter = (char, Style);

fn letters(line: &Line<'_>) -> Vec<Letter> {
    let spans = line.spans.iter();
    let letters = spans.flat_map(|span| {
        let style = line.style.patch(span.style);
        span.content.chars().map(move |letter| (letter, style))
    });
    letters.collect()
}

/// Index at which to break `letters`, of which `room` fit. The indentation of the line is no place
/// to break.
fn breaking(letters: &[Letter], room: usize) -> usize {
    let is_blank = |at: usize| letters.get(at).is_some_and(|(letter, _)| *letter == ' ');
    let begin = (0..letters.len()).take_while(|&at| is_blank(at)).count();
    let spaces = (begin..=room).rev();
    spaces.into_iter().find(|&at| is_blank(at)).unwrap_or(room)
}

/// A line of these letters, without the spaces at its end.
fn joined(letters: &[Letter], indent: usize) -> Line<'static> {
    let words = letters.iter().rposition(|(letter, _)| *letter != ' ');
    let letters = letters.get(..words.map_or(0, |last| last + 1));
    let runs = letters.unwrap_or_default().chunk_by(|a, b| a.1 == b.1);
    let spans = runs.filter_map(|run| {
        let text: String = run.iter().map(|(letter, _)| letter).collect();
        Some(Span::styled(text, run.first()?.1))
    });
    let indent = (indent > 0).then(|| Span::raw(" ".repeat(indent)));
    Line::from(indent.into_iter().chain(spans).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ratatui::style::Color;

    #[test]
    fn no_word_of_a_long_line_is_lost_at_any_width() {
        let text = "  TB3 pin 1, 2, 4, 5 QA0, /QA0, QB0, /QB0  7i77.0.0.a-name-longer-than-that";
        for width in 1..100 {
            let lines = wrapped_text(text, width, 4);
            let is_narrow = |line: &String| line.chars().count() <= width.max(2);
            assert!(lines.iter().all(is_narrow), "{width}: {lines:?}");
            let letters = |text: &str| text.replace(' ', "");
            assert_eq!(letters(&lines.concat()), letters(text), "{width}");
            if width >= 40 {
                let words = |text: &str| text.split_whitespace().map(str::to_owned).collect();
                let all: Vec<String> = words(&lines.join(" "));
                assert_eq!(all, words(text), "{width}: words are whole");
            }
        }
        assert_eq!(wrapped_text("", 10, 4), [""]);
        assert_eq!(wrapped_text("ab cd  ", 5, 4), ["ab cd"]);
    }

    #[test]
    fn words_keep_their_colours() {
        let red = Style::new().fg(Color::Red);
        let line = Line::from(vec![
            Span::raw("board     "),
            Span::styled("NOT REACHED", red),
        ]);
        let lines = wrapped(&line, 14, 2);
        assert_eq!(lines[0].to_string(), "board     NOT");
        assert_eq!(
            lines[1],
            Line::from(vec![Span::raw("  "), Span::styled("REACHED", red)])
        );
    }

    #[test]
    fn first_text_that_fits_is_taken() {
        let texts = || {
            vec![
                "longest one".to_owned(),
                "shorter".to_owned(),
                "x".to_owned(),
            ]
        };
        let fit = [20, 11, 10, 7, 6, 0].map(|width| fitting(width, texts()));
        assert_eq!(
            fit,
            ["longest one", "longest one", "shorter", "shorter", "x", "x"]
        );
    }
}
