use super::*;

const USER: usize = 0x10_0000;
const FALLBACK: usize = 0x1_0000;

/// A chip with a boot block, a user configuration and a fallback, and its backup.
fn whole() -> (Chip, Vec<u8>) {
    let mut chip = Chip::new();
    for (at, len) in [(USER, 200_000), (FALLBACK, 150_000)] {
        chip.bytes[at..at + len].copy_from_slice(&configuration(len));
    }
    let backup = chip.bytes.clone();
    (chip, backup)
}

fn differences(chip: &mut Chip, backup: &[u8]) -> Vec<(Option<Area>, u32, u32)> {
    let found = open(chip).unwrap().differences(backup, |_| true).unwrap();
    let found = found.expect("not ended").into_iter();
    found.map(|one| (one.area, one.start, one.end)).collect()
}

#[test]
fn backup_is_the_chip_and_differs_nowhere() {
    let (mut chip, bytes) = whole();
    let mut last = 0;
    let mut flash = open(&mut chip).unwrap();
    let backup = flash.backup(|done| {
        last = done;
        true
    });
    assert!(backup.unwrap().expect("not ended") == bytes);
    assert_eq!(last, bytes.len());
    assert!(flash.check_backup(&bytes).is_ok());
    assert_eq!(differences(&mut chip, &bytes), []);
    assert!(chip.erased.is_empty() && chip.written.is_empty());
}

#[test]
fn configuration_whose_first_page_is_erased_does_not_begin() {
    let (mut chip, _) = whole();
    for (at, area) in [(USER, Area::User), (FALLBACK, Area::Fallback)] {
        assert_eq!(open(&mut chip).unwrap().begins(area), Ok(true));
        chip.bytes[at..at + PAGE].fill(0xFF);
        assert_eq!(open(&mut chip).unwrap().begins(area), Ok(false));
    }
}

#[test]
fn backup_that_is_ended_is_none() {
    let (mut chip, bytes) = whole();
    let mut flash = open(&mut chip).unwrap();
    assert_eq!(flash.backup(|done| done < 5000), Ok(None));
    assert_eq!(flash.differences(&bytes, |_| false), Ok(None));
}

#[test]
fn differences_are_restored_user_area_first_and_boot_block_last() {
    let (mut chip, backup) = whole();
    let boot = (Some(Area::BootBlock), 0, 0x1_0000);
    let fallback = (Some(Area::Fallback), 0x1_0000, 0x3_0000);
    let unnamed = (None, 0x8_0000, 0x9_0000);
    // From the beginning of the area to the last sector that differs.
    let user = (Some(Area::User), 0x10_0000, 0x13_0000);
    let application = (Some(Area::Application), 0x1E_0000, 0x20_0000);
    for at in [0x1234, 0x2_0000, 0x8_0001, 0x12_FFFF, 0x1F_FFFF] {
        chip.bytes[at] ^= 0x5A;
    }
    let found = differences(&mut chip, &backup);
    assert_eq!(found, [user, application, unnamed, fallback, boot]);

    let mut flash = open(&mut chip).unwrap();
    let found = flash.differences(&backup, |_| true).unwrap().expect("all");
    for part in &found {
        flash.restore(&backup, part, |_, _| {}).unwrap();
    }
    assert!(chip.bytes == backup);
    let sectors = |(_, start, end): (_, u32, u32)| (start..end).step_by(SECTOR);
    let expected: Vec<u32> = [user, application, unnamed, fallback, boot]
        .into_iter()
        .flat_map(sectors)
        .collect();
    assert_eq!(chip.erased, expected, "and nothing else");
}

#[test]
fn file_that_a_board_would_not_start_from_is_no_backup() {
    let (mut chip, backup) = whole();
    let flash = open(&mut chip).unwrap();
    let size = EthernetError::OutsideArea {
        address: 0,
        bytes: 1000,
        area: Area::Whole,
        expected: "all of its 2097152 bytes from 0 on".into(),
    };
    assert_eq!(flash.check_backup(&backup[..1000]), Err(size));
    let mut no_boot = backup.clone();
    no_boot[..PAGE].fill(0xFF);
    let error = flash.check_backup(&no_boot);
    assert_eq!(error, Err(EthernetError::NoBootBlock { address: 0 }));
    let mut one = backup.clone();
    one[USER..USER + PAGE].fill(0xFF);
    assert_eq!(flash.check_backup(&one), Ok(()), "the fallback is enough");
    one[FALLBACK..FALLBACK + PAGE].fill(0xFF);
    let mut other_boot = backup.clone();
    other_boot[30] ^= 1;
    assert_eq!(
        flash.check_backup(&other_boot),
        Ok(()),
        "the chip may be so"
    );
    let error = flash.check_backup_boot_block(&other_boot);
    assert!(matches!(
        error,
        Err(EthernetError::OtherBootBlock { address: 30, .. })
    ));
    let address = USER as u32;
    let error = flash.check_backup(&one);
    assert_eq!(error, Err(EthernetError::NoUserConfiguration { address }));
}

#[test]
fn fallback_is_written_back_only_beside_a_user_configuration() {
    let (mut chip, backup) = whole();
    chip.bytes[USER..USER + PAGE].fill(0xFF);
    let part = FlashDifference {
        area: Some(Area::Fallback),
        start: 0x1_0000,
        end: 0x2_0000,
    };
    let mut flash = open(&mut chip).unwrap();
    let address = USER as u32;
    let refused = flash.restore(&backup, &part, |_, _| {});
    assert_eq!(refused, Err(EthernetError::NoUserConfiguration { address }));
    let outside = FlashDifference {
        area: None,
        start: 0x1F_0000,
        end: 0x21_0000,
    };
    let refused = flash.restore(&backup, &outside, |_, _| {});
    assert!(matches!(refused, Err(EthernetError::OutsideArea { .. })));
    assert!(chip.erased.is_empty());
}

#[test]
fn interrupted_restore_leaves_no_sync_word_and_can_be_repeated() {
    let (mut chip, backup) = whole();
    chip.bytes[USER + 100_000] ^= 0xFF;
    chip.pages_left = 300;
    let mut flash = open(&mut chip).unwrap();
    let found = flash.differences(&backup, |_| true).unwrap().expect("all");
    let cut_off = flash.restore(&backup, &found[0], |_, _| {});
    assert_eq!(cut_off, Err(EthernetError::Bus(NO_POWER)));
    assert!(!Bitfile::has_sync(&chip.bytes[USER..USER + PAGE]));
    chip.pages_left = usize::MAX;
    let mut flash = open(&mut chip).unwrap();
    let found = flash.differences(&backup, |_| true).unwrap().expect("all");
    flash.restore(&backup, &found[0], |_, _| {}).unwrap();
    assert!(chip.bytes == backup);
}
