//! The README's claims: its code drives the axis, and `docs/promises.md` names, for every sentence of the
//! README and of the pages that continue it, a test that would fail if the sentence were not true.

use std::{collections::BTreeSet, fs};

use mesa_hal::Clock;

const README: &str = include_str!("../../README.md");
/// The pages of which every sentence is in `docs/promises.md`, in the order of its chapters.
const PAGES: [(&str, &str); 3] = [
    ("README.md", README),
    ("docs/cycle.md", include_str!("../../docs/cycle.md")),
    ("docs/mesa.md", include_str!("../../docs/mesa.md")),
];
const PROMISES: &str = include_str!("../../docs/promises.md");
/// The second part of a chapter begins with this line.
const CLAIMS_NOTHING: &str = "### Claims nothing";
const TEN_LINES: &str = include_str!("ten_lines.in");

#[test]
fn the_lines_in_the_readme_are_those_that_are_run_here() {
    let (_, block) = README.split_once("```rust\n").expect("a block of code");
    let (block, _) = block.split_once("# Ok::").expect("its end");
    let run = TEN_LINES.strip_prefix("{\n").expect("an expression");
    let run = run
        .strip_suffix("(ended.driver.into_bus(), ended.statistics)\n}\n")
        .expect("that gives what is left");
    assert_eq!(block, run);
}

#[test]
fn the_lines_in_the_readme_move_the_axis() -> Result<(), Box<dyn std::error::Error>> {
    let (mut bus, statistics) = include!("ten_lines.in");
    // The motor needs a moment to stop.
    bus.wait(std::time::Duration::from_millis(50));
    // 1.5 V are 15 units a second, for a second.
    let mut motor = |axis| {
        let motor = bus.motor(axis).expect("a motor");
        (motor.position(), motor.velocity())
    };
    let (moved, speed) = motor(0);
    assert!((14.0..16.0).contains(&moved), "{moved} units");
    assert!(speed.abs() < 0.1, "it still moves: {speed}");
    for axis in 1..6 {
        assert!(motor(axis).0.abs() < 1e-9, "axis {axis}");
    }
    assert_eq!((statistics.cycles, statistics.failed_reads), (1000, 0));
    Ok(())
}

#[test]
fn every_sentence_of_the_pages_names_its_test_or_claims_nothing() {
    let chapters: Vec<_> = PROMISES
        .lines()
        .filter_map(|line| line.strip_prefix("## "))
        .collect();
    assert_eq!(chapters, PAGES.map(|(page, _)| page));
    for (page, text) in PAGES {
        let entries = entries().filter(|entry| entry.page == page);
        let known: BTreeSet<String> = entries.map(|entry| entry.sentence).collect();
        let said: BTreeSet<String> = sentences(text).into_iter().collect();
        let missing: Vec<_> = said.difference(&known).collect();
        assert!(
            missing.is_empty(),
            "{page}: not in docs/promises.md: {missing:#?}"
        );
        let gone: Vec<_> = known.difference(&said).collect();
        assert!(gone.is_empty(), "not in {page} any more: {gone:#?}");
        assert!(said.len() > 20, "{page}: {} sentences", said.len());
    }
}

#[test]
fn every_promise_names_tests_that_exist() {
    let mut promises = 0;
    for Entry {
        sentence,
        evidence,
        claims,
        ..
    } in entries()
    {
        assert_eq!(!evidence.is_empty(), claims, "{sentence}: {evidence:?}");
        promises += u32::from(claims);
        for item in evidence {
            assert!(
                exists(&item),
                "{sentence}\nnames {item}, which does not exist"
            );
        }
    }
    assert!(promises > 80, "{promises} promises");
}

/// A sentence in `docs/promises.md`, and the tests that it names.
struct Entry {
    page: &'static str,
    sentence: String,
    evidence: Vec<String>,
    /// False in the part of a chapter that claims nothing.
    claims: bool,
}

/// A line that begins with `> ` is a sentence; those with `- ` that follow it name its tests. A heading
/// names the page of the sentences below it.
fn entries() -> impl Iterator<Item = Entry> {
    let mut list: Vec<Entry> = Vec::new();
    let (mut page, mut claims) = ("", true);
    for line in PROMISES.lines() {
        if let Some(name) = line.strip_prefix("## ") {
            (page, claims) = (name, true);
        } else if line == CLAIMS_NOTHING {
            claims = false;
        } else if let Some(sentence) = line.strip_prefix("> ") {
            list.push(Entry {
                page,
                sentence: sentence.to_owned(),
                evidence: Vec::new(),
                claims,
            });
        } else if let (Some(item), Some(entry)) = (line.strip_prefix("- "), list.last_mut()) {
            entry.evidence.push(item.to_owned());
        }
    }
    list.into_iter()
}

/// True if there is a test `path::name`, or a text in a file: `path "text"`.
fn exists(item: &str) -> bool {
    let read = |path: &str| {
        let root = crate::root();
        fs::read_to_string(root.join(path)).unwrap_or_default()
    };
    if let Some((path, text)) = item.split_once(" \"") {
        return text
            .strip_suffix('"')
            .is_some_and(|text| read(path).contains(text));
    }
    let Some((path, name)) = item.rsplit_once("::") else {
        return false;
    };
    let source = read(path);
    let Some((before, _)) = source.split_once(&format!("fn {name}(")) else {
        return false;
    };
    before.trim_end().ends_with("#[test]")
}

/// The sentences of a page, without headings and code. A row of a table is one sentence.
fn sentences(page: &str) -> Vec<String> {
    let mut blocks: Vec<String> = vec![String::new()];
    let mut is_code = false;
    for line in page.lines() {
        let line = line.trim_start_matches("> ").trim_end();
        if line.starts_with("```") {
            is_code = !is_code;
            blocks.push(String::new());
            continue;
        }
        let is_target = line.starts_with('[') && line.contains("]: ");
        if is_code || is_target || line.starts_with('#') || line.starts_with("|---") {
            continue;
        }
        let begins = line.is_empty() || line.starts_with("- ") || line.starts_with('|');
        if begins {
            blocks.push(String::new());
        }
        if let Some(block) = blocks.last_mut() {
            block.push_str(line.trim_start_matches("- ").trim());
            block.push(' ');
        }
    }
    let plain = |text: &str| text.replace("**", "").trim().to_owned();
    let blocks = blocks
        .iter()
        .map(|block| plain(block))
        .filter(|block| !block.is_empty());
    blocks
        .flat_map(|block| {
            if block.starts_with('|') {
                return vec![block];
            }
            let ends = block.replace(". ", ".\n").replace("? ", "?\n");
            ends.lines().map(str::to_owned).collect()
        })
        .collect()
}
