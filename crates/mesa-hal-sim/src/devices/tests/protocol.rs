//! Accesses from the line to a device other than process data.

use super::{super::*, Host, lit};
use crate::{
    remote::Application,
    wire::{BIT_2M5, Burst},
};
use mesa_wire::lbp::{
    AccessSize, LbpStatus, LocalLocation, RemoteAccess, Request, UNIT_NUMBER, flash,
};

#[test]
fn nonvolatile_parameters_survive_and_apply_after_a_power_cycle() {
    let mut remote = FieldIo::i7i77().unwrap();
    let layout = remote.application().layout().clone();
    let nv = layout.address("NVWatchDogTimeout").unwrap();
    let working = layout.address("WatchDogTime").unwrap();
    let mut host = Host::new(&mut remote);
    assert_eq!(host.read(working, AccessSize::Word), 50);
    host.set(LocalLocation::NONVOLATILE, 1);
    let before = host.now;
    host.write(nv, AccessSize::Word, 100);
    assert!(
        host.now - before > 4_000_000,
        "an EEPROM takes milliseconds"
    );
    assert_eq!(host.read(nv, AccessSize::Word), 100, "read back");
    host.set(LocalLocation::NONVOLATILE, 0);
    assert_eq!(host.read(working, AccessSize::Word), 50, "not yet");
    host.write(working, AccessSize::Word, 7);
    let now = host.now;
    remote.set_power(now, false);
    remote.set_power(now + 1_000_000, true);
    let mut host = Host::new(&mut remote);
    host.now = now + 2_000_000;
    assert_eq!(host.read(working, AccessSize::Word), 100);
    let sizes = host.start(0);
    host.exchange(sizes, &[1, 0]);
    host.wait(99_000_000);
    let now = host.now;
    assert_eq!(lit(&remote), 1);
    remote.advance(now + 1_000_001);
    assert_eq!(lit(&remote), 0);
}

#[test]
fn unit_number_can_be_changed_for_good() {
    let mut remote = FieldIo::i7i77().unwrap();
    let nv = remote
        .application()
        .layout()
        .address("NVUnitNumber")
        .unwrap();
    let unit = Request::rpc(UNIT_NUMBER, &[], 4);
    let mut host = Host::new(&mut remote);
    assert_eq!(host.ask(&unit), Some(vec![1, 0, 0, 0x12]));
    host.set(LocalLocation::NONVOLATILE, 1);
    host.write(nv, AccessSize::Long, 0x12AB_CDEF);
    let now = host.now;
    remote.set_power(now, false);
    remote.set_power(now, true);
    let mut host = Host {
        remote: &mut remote,
        now,
    };
    assert_eq!(host.ask(&unit), Some(vec![0xEF, 0xCD, 0xAB, 0x12]));
}

#[test]
fn records_are_write_protected_and_an_attempt_sets_the_status() {
    let mut remote = FieldIo::i7i77().unwrap();
    let mut host = Host::new(&mut remote);
    let before = host.read(0x0400, AccessSize::Double);
    host.write(0x0400, AccessSize::Double, 0);
    assert_eq!(host.read(0x0400, AccessSize::Double), before);
    assert_eq!(
        host.local(LocalLocation::STATUS),
        LbpStatus::INVALID_ADDRESS.bits()
    );
    host.set(LocalLocation::STATUS, 0);
    assert_eq!(host.local(LocalLocation::STATUS), 0);
}

#[test]
fn rpc_list_of_the_manual_runs_on_a_remote() {
    // Manual 7I77, "EXAMPLE RPC COMMAND LIST": RPC5 at 0028.
    let mut remote = FieldIo::i7i77().unwrap();
    let mut host = Host::new(&mut remote);
    host.set(LocalLocation::RPC_MEMORY_ACCESS, 1);
    for (address, byte) in (0x28..).zip([0x65, 0x10, 0x00, 0x45, 0x12, 0x00, 0x00]) {
        host.write(address, AccessSize::Byte, byte);
    }
    assert_eq!(host.read(0x28, AccessSize::Long), 0x4500_1065);
    host.set(LocalLocation::RPC_MEMORY_ACCESS, 0);
    host.write(0x12, AccessSize::Word, 0x1234);
    let rpc = Request::rpc(0x85, &[0x55, 0xCC], 2);
    assert_eq!(host.ask(&rpc), Some(vec![0x34, 0x12]));
    assert_eq!(host.read(0x10, AccessSize::Word), 0xCC55);
}

/// Manual 7I77, "EXAMPLE LBP COMMANDS": write AA BB CC DD to 0010 with auto-increment, write two
/// more bytes at the current address, which leaves the address pointer at 0014, and read eight at
/// 0010.
#[test]
fn example_commands_of_the_manual_in_a_row() {
    let mut remote = crate::remote::SimRemote::model();
    remote.apply("present=1").unwrap();
    let mut host = Host::new(&mut remote);
    let write = [0x6E, 0x10, 0x00, 0xAA, 0xBB, 0xCC, 0xDD];
    assert!(host.raw(&write).is_empty());
    assert!(host.raw(&[0x61, 0xEE, 0xFF]).is_empty());
    assert_eq!(host.local(LocalLocation::ADDRESS_LOW), 0x14);
    assert_eq!(host.local(LocalLocation::ADDRESS_HIGH), 0);
    assert_eq!(
        host.raw(&[0x47, 0x10, 0x00]),
        [0xAA, 0xBB, 0xCC, 0xDD, 0xEE, 0xFF, 0x00, 0x00]
    );
}

#[test]
fn program_can_be_updated_through_the_flash_registers() {
    // FACTS 1.6.
    let mut remote = FieldIo::i7i77().unwrap();
    let mut host = Host::new(&mut remote);
    assert_eq!(host.local(LocalLocation::CAPABILITIES), 0x0D);
    host.set(LocalLocation::NONVOLATILE, 2);
    host.write(flash::OFFSET, AccessSize::Long, 0x1000);
    let erase = host.read(flash::LOG2_ERASE_SIZE, AccessSize::Byte);
    assert!((8..=16).contains(&erase));
    host.write(flash::COMMIT, AccessSize::Byte, flash::COMMIT_ERASE.into());
    host.write(0, AccessSize::Double, 0x0102_0304_0506_0708);
    host.write(flash::COMMIT, AccessSize::Byte, flash::COMMIT_WRITE.into());
    assert_eq!(host.read(0, AccessSize::Double), 0x0102_0304_0506_0708);
    host.set(LocalLocation::NONVOLATILE, 0);
    assert_eq!(remote.flash().unwrap().cells()[0x1000], 0x08);
}

#[test]
fn layouts_pack_what_they_unpack() {
    let text = "remote PACK\nmode 0 m\ndata A 3 bits both\ndata B 13 signed both 0 1\n\
                data P 5 pad both\ndata C 64 unsigned both\ndata D 100 bits both\n";
    let remote = Plain::from_description(text).unwrap();
    let layout = remote.application().layout();
    let mut memory = crate::remote::SimMemory::default();
    let wire: Vec<u8> = (0..24_u8)
        .map(|n| n.wrapping_mul(73).wrapping_add(11))
        .collect();
    layout.unpack(0, &mut memory, &wire);
    let mut again = vec![0; 24];
    layout.pack(0, &memory, &mut again);
    // 185 bits.
    assert_eq!(again[..23], wire[..23]);
    assert_eq!(again[23], wire[23] & 1);
    assert!(!remote.application().clears_faults(&wire));
}

#[test]
fn another_baud_rate_takes_effect_after_a_power_cycle() {
    // Manual 7I77, "OPERATE MODE BAUD RATE": index 4 is 115200 baud.
    let mut remote = FieldIo::i7i77().unwrap();
    let nv = remote.application().layout().address("NVBaudRate").unwrap();
    let mut host = Host::new(&mut remote);
    host.set(LocalLocation::NONVOLATILE, 1);
    host.write(nv, AccessSize::Word, 4);
    assert_eq!(host.local(LocalLocation::COOKIE), 0x5A);
    let now = host.now;
    remote.set_power(now, false);
    remote.set_power(now, true);
    let mut host = Host {
        remote: &mut remote,
        now,
    };
    let cookie = Request::access(RemoteAccess::ReadLocal(LocalLocation::COOKIE));
    assert_eq!(host.ask(&cookie), None);
    let burst = Burst::new(now + 10_000_000, 8_681, &[0xDF, 0x16]);
    remote.advance(burst.end());
    remote.receive(&burst);
    let reply = remote.transmit().unwrap();
    assert_eq!((reply.bytes(), reply.bit), (&[0x5A, 0xA5][..], 8_681));
}

proptest::proptest! {
    #[test]
    fn arbitrary_bursts_never_panic_and_the_remote_replies_after(
        noise in proptest::collection::vec(
            (proptest::collection::vec(proptest::prelude::any::<u8>(), 0..32), 0..200_000_u64),
            0..60,
        ),
        sealed in proptest::prelude::any::<bool>(),
    ) {
        let mut remote = FieldIo::i7i77().unwrap();
        let mut now = 0;
        for (mut bytes, gap) in noise {
            if sealed {
                // Half of the runs consist of frames with a valid CRC.
                bytes.truncate(12);
                bytes.push(mesa_wire::lbp::crc8(&bytes));
            }
            let burst = Burst::new(now + gap, BIT_2M5, &bytes);
            now = burst.end();
            remote.advance(now);
            remote.receive(&burst);
            while remote.transmit().is_some() {}
        }
        now += 1_000_000_000;
        let burst = Burst::new(now, BIT_2M5, &[0xDF, 0x16]);
        remote.advance(burst.end());
        remote.receive(&burst);
        let reply = remote.transmit();
        proptest::prop_assert_eq!(reply.map(|r| r.bytes().to_vec()), Some(vec![0x5A, 0xA5]));
    }
}
