//! Content of the screen as text: remotes, and pins in groups.

use mesa_hal::driver::RemoteState;
use mesa_hal::hal::{Age, AnyValue, HalType, PinInfo, Reading};
use mesa_hal::runner::{RemoteSnapshot, Snapshot};

use crate::board::pattern::Pattern;
use crate::ui::full_screen::short_time;
use mesa_tools::Counted;
use mesa_tools::advice::told;

/// A line of the list of pins.
#[derive(Clone, Debug, PartialEq)]
pub enum Line {
    /// A terminal block, or a part of the machine without one.
    Heading(String),
    /// A pin or parameter, by its number in the snapshot.
    Pin(usize),
}

/// Pins that match a pattern.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Listing {
    pub lines: Vec<Line>,
    /// Number of pins in `lines`.
    pub shown: usize,
    /// Number of other pins that match.
    pub hidden: usize,
}

impl Listing {
    /// Pins that match a pattern, grouped by terminal block; pins without a terminal follow.
    /// Without `is_all` parameters, inverted pins, and all pins of an encoder but its position are
    /// hidden; the latter are shown if the pattern is for them alone.
    pub fn of(snapshot: &Snapshot, pattern: &Pattern, is_all: bool, board: &str) -> Self {
        let is_hidden = |info: &PinInfo| !is_all && is_secondary(info);
        let is_detail = |info: &PinInfo| !is_all && is_detail(short(&info.name, board));
        let listing = Self::without(snapshot, pattern, board, |info| {
            is_hidden(info) || is_detail(info)
        });
        if listing.shown == 0 {
            return Self::without(snapshot, pattern, board, is_hidden);
        }
        listing
    }

    fn without(
        snapshot: &Snapshot,
        pattern: &Pattern,
        board: &str,
        is_hidden: impl Fn(&PinInfo) -> bool,
    ) -> Self {
        let mut groups: Vec<(Heading, Vec<usize>)> = Vec::new();
        let remotes: Vec<_> = snapshot.remotes().collect();
        let (mut shown, mut hidden) = (0, 0);
        for (number, info) in snapshot.infos().iter().enumerate() {
            if !pattern.fits(info) {
                continue;
            }
            if is_hidden(info) {
                hidden += 1;
                continue;
            }
            shown += 1;
            let heading = Heading::of(info, &remotes, board);
            match groups.iter_mut().find(|(known, _)| *known == heading) {
                Some((_, pins)) => pins.push(number),
                None => groups.push((heading, vec![number])),
            }
        }
        groups.sort_by_key(|(heading, _)| !heading.is_block);
        let lines = groups.into_iter().flat_map(|(heading, pins)| {
            let pins = pins.into_iter().map(Line::Pin);
            std::iter::once(Line::Heading(heading.text)).chain(pins)
        });
        Self {
            lines: lines.collect(),
            shown,
            hidden,
        }
    }
}

/// True for parameters, and for pins that show another one inverted.
fn is_secondary(info: &PinInfo) -> bool {
    info.role.is_param() || info.name.ends_with("-not") || info.name.ends_with("_not")
}

/// True for a pin of an encoder of the board, apart from its position. `name` is without the
/// board's.
fn is_detail(name: &str) -> bool {
    let pin = name
        .strip_prefix("encoder.")
        .and_then(|rest| rest.split_once('.'));
    pin.is_some_and(|(_, pin)| pin != "position")
}

/// Heading of a group of pins.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Heading {
    /// True for a terminal block.
    is_block: bool,
    text: String,
}

impl Heading {
    /// The terminal block of a pin, with its remote; without a block, the part of the machine that
    /// the pin belongs to.
    fn of(info: &PinInfo, remotes: &[RemoteSnapshot], board: &str) -> Self {
        let rest = short(&info.name, board);
        let part = rest.rsplit_once('.').map_or(board, |(part, _)| part);
        let block = info.place.terminal.split_once(" pin ");
        let of_remote = remotes.iter().any(|remote| remote.group == info.group);
        Self {
            is_block: block.is_some(),
            text: match block {
                None => part.to_owned(),
                Some((block, _)) if of_remote => format!("{block} of {part}"),
                Some((block, _)) => block.to_owned(),
            },
        }
    }
}

/// The name of a pin without that of the board.
pub fn short<'a>(name: &'a str, board: &str) -> &'a str {
    let rest = name.strip_prefix(board);
    rest.and_then(|rest| rest.strip_prefix('.')).unwrap_or(name)
}

/// A name of at most `width` characters: a longer one is shortened in its middle.
pub fn shortened(name: &str, width: usize) -> String {
    let count = name.chars().count();
    if count <= width {
        return name.to_owned();
    }
    let Some(kept) = width.checked_sub(1) else {
        return String::new();
    };
    let (front, back) = (kept / 2, kept - kept / 2);
    let begin: String = name.chars().take(front).collect();
    let end: String = name.chars().skip(count - back).collect();
    format!("{begin}…{end}")
}

/// Formats a value for a column.
pub fn number(value: AnyValue, unit: &str) -> String {
    let text = match value.hal_type {
        HalType::Bit => if value.bits == 0 { "off" } else { "ON" }.to_owned(),
        HalType::Float => format!("{:.4}", f64::from_bits(value.bits)),
        _ => value.to_string(),
    };
    format!("{text} {unit}").trim_end().to_owned()
}

/// Short note about a reading that is not valid.
pub fn note(info: &PinInfo, reading: Reading<AnyValue>) -> Option<String> {
    if info.role.is_param() || reading.valid {
        return None;
    }
    Some(match reading.age {
        Age::NEVER => "never read".to_owned(),
        age => format!("old {}", short_time(age.time)),
    })
}

/// Line about a remote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemoteLine {
    /// Port, channel and name.
    pub place: String,
    pub state: &'static str,
    /// True if it is known to run.
    pub runs: bool,
    /// Time since the last change of the state.
    pub since: String,
    /// The reason for its state, its counts, and the first fault if that is another one.
    pub rest: String,
}

impl RemoteLine {
    pub fn of(remote: &RemoteSnapshot, snapshot: &Snapshot) -> Self {
        let (state, reason) = match remote.state {
            RemoteState::Running => ("running", None),
            RemoteState::Offline { reason, .. } => ("OFFLINE", Some(reason)),
            RemoteState::Restarting { reason } => ("RESTARTING", Some(reason)),
            _ => ("?", None),
        };
        let is_known = snapshot.board().0.is_reached();
        let why = reason.map(|reason| told(&reason));
        let why = match (is_known, why) {
            (true, why) => why,
            (false, None) => Some(format!("the board is not reached; before that: {state}")),
            (false, Some(why)) => {
                let before = format!("the board is not reached; before that: {state}, {why}");
                Some(before)
            }
        };
        let counts = format!(
            "{}, {} failed",
            Counted(remote.transfers, "transfer"),
            remote.failures
        );
        let first = remote.first_fault.filter(|first| Some(*first) != reason);
        let first = first.map(|first| format!("first fault: {}", told(&first)));
        let rest: Vec<String> = why.into_iter().chain([counts]).chain(first).collect();
        Self {
            place: remote.label.to_string(),
            state: if is_known { state } else { "UNKNOWN" },
            runs: is_known && remote.state == RemoteState::Running,
            since: short_time(snapshot.time().since(remote.since)),
            rest: rest.join("; "),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::watch::screen::tests::snapshot;

    fn listed(pattern: &str, is_all: bool) -> Vec<String> {
        let snapshot = snapshot();
        let pattern = pattern.parse().unwrap();
        let listing = Listing::of(&snapshot, &pattern, is_all, "hm2_7i92.0");
        let lines = listing.lines.into_iter();
        lines
            .map(|line| match line {
                Line::Heading(heading) => format!("# {heading}"),
                Line::Pin(number) => short(&snapshot.infos()[number].name, "hm2_7i92.0").to_owned(),
            })
            .collect()
    }

    #[test]
    fn long_name_keeps_its_begin_and_its_end() {
        assert_eq!(shortened("7i77.0.0.input-00", 17), "7i77.0.0.input-00");
        assert_eq!(shortened("7i77.0.0.input-00-not", 11), "7i77.…0-not");
        assert_eq!(shortened("input", 1), "…");
        assert_eq!(shortened("input", 0), "");
    }

    #[test]
    fn pins_are_grouped_by_terminal_block_and_filtered() {
        let field = listed("7i77.0.0.input-", true);
        assert_eq!(field[0], "# TB8 of 7i77.0.0");
        assert_eq!(field[1], "7i77.0.0.input-00");
        let second = field.iter().position(|line| line == "# TB7 of 7i77.0.0");
        assert_eq!(second, Some(1 + 2 * 16), "{field:?}");
        assert_eq!(field.len(), 2 + 2 * 32);
        assert_eq!(listed("watchdog.has_bit", false)[0], "# watchdog");
        assert_eq!(listed("/QA3", false)[0], "# TB4");
        assert_eq!(listed("nothing such", true), [""; 0]);
        assert_eq!(
            listed("*.encoder.03.*", false),
            ["# TB4", "encoder.03.position"]
        );
        assert_eq!(
            listed("*.encoder.03.rawcounts", false),
            ["# TB4", "encoder.03.rawcounts"]
        );
        let headings = listed("", true);
        let mut headings: Vec<_> = headings
            .iter()
            .filter(|line| line.starts_with('#'))
            .collect();
        let all = headings.len();
        headings.sort();
        headings.dedup();
        assert_eq!(headings.len(), all, "each block is there once");
    }

    #[test]
    fn terminals_come_first_parameters_and_inverted_pins_on_request() {
        let snapshot = snapshot();
        let places = |is_all| {
            let all = Pattern::default();
            let listing = Listing::of(&snapshot, &all, is_all, "hm2_7i92.0");
            let pins = listing.lines.iter().filter_map(|line| match line {
                Line::Pin(number) => Some(&snapshot.infos()[*number]),
                Line::Heading(_) => None,
            });
            (pins.collect::<Vec<_>>(), listing)
        };
        let (pins, listing) = places(false);
        let is_free = |info: &&&PinInfo| info.place.terminal.is_empty();
        let at_terminals = pins.iter().take_while(|info| !is_free(info)).count();
        assert!(at_terminals >= 32 + 16 + 6, "{at_terminals}");
        assert!(pins.iter().skip(at_terminals).all(|info| is_free(&info)));
        let is_detail =
            |info: &PinInfo| info.name.contains(".encoder.0") && !info.name.ends_with(".position");
        let is_hidden =
            |info: &&PinInfo| info.role.is_param() || info.name.ends_with("not") || is_detail(info);
        assert!(!pins.iter().any(is_hidden));
        let hidden = snapshot.infos().iter().filter(is_hidden).count();
        assert_eq!((listing.shown, listing.hidden), (pins.len(), hidden));
        let (all, listing) = places(true);
        assert_eq!((all.len(), listing.hidden), (snapshot.infos().len(), 0));
        assert_eq!(listing.shown, pins.len() + hidden);
    }
}
