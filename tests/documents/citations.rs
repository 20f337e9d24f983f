//! Every source cited in the code and the documents can be found: facts in `docs/gateware.md`,
//! sections of manuals in the list there, recordings as files.

use std::collections::{BTreeMap, BTreeSet};
use std::{fs, path::Path};

const GATEWARE: &str = include_str!("../../docs/gateware.md");
/// Folders and files with citations.
const PLACES: [&str; 9] = [
    "src",
    "crates",
    "tests",
    "docs",
    "examples",
    "benches",
    "README.md",
    "CHANGELOG.md",
    "ARCHITECTURE.md",
];
const MANUALS: [&str; 4] = ["7I72", "7I77", "7I77D", "7I97"];
/// Names of recordings begin with one of these, followed by two or three digits.
const FAMILIES: [&str; 15] = [
    "t", "u", "v", "r", "wd", "io", "enc", "qc", "pwm", "dpll", "im", "in", "ssr", "led", "sg",
];

#[test]
fn cited_facts_exist_and_every_fact_is_cited_or_background() {
    let (facts, background) = GATEWARE.split_once("\n# Background").expect("the list");
    let (background, _) = background.split_once("\n# ").expect("an end of the list");
    let background: BTreeSet<String> = numbers_after_facts(background)
        .flatten()
        .flatten()
        .collect();
    let headings: BTreeSet<String> = facts
        .lines()
        .filter(|line| line.starts_with('#'))
        .flat_map(numbers_after_facts)
        .flatten()
        .flatten()
        .collect();
    let mut cited = BTreeSet::new();
    for text in texts() {
        for numbers in numbers_after_facts(&text.words) {
            let numbers =
                numbers.unwrap_or_else(|| panic!("{}: FACTS without a number", text.path));
            for number in numbers {
                assert!(
                    headings.contains(&number),
                    "{}: no FACTS {number}",
                    text.path
                );
                if text.path != "docs/gateware.md" {
                    cited.insert(number);
                }
            }
        }
    }
    let chapters = headings.iter().filter(|number| !number.contains('.'));
    let known: BTreeSet<String> = cited
        .iter()
        .chain(&background)
        .chain(chapters)
        .cloned()
        .collect();
    let unknown: Vec<_> = headings.symmetric_difference(&known).collect();
    assert!(
        unknown.is_empty(),
        "neither cited nor background: {unknown:?}"
    );
    assert!(cited.len() > 70, "{} facts", cited.len());
}

/// The numbers after each `FACTS`, ranges in full; `None` if it is not a number.
fn numbers_after_facts(text: &str) -> impl Iterator<Item = Option<Vec<String>>> {
    text.split("FACTS").skip(1).map(|after| {
        let mut rest = after.strip_prefix(' ')?;
        let mut list: Vec<String> = Vec::new();
        let mut is_range = false;
        loop {
            let len = rest
                .find(|c: char| !c.is_ascii_digit() && c != '.')
                .unwrap_or(rest.len());
            let number = rest[..len].trim_end_matches('.');
            let first = list.last().cloned().filter(|_| is_range);
            match first {
                Some(first) => list.extend(after_up_to(&first, number)),
                None => list.push(number.to_owned()),
            }
            rest = &rest[number.len()..];
            let separator = [", ", " and ", " to "].into_iter().find(|separator| {
                let next = rest.strip_prefix(separator);
                next.is_some_and(|next| next.starts_with(|c: char| c.is_ascii_digit()))
            });
            let Some(separator) = separator else { break };
            is_range = separator == " to ";
            rest = &rest[separator.len()..];
        }
        list.iter().all(|number| !number.is_empty()).then_some(list)
    })
}

/// `8.1` to `8.4`: 8.2, 8.3, 8.4.
fn after_up_to(first: &str, last: &str) -> Vec<String> {
    let split = |number: &str| match number.rsplit_once('.') {
        Some((chapter, number)) => (format!("{chapter}."), number.parse::<u32>()),
        None => (String::new(), number.parse()),
    };
    let ((chapter, Ok(from)), (same, Ok(to))) = (split(first), split(last)) else {
        panic!("FACTS {first} to {last}")
    };
    assert_eq!(chapter, same, "FACTS {first} to {last}");
    (from + 1..=to)
        .map(|number| format!("{chapter}{number}"))
        .collect()
}

#[test]
fn cited_manual_sections_match_the_list_exactly() {
    let (_, list) = GATEWARE.split_once("\n# Manuals").expect("the list");
    let mut listed: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for part in list.split("\n## ").skip(1) {
        let (heading, sections) = part.split_once('\n').expect("its sections");
        let manual = heading.split([',', ' ']).next().expect("a name");
        let titles = sections.lines().filter_map(|line| line.strip_prefix("- "));
        listed.insert(manual, titles.map(str::to_owned).collect());
    }
    let mut cited: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for text in texts() {
        for (manual, title) in sections(&text.words) {
            let is_listed = listed.get(manual).is_some_and(|list| list.contains(&title));
            assert!(
                is_listed,
                "{}: no \"{title}\" of the {manual} in the list",
                text.path
            );
            cited.entry(manual).or_default().insert(title);
        }
    }
    assert_eq!(cited, listed);
}

/// The sections in `Manual: 7I77, "STOP ALL", "DOIT"`, for each manual that is named there. Quoted
/// texts that are not in capitals are words of the manual.
fn sections(text: &str) -> Vec<(&'static str, String)> {
    let mut found = Vec::new();
    for after in text.split("anual").skip(1) {
        let after = after.trim_start_matches(['s', ':']);
        let Some((names, mut rest)) = after.split_once('"') else {
            continue;
        };
        let is_name = |word: &&str| word.starts_with("7I");
        let names: Vec<&str> = names
            .split([' ', ','])
            .filter(|word| !word.is_empty())
            .collect();
        let is_citation = names.first().is_some_and(is_name)
            && names.iter().all(|word| is_name(word) || *word == "and");
        if !is_citation {
            continue;
        }
        while let Some((title, behind)) = rest.split_once('"') {
            let is_title =
                title.contains(|c: char| c.is_uppercase()) && title == title.to_uppercase();
            for manual in MANUALS
                .iter()
                .filter(|manual| is_title && names.contains(manual))
            {
                found.push((*manual, title.to_owned()));
            }
            let Some((between, next)) = behind.split_once('"') else {
                break;
            };
            if between.contains(['.', ';']) || between.len() > 30 {
                break;
            }
            rest = next;
        }
    }
    found
}

#[test]
fn every_recording_that_is_cited_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("transcripts");
    let files: Vec<String> = [root.clone(), root.join("modules")]
        .iter()
        .flat_map(|folder| fs::read_dir(folder).expect("the recordings"))
        .map(|file| {
            file.expect("a file")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    let mut cited = BTreeSet::new();
    for text in texts() {
        let words = text
            .words
            .split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        for word in words.filter(|word| is_recording(word)) {
            let is_there = files.iter().any(|file| file.starts_with(word));
            assert!(is_there, "{}: no recording {word}", text.path);
            cited.insert(word.to_owned());
        }
    }
    assert!(cited.len() > 50, "{} recordings", cited.len());
}

/// True if a word has the form of a recording's name: `t03`, `t07a`, `u08`, `enc04d_rates`.
fn is_recording(word: &str) -> bool {
    let (name, _) = word.split_once('_').unwrap_or((word, ""));
    let name = name.trim_end_matches(|c: char| c.is_ascii_lowercase());
    let digits = name.trim_start_matches(|c: char| c.is_ascii_lowercase());
    let is_type = matches!(word, "u16" | "u32" | "u64");
    !is_type
        && (2..=3).contains(&digits.len())
        && digits.bytes().all(|byte| byte.is_ascii_digit())
        && FAMILIES.contains(&name.trim_end_matches(digits))
}

/// Connected words of a file: a comment, or a page of documentation.
struct Text {
    path: String,
    words: String,
}

fn texts() -> Vec<Text> {
    let root = crate::root();
    let mut found = Vec::new();
    for place in PLACES {
        collect(root, &root.join(place), &mut found);
    }
    found
}

fn collect(root: &Path, path: &Path, found: &mut Vec<Text>) {
    if path.is_dir() {
        for entry in fs::read_dir(path).expect("a folder") {
            collect(root, &entry.expect("an entry").path(), found);
        }
        return;
    }
    let name = path
        .strip_prefix(root)
        .expect("inside")
        .to_string_lossy()
        .into_owned();
    let extension = path.extension();
    let is_rust = extension.is_some_and(|extension| extension == "rs");
    let is_page = extension.is_some_and(|extension| extension == "md");
    if !(is_rust || is_page) || name == file!() {
        return;
    }
    let content = fs::read_to_string(path).expect("a text");
    let mut words = String::new();
    for line in content.lines() {
        let comment = if is_rust { comment(line) } else { Some(line) };
        match comment {
            Some(comment) => {
                words.push_str(comment.trim());
                words.push(' ');
            }
            None if words.is_empty() => {}
            None => found.push(Text {
                path: name.clone(),
                words: std::mem::take(&mut words),
            }),
        }
    }
    found.push(Text { path: name, words });
}

/// The comment on a line of code.
fn comment(line: &str) -> Option<&str> {
    let (before, comment) = line.split_once("//")?;
    let is_comment = before.trim().is_empty() || comment.starts_with(' ');
    is_comment.then(|| comment.trim_start_matches(['/', '!']))
}
