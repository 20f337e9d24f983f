//! The commands for one board, with `--pci`.

use mesa_pci::search;

use super::PciBoard;
use crate::run::{done, hold_against_schema, json, run};

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn inventory_has_the_remotes_of_the_card_and_no_ethernet_side() {
    let board = PciBoard::start(&["--board", "5i25-7i77-7i76"]);
    let found = json(&["info", "--pci", board.folder()]);
    assert!(found["ethernet"].is_null());
    let firmware = &found["firmware"];
    assert_eq!(firmware["board"], "MESA5I25");
    assert_eq!(firmware["clock_low_hz"], 33_333_333);
    let channels = found["serial_ports"][0]["channels"]
        .as_array()
        .expect("channels");
    let names = channels.iter().map(|channel| {
        let name = channel["found"]["name"]
            .as_str()
            .or(channel["remote"]["name"].as_str());
        (
            channel["channel"].as_u64().expect("a number"),
            name.map(str::to_owned),
        )
    });
    let text = format!("{:?}", names.collect::<Vec<_>>());
    let all = found["serial_ports"].to_string();
    for card in ["7I77", "7I76"] {
        assert!(all.contains(card), "{card}: {text} {all}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn pins_registers_and_files_for_linuxcnc_come_over_the_bus() {
    let mut board = PciBoard::start(&["--board", "5i25-7i77"]);
    let pins = run(&[
        "pins",
        "hm2_5i25.0.7i77.0.0.input-0?",
        "--pci",
        board.folder(),
    ]);
    assert_eq!(pins.code, Some(0), "{pins:?}");
    assert!(pins.out.contains("7i77.0.0.input-09"), "{pins:?}");
    let cookie = json(&["peek", "0:0x100", "--pci", board.folder()]);
    assert!(
        cookie.to_string().contains("1437256446") || cookie.to_string().contains("55AACAFE"),
        "{cookie}"
    );
    let hal = run(&["hal", "--pci", board.folder()]);
    assert_eq!(hal.code, Some(0), "{hal:?}");
    assert!(
        hal.out.contains("loadrt hm2_pci config=[HOSTMOT2]CONFIG\n"),
        "{}",
        hal.out
    );
    for absent in [
        "board_ip",
        "packet-error",
        "PACKET_ERROR",
        "BOARD_IP",
        "UdpBus",
    ] {
        assert!(!hal.out.contains(absent), "{absent}");
    }
    assert!(hal.out.contains("PciDevice::at(SYSFS.as_ref(), address)?"));
    let ours = run(&["hal", "--pci", board.folder(), "--driver", "mesa_pci"]);
    assert!(
        ours.out.contains("\nloadrt mesa_pci config="),
        "{}",
        ours.out
    );
    let wrong = run(&["hal", "--pci", board.folder(), "--driver", "mesa_eth"]);
    assert_eq!(wrong.code, Some(2), "{wrong:?}");
    let accesses = board.console.show("network");
    let count: u64 = accesses["network.pci.accesses"].parse().expect("a count");
    assert!(count > 1000, "{count}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn stepgens_beside_servo_axes_are_driven_at_7i76_terminals() {
    let board = PciBoard::start(&["--board", "5i25-7i77-7i76"]);
    let text = done(&["info", "--pci", board.folder()]);
    let line = |pin: &str| {
        let mut lines = text.lines().filter(|line| line.contains(pin));
        lines.next().unwrap_or_default().to_owned()
    };
    assert!(
        line("StepGen 1 Step ")
            .ends_with("P2 DB25 pin 15 IO20, 7I76 TB2 pin 8, TB2 pin 9 STEP1-, STEP1+"),
        "{text}"
    );
    assert!(
        line("StepGen 4 Dir ").ends_with("7I76 TB3 pin 4, TB3 pin 5 DIR4-, DIR4+"),
        "{text}"
    );
    assert!(!text.contains("not driven"), "{text}");
    let pins = done(&["pins", "*.stepgen.04.*", "--pci", board.folder()]);
    assert!(
        pins.contains("hm2_5i25.0.stepgen.04.position-cmd"),
        "{pins}"
    );
    let hal = done(&["hal", "--pci", board.folder(), "--driver", "mesa_pci"]);
    for line in [
        "loadrt mesa_pci config=[HOSTMOT2]CONFIG",
        "net 7i77-0-1-analogout5 <= pid.5.output",
        "net stepgen-02-position-cmd <= joint.8.motor-pos-cmd",
        "KINEMATICS = trivkins coordinates=XYZABCUVW",
    ] {
        assert!(hal.lines().any(|one| one.contains(line)), "{line}: {hal}");
    }
    assert!(!hal.contains("not driven"), "{hal}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn second_program_is_refused_and_names_the_first() {
    let board = PciBoard::start(&["--board", "5i25-7i77"]);
    let found = search(board.folder().as_ref()).expect("boards");
    let bus = found[0].open().expect("the board");
    let refused = run(&["info", "--pci", board.folder()]);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    let own = format!("(process {}) drives this board", std::process::id());
    assert!(refused.err.contains(&own), "{refused:?}");
    drop(bus);
    assert_eq!(run(&["info", "--pci", board.folder()]).code, Some(0));
}

/// The page that lists the points that are not confirmed.
const GATEWARE: &str = include_str!("../../../../../docs/gateware.md");

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn doctor_looks_at_slot_and_bus_and_gathers_what_confirms_them() {
    let board = PciBoard::start(&["--board", "5i25-7i77"]);
    let report = crate::interop::Scratch::new("report.json");
    let run = run(&[
        "doctor",
        "--pci",
        board.folder(),
        "--passive",
        "--report",
        report.path(),
        "--json",
    ]);
    let found: serde_json::Value = serde_json::from_str(&run.out).expect("JSON");
    hold_against_schema("doctor", &found);
    let findings = found["findings"].as_array().expect("findings");
    for (check, figure) in [
        ("slot", "a simulated 5I25"),
        ("firmware", "HostMot2 for a 5I25"),
        ("bus: time of a read", " us"),
        ("second master", "none seen"),
    ] {
        let fits = |finding: &&serde_json::Value| {
            finding["check"] == check
                && finding["figure"]
                    .as_str()
                    .is_some_and(|it| it.contains(figure))
        };
        assert!(findings.iter().find(fits).is_some(), "{check}: {found:#}");
    }
    let text = std::fs::read_to_string(&report.0).expect("a report");
    let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    hold_against_schema("doctor_report", &report);
    assert!(report.get("identity").is_none());
    let pci = &report["pci"];
    assert_eq!(
        (&pci["board"], &pci["flash_id"]),
        (&"5I25".into(), &"0x13".into())
    );
    assert_eq!(pci["simulated"], true);
    assert!(
        pci["flash_byte_ns"].as_u64().is_some_and(|ns| ns > 0),
        "{pci}"
    );
    // A simulated board confirms nothing.
    let questions = report["questions"].as_array().expect("questions");
    let mut facts = vec!["FACTS 15.1", "docs/pci.md"];
    for part in GATEWARE.split("\n## FACTS 15.").skip(1) {
        if part
            .split("\n#")
            .next()
            .is_some_and(|part| part.contains("not confirmed"))
        {
            facts.push(if part.starts_with("2:") {
                "FACTS 15.2"
            } else {
                "another"
            });
        }
    }
    assert_eq!(facts.len(), 3, "{facts:?}");
    for fact in facts {
        let mut of_fact = questions.iter().filter(|one| one["stands_in"] == fact);
        let question = of_fact
            .next()
            .unwrap_or_else(|| panic!("nothing decides {fact}"));
        assert_eq!(
            question["found"].as_array().map(Vec::len),
            Some(0),
            "{fact}"
        );
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn commands_of_the_ethernet_side_are_refused_with_the_reason() {
    let board = PciBoard::start(&["--board", "5i25-7i77"]);
    for command in [
        &["ip"][..],
        &["led"],
        &["reset", "--yes"],
        &["reload", "--yes"],
        &["raw", "01420001"],
        &["info", "--passive"],
        &["watch", "--passive", "--json"],
    ] {
        let run = run(&[command, &["--pci", board.folder()]].concat());
        assert_eq!(run.code, Some(1), "{command:?}: {run:?}");
        assert!(
            run.err.contains("this one is on the PCI bus"),
            "{command:?}: {run:?}"
        );
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn board_that_is_not_there_is_an_error_with_the_way_to_find_it() {
    let empty = crate::interop::Scratch::new("empty");
    std::fs::create_dir(&empty.0).expect("a folder");
    let none = run(&["info", "--pci", empty.path()]);
    assert_eq!(none.code, Some(1), "{none:?}");
    assert!(none.err.contains("lspci -D -d 2718:"), "{none:?}");
    assert_eq!(run(&["list", "--pci", empty.path()]).code, Some(1));
    let mut board = PciBoard::start(&["--board", "5i25-7i77"]);
    board.console.run("bus off");
    let silent = run(&["info", "--pci", board.folder()]);
    assert_eq!(silent.code, Some(1), "{silent:?}");
    assert!(
        silent.err.contains("no HostMot2") && silent.err.contains("does not answer"),
        "{silent:?}"
    );
    board.console.run("bus on");
    assert_eq!(run(&["info", "--pci", board.folder()]).code, Some(0));
    let pattern = run(&["pins", "--pci", "*.input-0?"]);
    assert_eq!(pattern.code, Some(2), "{pattern:?}");
    let _ = std::fs::remove_dir(&empty.0);
}
