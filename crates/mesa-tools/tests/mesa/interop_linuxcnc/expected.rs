//! The pins and parameters that LinuxCNC must create.

use std::collections::BTreeMap;

/// Type and direction by name.
pub type List = BTreeMap<String, (String, String)>;

/// Pins and parameters that LinuxCNC must create.
#[derive(Default)]
pub struct Expected {
    pins: List,
    params: List,
}

impl Expected {
    /// Parses tables: `pin` or `param`, type, direction, name and number; `{N}`, `{NN}` and `{NNN}`
    /// stand for the index with at least one, two or three digits.
    pub fn of(tables: &[&str]) -> Self {
        let mut expected = Self::default();
        for line in tables.iter().flat_map(|table| table.trim().lines()) {
            let words: Vec<&str> = line.split(' ').collect();
            let (&[what, kind, direction, name], count) = words.split_at(4) else {
                panic!("not four words: {line}");
            };
            let list = match what {
                "pin" => &mut expected.pins,
                _ => &mut expected.params,
            };
            let count = count.first().map_or(1, |count| count.parse().expect(line));
            for n in 0..count {
                let name = name.replace("{NNN}", &format!("{n:03}"));
                let name = name.replace("{NN}", &format!("{n:02}"));
                let name = name.replace("{N}", &n.to_string());
                list.insert(name, (kind.to_owned(), direction.to_owned()));
            }
        }
        expected
    }

    /// Pins and parameters that are missing or not as expected.
    pub fn missing(&self, pins: &List, params: &List) -> Vec<String> {
        let missing = |expected: &List, found: &List| -> Vec<String> {
            let differs =
                |(name, entry): &(&String, &(String, String))| found.get(*name) != Some(*entry);
            let told = |(name, entry): (&String, &(String, String))| {
                format!("{name}: {entry:?}, found {:?}", found.get(name))
            };
            expected.iter().filter(differs).map(told).collect()
        };
        [missing(&self.pins, pins), missing(&self.params, params)].concat()
    }
}
