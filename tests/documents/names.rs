//! Names of tests are short sentences about what is promised, and comments fit the column limit.

use std::fs;
use std::path::{Path, PathBuf};

/// Largest number of characters of a test's name.
const LONGEST_NAME: usize = 60;
/// Largest number of columns of a line of a comment.
const COLUMNS: usize = 100;

/// First words of a name that is no subject.
const NO_SUBJECTS: [&str; 14] = [
    "the", "an", "what", "who", "how", "which", "where", "while", "when", "if", "it", "they",
    "nobody", "whoever",
];
/// Words for what a component reports, shows or returns.
const SPEECH: [&str; 7] = ["tell", "tells", "told", "say", "says", "said", "anew"];

/// All sources of the project, by their path from its root.
fn sources() -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for folder in ["src", "crates", "tests", "examples", "benches", "fuzz"] {
        add(&crate::root().join(folder), &mut found);
    }
    assert!(found.len() > 500, "{} sources", found.len());
    found
}

fn add(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            if !path.ends_with("target") {
                add(&path, found);
            }
        } else if path.extension().is_some_and(|kind| kind == "rs") {
            let text = fs::read_to_string(&path).expect("a source");
            found.push((path, text));
        }
    }
}

/// The names of the tests of a source.
fn tests(text: &str) -> Vec<&str> {
    let mut names = Vec::new();
    let mut is_test = false;
    for line in text.lines().map(str::trim) {
        if line == "#[test]" {
            is_test = true;
        } else if let Some(name) = line.strip_prefix("fn ").filter(|_| is_test) {
            names.extend(name.split('(').next());
            is_test = false;
        }
    }
    names
}

/// Why a name is none of a test, if so.
fn fault(name: &str) -> Option<&'static str> {
    let words: Vec<_> = name.split('_').collect();
    if name.len() > LONGEST_NAME {
        Some("is longer than 60 characters")
    } else if words.first().is_some_and(|word| NO_SUBJECTS.contains(word)) {
        Some("does not begin with its subject")
    } else if words.iter().any(|word| SPEECH.contains(word)) {
        Some("has a word that means reported, shown or returned")
    } else {
        None
    }
}

#[test]
fn test_names_are_short_and_begin_with_their_subject() {
    let sources = sources();
    let names = sources.iter().flat_map(|(path, text)| {
        let path = path.display();
        tests(text)
            .into_iter()
            .map(move |name| (format!("{path}: {name}"), name))
    });
    let mut count = 0;
    let mut faults = Vec::new();
    for (place, name) in names {
        count += 1;
        faults.extend(fault(name).map(|fault| format!("{place} {fault}")));
    }
    assert!(count > 1_500, "{count} names");
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn faults_of_test_names_are_found() {
    for name in ["what_is_sent", "board_says_hello", &"reply_".repeat(11)] {
        assert!(fault(name).is_some(), "{name}");
    }
    assert_eq!(fault("stale_reply_is_counted_and_dropped"), None);
    assert_eq!(
        tests("#[test]\n#[ignore]\nfn a_name() {}\nfn other() {}"),
        ["a_name"]
    );
}

/// Tables, links and code in a comment cannot be wrapped, and texts of a program are no comments.
#[test]
fn comment_lines_fit_100_columns() {
    let mut long = Vec::new();
    for (path, text) in sources() {
        let mut is_code = false;
        for (number, line) in text.lines().enumerate() {
            let Some(comment) = line.trim_start().strip_prefix("//") else {
                continue;
            };
            let comment = comment.trim_start_matches(['/', '!']).trim_start();
            is_code ^= comment.starts_with("```");
            let is_text = line.ends_with(['\\', '"']);
            let is_wrapped = !is_code
                && !is_text
                && !comment.starts_with(['|', '#', '['])
                && comment.contains(' ');
            if is_wrapped && line.chars().count() > COLUMNS {
                long.push(format!("{}:{}", path.display(), number + 1));
            }
        }
    }
    assert!(long.is_empty(), "{long:#?}");
}
