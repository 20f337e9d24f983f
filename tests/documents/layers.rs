//! A layer depends only on those below it, in the order given in `src/lib.rs`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The layers of `mesa-wire`, which are independent of each other.
const WIRE: [&str; 3] = ["bus", "lbp", "lbp16"];

/// The layers from the lowest up, each with those that it may name; `..` adds all that the named
/// layer may name itself. Wire formats are those of `mesa-wire`.
const LAYERS: [(&str, &[&str]); 13] = [
    ("bus", &[]),
    ("hal", &["bus"]),
    ("hostmot2", &["bus", "hal"]),
    ("sslbp", &["bus", "lbp", "hostmot2"]),
    ("discovery", &["bus", "lbp", "hal", "sslbp"]),
    ("remote", &["lbp", "hal", "hostmot2", "sslbp", "discovery"]),
    ("boards", &["hal", "hostmot2", "sslbp", "discovery"]),
    ("events", &["bus", "hostmot2", "sslbp"]),
    ("settings", &["hostmot2", "sslbp", "discovery", "events"]),
    (
        "modules",
        &[
            "bus",
            "lbp",
            "hal",
            "hostmot2",
            "sslbp",
            "discovery",
            "remote",
            "boards",
            "events",
            "settings",
        ],
    ),
    ("driver", &["modules.."]),
    ("ethernet", &["bus", "lbp16", "boards"]),
    // A log of a bus names the registers of a firmware.
    (
        "transport",
        &["bus", "lbp16", "hostmot2", "sslbp", "ethernet"],
    ),
];

/// Modules outside of the layers: points of time, the serialized forms of settings and events,
/// values as words, rounded numbers, counters, fractions of a time, the error of parsing, and the
/// advice of errors.
const FORMS: [&str; 11] = [
    "time",
    "advice",
    "Advice",
    "advice_texts",
    "MesaError",
    "serial_form",
    "packed",
    "ParseError",
    "Rounded",
    "tally",
    "fraction",
];

#[test]
fn layer_knows_only_those_below_it() {
    let root = crate::root();
    for layer in WIRE {
        let wire = root.join("crates/mesa-wire/src");
        let mut may_know = BTreeSet::from([layer]);
        // The line to a remote may go over a bus, whose error it keeps.
        if layer == "lbp" {
            may_know.insert("bus");
        }
        names_only(&wire.join(layer), &may_know);
    }
    let mut below = BTreeMap::from(WIRE.map(|layer| (layer, BTreeSet::from([layer]))));
    for (layer, names) in LAYERS {
        let mut may_know = BTreeSet::from([layer]);
        for name in names {
            let all = name.strip_suffix("..");
            let known: &BTreeSet<_> = &below[all.unwrap_or(name)];
            let known = known.iter().filter(|known| all.is_some() || *known == name);
            may_know.extend(known);
        }
        names_only(&root.join("src").join(layer), &may_know);
        below.insert(layer, may_know);
    }
}

/// The folders of the command `mesa`, from the lowest up.
const COMMAND: [&str; 4] = ["ui", "machine", "board", "commands"];

#[test]
fn folder_of_the_command_knows_only_those_below_it() {
    let command = crate::root().join("crates/mesa-tools/src/bin/mesa");
    for (number, folder) in COMMAND.into_iter().enumerate() {
        let may_know = COMMAND.into_iter().take(number + 1).collect();
        names_only(&command.join(folder), &may_know);
    }
}

/// Checks that the sources of a layer name no other parts of their package than these layers.
fn names_only(layer: &Path, may_know: &BTreeSet<&str>) {
    let mut files = Vec::new();
    find_sources(layer, &mut files);
    assert!(!files.is_empty(), "{}", layer.display());
    for file in files {
        let text = fs::read_to_string(&file).expect("a source");
        for name in known(&text) {
            let is_known = FORMS.contains(&name.as_str()) || may_know.contains(name.as_str());
            assert!(is_known, "{} names `{name}`", file.display());
        }
    }
}

#[test]
fn crate_modules_named_by_a_source_are_found() {
    let text = "#[cfg(test)]\nmod tests;\nuse crate::bus::{Access, Clock};\nuse crate::{\n    hal,\n    lbp::{a, b},\n};\n\
                /// See [`x`](crate::driver::Driver).\nlet a = crate::sslbp::Port::new();\n\
                #[cfg(test)]\nmod tests {\n    use mesa_hal_sim::SimFpga;\n}\n";
    let names = ["bus", "hal", "lbp", "sslbp"].map(String::from);
    assert_eq!(known(text), BTreeSet::from(names));
}

/// The sources below a folder, without unit tests.
fn find_sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a layer is a folder") {
        let path = entry.expect("an entry").path();
        match path.file_name().and_then(|name| name.to_str()) {
            Some("tests" | "tests.rs") => {}
            _ if path.is_dir() => find_sources(&path, files),
            _ => files.push(path),
        }
    }
}

/// The parts of the crate that a source names, in its code before its unit tests.
fn known(text: &str) -> BTreeSet<String> {
    // The declaration of tests in a file of their own may be anywhere.
    let text = text.replace("#[cfg(test)]\nmod tests;", "");
    let lines = text
        .lines()
        .take_while(|line| !line.starts_with("#[cfg(test)]"));
    let code: String = lines
        .filter(|line| !line.trim_start().starts_with("//"))
        .flat_map(|line| [line, "\n"])
        .collect();
    let mut names = BTreeSet::new();
    for part in code.split("crate::").skip(1) {
        match part.strip_prefix('{') {
            Some(list) => names.extend(top_level(list)),
            None => names.extend(first_word(part)),
        }
    }
    names
}

/// The first words of the items of a list in braces, up to its end.
fn top_level(list: &str) -> Vec<String> {
    let (mut depth, mut names, mut rest) = (0, Vec::new(), list);
    names.extend(first_word(rest));
    while let Some(at) = rest.find(['{', '}', ',']) {
        let (found, after) = (rest.as_bytes()[at], &rest[at + 1..]);
        match found {
            b'{' => depth += 1,
            b'}' if depth == 0 => break,
            b'}' => depth -= 1,
            _ if depth == 0 => names.extend(first_word(after)),
            _ => {}
        }
        rest = after;
    }
    names
}

fn first_word(text: &str) -> Option<String> {
    let text = text.trim_start();
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_');
    let word = &text[..end.unwrap_or(text.len())];
    (!word.is_empty()).then(|| word.to_string())
}
