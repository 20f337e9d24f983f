//! `mesa report`: the page is well-formed and contains what the simulator has.

use std::fs;
use std::net::Ipv4Addr;

use mesa_hal_sim::devices::{FieldIo, SimDevice};

use crate::interop::Scratch;
use crate::interop::board::Board;
use crate::run::{done, json, run};

/// Elements that have no content.
const EMPTY: [&str; 2] = ["meta", "img"];

/// The texts of a page between its elements, as a browser shows them. Fails unless each element is
/// closed, in order, and the page has no script and asks for no other file.
fn texts(page: &str) -> Vec<String> {
    let rest = page.strip_prefix("<!DOCTYPE html>\n").expect("a doctype");
    let (mut open, mut texts) = (Vec::new(), Vec::new());
    for part in rest.split('<').skip(1) {
        let (tag, text) = part.split_once('>').expect("the end of a tag");
        let name = tag
            .split_whitespace()
            .next()
            .expect("a name")
            .trim_end_matches('/');
        assert!(
            !["script", "link", "iframe", "object"].contains(&name),
            "{tag}"
        );
        if let Some(closed) = name.strip_prefix('/') {
            assert_eq!(open.pop(), Some(closed.to_owned()), "{tag}");
        } else if EMPTY.contains(&name) {
            assert!(tag.ends_with('/'), "{tag}");
        } else {
            open.push(name.to_owned());
        }
        let addresses = tag
            .split("src=\"")
            .skip(1)
            .chain(tag.split("href=\"").skip(1));
        for address in addresses {
            assert!(address.starts_with("data:image/svg+xml,"), "{tag}");
        }
        assert!(!tag.contains(" on"), "a handler: {tag}");
        let is_style = open.last().is_some_and(|name| name == "style");
        for escape in text.split('&').skip(1) {
            let known = ["amp;", "lt;", "gt;", "quot;", "#39;"];
            let is_known = known.iter().any(|known| escape.starts_with(known));
            assert!(is_known || is_style, "{text}");
        }
        let text = text
            .replace("&lt;", "<")
            .replace("&gt;", ">")
            .replace("&quot;", "\"");
        let text = text.replace("&#39;", "'").replace("&amp;", "&");
        if !text.trim().is_empty() && !is_style {
            texts.push(text.trim().to_owned());
        }
    }
    assert_eq!(open, [""; 0], "all are closed");
    texts
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn page_has_what_the_simulated_cabinet_has() {
    let mut board = Board::start(
        Ipv4Addr::LOCALHOST,
        &["--board", "7i92-7i77", "--port", "0"],
    );
    board.console.run("field 0 4");
    let address = board.address.to_string();
    let page = Scratch::new("cabinet.html");
    let report = json(&["report", page.path(), "--addr", &address]);
    assert_eq!(report["remotes"], 2, "{report}");
    assert_eq!(report["findings"], 1, "{report}");
    let page = fs::read_to_string(page.path()).expect("a page");
    let texts = texts(&page);
    let is_there = |text: &str| texts.iter().any(|found| found == text);
    // The simulated board: its identity is in the manual, its remotes in the simulator.
    for text in [
        &format!("7I92 at {address}"),
        "7I92",
        "MESA7I92",
        "1 thing to look at: MESA7I92, 2 remotes",
        "7i77.0.0: field voltage too low or missing",
        "0x12000001",
        "7I77 field I/O",
        "TB8 pin 20",
        "OUTPUT3",
        "output-03",
        "7i77.0.0",
        "7i77.0.1",
        "SSerial (C1)",
    ] {
        let is_part = texts.iter().any(|found| found.contains(text));
        assert!(is_there(text) || is_part, "{text}: {texts:#?}");
    }
    let card = FieldIo::i7i77().expect("a card");
    let parameters = card.parameters();
    assert!(parameters.len() > 3, "{parameters:?}");
    for (name, raw) in parameters {
        // The simulator has the names in lower case.
        let is_name = |text: &String| text.eq_ignore_ascii_case(&name);
        assert!(texts.iter().any(is_name), "{name}: {texts:#?}");
        assert!(is_there(&format!("0x{raw:X}")), "{name} {raw}: {texts:#?}");
    }
    let inputs = texts.iter().filter(|text| text.starts_with("INPUT"));
    let outputs = texts.iter().filter(|text| text.starts_with("OUTPUT"));
    assert_eq!((inputs.count(), outputs.count()), (32, 16), "{texts:#?}");
    // Date and host of this computer.
    let year = texts
        .iter()
        .find(|text| text.ends_with(" UTC"))
        .expect("a date");
    assert!(year.starts_with("20") && year.len() == "2026-01-01 00:00:00 UTC".len());
    let host = fs::read_to_string("/proc/sys/kernel/hostname").expect("a name");
    assert!(
        texts.iter().any(|text| text.starts_with(host.trim())),
        "{texts:#?}"
    );
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn report_drives_nothing_and_writes_nothing() {
    let mut board = Board::start(
        Ipv4Addr::LOCALHOST,
        &["--board", "7i92-7i77", "--port", "0"],
    );
    let address = board.address.to_string();
    let before = board.console.show("0");
    let page = Scratch::new("driven.html");
    done(&[
        "report",
        page.path(),
        "--addr",
        &address,
        "--seconds",
        "0.3",
    ]);
    let texts = texts(&fs::read_to_string(page.path()).expect("a page"));
    let figures = texts.iter().find(|text| text.contains("cycles at 1000 Hz"));
    let figures = figures.expect("the figures of the measurement");
    assert!(
        figures.contains("300 cycles at 1000 Hz, paced by the host"),
        "{figures}"
    );
    let after = board.console.show("0");
    for (name, value) in &before {
        if name.contains(".output-") || name.contains("NV") {
            assert_eq!(after[name], *value, "{name}");
        }
    }
    let outputs = after.iter().filter(|(name, _)| name.contains(".output-"));
    assert!(outputs.clone().count() >= 16, "{after:?}");
    assert!(outputs.clone().all(|(_, value)| value == "0"), "{after:?}");
}

#[test]
fn report_of_a_wiring_check_and_a_picture_are_included() {
    let [wiring, plain, svg, page] =
        ["wiring.json", "wiring.txt", "late.svg", "whole.html"].map(Scratch::new);
    let check = [
        "wiring",
        "*.input-31",
        "--timeout",
        "0.5",
        "--sim",
        "7i92-7i77",
    ];
    for file in [&wiring, &plain] {
        let run = run(&[&check[..], &["--report", file.path()]].concat());
        assert_eq!(run.code, Some(1), "no switch was actuated: {run:?}");
    }
    let latency = ["latency", "--sim", "7i92-7i77", "--seconds", "0.1"];
    done(&[&latency[..], &["--plot", svg.path()]].concat());
    let report = [
        "report",
        page.path(),
        "--sim",
        "7i92-7i77",
        "--yes",
        "--latency",
        svg.path(),
    ];
    for file in [&wiring, &plain] {
        done(&[&report[..], &["--wiring", file.path()]].concat());
        let page = fs::read_to_string(page.path()).expect("a page");
        let texts = texts(&page);
        let of = texts.iter().find(|text| text.starts_with(file.path()));
        assert!(
            of.is_some_and(|of| of.contains(", written 20")),
            "{texts:#?}"
        );
        let verdicts = texts
            .iter()
            .map(|text| text.to_lowercase().matches("no change").count());
        assert!(verdicts.sum::<usize>() >= 1, "{texts:#?}");
        let picture = fs::read_to_string(svg.path()).expect("a picture");
        let [begin] = page
            .split("src=\"data:image/svg+xml,")
            .skip(1)
            .collect::<Vec<_>>()[..]
        else {
            panic!("one picture");
        };
        let data = begin.split('"').next().expect("its data");
        assert_eq!(decoded(data), picture);
    }
}

/// Text of percent-encoded data.
fn decoded(data: &str) -> String {
    let mut parts = data.split('%');
    let mut bytes = parts.next().unwrap_or_default().as_bytes().to_vec();
    for part in parts {
        let (code, rest) = part.split_at(2);
        bytes.push(u8::from_str_radix(code, 16).expect("hexadecimal"));
        bytes.extend(rest.as_bytes());
    }
    String::from_utf8(bytes).expect("UTF-8")
}

#[test]
fn text_of_a_file_is_no_markup() {
    let [wiring, page] = ["hostile.json", "hostile.html"].map(Scratch::new);
    let hostile = "<script>alert('1')</script>&amp;\"";
    let row = serde_json::json!({
        "pin": hostile, "terminal": hostile, "signal": "", "verdict": hostile, "others": [hostile],
        "reason": hostile,
    });
    let report = serde_json::json!({
        "address": hostile, "outcome": hostile, "terminals": [row], "missing": [hostile],
        "exchanged": [[hostile, hostile]],
    });
    fs::write(wiring.path(), report.to_string()).expect("a scratch file");
    done(&[
        "report",
        page.path(),
        "--sim",
        "7i97",
        "--wiring",
        wiring.path(),
    ]);
    let texts = texts(&fs::read_to_string(page.path()).expect("a page"));
    assert!(
        texts.iter().filter(|text| text.contains(hostile)).count() >= 6,
        "{texts:#?}"
    );
}

#[test]
fn invalid_report_or_picture_is_refused_before_board_access() {
    let [file, page] = ["other.json", "refused.html"].map(Scratch::new);
    for (content, option, said) in [
        (
            "{\"terminals\": 1}",
            "--wiring",
            "no report of a wiring check",
        ),
        ("7i77: 3 of 4", "--wiring", "no report of a wiring check"),
        ("<html/>", "--latency", "no SVG picture"),
    ] {
        fs::write(file.path(), content).expect("a scratch file");
        let nowhere = ["report", page.path(), "--addr", "127.0.0.1:1"];
        let run = run(&[&nowhere[..], &[option, file.path()]].concat());
        assert_eq!(run.code, Some(2), "{content}: {run:?}");
        assert!(run.err.contains(said), "{content}: {run:?}");
        assert!(!page.0.exists(), "{content}");
    }
}

#[test]
fn board_without_remotes_has_a_page_as_well() {
    let page = Scratch::new("alone.html");
    let text = done(&["report", page.path(), "--sim", "7i97"]);
    assert!(text.contains("7I97 with 0 remotes, "), "{text}");
    let texts = texts(&fs::read_to_string(page.path()).expect("a page"));
    assert!(
        texts.iter().any(|text| text == "No remote has any."),
        "{texts:#?}"
    );
    assert!(texts.iter().any(|text| text == "AOUT0"), "{texts:#?}");
}
