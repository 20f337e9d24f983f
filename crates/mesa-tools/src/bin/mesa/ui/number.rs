//! Formatting of numbers in text output, and parsing of times. Times are formatted with
//! [`mesa_hal::Rounded`]; JSON has every digit.

use std::ops::RangeInclusive;
use std::time::Duration;

/// Formats the value of a pin with four decimals; below 0.001 and from 10 million on in scientific
/// notation with four significant digits.
pub fn value(number: f64) -> String {
    match number.abs() {
        size if size == 0.0 || (1e-3..1e7).contains(&size) => format!("{number:.4}"),
        _ => format!("{number:.3e}"),
    }
}

/// Formats a limit of a range in its shortest form, as a person would type it. Boards and remotes
/// store many limits as 32-bit numbers, whose further digits are meaningless.
pub fn end(number: f64) -> String {
    let short = number as f32;
    match number.abs() {
        size if size >= 1e10 || (size > 0.0 && size < 1e-4) => format!("{number:.3e}"),
        _ if f64::from(short).to_bits() == number.to_bits() => short.to_string(),
        _ => {
            let text = format!("{number:.4}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
    }
}

/// Parses a time in seconds or milliseconds: `2.5s`, `2.5` or `200ms`. The error names the limits.
pub fn time(text: &str, seconds: RangeInclusive<f64>) -> Result<Duration, String> {
    let (number, unit) = match text.strip_suffix("ms") {
        Some(number) => (number, 1e-3),
        None => (text.strip_suffix('s').unwrap_or(text), 1.0),
    };
    let parsed = number.parse::<f64>().map(|number| number * unit);
    let parsed = parsed.ok().filter(|parsed| seconds.contains(parsed));
    parsed.map(Duration::from_secs_f64).ok_or_else(|| {
        let (least, most) = seconds.into_inner();
        format!("`{text}` is no time from {least} s to {most} s, as 2.5s or 500ms")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_four_digits() {
        for (number, text) in [
            (0.0, "0.0000"),
            (1.0, "1.0000"),
            (-23.711_107_671_260_834, "-23.7111"),
            (1e300, "1.000e300"),
            (1.234_56e-6, "1.235e-6"),
        ] {
            assert_eq!(value(number), text);
        }
    }

    #[test]
    fn times_are_seconds_or_milliseconds_within_limits() {
        for (text, millis) in [
            ("2.5s", 2500),
            ("2.5", 2500),
            ("200ms", 200),
            ("60", 60_000),
        ] {
            assert_eq!(time(text, 0.1..=60.0), Ok(Duration::from_millis(millis)));
        }
        for text in [
            "", "s", "ms", "99ms", "60.1", "-1s", "NaN", "inf", "2 s", "2min",
        ] {
            let error = time(text, 0.1..=60.0).expect_err(text);
            let expected = format!("`{text}` is no time from 0.1 s to 60 s, as 2.5s or 500ms");
            assert_eq!(error, expected);
        }
    }

    #[test]
    fn ends_of_ranges_are_what_was_meant() {
        for (number, text) in [
            (0.0, "0"),
            (-10.0, "-10"),
            (36.299_999_237_060_55, "36.3"),
            (2_083_333.333_333_333_3, "2083333.3333"),
            (4_294_967_295.0, "4294967295"),
            (f64::MAX, "1.798e308"),
        ] {
            assert_eq!(end(number), text);
        }
    }
}
