//! `mesa latency`.

use std::io::{BufRead, BufReader};
use std::net::Ipv4Addr;
use std::time::Instant;

use serde_json::Value;

use crate::interop::board::Board;
use crate::interop::{PATIENCE, Process, Scratch};
use crate::run::{Run, command, done, json, run};

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{value} is no number"))
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn both_paces_are_measured_and_judged_for_programs() {
    let measured = json(&[
        "latency",
        "--sim",
        "7i97",
        "--seconds",
        "0.5",
        "--pace",
        "both",
    ]);
    assert_eq!(measured["board"], "hm2_7i97.0");
    let runs = measured["runs"].as_array().expect("runs");
    let paces: Vec<_> = runs.iter().map(|run| &run["pace"]).collect();
    assert_eq!(paces, ["host", "board"]);
    for run in runs {
        assert_eq!(run["cycles"], 500);
        assert!(number(&run["cpu_us_per_cycle"]) > 1.0, "{run}");
        for bytes in ["bytes_out_per_cycle", "bytes_back_per_cycle"] {
            assert!((50.0..300.0).contains(&number(&run[bytes])), "{run}");
        }
        for times in ["late_us", "used_us"] {
            let ordered = ["min", "median", "p99", "p99_99", "max"];
            let ordered = ordered.map(|name| number(&run[times][name]));
            assert!(ordered.is_sorted(), "{times}: {ordered:?}");
        }
        assert_eq!(run["offline"], serde_json::json!([]));
        let verdicts = run["verdicts"].as_array().expect("verdicts");
        let rates: Vec<_> = verdicts.iter().map(|verdict| &verdict["rate_hz"]).collect();
        assert_eq!(rates, [1000, 2000, 4000]);
    }
    let [host, board] = &runs[..] else {
        panic!("two runs")
    };
    let packets = [host, board].map(|run| number(&run["packets_out_per_cycle"]));
    assert!(
        (packets[0] - 2.0).abs() < 0.1 && packets[1] < 1.9,
        "{packets:?}"
    );
    let rows = host["histogram"].as_array().expect("rows");
    let late: f64 = rows.iter().map(|row| number(&row["late"])).sum();
    assert_eq!(late, 500.0, "each cycle is in one row");
    assert!(number(&host["round_trip_us"]["min"]) > 1.0, "{host}");
    assert!(board["round_trip_us"].is_null(), "{board}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn percentiles_the_bars_and_the_picture_are_for_people() {
    let picture = Scratch::new("latency.svg");
    let base = [
        "latency",
        "--sim",
        "7i92-7i77",
        "--seconds",
        "0.3",
        "--rate",
        "500",
    ];
    let text = done(&[&base[..], &["--plot", picture.path()]].concat());
    for line in [
        "hm2_7i92.0: 150 cycles at 500 Hz, paced by the host",
        "us                   min    median      99 %   99.99 %       max",
        "used (log scale)",
        "packets out per cycle: 2.0",
        "CPU per cycle: ",
        "4000 Hz: ",
        "\n500 Hz: ",
    ] {
        assert!(text.contains(line), "{line}:\n{text}");
    }
    assert!(text.contains("##"), "bars: {text}");
    let picture = std::fs::read_to_string(picture.path()).expect("a picture");
    assert!(picture.starts_with("<svg") && picture.trim_end().ends_with("</svg>"));
    for words in [
        "hm2_7i92.0: cycles at 500 Hz",
        "paced by the host: 150 cycles, none of ",
        "paced by the host: lateness of its begin",
        "the period",
        "4000 Hz: ",
    ] {
        assert!(picture.contains(words), "{words}");
    }
    let made = picture.lines().find(|line| line.contains(", Linux "));
    assert!(made.is_some_and(|made| made.ends_with(" UTC")), "{made:?}");
    assert!(picture.matches("<rect").count() > 4, "bars");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn both_paces_are_on_one_axis_of_the_picture() {
    let picture = Scratch::new("both.svg");
    let base = [
        "latency",
        "--sim",
        "7i97",
        "--seconds",
        "0.2",
        "--pace",
        "both",
    ];
    done(&[&base[..], &["--plot", picture.path()]].concat());
    let picture = std::fs::read_to_string(picture.path()).expect("a picture");
    assert_eq!(picture.matches("time in us").count(), 1);
    for pace in ["host", "board"] {
        for what in ["time until a cycle is over", "lateness of its begin"] {
            let label = format!("paced by the {pace}: {what}");
            assert!(picture.contains(&label), "{label}");
        }
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn options_already_given_are_not_advised() {
    let base = [
        "latency",
        "--sim",
        "7i97",
        "--seconds",
        "0.3",
        "--rate",
        "2000",
    ];
    let reasons = |arguments: &[&str]| -> Vec<String> {
        let found = json(&[&base[..], arguments].concat());
        let verdicts = found["runs"][0]["verdicts"].as_array().expect("verdicts");
        let reasons = verdicts.iter().map(|one| one["reason"].as_str());
        reasons.map(|one| one.expect("a text").to_owned()).collect()
    };
    for reason in reasons(&["--lock-memory"]) {
        assert!(!reason.contains("--lock-memory"), "{reason}");
    }
    for reason in reasons(&["--cpu", "0"]) {
        assert!(!reason.contains("--cpu"), "{reason}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn lost_packets_are_named_and_a_mode_is_started() {
    let arguments = ["--board", "7i97", "--port", "0", "--remote", "0=7i77-io"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
    let address = board.address.to_string();
    let latency = [
        "latency",
        "--addr",
        &address,
        "--seconds",
        "5",
        "--rate",
        "100",
    ];
    let mode = ["--mode", "0.0=3", "--json"];
    let child = command(&[&latency[..], &mode].concat()).spawn();
    let mut child = Process::new(child.expect("mesa starts"));
    let said = child.child().stderr.take().expect("standard error");
    let mut lines = BufReader::new(said).lines().map_while(Result::ok);
    lines
        .find(|line| line.contains(": 7i77.0.0"))
        .expect("it is started");
    board.wait_for_packets(20);
    assert_eq!(board.console.show("all")["remote.0.mode"], "3");
    board.console.run("loss 0.1");
    board.wait_for_packets(60);
    board.console.run("loss 0");
    let ended = Run::from(child.output());
    let value: Value = serde_json::from_str(&ended.out).expect("JSON");
    crate::run::hold_against_schema("latency", &value);
    let shown = board.console.show("network");
    let [to_board, back] = ["received", "sent"].map(|way| {
        let lost = shown[&format!("network.{way}.lost")].parse::<u64>();
        lost.expect("a count")
    });
    assert!(to_board + back > 0, "{shown:?}");
    let packets = &value["runs"][0]["packets"];
    assert_eq!(packets["lost"], to_board + back, "{value:#}");
    assert_eq!(packets["lost_to_board"], to_board, "{value:#}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn remote_offline_in_a_run_is_reported_and_no_rate_is_rated() {
    let arguments = ["--board", "7i97", "--port", "0", "--remote", "0=7i77-io"];
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
    let address = board.address.to_string();
    let latency = [
        "latency",
        "--addr",
        &address,
        "--seconds",
        "6",
        "--rate",
        "200",
    ];
    for (arguments, is_json) in [(&["--json"][..], true), (&[], false)] {
        board.console.run("plug 0");
        let child = command(&[&latency[..], arguments].concat()).spawn();
        let child = Process::new(child.expect("mesa starts"));
        board.wait_for_packets(600);
        board.console.run("unplug 0");
        let ended = Run::from(child.output());
        assert_eq!(ended.code, Some(1), "{ended:?}");
        if is_json {
            let value: Value = serde_json::from_str(&ended.out).expect("JSON");
            crate::run::hold_against_schema("latency", &value);
            let offline = &value["runs"][0]["offline"][0];
            assert_eq!(offline["place"], "0.0", "{value:#}");
            assert_eq!(offline["is_back"], false, "{value:#}");
        } else {
            assert!(ended.out.contains("7i77.0.0 is OFFLINE: "), "{ended:?}");
            assert!(!ended.out.contains("thread"), "{ended:?}");
            assert!(
                ended.out.contains("1000 Hz: NO: a remote was offline"),
                "{ended:?}"
            );
        }
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn latency_ends_on_a_signal_with_results_and_never_drives() {
    let remotes = ["--remote", "0=7i77-io", "--remote", "1=7i77-analog"];
    let arguments = [&["--board", "7i97", "--port", "0"][..], &remotes].concat();
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &arguments);
    let address = board.address.to_string();
    let endless = ["latency", "--addr", &address, "--seconds", "3600"];
    let mut child = Process::new(command(&endless).spawn().expect("mesa starts"));
    let end = Instant::now() + PATIENCE;
    let (mut looked, mut outputs) = (0, 0);
    while looked < 20 {
        assert!(Instant::now() < end, "it does not run");
        let all = board.console.show("all");
        let received = &all["network.received.packets"];
        let is_running = received.parse::<u64>().is_ok_and(|packets| packets > 1000);
        looked += u32::from(is_running);
        for (name, value) in all {
            let what = name.rsplit('.').next().unwrap_or_default();
            let is_output = ["output", "analogout", "enable", "analogena", "spinena"];
            if is_output.iter().any(|kind| what.starts_with(kind)) {
                let value: f64 = value.parse().unwrap_or(0.0);
                assert!(value.abs() < 0.01, "{name} is {value}");
                outputs += 1;
            }
        }
    }
    assert!(outputs > 20 * 20, "{outputs} outputs looked at");
    child.signal("INT");
    let Run { code, out, err } = child.output().into();
    assert_eq!(code, Some(130), "{out}{err}");
    assert!(out.contains("CPU per cycle: "), "{out}{err}");
    let said = "ended by SIGINT before its time; no output was ever on, and the ports are stopped";
    assert!(err.contains(said), "{err}");
    assert!(err.contains("7i77.0.0"), "what was found: {err}");
}

#[test]
fn impossible_options_are_refused_with_the_reason() {
    let sim = ["latency", "--sim", "7i80-7i77"];
    for (arguments, code, said) in [
        (&["--seconds", "0"][..], 2, "0.1 to 86400"),
        (&["--seconds", "nan"], 2, "0.1 to 86400"),
        (&["--rate", "99"], 2, "100..=10000"),
        (&["--realtime", "100"], 2, "1..=99"),
        (&["--cpu", "4000"], 1, "nproc"),
        (&["--pace", "board"], 1, "cannot pace the cycle"),
        (
            &["--plot", "/nowhere/at/all.svg"],
            1,
            "/nowhere/at/all.svg: ",
        ),
    ] {
        let run = run(&[&sim[..], arguments].concat());
        assert_eq!(run.code, Some(code), "{arguments:?}: {run:?}");
        assert!(run.err.contains(said), "{arguments:?}: {run:?}");
        assert_eq!(run.out, "", "{arguments:?}");
    }
    // The result at the host's pace is not lost when the board's pace fails.
    let both = run(&[&sim[..], &["--pace", "both", "--seconds", "0.1"]].concat());
    assert_eq!(both.code, Some(0), "{both:?}");
    assert!(both.out.contains("paced by the host"), "{both:?}");
    assert!(both.err.contains("paced by the board: "), "{both:?}");
}

#[test]
fn latency_runs_to_its_end_if_its_output_is_not_read() {
    let short = ["latency", "--sim", "7i97", "--seconds", "0.1"];
    let mut child = Process::new(command(&short).spawn().expect("mesa starts"));
    child.stop_reading();
    let run: Run = child.output().into();
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(!run.err.contains("panicked"), "{run:?}");
}
