//! `mesa doctor`.

use std::fs;
use std::net::Ipv4Addr;
use std::path::PathBuf;

use serde_json::Value;

use crate::interop::{Process, Scratch, board::Board};
use crate::run::{Run, command, done, hold_against_schema, json, run};

/// Verdict and figure of the check whose name contains a text.
fn finding<'a>(diagnosis: &'a Value, check: &str) -> (&'a str, &'a str) {
    let findings = diagnosis["findings"].as_array().expect("findings");
    let is_it = |one: &&Value| {
        one["check"]
            .as_str()
            .is_some_and(|name| name.contains(check))
    };
    let one = findings.iter().find(is_it);
    let one = one.unwrap_or_else(|| panic!("no {check}: {diagnosis:#}"));
    let text = |name: &str| one[name].as_str().expect("a text");
    (text("verdict"), text("figure"))
}

/// Runs a diagnosis, which need not succeed: exit code, JSON and standard error.
fn diagnosis(arguments: &[&str]) -> (Option<i32>, Value, String) {
    let run = run(&[&["doctor", "--json"], arguments].concat());
    let value = serde_json::from_str(&run.out).unwrap_or_else(|error| panic!("{error}: {run:?}"));
    hold_against_schema("doctor", &value);
    (run.code, value, run.err)
}

/// A period that a busy test machine keeps.
const SLOW: &str = "10000";

/// A root directory with these files, in place of a computer's.
fn computer(name: &str, files: &[(&str, &str)]) -> PathBuf {
    let root = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let root = root.join(format!("{}-{name}", std::process::id()));
    for (path, text) in files {
        let path = root.join(path);
        fs::create_dir_all(path.parent().expect("a directory")).expect("a scratch directory");
        fs::write(path, text).expect("a scratch file");
    }
    root
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn bus_log_has_the_words_of_the_cycles_by_name() {
    let file = Scratch::new("bus.txt");
    let period = ["--period", SLOW, "--exchanges", "10"];
    let log = ["--yes", "--bus-log", file.path()];
    let run = run(&[&["doctor", "--sim", "7i97"][..], &period, &log].concat());
    let text = fs::read_to_string(file.path()).unwrap_or_else(|error| panic!("{error}: {run:?}"));
    assert!(text.contains(" host read 0x0100 0x55AACAFE ; cookie\n"));
    assert!(text.contains(" host write "), "{text}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn machine_is_checked_with_consent_and_ends_with_outputs_off() {
    let board = Board::start(
        Ipv4Addr::LOCALHOST,
        &["--board", "7i97", "--port", "0", "--remote", "0=7i77-io:2"],
    );
    let address = board.address.to_string();
    // Long enough for a busy machine, and short enough for the DPLL of a 7I97.
    let period = ["--period", "10000", "--exchanges", "10"];
    let ask = [&["--addr", address.as_str()][..], &period].concat();
    let refused = run(&[&["doctor"][..], &ask].concat());
    assert_eq!(refused.code, Some(2), "not a terminal: {refused:?}");
    assert!(refused.err.contains("--passive"), "{refused:?}");

    let (_, found, said) = diagnosis(&[&ask[..], &["--yes"]].concat());
    assert!(said.contains("no output was ever on"), "{said}");
    assert_eq!(finding(&found, "network route").0, "ok");
    assert_eq!(finding(&found, "second master").0, "ok");
    assert_eq!(
        finding(&found, "firmware"),
        ("ok", "7I97, network firmware 16")
    );
    let (_, loss) = finding(&found, "packet loss");
    assert!(loss.contains("packets lost"), "{loss}");
    let (_, watchdog) = finding(&found, "board: watchdog against period");
    assert_eq!(watchdog, "50 ms, period 10 ms");
    assert_eq!(
        finding(&found, "7i77.0.0: field power"),
        ("unknown", "not measured in this software mode")
    );
    let (_, kernel) = finding(&found, "kernel");
    assert!(kernel.contains("PREEMPT_RT"), "{kernel}");
    let shown = board.stop("TERM");
    for enable in 0..6 {
        assert_eq!(shown[&format!("board.enable{enable}")], "0");
    }
}

/// Runs a passive diagnosis of a board whose network has a fault, and returns it with the counts of
/// the board's network meanwhile: lost packets that it did not receive, and lost replies.
fn with_mishap(mishap: &str) -> (Value, [u64; 2]) {
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let address = board.address.to_string();
    // The seldom packets before and after the test exchanges are not disturbed.
    let exchanges = ["--exchanges", "300", "--period", "2000"];
    let arguments = ["doctor", "--json", "--addr", &address, "--passive"];
    let child = command(&[&arguments[..], &exchanges].concat()).spawn();
    let child = Process::new(child.expect("mesa starts"));
    board.wait_for_packets(30);
    board.console.run(mishap);
    board.wait_for_packets(100);
    board.console.run("loss 0");
    board.console.run("late 0");
    let ended = Run::from(child.output());
    let found: Value = serde_json::from_str(&ended.out).expect("JSON");
    hold_against_schema("doctor", &found);
    let shown = board.console.show("network");
    let lost = ["received", "sent"].map(|way| {
        let count = &shown[&format!("network.{way}.lost")];
        count.parse().expect("a count")
    });
    (found, lost)
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn late_replies_are_not_called_lost_and_the_cable_is_not_blamed() {
    let (found, lost) = with_mishap("late 0.3");
    assert_eq!(lost, [0, 0]);
    let (verdict, loss) = finding(&found, "packet loss");
    assert_eq!(verdict, "ok", "{loss}");
    assert!(loss.starts_with("none of 3"), "{loss}");
    let (verdict, late) = finding(&found, "latency against period");
    assert_eq!(verdict, "bad", "{late}");
    let count: u32 = late.split(' ').next().expect("a word").parse().expect(late);
    assert!((20..=300).contains(&count), "{late}");
    let advice = found["findings"].as_array().expect("findings");
    let advice = advice
        .iter()
        .find(|one| one["check"] == "latency against period");
    let advice = advice.expect("it")["advice"].as_str().expect("advice");
    assert!(advice.contains("the cable is not the cause"), "{advice}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn loss_per_direction_matches_the_counters_of_the_board() {
    let (found, [to_board, back]) = with_mishap("loss 0.2");
    assert!(to_board > 5 && back > 5, "{to_board}, {back}");
    let (verdict, loss) = finding(&found, "packet loss");
    assert_eq!(verdict, "bad", "{loss}");
    let said =
        format!("packets lost, {to_board} on the way to the board and {back} on the way back");
    assert!(loss.contains(&said), "{loss}, and not {said}");
    assert!(
        loss.starts_with(&format!("{} of ", to_board + back)),
        "{loss}"
    );
}

#[test]
fn software_mode_that_measures_field_power_is_used_and_rated() {
    let machine = [
        "--sim",
        "7i92-7i77",
        "--yes",
        "--exchanges",
        "10",
        "--period",
        SLOW,
    ];
    let (_, found, _) = diagnosis(&[&machine[..], &["--mode", "0.0=2"]].concat());
    assert_eq!(
        finding(&found, "7i77.0.0: field power"),
        ("ok", "measured, and no fault reported")
    );
    assert_eq!(
        finding(&found, "7i77.0.1: field power"),
        ("unknown", "not measured by this part of the card")
    );
}

/// A 7I72 measures in another mode than a 7I77, and a 7I64 in none.
#[test]
fn field_power_that_is_not_measured_has_the_advice_of_its_card() {
    let machine = [
        "--sim",
        "7i97,0=7i72,1=7i64",
        "--yes",
        "--exchanges",
        "10",
        "--period",
        SLOW,
    ];
    let (_, found, _) = diagnosis(&machine);
    for (card, expected) in [
        (
            "7i72.0.0",
            "in software mode 1: `mesa pins fieldvoltage --mode PORT.CHANNEL=1`",
        ),
        ("7i64.0.1", "measure it at its terminals"),
    ] {
        let findings = found["findings"].as_array().expect("findings");
        let of_card = findings.iter().find(|one| {
            let check = one["check"].as_str().expect("a check");
            check.contains(card) && check.ends_with("field power")
        });
        let advice = of_card.expect("field power")["advice"]
            .as_str()
            .expect("advice");
        assert!(advice.ends_with(expected), "{advice}");
    }
}

#[test]
fn t_board_is_named_as_such() {
    let passive = ["--passive", "--exchanges", "10", "--period", SLOW];
    let (_, found, _) = diagnosis(&[&["--sim", "7i97t"][..], &passive].concat());
    let (verdict, figure) = finding(&found, "board generation");
    assert_eq!(verdict, "look");
    assert!(
        figure.starts_with("7I97T is a T board: an Efinix FPGA (20 kgates"),
        "{figure}"
    );
    assert_eq!(finding(&found, "firmware").1, "7I97T, network firmware 16");
    let (_, found, _) = diagnosis(&[&["--sim", "7i97"][..], &passive].concat());
    assert!(!found.to_string().contains("T board"), "{found:#}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn remote_without_field_power_is_bad_and_sets_the_exit_code() {
    let mut board = Board::start(
        Ipv4Addr::LOCALHOST,
        &["--board", "7i97", "--port", "0", "--remote", "0=7i77-io"],
    );
    let address = board.address.to_string();
    board.console.run("field 0 0");
    let ask = [
        "--addr",
        &address,
        "--period",
        "5000",
        "--exchanges",
        "10",
        "--yes",
    ];
    let (code, found, _) = diagnosis(&ask);
    assert_eq!(
        (code, &found["verdict"]),
        (Some(1), &"bad".into()),
        "{found:#}"
    );
    let text = run(&[&["doctor"][..], &ask].concat());
    assert_eq!(text.code, Some(1), "{text:?}");
    assert!(
        text.out.contains("BAD") && text.out.contains("-> "),
        "{text:?}"
    );
    // The rule whose breach destroys the outputs.
    assert!(
        text.out.contains("it must rise slower than 10 V/ms"),
        "{text:?}"
    );
}

#[test]
fn passive_starts_nothing_and_reads_the_files_of_the_computer() {
    let root = computer(
        "doctor",
        &[
            (
                "proc/net/route",
                "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\n",
            ),
            ("sys/class/net/eth0/type", "1\n"),
            ("sys/kernel/realtime", "1\n"),
            ("sys/devices/system/cpu/online", "0-3\n"),
            ("sys/devices/system/cpu/isolated", "3\n"),
            (
                "sys/devices/system/cpu/cpu2/cpufreq/scaling_governor",
                "powersave\n",
            ),
            ("usr/lib/linuxcnc/modules/mesa_eth.so", ""),
            ("proc/77/comm", "rtapi_app:T#0\n"),
            (
                "proc/77/maps",
                "7f00-7f10 r-xp 00000000 08:01 42 /usr/lib/linuxcnc/modules/mesa_eth.so\n",
            ),
            (
                "proc/self/limits",
                "Max locked memory  unlimited  unlimited  bytes\nMax realtime priority  95  95\n",
            ),
        ],
    );
    let root = root.to_str().expect("UTF-8");
    let passive = [
        "--sim",
        "7i97",
        "--passive",
        "--exchanges",
        "10",
        "--period",
        SLOW,
        "--root",
        root,
    ];
    let (_, found, said) = diagnosis(&passive);
    assert_eq!(said, "", "nothing was started");
    for (check, verdict) in [
        ("kernel", "ok"),
        ("realtime priority", "ok"),
        ("locked memory", "ok"),
        ("isolated CPUs", "ok"),
        ("CPU frequency", "look"),
        ("LinuxCNC", "look"),
        ("CPU idle states", "unknown"),
    ] {
        assert_eq!(finding(&found, check).0, verdict, "{check}: {found:#}");
    }
    let findings = found["findings"].as_array().expect("findings");
    assert!(findings.iter().all(|one| {
        !one["check"]
            .as_str()
            .is_some_and(|name| name.contains("field power"))
    }));
    let text = done(&[&["doctor"], &passive[..]].concat());
    assert!(
        text.contains("look     CPU frequency: governor powersave"),
        "{text}"
    );
    assert!(text.contains("LinuxCNC: runs with mesa_eth"), "{text}");
    fs::remove_dir_all(root).expect("it is there");
}

/// The page that lists the points that are not confirmed.
const GATEWARE: &str = include_str!("../../../../../docs/gateware.md");

#[test]
fn report_gathers_what_decides_everything_that_is_not_confirmed() {
    let file = Scratch::new("doctor-report.json");
    let machine = "7i92-7i77,2=7i72";
    let ask = [
        "doctor",
        "--sim",
        machine,
        "--period",
        SLOW,
        "--exchanges",
        "10",
        "--report",
    ];
    let ended = run(&[&ask[..], &[file.path(), "--yes"]].concat());
    assert!(ended.err.contains("4 of 4 questions"), "{ended:?}");
    let text = fs::read_to_string(&file.0).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    hold_against_schema("doctor_report", &report);
    let questions = report["questions"].as_array().expect("questions");
    let of = |fact: &str| {
        let mut all = questions.iter();
        let question = all.find(|one| one["stands_in"] == fact);
        question.unwrap_or_else(|| panic!("nothing decides {fact}"))
    };
    let mut places = 0;
    for part in GATEWARE.split("\n## ") {
        let words = part.split_whitespace().collect::<Vec<_>>().join(" ");
        let is_of_pci = words.starts_with("FACTS 15.");
        if words.contains("not confirmed") && !is_of_pci {
            let (fact, _) = words.split_once(':').expect("a heading");
            assert!(of(fact)["found"][0].is_string(), "{fact}: {report:#}");
            places += 1;
        }
    }
    assert_eq!(places, 3, "places where something is not confirmed");
    let scale = of("FACTS 8.4")["found"][0].as_str().expect("a text");
    let is_told = scale.starts_with("FieldVoltage: ") && scale.contains("16 bits, 0 to ");
    assert!(is_told, "{scale}");
    assert_eq!(report["memory"][0]["values"][0], 0x55AA_CAFE_u32);

    let passive = run(&[&ask[..], &[file.path(), "--passive", "--yes"]].concat());
    assert!(passive.err.contains("1 of 4 questions"), "{passive:?}");
    let nowhere = run(&[&ask[..], &["/nowhere/report.json", "--passive"]].concat());
    assert!(
        nowhere.code == Some(1) && nowhere.err.contains("/nowhere/report.json"),
        "{nowhere:?}"
    );
}

#[test]
fn network_and_computer_are_checked_even_without_a_board() {
    let (code, found, _) = diagnosis(&["--addr", "127.93.0.11", "--passive"]);
    assert_eq!(code, Some(1));
    let (verdict, figure) = finding(&found, "board");
    assert!(
        verdict == "bad" && figure.contains("no program listens"),
        "{figure}"
    );
    finding(&found, "kernel");
    for arguments in [
        ["--period", "99"],
        ["--period", "10001"],
        ["--exchanges", "9"],
    ] {
        let run = run(&[&["doctor", "--sim", "7i97", "--passive"], &arguments[..]].concat());
        assert_eq!(run.code, Some(2), "{arguments:?}: {run:?}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn ctrl_c_ends_it_with_what_was_found_and_nothing_running() {
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let address = board.address.to_string();
    let ask = [
        "doctor",
        "--addr",
        &address,
        "--exchanges",
        "100000",
        "--yes",
    ];
    let mut process = Process::new(command(&ask).spawn().expect("mesa starts"));
    board.wait_for_packets(1000);
    process.signal("INT");
    let ended = Run::from(process.output());
    assert_eq!(ended.code, Some(130), "{ended:?}");
    assert!(ended.err.contains("nothing was left running"), "{ended:?}");
    assert!(ended.out.contains("packet loss"), "{ended:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_that_another_program_drives_is_left_alone() {
    let mut board = Board::start(Ipv4Addr::LOCALHOST, &["--board", "7i97", "--port", "0"]);
    let address = board.address.to_string();
    let other = [
        "doctor",
        "--addr",
        &address,
        "--passive",
        "--exchanges",
        "100000",
    ];
    let mut other = Process::new(command(&other).spawn().expect("mesa starts"));
    board.wait_for_packets(1000);
    let (code, found, _) = diagnosis(&["--addr", &address, "--yes"]);
    other.signal("INT");
    other.output();
    assert_eq!(code, Some(1), "{found:#}");
    let (verdict, figure) = finding(&found, "board");
    assert!(
        verdict == "bad" && figure.contains("another program or host drives"),
        "{figure}"
    );
    let value = json(&["peek", "0:0x100", "--addr", &address]);
    assert_eq!(value["registers"][0]["value"], 0x55AA_CAFE_u32);
}
