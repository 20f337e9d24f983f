//! Words and numbers of a line.

/// The first word, and the rest.
pub fn split(text: &str) -> Result<(&str, &str), String> {
    text.split_once(' ')
        .filter(|(first, rest)| !first.is_empty() && !rest.trim().is_empty())
        .ok_or_else(|| format!("the line ends after {text:?}"))
}

pub fn hexadecimal(text: &str, digits: usize) -> Result<u32, String> {
    if text.len() != digits || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return Err(format!("not {digits} hexadecimal digits: {text:?}"));
    }
    u32::from_str_radix(text, 16).map_err(|error| error.to_string())
}

/// A decimal number times 10^`scale`, exactly.
pub fn decimal(text: &str, scale: usize) -> Result<u64, String> {
    let bad = || format!("not a number: {text:?}");
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    let ends_in_point = text.ends_with('.');
    if whole.is_empty()
        || ends_in_point
        || !digits(whole)
        || !digits(fraction)
        || fraction.len() > scale
    {
        return Err(bad());
    }
    format!("{whole}{fraction:0<scale$}")
        .parse()
        .map_err(|_| bad())
}
