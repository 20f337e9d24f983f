//! Inventories of simulated boards.

use crate::common::ethernet::{SimLink, connect};
use mesa_hal::ethernet::{AddressSource, EthernetBoard};
use mesa_hal_sim::{AddressJumpers, BoardConfig, SimBoard, SimFpga, gtag, machines};
use mesa_tools::inventory::{self, InventoryEthernet};

/// A 5I25 of 2012 printed SSLBP 1.38: FACTS 2.3.
#[test]
fn old_serial_firmware_is_reported() {
    for (minor, is_old) in [(38, true), (43, false)] {
        let mut firmware = machines::firmware_5i25_7i77();
        firmware.sslbp_minor = minor;
        let mut fpga = SimFpga::new(firmware);
        machines::plug_7i77(&mut fpga, 0, 0);
        let taken = inventory::take(&mut fpga, None, &[].into(), || true).expect("a 5I25");
        assert_eq!(taken.serial_ports[0].sslbp, format!("1.{minor}"));
        let finding = taken.findings.iter().find(|text| text.contains("SSLBP"));
        assert_eq!(finding.is_some(), is_old, "{finding:?}");
        assert!(finding.is_none_or(|text| text.starts_with("port 0 has SSLBP 1.38: ")));
    }
}

/// The stock firmware of a 7I92 lists PWM with 0 instances, which is no finding.
#[test]
fn descriptor_without_instances_is_nothing_to_look_at() {
    let mut fpga = machines::i7i92_with_cards();
    let mut listed = fpga.firmware().modules.iter();
    assert!(listed.any(|module| (module.gtag, module.instances) == (gtag::PWM, 0)));
    let taken = inventory::take(&mut fpga, None, &[].into(), || true).expect("a 7I92");
    assert_eq!(taken.findings, [""; 0]);
}

/// A 7I97T whose card name is 7I97 as well is distinguished by its firmware. FACTS 9.6.
#[test]
fn jumpers_both_up_mean_fallback_on_a_7i97t_invalid_on_a_7i97() {
    for (fpga, source, findings) in [
        (machines::i7i97t(1), AddressSource::Fallback, 0),
        (machines::i7i97(1), AddressSource::Invalid, 1),
    ] {
        let mut config = BoardConfig::new("7I97");
        config.jumpers = AddressJumpers::Both;
        let mut bus = connect(SimLink::to(SimBoard::new(config, fpga)));
        let ethernet = InventoryEthernet::read(&mut EthernetBoard::new(&mut bus)).expect("a board");
        assert_eq!(ethernet.identity.address_from, AddressSource::Invalid);
        let taken = inventory::take(&mut bus, Some(ethernet), &[].into(), || true);
        let taken = taken.expect("a 7I97");
        let identity = taken.ethernet.expect("the Ethernet side").identity;
        assert_eq!(identity.address_from, source);
        assert_eq!(taken.findings.len(), findings, "{:?}", taken.findings);
    }
}

/// Other programs refuse such a board.
#[test]
fn eeprom_that_was_never_written_is_a_finding() {
    for (is_blank, lacks) in [
        ([false, false], None),
        ([true, false], Some("no card name")),
        ([false, true], Some("no MAC address")),
        ([true, true], Some("neither card name nor MAC address")),
    ] {
        let mut config = BoardConfig::new("7I97");
        if is_blank[0] {
            config.name = [0xFF; 16];
        }
        if is_blank[1] {
            config.mac = [0xFF; 6];
        }
        let mut bus = connect(SimLink::to(SimBoard::new(config, machines::i7i97(1))));
        let ethernet = InventoryEthernet::read(&mut EthernetBoard::new(&mut bus)).expect("a board");
        let taken = inventory::take(&mut bus, Some(ethernet), &[].into(), || true);
        let findings = taken.expect("a 7I97").findings;
        assert_eq!(findings.len(), usize::from(lacks.is_some()), "{findings:?}");
        if let Some(lacks) = lacks {
            assert!(findings[0].contains(lacks), "{findings:?}");
        }
    }
}

#[cfg(feature = "serde")]
#[test]
fn inventory_is_as_it_is_written() {
    use crate::common::machine::{ANALOG, FIELD, fpga};
    use std::path::Path;

    let mut fpga = fpga();
    for channel in [FIELD, ANALOG] {
        let _ = fpga.plug(0, channel, None);
    }
    let taken = inventory::take(&mut fpga, None, &[].into(), || true).expect("a 7I92");
    let made = serde_json::to_value(taken).expect("JSON");
    let written = serde_json::from_str(include_str!("inventory.json"));
    if written.ok().as_ref() == Some(&made) {
        return;
    }
    let other = Path::new(env!("CARGO_TARGET_TMPDIR")).join("inventory.json");
    let text = serde_json::to_string_pretty(&made).expect("JSON");
    std::fs::write(&other, text + "\n").expect("a folder for it");
    panic!(
        "tests/library/inventory.json is another one than {}",
        other.display()
    );
}
