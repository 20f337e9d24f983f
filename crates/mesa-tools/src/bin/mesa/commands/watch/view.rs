//! Content of the screen as text: remotes, and pins in groups.

use crate::context::told;
use mesa_hal::driver::RemoteState;
use mesa_hal::hal::{Age, AnyValue, HalType, PinInfo, Reading};
use mesa_hal::runner::{RemoteSnapshot, Snapshot};

use crate::full_screen::short_time;
use crate::pattern::Pattern;

/// A line of the list of pins.
#[derive(Clone, Debug, PartialEq)]
pub enum Line {
    /// A terminal block, or a part of the machine without one.
    Heading(String),
    /// A pin or parameter, by its number in the snapshot.
    Pin(usize),
}

/// The pins that match a pattern, grouped by terminal block, in the order of the machine.
pub fn lines(snapshot: &Snapshot, pattern: &Pattern, board: &str) -> Vec<Line> {
    let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
    let remotes: Vec<_> = snapshot.remotes().collect();
    for (number, info) in snapshot.infos().iter().enumerate() {
        if !pattern.fits(info) {
            continue;
        }
        let heading = heading(info, &remotes, board);
        match groups.iter_mut().find(|(known, _)| *known == heading) {
            Some((_, pins)) => pins.push(number),
            None => groups.push((heading, vec![number])),
        }
    }
    let lines = groups.into_iter().flat_map(|(heading, pins)| {
        let pins = pins.into_iter().map(Line::Pin);
        std::iter::once(Line::Heading(heading)).chain(pins)
    });
    lines.collect()
}

/// The terminal block of a pin, with its remote; without a block, the part of the machine that the
/// pin belongs to.
fn heading(info: &PinInfo, remotes: &[RemoteSnapshot], board: &str) -> String {
    let rest = short(&info.name, board);
    let part = rest.rsplit_once('.').map_or(board, |(part, _)| part);
    let Some((block, _)) = info.place.terminal.split_once(" pin ") else {
        return part.to_owned();
    };
    if remotes.iter().any(|remote| remote.group == info.group) {
        format!("{block} of {part}")
    } else {
        block.to_owned()
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
    let kept = width.saturating_sub(1);
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

/// Short note about a reading that is not valid; else empty.
pub fn state(info: &PinInfo, reading: Reading<AnyValue>) -> String {
    if info.role.is_param() || reading.valid {
        return String::new();
    }
    match reading.age {
        Age::NEVER => "never read".to_owned(),
        age => format!("old {}", short_time(age.time)),
    }
}

/// Place and name of a remote, its state, the time since the last change, and counts with the
/// reason. The reason of an earlier fault is marked as such.
pub fn remote(remote: &RemoteSnapshot, snapshot: &Snapshot) -> [String; 4] {
    let since = short_time(snapshot.time().since(remote.since));
    let counts = format!("{} transfers, {} failed", remote.transfers, remote.failures);
    let (state, rest) = match (remote.state, remote.first_fault) {
        (RemoteState::Running, None) => ("running", counts),
        (RemoteState::Running, Some(before)) => {
            ("running", format!("{counts}; before: {}", told(&before)))
        }
        (RemoteState::Offline { reason, .. }, _) => {
            ("OFFLINE", format!("{}; {counts}", told(&reason)))
        }
        (RemoteState::Restarting { reason }, _) => {
            ("RESTARTING", format!("{}; {counts}", told(&reason)))
        }
        _ => ("?", counts),
    };
    [
        format!("{}.{} {}", remote.id.port, remote.id.channel, remote.name),
        state.to_owned(),
        since,
        rest,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::watch::screen::tests::snapshot;

    fn listed(pattern: &str) -> Vec<String> {
        let snapshot = snapshot();
        let lines = lines(&snapshot, &pattern.parse().unwrap(), "hm2_7i92.0");
        lines
            .into_iter()
            .map(|line| match line {
                Line::Heading(heading) => format!("# {heading}"),
                Line::Pin(number) => short(&snapshot.infos()[number].name, "hm2_7i92.0").to_owned(),
            })
            .collect()
    }

    #[test]
    fn a_long_name_keeps_its_begin_and_its_end() {
        assert_eq!(shortened("7i77.0.0.input-00", 17), "7i77.0.0.input-00");
        assert_eq!(shortened("7i77.0.0.input-00-not", 11), "7i77.…0-not");
        assert_eq!(shortened("input", 1), "…");
    }

    #[test]
    fn pins_are_grouped_by_terminal_block_and_filtered() {
        let field = listed("7i77.0.0.input-");
        assert_eq!(field[0], "# TB8 of 7i77.0.0");
        assert_eq!(field[1], "7i77.0.0.input-00");
        let second = field.iter().position(|line| line == "# TB7 of 7i77.0.0");
        assert_eq!(second, Some(1 + 2 * 16), "{field:?}");
        assert_eq!(field.len(), 2 + 2 * 32);
        assert_eq!(listed("watchdog.has_bit")[0], "# watchdog");
        assert_eq!(listed("/QA3")[0], "# TB4");
        assert_eq!(listed("nothing such"), [""; 0]);
        let headings = listed("");
        let mut headings: Vec<_> = headings
            .iter()
            .filter(|line| line.starts_with('#'))
            .collect();
        let all = headings.len();
        headings.sort();
        headings.dedup();
        assert_eq!(headings.len(), all, "each block is there once");
    }
}
