//! The existing name nearest to a mistyped one.

use alloc::string::String;

use super::MAX_NAME;

/// Largest number of names that are compared.
const MAX_NAMES: usize = 10_000;

/// Finds the existing name nearest to one that does not exist. The first choice is a name that ends
/// in `wanted` after a point. Otherwise it is the name, or end of a name, that the fewest changed
/// characters turn into `wanted`, if these are at most a third of its characters.
///
/// Upper and lower case are equal. Bounded by 10,000 names of 47 characters. Allocates: for set-up.
pub(super) fn nearest<'a>(
    names: impl Iterator<Item = &'a str> + Clone,
    wanted: &str,
) -> Option<String> {
    let names = names.take(MAX_NAMES);
    if let Some(name) = names.clone().find(|name| is_end(name, wanted)) {
        return Some(name.into());
    }
    let most = wanted.len().min(MAX_NAME) / 3;
    let points = wanted.matches('.').count();
    let distance = |name: &str| {
        let ends = [name, end(name, points)].into_iter();
        let near = ends.filter(|end| end.len().abs_diff(wanted.len()) <= most);
        near.map(|end| changes(end.as_bytes(), wanted.as_bytes()))
            .min()
    };
    let near = names
        .filter_map(|name| Some((distance(name)?, name)))
        .min_by_key(|(changes, _)| *changes);
    near.filter(|(changes, _)| *changes <= most)
        .map(|(_, name)| name.into())
}

/// True if the name ends in `wanted` after a point.
pub(super) fn is_end(name: &str, wanted: &str) -> bool {
    let at = name.len().checked_sub(wanted.len());
    let parts = at.and_then(|at| name.split_at_checked(at));
    parts.is_some_and(|(stem, end)| {
        !end.is_empty() && end.eq_ignore_ascii_case(wanted) && stem.ends_with('.')
    })
}

/// The last part of a name, with `points` points in it.
fn end(name: &str, points: usize) -> &str {
    let before = name.rmatch_indices('.').nth(points);
    let end = before.and_then(|(at, _)| name.get(at.saturating_add(1)..));
    end.unwrap_or(name)
}

/// Number of characters of `one` to be changed, added or left out to make it `other` (Levenshtein
/// distance); [`usize::MAX`] if `one` is longer than a name can be.
fn changes(one: &[u8], other: &[u8]) -> usize {
    // For each beginning of `one`: its distance to the part of `other` compared until now.
    let mut row = [0_usize; MAX_NAME + 1];
    let Some(row) = row.get_mut(..=one.len()) else {
        return usize::MAX;
    };
    for (index, slot) in row.iter_mut().enumerate() {
        *slot = index;
    }
    for (before, letter) in (0_usize..).zip(other) {
        let (mut left, mut corner) = (before.saturating_add(1), before);
        for (slot, own) in row
            .iter_mut()
            .zip(core::iter::once(None).chain(one.iter().map(Some)))
        {
            let above = *slot;
            if let Some(own) = own {
                let is_other = usize::from(!own.eq_ignore_ascii_case(letter));
                let replaced = corner.saturating_add(is_other);
                left = replaced.min(above.min(left).saturating_add(1));
                corner = above;
            }
            *slot = left;
        }
    }
    row.last().copied().unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{PinMaker, PinStore};
    use super::*;

    fn nearest_of(names: &[&str], wanted: &str) -> Option<String> {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "");
        for &name in names {
            make.input::<bool>(name).expect("made");
        }
        store.catalog.nearest(wanted)
    }

    #[test]
    fn slip_of_the_pen_finds_what_was_meant() {
        let names = [
            "hm2_7i92.0.7i77.0.0.input-07",
            "hm2_7i92.0.7i77.0.0.output-07",
        ];
        for (wanted, meant) in [
            ("hm2_7i92.0.7i77.0.0.inptu-07", Some(names[0])),
            ("hm2_7i92.0.7i77.0.0.output_07", Some(names[1])),
            ("hm2_7i97.0.7i77.0.0.output-7", Some(names[1])),
            ("output-07", Some(names[1])),
            ("7i77.0.0.input-07", Some(names[0])),
            ("7i77.0.0.input-7", Some(names[0])),
            ("outputt-07", Some(names[1])),
            ("put-07", Some(names[0])),
            ("HM2_7I92.0.7I77.0.0.INPUT-07", Some(names[0])),
            ("OUTPUT-07", Some(names[1])),
            ("OUTPUT-7", Some(names[1])),
            ("ut-07", None),
            ("", None),
            ("spindle", None),
        ] {
            assert_eq!(nearest_of(&names, wanted).as_deref(), meant, "{wanted}");
        }
    }

    #[test]
    fn enable_of_an_output_is_what_enables_it_whatever_its_name() {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "hm2_7i92.0.7i77.0.1.");
        let volts = make.output("analogout0", 0.0).expect("made");
        make.setting("analogout0-maxlim", 10.0).expect("made");
        let enable = make.output("analogena", false).expect("made");
        store.enabled_by(volts, enable);
        let meant = Some("hm2_7i92.0.7i77.0.1.analogena".into());
        for wanted in [
            "hm2_7i92.0.7i77.0.1.analogout0-enable",
            "analogout0-enable",
            "7i77.0.1.ANALOGOUT0.ENA",
        ] {
            assert_eq!(store.catalog.nearest(wanted), meant, "{wanted}");
        }
        let limit = Some("hm2_7i92.0.7i77.0.1.analogout0-maxlim".into());
        assert_eq!(store.catalog.nearest("analogout0-maxlm"), limit);
        for wanted in ["-ena", ".", "ena", "", "-"] {
            let _ = store.catalog.nearest(wanted);
        }
    }

    /// The recursive definition, for short words.
    fn slowly(one: &[u8], other: &[u8]) -> usize {
        let (Some((a, one_rest)), Some((b, other_rest))) = (one.split_first(), other.split_first())
        else {
            return one.len() + other.len();
        };
        if a == b {
            return slowly(one_rest, other_rest);
        }
        let replaced = slowly(one_rest, other_rest);
        1 + replaced
            .min(slowly(one, other_rest))
            .min(slowly(one_rest, other))
    }

    proptest! {
        #[test]
        fn changes_are_counted_as_they_are_defined(one in "[ab-]{0,6}", other in "[ab-]{0,6}") {
            let (one, other) = (one.as_bytes(), other.as_bytes());
            prop_assert_eq!(changes(one, other), slowly(one, other));
        }

        #[test]
        fn no_text_is_too_much(wanted in ".{0,200}") {
            let _ = nearest_of(&["card.pin"], &wanted);
        }
    }
}
