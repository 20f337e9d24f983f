//! Each link of a page to a file or to a heading leads there.

use std::path::{Path, PathBuf};
use std::{collections::BTreeSet, fs};

/// Pages beside those of `docs`.
const PAGES: [&str; 9] = [
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "ARCHITECTURE.md",
    "SECURITY.md",
    "crates/mesa-hal-sim/README.md",
    "crates/mesa-pci/README.md",
    "crates/mesa-tools/README.md",
    "crates/mesa-wire/README.md",
];

#[test]
fn each_link_of_a_page_leads_to_a_file_and_a_heading() {
    let root = crate::root();
    let docs = fs::read_dir(root.join("docs")).expect("a folder");
    let docs = docs.map(|entry| entry.expect("an entry").path());
    let docs = docs.filter(|path| path.extension().is_some_and(|end| end == "md"));
    let pages: Vec<PathBuf> = PAGES
        .iter()
        .map(|page| root.join(page))
        .chain(docs)
        .collect();
    let mut followed = 0;
    for page in pages {
        let text = read(&page);
        for target in links(&text) {
            let (file, heading) = target.split_once('#').unwrap_or((target, ""));
            let file = match file {
                "" => page.clone(),
                file => page.parent().expect("a folder").join(file),
            };
            assert!(file.exists(), "{}: {target}", page.display());
            if !heading.is_empty() {
                let found = headings(&read(&file)).contains(heading);
                assert!(found, "{}: {target}", page.display());
            }
            followed += 1;
        }
    }
    assert!(followed > 50, "{followed} links");
}

/// Folders that a path of a page may begin with.
const FOLDERS: [&str; 8] = [
    "src/",
    "crates/",
    "tests/",
    "examples/",
    "benches/",
    "docs/",
    "fuzz/",
    ".ci/",
];

#[test]
fn each_path_that_a_page_for_developers_names_is_there() {
    let mut named = 0;
    for page in ["ARCHITECTURE.md", "CONTRIBUTING.md", "docs/README.md"] {
        let text = read(&crate::root().join(page));
        let quoted = text.split('`').skip(1).step_by(2);
        let paths = quoted.filter(|path| FOLDERS.iter().any(|folder| path.starts_with(folder)));
        for path in paths.filter(|path| !path.contains(['*', '<', ' '])) {
            assert!(crate::root().join(path).exists(), "{page}: {path}");
            named += 1;
        }
    }
    assert!(named > 50, "{named} paths");
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The targets of links, without those of the documentation and of the web.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let inline = text.split("](").skip(1);
    let inline = inline.filter_map(|rest| rest.split_once(')').map(|(target, _)| target));
    // `[name]: target`, on a line of its own.
    let defined = text.lines().filter(|line| line.starts_with('['));
    let defined = defined.filter_map(|line| line.split_once("]: ").map(|(_, target)| target));
    inline
        .chain(defined)
        .filter(|target| !target.contains("::") && !target.contains("//"))
}

/// The anchors of a page's headings, as a browser of repositories makes them.
fn headings(text: &str) -> BTreeSet<String> {
    let lines = text.lines().filter(|line| line.starts_with('#'));
    lines
        .map(|line| {
            let words = line.trim_start_matches('#').trim().to_lowercase();
            let kept = words.chars().filter_map(|c| match c {
                ' ' => Some('-'),
                '-' | '_' => Some(c),
                c => c.is_alphanumeric().then_some(c),
            });
            kept.collect()
        })
        .collect()
}
