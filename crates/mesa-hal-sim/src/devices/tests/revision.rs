//! The revision of the running program, as D5 and as a parameter.

use super::*;
use crate::remote::firmware_file;

/// A card with a parameter of `bits` bits.
fn card(bits: u8) -> SimRemote<Device<Plain>> {
    let text = format!(
        "remote 7X99\nrevision 9\nmode 0 outputs\n  data Output 8 bits out\n\
         parameter Before 32 unsigned in 0 4294967295 = 4294967295\n\
         parameter SwRevision {bits} unsigned in 0 255 = 3\n\
         parameter After 32 unsigned in 0 4294967295 = 4294967295\n"
    );
    Plain::from_description(&text).expect("a card")
}

fn parameter(card: &dyn SimDevice, name: &str) -> u64 {
    let parameters = card.parameters();
    let found = parameters.iter().find(|(found, _)| found == name);
    found.expect("a parameter").1
}

#[test]
fn parameter_follows_the_program_that_runs_whatever_its_width() {
    for bits in [8, 16, 32] {
        let mut card = card(bits);
        assert_eq!((card.revision(), parameter(&card, "swrevision")), (9, 9));
        SimDevice::load_program(&mut card, &firmware_file(*b"7X99", 201, 3000));
        assert_eq!(parameter(&card, "swrevision"), 9, "the old program runs");
        card.set_power(1_000_000, false);
        card.set_power(2_000_000, true);
        assert_eq!(card.revision(), 201);
        assert_eq!(parameter(&card, "swrevision"), 201, "{bits} bits");
        for beside in ["before", "after"] {
            assert_eq!(parameter(&card, beside), 0xFFFF_FFFF, "{bits} bits");
        }
        // Without flash memory the revision is that of the description.
        card.take_flash();
        card.set_power(3_000_000, false);
        card.set_power(4_000_000, true);
        assert_eq!(parameter(&card, "swrevision"), 9, "{bits} bits");
    }
}

#[test]
fn limits_of_the_baud_rate_are_those_of_its_table() {
    // Manual: 7I77, "OPERATE MODE BAUD RATE": indexes 0 to 11.
    for description in [
        FieldIo::description(),
        Analog::description(),
        Outputs48::description(),
    ] {
        let description = description.expect("a description");
        let mut parameters = description.parameters.iter();
        let found = parameters.find(|parameter| parameter.record.name == "NVBaudRate");
        let record = &found.expect("the parameter").record;
        assert_eq!((record.min, record.max), (0.0, 11.0));
    }
}
