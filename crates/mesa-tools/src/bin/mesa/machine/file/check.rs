//! Allowed values of a description, and the lines of wrong ones.

use std::fmt::Write;

use toml::Spanned;

/// The text of a description.
#[derive(Clone, Copy)]
pub struct Lines<'a>(pub &'a str);

/// Range of the numbers that a key accepts.
#[derive(Clone, Copy)]
pub struct Range {
    low: f64,
    high: f64,
    /// True if `low` itself is allowed.
    with_low: bool,
    unit: &'static str,
}

impl Range {
    pub const CLICKS: Self = Self::above(0.0, 1000.0, " clicks a second");
    pub const NOT_NEGATIVE: Self = Self::from(0.0, 1e9, "");
    pub const BOUNCE: Self = Self::from(0.0, 1000.0, " ms");
    pub const POSITION: Self = Self::from(-1e9, 1e9, "");

    const fn from(low: f64, high: f64, unit: &'static str) -> Self {
        Self {
            low,
            high,
            with_low: true,
            unit,
        }
    }

    const fn above(low: f64, high: f64, unit: &'static str) -> Self {
        Self {
            with_low: false,
            ..Self::from(low, high, unit)
        }
    }

    fn contains(&self, value: f64) -> bool {
        let is_in = (self.low..=self.high).contains(&value);
        is_in && (self.with_low || value > self.low)
    }

    fn allowed(&self) -> String {
        let Self {
            low, high, unit, ..
        } = self;
        let mut text = String::from("allowed is ");
        let _ = if self.with_low {
            write!(text, "{low} to {high}{unit}")
        } else {
            write!(text, "more than {low}, up to {high}{unit}")
        };
        text
    }
}

/// Limit of a name's length: longer names are hard to type.
const LONGEST_NAME: usize = 24;

impl Lines<'_> {
    /// Number of the line that contains a byte, from 1 on.
    pub fn number_of(&self, byte: usize) -> usize {
        let before = self.0.bytes().take(byte);
        before.filter(|&byte| byte == b'\n').count() + 1
    }

    /// Error text for a key with a value that is not allowed.
    pub fn wrong<T>(&self, value: &Spanned<T>, key: &str, allowed: &str) -> String {
        let span = value.span();
        let line = self.number_of(span.start);
        let shown = self.0.get(span).unwrap_or_default();
        let shown = shown.lines().next().unwrap_or_default();
        format!("line {line}: {key} = {shown}: {allowed}")
    }

    /// Error text, with its line, for a text that is not a valid description.
    pub fn not_toml(&self, error: &toml::de::Error) -> String {
        let span = error.span().unwrap_or_default();
        let line = self.number_of(span.start);
        let text = self.0.lines().nth(line - 1).unwrap_or_default().trim();
        format!("line {line}: `{text}`: {}", error.message())
    }

    /// Checks that a number is in its range.
    pub fn number(&self, value: &Spanned<f64>, key: &str, range: Range) -> Result<f64, String> {
        let number = *value.get_ref();
        if range.contains(number) {
            Ok(number)
        } else {
            Err(self.wrong(value, key, &range.allowed()))
        }
    }

    /// Checks that a name is well formed and that no other item of its kind has it.
    pub fn name<'b>(
        &self,
        value: &Spanned<String>,
        key: &str,
        mut others: impl Iterator<Item = &'b str>,
    ) -> Result<String, String> {
        let name = value.get_ref();
        let good = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        let starts = name.starts_with(|c: char| c.is_ascii_alphabetic());
        if !starts || name.len() > LONGEST_NAME || !name.chars().all(good) {
            let allowed = format!(
                "allowed are up to {LONGEST_NAME} letters, digits, - and _, a letter first"
            );
            return Err(self.wrong(value, key, &allowed));
        }
        if others.any(|other| other == name) {
            return Err(self.wrong(value, key, "another one has this name"));
        }
        Ok(name.clone())
    }
}
