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

/// The image has eight SSI encoders at I/O pins 0 to 7 and 17 to 24, and a serial module.
const ABSOLUTE: &str = "SSI (08) version 0, 8 instances: this crate does not drive it; I/O pins 0-7, \
    17-24 are plain I/O";

#[test]
fn a_module_that_is_not_driven_is_named_with_its_pins_by_info_and_hal() {
    let path = image("7I92-7I74_SSI_SSx2_34");
    let found = json(&["info", "--sim", &path]);
    assert_eq!(found["findings"], Value::from(vec![ABSOLUTE]));
    assert_eq!(found["firmware"]["pins"][1]["function"], "SSI 1 Data");
    let hal = run(&["hal", "--sim", &path]);
    assert_eq!(hal.code, Some(0), "{hal:?}");
    assert!(
        hal.err.contains(&format!("Note: {ABSOLUTE}")),
        "{}",
        hal.err
    );
    assert!(hal.out.contains(&format!("# {ABSOLUTE}\n")), "{}", hal.out);
}

#[test]
fn local_pins_and_what_is_behind_the_modules_are_in_the_tables_and_nothing_to_look_at() {
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
fn an_instance_of_none_is_in_the_table_only() {
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
