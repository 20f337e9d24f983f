//! The simulated cards of a machine: those of the simulator, and for a kind that it does not have
//! one that describes itself with the names of the list.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::rc::Rc;

use mesa_hal_sim::devices::{Analog, DescriptionError, FieldIo, Outputs48, Plain};
use mesa_hal_sim::wire::RemoteEnd;

use super::list::{Card, Entry, List};

/// Makes a card.
type Make = Rc<dyn Fn() -> Result<Box<dyn RemoteEnd>, DescriptionError>>;

/// A card in a software mode.
#[derive(Clone)]
pub struct Choice {
    pub card: Card,
    pub make: Make,
    pub mode: u8,
}

/// The greatest software mode of a known card.
const LAST_MODE: u8 = 4;

macro_rules! makes {
    ($($make:expr),*) => {
        vec![$(Rc::new(|| Ok(Box::new($make?)))),*]
    };
}

/// The cards that a card of the list can be: each kind with its name, in each software mode.
pub fn choices(list: &List, card: &Card) -> Vec<Choice> {
    let makes: Vec<Make> = match &*card.name {
        "7i64" => makes![Plain::i7i64()],
        "7i69" => makes![Plain::i7i69()],
        "7i70" => makes![Plain::i7i70()],
        "7i71" => makes![Outputs48::i7i71()],
        "7i72" => makes![Outputs48::i7i72()],
        "7i73" => makes![Plain::i7i73(), Plain::i7i73_display()],
        "7i76" => makes![
            FieldIo::i7i76(),
            FieldIo::i7i76_of_revision_14(),
            FieldIo::i7i76e(),
            FieldIo::i7i76eu()
        ],
        "7i77" => makes![FieldIo::i7i77(), Analog::i7i77()],
        "7i83" => makes![Plain::i7i83()],
        "7i84" => makes![FieldIo::i7i84(), FieldIo::i7i84u()],
        "7i87" => makes![Plain::i7i87()],
        _ => {
            let text = described(card, &own_of(list, card));
            vec![Rc::new(move || {
                Ok(Box::new(Plain::from_description(&text)?))
            })]
        }
    };
    let choice = |(make, mode)| Choice {
        card: card.clone(),
        make,
        mode,
    };
    let modes =
        (0..=LAST_MODE).flat_map(|mode| makes.iter().cloned().map(move |make| (make, mode)));
    modes.map(choice).collect()
}

/// The start of a card's names.
pub fn prefix(card: &Card) -> String {
    format!("{}.{}.{}.", card.name, card.port, card.channel)
}

fn own_of<'a>(list: &'a List, card: &Card) -> BTreeMap<&'a str, &'a Entry> {
    let prefix = prefix(card);
    let entries = list.entries.iter();
    entries
        .filter_map(|(name, entry)| Some((name.strip_prefix(&prefix)?, entry)))
        .collect()
}

fn is_parameter(entry: &Entry) -> bool {
    matches!(&*entry.direction, "RO" | "RW")
}

/// The text that describes a card with these names, the ends of which belong to an element
/// together: its type is that of its pins.
fn described(card: &Card, own: &BTreeMap<&str, &Entry>) -> String {
    let (first, rest) = card.name.split_at(1);
    let (second, rest) = rest.split_at(1);
    let mut text = format!(
        "remote {first}{}{rest}\nunit 0x12345678\n",
        second.to_uppercase()
    );
    let pins = own.iter().filter(|(_, entry)| !is_parameter(entry));
    let ends = ["-not", "-invert", "-scalemax", "-maxlim", "-minlim"];
    let elements: BTreeSet<&str> = pins
        .clone()
        .map(|(name, _)| {
            ends.iter()
                .fold(*name, |name, end| name.strip_suffix(end).unwrap_or(name))
        })
        .map(|name| match name.rsplit_once('-') {
            Some((stem, number)) if number.parse::<u8>().is_ok() => stem,
            _ => name.split('.').next().unwrap_or(name),
        })
        .collect();
    text += "mode 0 as_listed\n";
    for element in elements {
        let bits = (0..64).take_while(|bit| own.contains_key(&*format!("{element}-{bit:02}")));
        let (bits, kind, name) = match bits.count() {
            0 if own.contains_key(&*format!("{element}.count")) => {
                (8, "encoder", format!("{element}.count"))
            }
            0 if own
                .get(element)
                .is_some_and(|entry| entry.hal_type == "bit") =>
            {
                (1, "boolean", element.to_owned())
            }
            0 => (16, "unsigned", element.to_owned()),
            bits => (bits, "bits", format!("{element}-00")),
        };
        let is_out = own.get(&*name).is_some_and(|entry| entry.direction == "IN");
        let direction = if is_out { "out" } else { "in" };
        let limit = |end: &str| {
            own.get(&*format!("{element}{end}"))
                .map(|entry| &*entry.value)
        };
        let greatest = limit("-scalemax").unwrap_or("1");
        let kind = match limit("-minlim") {
            Some(least) if least.starts_with('-') => "signed",
            _ => kind,
        };
        let least = limit("-minlim").unwrap_or("0");
        let _ = writeln!(
            text,
            "  data {element} {bits} {kind} {direction} {least} {greatest}"
        );
    }
    let with_ends = |name: &str| ends.iter().any(|end| name.ends_with(end)) || name.contains('.');
    let parameters = own
        .iter()
        .filter(|(name, entry)| is_parameter(entry) && !with_ends(name));
    for (name, entry) in parameters {
        let kind = match &*entry.hal_type {
            "s32" => "signed",
            "float" => "float",
            _ => "unsigned",
        };
        let direction = if entry.direction == "RW" {
            "both"
        } else {
            "in"
        };
        let value = entry.value.replace("0x", "");
        let value = u32::from_str_radix(&value, 16).unwrap_or_default();
        let _ = writeln!(
            text,
            "parameter {name} 32 {kind} {direction} 0 4294967295 = {value}"
        );
    }
    text
}
