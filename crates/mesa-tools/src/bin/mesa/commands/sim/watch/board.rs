//! Screen view of a board and its machine.

use std::collections::BTreeMap;
use std::fmt::Write;

use mesa_hal::lbp::RemoteFaults;
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};

use super::values::{Rate, Values};
use crate::machine::slot::Slot;
use crate::ui::colours::Palette;
use crate::ui::full_screen::{SAMPLES, Trend};
use mesa_tools::Counted;

/// Seconds of silence after which a client no longer counts as active.
const TALKS: f64 = 2.0;

/// View of a board.
#[derive(Debug)]
pub struct BoardView {
    pub name: String,
    address: String,
    values: Values,
    packets: Rate,
    packet_trend: Trend,
    /// By slot.
    requests: BTreeMap<Slot, Rate>,
    /// By axis.
    positions: BTreeMap<String, Trend>,
}

impl BoardView {
    pub fn new(name: &str, address: String) -> Self {
        Self {
            name: name.to_owned(),
            address,
            values: Values::default(),
            packets: Rate::default(),
            packet_trend: Trend::default(),
            requests: BTreeMap::new(),
            positions: BTreeMap::new(),
        }
    }

    /// Takes the output of `show`.
    pub fn take(&mut self, lines: &str) {
        let values = Values::parse(lines);
        let time = values.number("time");
        self.packets
            .push(time, values.number("network.received.packets"));
        self.packet_trend.push(self.packets.per_second());
        for slot in values.slots() {
            let rate = self.requests.entry(slot).or_default();
            rate.push(time, values.number(&format!("remote.{slot}.requests.sent")));
        }
        for axis in values.parts("motor") {
            let trend = self.positions.entry(axis.to_owned()).or_default();
            trend.push(values.number(&format!("motor.{axis}.position")));
        }
        self.values = values;
    }

    /// One line about the board: address, packet rate, active clients and watchdog; a trend if a
    /// line of `width` has room for it.
    pub fn line(&self, palette: Palette, width: usize) -> Line<'static> {
        let values = &self.values;
        let (watchdog, color) = if values.is_on("board.watchdog-bitten") {
            ("WATCHDOG HAS BITTEN", Color::Red)
        } else if values.is_on("board.watchdog-running") {
            ("watchdog alive", Color::Green)
        } else {
            ("watchdog off", Color::Reset)
        };
        let clients = values.parts("network.client").into_iter();
        let clients = clients.filter_map(|client| {
            let name = |what: &str| format!("network.client.{client}.{what}");
            let talks = values.number(&name("silent")) < TALKS;
            talks.then(|| values.text(&name("address")))
        });
        let clients: Vec<_> = clients.collect();
        let clients = match clients[..] {
            [] => "no client".to_owned(),
            _ => format!("from {}", clients.join(", ")),
        };
        let line = Line::from(vec![
            Span::raw(format!(
                "{:<10} {} {:<21} {:>6.0} packets/s  ",
                self.name,
                values.text("board.name"),
                self.address,
                self.packets.per_second(),
            )),
            Span::styled(watchdog, palette.style(color)),
            Span::raw(format!("  {clients}")),
        ]);
        with_trend(line, Some(&self.packet_trend), width)
    }

    /// Network counters of the board.
    pub fn network(&self) -> String {
        let both = |what: &str| {
            let sum = ["received", "sent"].map(|way| self.number("network", &[way, what]));
            sum.iter().sum::<f64>()
        };
        format!(
            "up {:.0} s; {} in, {} out; mishaps: {} lost, {} late, {} duplicate; errors: {} parse, {} memory, {} write; {}, {}",
            self.values.number("time"),
            Counted(
                self.number("network", &["received", "packets"]) as u64,
                "packet"
            ),
            self.number("network", &["sent", "packets"]),
            both("lost"),
            both("late"),
            both("duplicate"),
            self.number("board", &["errors", "parse"]),
            self.number("board", &["errors", "memory"]),
            self.number("board", &["errors", "write"]),
            Counted(self.number("board", &["reloads"]) as u64, "reload"),
            Counted(self.number("board", &["resets"]) as u64, "reset"),
        )
    }

    fn number(&self, of: &str, what: &[&str]) -> f64 {
        self.values.number(&format!("{of}.{}", what.join(".")))
    }

    /// The machine: remotes, axes, inputs and outputs; trends where lines of `width` have room for
    /// them.
    pub fn machine(&self, palette: Palette, width: usize) -> Vec<Line<'static>> {
        let mut lines = Vec::new();
        lines.push(heading("remotes"));
        let slots = self.values.slots();
        if slots.is_empty() {
            lines.push(Line::raw("  none"));
        }
        lines.extend(slots.iter().map(|&slot| self.remote(slot, palette)));
        let axes = self.values.parts("motor");
        if !axes.is_empty() {
            lines.push(heading(
                "axis             position      velocity       command  drive",
            ));
        }
        let trend = |axis: &str| self.positions.get(axis);
        let axes = axes.iter();
        lines.extend(axes.map(|axis| with_trend(self.axis(axis, palette), trend(axis), width)));
        lines.push(heading("inputs and outputs"));
        lines.extend(self.wiring(palette));
        let own = self.values.under("board");
        let own = own.filter(|(name, _)| is_terminal(name));
        lines.push(Line::raw(format!("  {:<14}{}", "board", signals(own))));
        for slot in slots {
            let all = self.values.under(&format!("remote.{slot}"));
            let all: Vec<_> = all.filter(|(name, _)| is_signal(name)).collect();
            let place = format!("channel {slot}");
            lines.push(Line::raw(format!(
                "  {place:<14}{}",
                signals(all.into_iter())
            )));
        }
        lines
    }

    /// A remote: its state, its request rate and its faults.
    fn remote(&self, slot: Slot, palette: Palette) -> Line<'static> {
        let of = format!("remote.{slot}");
        let is_on = |what: &str| self.values.is_on(&format!("{of}.{what}"));
        let text = |what: &str| self.values.text(&format!("{of}.{what}"));
        let number = |what: &[&str]| self.number(&of, what);
        let rate = self.requests.get(&slot).map_or(0.0, Rate::per_second);
        let faults = u8::from_str_radix(text("faults"), 16).unwrap_or_default();
        let faults = RemoteFaults::from_bits_retain(faults);
        let (state, color) = if !is_on("plugged") {
            ("UNPLUGGED", Color::Red)
        } else if !is_on("powered") {
            ("NO POWER", Color::Red)
        } else if is_on("bootloader") {
            ("BOOTLOADER", Color::Red)
        } else if rate == 0.0 {
            ("idle", Color::Reset)
        } else if faults.is_empty() {
            ("running", Color::Green)
        } else {
            ("FAULT", Color::Red)
        };
        let spoiled = |way| number(&[way, "sent"]) - number(&[way, "intact"]);
        let why = if faults.is_empty() {
            String::new()
        } else {
            format!("   {faults}")
        };
        Line::from(vec![
            Span::raw(format!("  {slot} {:<12} ", text("device"))),
            Span::styled(format!("{state:<11}"), palette.style(color)),
            Span::raw(format!(
                "{rate:>6.0} requests/s, {} spoiled; mode {}, revision {}{why}",
                spoiled("requests") + spoiled("replies"),
                text("mode"),
                text("revision"),
            )),
        ])
    }

    /// An axis: position, movement, and the command to its drive.
    fn axis(&self, axis: &str, palette: Palette) -> Line<'static> {
        let of = format!("motor.{axis}");
        let is_on = |what: &str| self.values.is_on(&format!("{of}.{what}"));
        let number = |what: &str| self.number(&of, &[what]);
        let name = match self.values.text(&format!("{of}.name")) {
            "" => axis,
            name => name,
        };
        let is_stepper = self.values.has(&format!("{of}.steps"));
        let (drive, color) = if !is_on("powered") {
            ("NO POWER", Color::Red)
        } else if is_stepper {
            ("powered", Color::Reset)
        } else if is_on("enabled") {
            ("enabled", Color::Green)
        } else {
            ("disabled", Color::Reset)
        };
        let lost = number("lost-steps") + number("overshot-steps");
        let held = match (is_on("stalled"), is_on("at-stop")) {
            (true, _) => "JAMMED".to_owned(),
            (false, true) => "AT STOP".to_owned(),
            _ if is_stepper && lost > 0.0 => format!("{lost} LOST"),
            _ => String::new(),
        };
        let command = if is_stepper {
            format!("{:>7} steps", number("commanded-steps"))
        } else {
            format!("{:>11.4} V", number("volts"))
        };
        Line::from(vec![
            Span::raw(format!(
                "  {name:<9} {:>13.4} {:>13.4} {command}  ",
                number("position"),
                number("velocity"),
            )),
            Span::styled(format!("{drive:<9}"), palette.style(color)),
            Span::styled(format!("{held:<7}"), palette.style(Color::Red)),
        ])
    }

    /// Equipment on inputs: emergency stop, switches, handwheels.
    fn wiring(&self, palette: Palette) -> Vec<Line<'static>> {
        let mut lines = Vec::new();
        if self.values.has("estop") {
            let (state, color) = if self.values.is_on("estop") {
                ("PRESSED", Color::Red)
            } else {
                ("released, its chain is closed", Color::Green)
            };
            lines.push(Line::from(vec![
                Span::raw(format!("  {:<15}", "emergency stop")),
                Span::styled(state, palette.style(color)),
            ]));
        }
        let switches: Vec<_> = self.values.under("switch").collect();
        if !switches.is_empty() {
            let mut spans = vec![Span::raw(format!("  {:<14}", "switches"))];
            for (name, state) in switches {
                let (state, color) = match state {
                    "1" => ("ON", Color::Green),
                    _ => ("off", Color::Reset),
                };
                let text = format!(" {name} {state} ");
                spans.push(Span::styled(text, palette.style(color)));
            }
            lines.push(Line::from(spans));
        }
        for wheel in self.values.parts("wheel") {
            let name = |what: &str| format!("wheel.{wheel}.{what}");
            let turning = if self.values.is_on(&name("turning")) {
                ", turning"
            } else {
                ""
            };
            let clicks = match self.values.text(&name("clicks")) {
                one @ ("1" | "-1") => format!("{one} click"),
                clicks => format!("{clicks} clicks"),
            };
            let text = format!("  {:<15}{wheel} {clicks}{turning}", "handwheel");
            lines.push(Line::raw(text));
        }
        lines
    }
}

/// A line with a trend behind it, if there is room.
fn with_trend(mut line: Line<'static>, trend: Option<&Trend>, width: usize) -> Line<'static> {
    if let Some(trend) = trend.filter(|_| line.width() + 2 + SAMPLES <= width) {
        line.push_span(Span::raw(format!("  {trend:SAMPLES$}")));
    }
    line
}

fn heading(text: &'static str) -> Line<'static> {
    Line::styled(text, Style::new().add_modifier(Modifier::BOLD))
}

/// True if a value of a board is the signal of a terminal or of an LED.
fn is_terminal(name: &str) -> bool {
    let kinds = ["input-", "output-", "led-", "analogout", "enable"];
    kinds.iter().any(|kind| name.starts_with(kind))
}

/// True if a value of a remote is the signal of a terminal, and not shown elsewhere.
fn is_signal(name: &str) -> bool {
    let others = [
        "device",
        "plugged",
        "powered",
        "mode",
        "revision",
        "bootloader",
        "faults",
    ];
    !name.contains('.') && !others.contains(&name)
}

/// Signals in one line: of the numbered ones, the numbers that are on; of the others, those that
/// are not 0.
fn signals<'a>(all: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut on: Vec<(&str, Vec<u32>)> = Vec::new();
    let mut others = String::new();
    for (name, value) in all {
        let numbered = name.rsplit_once('-');
        let numbered = numbered.and_then(|(kind, number)| Some((kind, number.parse().ok()?)));
        let Some((kind, number)) = numbered else {
            if value.parse() != Ok(0.0) {
                let _ = write!(others, "  {name} {value}");
            }
            continue;
        };
        if on.last().is_none_or(|(last, _)| *last != kind) {
            on.push((kind, Vec::new()));
        }
        if let Some((_, numbers)) = on.last_mut().filter(|_| value == "1") {
            numbers.push(number);
        }
    }
    let mut text = String::new();
    for (kind, numbers) in on {
        let _ = write!(text, " {kind}s on: {} ", ranges(&numbers));
    }
    text + &others
}

/// Ascending numbers in short form: 0-3 7.
fn ranges(numbers: &[u32]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b);
    let runs = runs.map(|run| match run {
        [first, .., last] => format!("{first}-{last}"),
        _ => run.iter().map(u32::to_string).collect(),
    });
    let runs: Vec<_> = runs.collect();
    if runs.is_empty() {
        return "none".to_owned();
    }
    runs.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(lines: &[Line<'_>]) -> String {
        let lines = lines.iter().map(|line| line.to_string() + "\n");
        lines.collect()
    }

    fn palette() -> Palette {
        Palette::from_environment()
    }

    #[test]
    fn active_signals_are_listed_as_ranges() {
        assert_eq!(ranges(&[]), "none");
        assert_eq!(ranges(&[3]), "3");
        assert_eq!(ranges(&[0, 1, 2, 7, 9, 10]), "0-2 7 9-10");
        let all = [
            ("analogin0", "24.0000"),
            ("analogin1", "0.0000"),
            ("input-00", "1"),
            ("input-01", "1"),
            ("input-02", "0"),
            ("output-00", "0"),
            ("enc0", "-3"),
        ];
        assert_eq!(
            signals(all.into_iter()),
            " inputs on: 0-1  outputs on: none   analogin0 24.0000  enc0 -3"
        );
    }

    #[test]
    fn remote_is_in_the_state_that_its_truth_gives() {
        let good = "remote.0.device 7i72\nremote.0.plugged 1\nremote.0.powered 1\n\
                    remote.0.bootloader 0\nremote.0.faults 00\nremote.0.mode 0\n";
        for (more, requests, state) in [
            ("", 100, "running"),
            ("", 0, "idle"),
            ("remote.0.faults 08\n", 100, "FAULT"),
            ("remote.0.bootloader 1\n", 100, "BOOTLOADER"),
            ("remote.0.powered 0\n", 100, "NO POWER"),
            ("remote.0.plugged 0\n", 100, "UNPLUGGED"),
        ] {
            let mut view = BoardView::new("mill", "127.0.0.1:27181".to_owned());
            for (time, sent) in [(0, 0), (1, requests)] {
                view.take(&format!(
                    "{good}{more}time {time}\nremote.0.requests.sent {sent}\n\
                     remote.0.requests.intact {sent}\n"
                ));
            }
            let shown = text(&view.machine(palette(), 120));
            assert!(
                shown.contains(&format!("  0 7i72         {state} ")),
                "{shown}"
            );
            let rate = format!("{requests:>6} requests/s, 0 spoiled");
            assert!(shown.contains(&rate), "{shown}");
            let is_overloaded = shown.contains("output overloaded");
            assert_eq!(is_overloaded, state == "FAULT", "{shown}");
        }
    }

    #[test]
    fn active_clients_and_the_watchdog_state_are_shown() {
        let mut view = BoardView::new("mill", "127.0.0.1:27181".to_owned());
        let line = |view: &BoardView| view.line(palette(), 120).to_string();
        view.take("time 0\nboard.name 7I97\nnetwork.received.packets 0\n");
        assert!(line(&view).contains("watchdog off  no client"));
        view.take(
            "time 0.5\nboard.name 7I97\nnetwork.received.packets 1000\nboard.watchdog-running 1\n\
             network.client.0.address 10.0.0.1:5\nnetwork.client.0.silent 0.001\n\
             network.client.1.address 10.0.0.2:6\nnetwork.client.1.silent 2.5\n",
        );
        let shown = line(&view);
        assert!(shown.contains("  2000 packets/s"), "{shown}");
        assert!(shown.contains("watchdog alive  from 10.0.0.1:5"), "{shown}");
        assert!(!shown.contains("10.0.0.2"), "{shown}");
        view.take("time 1\nboard.watchdog-bitten 1\nboard.watchdog-running 1\n");
        assert!(line(&view).contains("WATCHDOG HAS BITTEN"));
    }
}
