//! Public firmwares: modules that are not driven, and pins without a connector.

use serde_json::Value;

use crate::run::{json, run};

fn image(name: &str) -> String {
    let directory = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/transcripts/firmwares"
    );
    format!("{directory}/{name}.txt")
}

/// The image has a galvanometer interface at I/O pins 6 to 9 and 14, beside modules that are
/// driven.
const MIRRORS: &str = "XY2Mod (2B) version 0, 1 instance: the driver does not support it; I/O pins 6-9, 14 are \
    plain I/O";

#[test]
fn undriven_module_is_named_with_its_pins_by_info_and_hal() {
    let path = image("7I92-7I76XY2Modx1D_34");
    let found = json(&["info", "--sim", &path]);
    assert_eq!(found["findings"], Value::from(vec![MIRRORS]));
    assert_eq!(found["firmware"]["pins"][1]["function"], "StepGen 0 Step");
    let hal = run(&["hal", "--sim", &path]);
    assert_eq!(hal.code, Some(0), "{hal:?}");
    assert!(hal.err.contains(&format!("Note: {MIRRORS}")), "{}", hal.err);
    assert!(hal.out.contains(&format!("# {MIRRORS}\n")), "{}", hal.out);
}

#[test]
fn local_pins_and_trailing_data_are_listed_with_no_finding() {
    let path = image("7I97-7I97D_51");
    let found = json(&["info", "--sim", &path]);
    assert_eq!(found["findings"], Value::from(Vec::<String>::new()));
    let behind = ["CPDrive (C4)", "width of InMux (1E) 0: 16 inputs"];
    assert_eq!(found["firmware"]["trailing"], Value::from(behind.to_vec()));
    let local = &found["firmware"]["local_pins"];
    assert_eq!(local[0]["function"], "CPDrive 0 Low");
    let text = run(&["info", "--sim", &path]).out;
    for line in [
        "  and behind their end: CPDrive (C4); width of InMux (1E) 0: 16 inputs\n",
        "Local I/O pins, which end on the board\n",
    ] {
        assert!(text.contains(line), "{line}: {text}");
    }
}

#[test]
fn instance_of_none_is_in_the_table_only() {
    let found = json(&["info", "--sim", &image("5I25-PktUART1inst_34-2016")]);
    let findings = found["findings"].to_string();
    assert!(
        !findings.contains("StepGen") && !findings.contains("PWM"),
        "{findings}"
    );
    assert!(findings.contains("PktUARTTransmit (1B)"), "{findings}");
    let modules = found["firmware"]["modules"].as_array().expect("modules");
    assert!(
        modules
            .iter()
            .any(|module| module["module"] == "StepGen (05)")
    );
}

#[test]
fn a_7i76eu_has_its_card_on_its_own_serial_port() {
    let machine = format!("{},0=7i76eu", image("7I76E-7I76_7I88SS_7I89D_51"));
    let found = json(&["info", "--sim", &machine]);
    let remote = &found["serial_ports"][0]["channels"][0]["remote"];
    assert_eq!(remote["name"], "7I76");
    let parameters = remote["parameters"].to_string();
    for name in ["Output_Source", "Output_Sink", "SpinMode"] {
        assert!(parameters.contains(name), "{name}: {parameters}");
    }
}
