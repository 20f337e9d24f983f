//! Patterns that select pins: a part of a name, or a pattern of the whole.

use std::convert::Infallible;
use std::str::FromStr;

use mesa_hal::hal::PinInfo;

use crate::board::place::Typed;

/// A part of a pin's name, terminal or signal; with `*` or `?`, a pattern for the whole of one of
/// them; or a terminal [as typed](Typed). Case is ignored. An empty pattern matches every pin.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pattern(String);

impl FromStr for Pattern {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(text.into())
    }
}

impl From<&str> for Pattern {
    fn from(text: &str) -> Self {
        Self(text.to_lowercase())
    }
}

impl Pattern {
    /// True if a pin matches.
    pub fn fits(&self, info: &PinInfo) -> bool {
        let texts = [&info.name, &info.place.terminal, &info.place.signal];
        texts.into_iter().any(|text| self.fits_text(text)) || Typed::from(&*self.0).fits(info)
    }

    /// True if a text matches.
    pub fn fits_text(&self, text: &str) -> bool {
        let text = text.to_lowercase();
        if self.0.contains(['*', '?']) {
            is_match(self.0.as_bytes(), text.as_bytes())
        } else {
            text.contains(&self.0)
        }
    }
}

/// True if a pattern with `*` and `?` matches the whole text. Takes time proportional to the
/// product of both lengths at most.
pub fn is_match(pattern: &[u8], text: &[u8]) -> bool {
    let (mut p, mut t) = (0, 0);
    // Index behind the last `*`, and the end of the text that the `*` matches so far.
    let mut star = None;
    while let Some(byte) = text.get(t) {
        match pattern.get(p) {
            Some(b'*') => {
                star = Some((p + 1, t));
                p += 1;
            }
            Some(wanted) if wanted == byte || *wanted == b'?' => {
                p += 1;
                t += 1;
            }
            _ => {
                let Some((behind, end)) = star else {
                    return false;
                };
                star = Some((behind, end + 1));
                (p, t) = (behind, end + 1);
            }
        }
    }
    pattern.iter().skip(p).all(|&byte| byte == b'*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn part_fits_anywhere_and_a_pattern_the_whole() {
        for (pattern, text, fits) in [
            ("", "anything", true),
            ("input-0", "hm2_7i92.0.7i77.0.0.input-07", true),
            ("INPUT2", "input2", true),
            ("input-1", "input-0", false),
            ("*.input-0?", "hm2_7i92.0.7i77.0.0.input-07", true),
            ("*.input-0?", "hm2_7i92.0.7i77.0.0.input-07-not", false),
            ("input-*", "hm2.input-01", false),
            ("*a*b*c", "xxaxxbbxxc", true),
            ("*a*b*c", "xxaxxbbxx", false),
            ("*", "", true),
            ("?", "", false),
            ("a**", "a", true),
        ] {
            let found = pattern.parse::<Pattern>().unwrap().fits_text(text);
            assert_eq!(found, fits, "{pattern} {text}");
        }
    }
}
