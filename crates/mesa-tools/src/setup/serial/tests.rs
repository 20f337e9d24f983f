//! A simulated remote in place of a card on a serial port. Only the host uses real time.

use std::collections::VecDeque;
use std::io;

use super::*;
use crate::setup::FirmwareFile;
use crate::setup::update::{UpdateError, UpdatePlan, UpdateProgress, UpdateStep};
use mesa_hal::MesaError;
use mesa_hal::lbp::{AccessSize, MemoryAddress};
use mesa_hal_sim::devices::{Device, FieldIo, Outputs48, SimDevice, World};
use mesa_hal_sim::remote::{SimRemote, firmware_file};
use mesa_hal_sim::wire::{Burst, Nanos, RemoteEnd};

/// Bits of 115200 baud.
const BIT: Nanos = 8_681;

/// A serial line with a remote behind it.
struct Line<W: World = FieldIo> {
    remote: SimRemote<Device<W>>,
    now: Nanos,
    /// Characters that have arrived and were not read.
    waiting: VecDeque<u8>,
    /// Number of requests before the remote is switched off.
    cut: Option<u32>,
}

impl Line {
    fn new() -> Self {
        Self::to(FieldIo::i7i77().unwrap())
    }
}

impl<W: World> Line<W> {
    fn to(mut remote: SimRemote<Device<W>>) -> Self {
        SimDevice::set_setup_jumper(&mut remote, 0, true);
        Self {
            remote,
            now: 0,
            waiting: VecDeque::new(),
            cut: None,
        }
    }

    fn power_cycle(&mut self) {
        self.remote.set_power(self.now, false);
        self.remote.set_power(self.now, true);
        self.cut = None;
    }
}

impl<W: World> Write for Line<W> {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        match &mut self.cut {
            Some(0) => self.remote.set_power(self.now, false),
            Some(requests) => *requests -= 1,
            None => {}
        }
        // Long after any earlier burst.
        let start = self.now + 5_000_000;
        let request = Burst::new(start, BIT, data);
        self.remote.advance(request.end());
        self.remote.receive(&request);
        self.now = request.end();
        while let Some(reply) = self.remote.transmit() {
            self.now = self.now.max(reply.end());
            self.waiting.extend(reply.bytes());
        }
        Ok(data.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<W: World> Read for Line<W> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.waiting.is_empty() {
            return Err(ErrorKind::TimedOut.into());
        }
        Read::read(&mut self.waiting, buffer)
    }
}

/// A host with short timeouts: the simulated remote replies at once or never.
fn host_on<W: World>(line: Line<W>) -> SerialHost<Line<W>> {
    SerialHost {
        reply: Duration::from_millis(5),
        quiet: Duration::from_millis(2),
        ..SerialHost::new(line)
    }
}

fn never(_: UpdateProgress) -> bool {
    true
}

fn file(revision: u8, body: usize) -> FirmwareFile {
    let file = firmware_file(*b"7I77", revision, body);
    FirmwareFile::new("7I77.BIN", file, RemoteName(*b"7I77")).unwrap()
}

#[test]
fn card_is_identified_and_discovered_as_through_an_fpga() {
    let mut host = host_on(Line::new());
    let remote = host.identify().unwrap();
    assert_eq!(remote.started.name, RemoteName(*b"7I77"));
    assert_eq!(remote.started.unit_number >> 24, 0x12);
    assert_eq!((remote.started.sizes.rx, remote.started.sizes.tx), (5, 2));
    assert!(!remote.is_bare);
    let found = host.discover(&remote, &DiscoveryOptions::default());
    assert_eq!(found.problems, []);
    let data = found.descriptor.process_data.iter();
    let names: Vec<_> = data.map(|record| record.name.as_str()).collect();
    assert_eq!(names, ["Output", "Input"]);
    let watchdog = found.descriptor.parameter("nvwatchdogtimeout").unwrap();
    assert_eq!(watchdog.read_parameter(&mut host).unwrap().raw, 50);
    watchdog.write_parameter(&mut host, 100).unwrap();
    assert_eq!(watchdog.read_parameter(&mut host).unwrap().raw, 100);
    let mut line = host.into_inner();
    let kept = line.remote.parameters();
    assert!(
        kept.contains(&("nvwatchdogtimeout".into(), 100)),
        "{kept:?}"
    );
    line.power_cycle();
    let mut host = host_on(line);
    assert_eq!(watchdog.read_parameter(&mut host).unwrap().raw, 100);
}

#[test]
fn reply_that_is_lost_damaged_or_too_long_is_asked_for_again() {
    let mut host = host_on(Line::new());
    for spoil in [
        |line: &mut Line| line.remote.inject().drop = 2,
        |line: &mut Line| line.remote.inject().bad_crc = 2,
        |line: &mut Line| line.remote.inject().extra = 3,
        |line: &mut Line| line.remote.inject().short = 1,
    ] {
        spoil(&mut host.port);
        let read = host.exchange(RemoteAccess::ReadLocal(LocalLocation::COOKIE));
        assert_eq!(read.unwrap(), 0x5A);
    }
}

#[test]
fn errors_contain_the_next_step() {
    let mut host = host_on(Line::new());
    host.port.remote.inject().bad_crc = 100;
    let error = host.identify().unwrap_err().with_advice().to_string();
    assert!(error.contains("baud rate"), "{error}");
    host.port.remote.inject().bad_crc = 0;
    host.port.remote.set_power(0, false);
    let error = host.identify().unwrap_err().with_advice().to_string();
    for hint in ["power", "setup mode", "115200", "swapped", "3 times"] {
        assert!(error.contains(hint), "{error}");
    }
    host.port.power_cycle();
    host.port.remote.configure(|config| config.cookie = 0x11);
    let error = host.identify().unwrap_err();
    assert!(matches!(error, SerialError::NotARemote { found: 0x11 }));
}

#[test]
fn firmware_is_compared_written_verified_and_runs_at_power_up() {
    let mut host = host_on(Line::new());
    let firmware = file(21, 9000);
    let boot = host.port.remote.flash().unwrap().cells()[..0x1000].to_vec();
    let plan = UpdatePlan::make(&mut host, &firmware, &mut never).unwrap();
    assert_eq!((plan.erase_size, plan.write_size), (0x1000, 0x100));
    assert!(plan.is_readable);
    assert!(plan.different().eq([0x1000, 0x2000, 0x3000]));
    let mut steps = Vec::new();
    plan.carry_out(&mut host, &firmware, true, &mut |progress| {
        assert!(progress.done < progress.total, "{progress:?}");
        if steps.last() != Some(&progress.step) {
            steps.push(progress.step);
        }
        true
    })
    .unwrap();
    assert_eq!(steps, [UpdateStep::Write, UpdateStep::Verify].repeat(3));
    let again = UpdatePlan::make(&mut host, &firmware, &mut never).unwrap();
    assert_eq!(again.different().count(), 0);
    let mut line = host.into_inner();
    let cells = line.remote.flash().unwrap().cells();
    assert_eq!(
        cells[..0x1000],
        boot,
        "the bootloader's block is left alone"
    );
    assert_eq!(
        cells[0x1000..firmware.bytes().len()],
        firmware.bytes()[0x1000..]
    );
    assert_eq!(
        line.remote.revision(),
        14,
        "the old program runs until then"
    );
    line.power_cycle();
    assert_eq!(line.remote.revision(), 21);
    assert!(!line.remote.is_in_bootloader());
}

#[test]
fn update_that_was_cut_off_anywhere_is_found_and_finished() {
    let firmware = file(22, 5000);
    for requests in [3, 40, 300, 900] {
        let mut host = host_on(Line::new());
        let plan = UpdatePlan::make(&mut host, &firmware, &mut never).unwrap();
        host.port.cut = Some(requests);
        let cut = plan.carry_out(&mut host, &firmware, true, &mut never);
        assert!(matches!(cut, Err(UpdateError::Link(_))), "{cut:?}");
        host.port.power_cycle();
        assert!(host.port.remote.is_in_bootloader(), "after {requests}");
        let remote = host.identify().unwrap();
        assert!(remote.is_bare);
        assert_eq!(remote.started.name, RemoteName(*b"7I77"));
        let plan = UpdatePlan::make(&mut host, &firmware, &mut never).unwrap();
        assert!(plan.different().next().is_some());
        plan.carry_out(&mut host, &firmware, true, &mut never)
            .unwrap();
        host.port.power_cycle();
        assert_eq!(host.port.remote.revision(), 22);
        assert!(!host.identify().unwrap().is_bare);
    }
}

#[test]
fn stopped_update_reports_blocks_left_and_deselects_the_flash() {
    let mut host = host_on(Line::new());
    let firmware = file(23, 5000);
    let plan = UpdatePlan::make(&mut host, &firmware, &mut never).unwrap();
    let mut pages = 0;
    let stopped = plan.carry_out(&mut host, &firmware, true, &mut |_| {
        pages += 1;
        pages < 20
    });
    let expected = UpdateError::Stopped { left: 1, blocks: 2 };
    assert_eq!(stopped.unwrap_err().to_string(), expected.to_string());
    let selected = host.exchange(RemoteAccess::ReadLocal(LocalLocation::NONVOLATILE));
    assert_eq!(selected.unwrap(), 0);
}

#[test]
fn remote_without_readable_flash_memory_is_refused() {
    let firmware = file(24, 5000);
    let mut host = host_on(Line::new());
    let remote = &mut host.port.remote;
    remote.flash_mut().unwrap().hide(true);
    let plan = UpdatePlan::make(&mut host, &firmware, &mut never).unwrap();
    assert!(!plan.is_readable);
    let refused = plan.carry_out(&mut host, &firmware, true, &mut never);
    assert!(matches!(refused, Err(UpdateError::NotReadable)));
    // setsserial does not look either.
    plan.carry_out(&mut host, &firmware, false, &mut never)
        .unwrap();
    host.port.power_cycle();
    assert_eq!(host.port.remote.revision(), 24);
    let short = FirmwareFile::new("7I77.BIN", vec![1; 0x1000], RemoteName(*b"7I77")).unwrap();
    let refused = UpdatePlan::make(&mut host, &short, &mut never);
    assert!(matches!(refused, Err(UpdateError::TooShort { .. })));
    // A card without flash memory has its EEPROM at these addresses.
    let mut line = Line::new();
    line.remote.take_flash();
    let refused = UpdatePlan::make(&mut host_on(line), &firmware, &mut never);
    assert!(matches!(refused, Err(UpdateError::Sizes { .. })));
}

/// The simulated card has 0x8000 bytes of flash memory.
#[test]
fn file_longer_than_the_flash_is_refused_before_any_erase() {
    for repeats in [false, true] {
        let mut host = host_on(Line::new());
        host.port.remote.flash_mut().unwrap().repeat(repeats);
        let before = host.port.remote.flash().unwrap().cells().to_vec();
        for body in [0x7000 - 19, 0x8000, 0x1_2345] {
            let firmware = file(26, body);
            let refused = UpdatePlan::make(&mut host, &firmware, &mut never);
            let Err(UpdateError::TooLong { file, flash }) = refused else {
                panic!("{body:#X}, repeats {repeats}: {refused:?}");
            };
            assert_eq!((file, flash), (firmware.bytes().len(), 0x8000));
        }
        let flash = host.port.remote.flash().unwrap();
        assert!(flash.changes() == 0 && flash.cells() == before);
        // One that fills it to the last byte.
        let firmware = file(27, 0x7000 - 20);
        let plan = UpdatePlan::make(&mut host, &firmware, &mut never).unwrap();
        assert_eq!(plan.behind_end, None);
        plan.carry_out(&mut host, &firmware, true, &mut never)
            .unwrap();
        host.port.power_cycle();
        assert_eq!(host.port.remote.revision(), 27);
    }
}

/// Manual: 7I77, "EXAMPLE LBP COMMANDS". The six bytes at 0x10 are the outputs of a 7I72.
#[test]
fn remote_follows_the_examples_of_the_manual() {
    let mut host = host_on(Line::to(Outputs48::i7i72().unwrap()));
    let at = MemoryAddress::at(0x10);
    let write = Request::write(at.auto_increment(), AccessSize::Long, 0xDDCC_BBAA);
    assert!(host.request(&write).unwrap().is_empty());
    let write = Request::write(MemoryAddress::CURRENT, AccessSize::Word, 0xFFEE);
    assert!(host.request(&write).unwrap().is_empty());
    let read = host
        .request(&Request::read(at, AccessSize::Double))
        .unwrap();
    assert_eq!(read[..6], [0xAA, 0xBB, 0xCC, 0xDD, 0xEE, 0xFF]);
    // The current address was not moved by the last write, nor by this read.
    let next = Request::read(MemoryAddress::CURRENT.auto_increment(), AccessSize::Byte);
    assert_eq!(host.request(&next).unwrap(), [0xAA]);
    assert_eq!(host.request(&next).unwrap(), [0xBB]);
    // A request whose repetition would read the next address is not repeated.
    host.port.remote.inject().drop = 1;
    let lost = host.request(&next).unwrap_err();
    assert!(
        matches!(lost, SerialError::NoReply { attempts: 1, .. }),
        "{lost}"
    );
}

#[test]
fn cell_that_does_not_keep_its_value_is_found() {
    let mut host = host_on(Line::new());
    let firmware = file(25, 5000);
    let plan = UpdatePlan::make(&mut host, &firmware, &mut never).unwrap();
    host.port.remote.flash_mut().unwrap().stick(0x1234);
    let error = plan.carry_out(&mut host, &firmware, true, &mut never);
    let Err(UpdateError::NotKept { offset, .. }) = error else {
        panic!("{error:?}");
    };
    assert_eq!(offset, 0x1230);
}
