//! A list of the pins and parameters of a real machine, as `halcmd` printed them.

use std::collections::BTreeMap;

/// Type, direction and value of a pin or parameter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    pub hal_type: String,
    pub direction: String,
    pub value: String,
}

impl Entry {
    /// True if the value is one that a user sets: a fresh load decides it, and no read changes it.
    pub fn is_setting(&self) -> bool {
        matches!(&*self.direction, "RW" | "IN")
    }
}

/// A smart-serial card of the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Card {
    pub port: usize,
    pub channel: usize,
    /// As in the names: `7i76`.
    pub name: String,
}

/// The list of a machine.
#[derive(Debug)]
pub struct List {
    /// The name of its file.
    pub name: String,
    /// What the comment says of the firmware.
    pub firmware: String,
    pub cards: Vec<Card>,
    /// Prefix of all names, for example `hm2_7i97.0.`.
    pub prefix: String,
    /// By the rest of the name.
    pub entries: BTreeMap<String, Entry>,
}

impl List {
    /// Parses a list.
    pub fn parse(name: &str, text: &str) -> Result<Self, String> {
        let comment = |key: &str| {
            let mut lines = text.lines();
            lines.find_map(|line| line.strip_prefix('#')?.trim().strip_prefix(key))
        };
        let firmware = comment("firmware:").ok_or("no line `# firmware:`")?.trim();
        let cards = comment("cards:").ok_or("no line `# cards:`")?;
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        let lines: Vec<Vec<&str>> = lines
            .map(|line| line.split_whitespace().collect())
            .filter(|words: &Vec<_>| !words.is_empty())
            .collect();
        let mut list = Self {
            name: name.into(),
            firmware: firmware.into(),
            cards: cards_of(cards)?,
            prefix: String::new(),
            entries: BTreeMap::new(),
        };
        for words in lines {
            let [kind @ ("pin" | "param"), hal_type, direction, value, full] = *words else {
                return Err(format!("not a line of a list: {words:?}"));
            };
            let is_parameter = matches!(direction, "RO" | "RW");
            if is_parameter != (kind == "param") {
                return Err(format!("{full}: {kind} {direction}"));
            }
            let (prefix, rest) = split(full).ok_or_else(|| format!("{full}: no board"))?;
            if list.prefix.is_empty() {
                list.prefix = prefix.into();
            } else if list.prefix != prefix {
                return Err(format!("{full}: another board than {}", list.prefix));
            }
            let entry = Entry {
                hal_type: hal_type.into(),
                direction: direction.into(),
                value: value.into(),
            };
            list.entries.insert(rest.into(), entry);
        }
        Ok(list)
    }

    /// The board's own name, for example `7i97`.
    pub fn board(&self) -> &str {
        let board = self.prefix.strip_prefix("hm2_").unwrap_or_default();
        board.split('.').next().unwrap_or_default()
    }

    pub fn has(&self, name: &str) -> bool {
        self.entries.contains_key(name)
    }

    /// Number of instances whose pins have names with this beginning, a number, and this end;
    /// without an end, any.
    pub fn instances(&self, begin: &str, end: &str) -> u8 {
        let is_there = |number: &u8| match end {
            "" => self.begins(&format!("{begin}{number:02}.")),
            end => self.has(&format!("{begin}{number:02}{end}")),
        };
        (0..u8::MAX).take_while(is_there).count() as u8
    }

    /// Names with this beginning.
    pub fn begins(&self, begin: &str) -> bool {
        self.entries.keys().any(|name| name.starts_with(begin))
    }
}

/// `hm2_7i97.0.` and the rest.
fn split(full: &str) -> Option<(&str, &str)> {
    let board = full.find('.')?;
    let number = full.get(board + 1..)?.find('.')?;
    Some(full.split_at(board + number + 2))
}

/// `port 0 channel 2 7i76 (analogin, ...); port ...`, or `none`.
fn cards_of(text: &str) -> Result<Vec<Card>, String> {
    let mut cards = Vec::new();
    for text in text.split(';').map(str::trim) {
        let words: Vec<&str> = text.split_whitespace().collect();
        match *words {
            ["none", ..] | [] => {}
            ["port", port, "channel", channel, name, ..] => cards.push(Card {
                port: port.parse().map_err(|_| format!("a port: {port}"))?,
                channel: channel
                    .parse()
                    .map_err(|_| format!("a channel: {channel}"))?,
                name: name.to_lowercase(),
            }),
            _ => return Err(format!("cards: {text}")),
        }
    }
    Ok(cards)
}
