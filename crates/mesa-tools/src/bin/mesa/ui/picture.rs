//! Parts of all pictures: fonts, colours, texts, ticks.

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::ui::context::Failure;

/// Area of a picture, in pixels.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

pub const FONT: &str = "sans-serif";
/// Size of the texts at axes and traces, in pixels.
pub const SMALL: u32 = 14;
pub const GREY: RGBColor = RGBColor(90, 90, 90);
pub const RED: RGBColor = RGBColor(192, 57, 43);
pub const GREEN: RGBColor = RGBColor(39, 134, 72);
pub const YELLOW: RGBColor = RGBColor(214, 158, 20);

/// Colours of traces, which are told apart on white by most people.
pub const TRACES: [RGBColor; 6] = [
    RGBColor(31, 119, 180),
    RGBColor(211, 96, 0),
    RGBColor(44, 140, 80),
    RGBColor(128, 82, 170),
    RGBColor(150, 90, 40),
    RGBColor(0, 140, 150),
];

/// Text of a colour and size, in pixels.
pub fn text(size: u32, colour: RGBColor) -> TextStyle<'static> {
    (FONT, size).into_font().color(&colour)
}

/// Writes a line of text into an area, from the pixel `x` on at the height `y`.
pub fn write(
    area: &Area<'_>,
    line: &str,
    at: (i32, i32),
    style: TextStyle<'static>,
) -> Result<(), Failure> {
    area.draw(&Text::new(line.to_owned(), at, style))
        .map_err(failed)
}

/// Number at an axis, without zeros behind its last digit that counts.
pub fn tick(number: f64) -> String {
    let text = format!("{number:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    match text {
        "-0" => "0".to_owned(),
        text => text.to_owned(),
    }
}

/// Breaks a text at spaces into lines of at most `width` characters; a longer word has its own
/// line.
pub fn lines(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + word.chars().count() < width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// A picture that could not be drawn.
pub fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::refused(format_args!("the picture: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_no_word_of_a_text_is_lost() {
        let ticks = [0.0, -0.0, 1500.0, -0.25, 0.000_001, 2.000_000_4].map(tick);
        assert_eq!(ticks, ["0", "0", "1500", "-0.25", "0.000001", "2"]);
        let text = "no cycle needs more than 400 us of 1000";
        assert_eq!(lines(text, 100), [text]);
        let broken = lines(text, 12);
        assert!(broken.iter().all(|line| line.len() <= 12), "{broken:?}");
        assert_eq!(broken.join(" "), text);
        assert_eq!(lines("unbreakable", 4), ["unbreakable"]);
    }
}
