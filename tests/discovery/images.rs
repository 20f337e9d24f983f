//! Discovery on memory images: recorded ones, damaged ones, and arbitrary ones.

mod damage;

use crate::common::image::Image;
use mesa_hal::boards::REMOTES;
use mesa_hal::discovery::{
    DataDirection, DataType, Discovery, DiscoveryOptions, ElementTable, ModeType, ProblemKind,
    RemoteTable, Table, discover,
};
use mesa_hal::sslbp::RemoteName;
use mesa_hal::sslbp::{Channel, CsStatus, ProcessDataSizes, StartedRemote};
use proptest::prelude::*;

fn started(ptoc: u16, gtoc: u16, rx: u8, tx: u8) -> StartedRemote {
    StartedRemote {
        channel: Channel::ALL[0],
        name: RemoteName(*b"7I77"),
        unit_number: 0x77AA,
        software_mode: 0,
        ptoc,
        gtoc,
        sizes: ProcessDataSizes { rx, tx },
        cs: CsStatus::default(),
    }
}

fn run(image: &mut Image, started: &StartedRemote) -> Discovery {
    let options = DiscoveryOptions {
        tables: &REMOTES,
        ..DiscoveryOptions::default()
    };
    discover(image, started, 3, &options)
}

fn kinds(found: &Discovery) -> Vec<ProblemKind> {
    let problems = found.problems.iter();
    problems.map(|problem| problem.kind.clone()).collect()
}

/// The four software modes of the recorded 7I77: tables and sizes.
const MODES: [(u16, u16, u8, u8); 4] = [
    (0x49A, 0x4A4, 5, 2),
    (0x5C0, 0x5D2, 9, 2),
    (0x712, 0x726, 10, 2),
    (0x88E, 0x8A6, 12, 2),
];

/// Manual: 7I77, "DISCOVERY SEQUENCE"; memory of transcript t03.
#[test]
fn recorded_7i77_is_found_as_it_is() {
    let mut image = Image::recorded("t03_setup_one", 0);
    let found = run(&mut image, &started(0x5C0, 0x5D2, 9, 2));
    assert_eq!(found.problems, []);
    let elements: Vec<_> = found
        .descriptor
        .process_data
        .iter()
        .map(|record| {
            (
                record.name.as_str(),
                record.bits,
                record.data_type,
                record.direction,
            )
        })
        .collect();
    let (input, output) = (DataDirection::Input, DataDirection::Output);
    assert_eq!(
        elements,
        [
            ("Output", 16, DataType::Bits, output),
            ("Input", 32, DataType::Bits, input),
            ("Analogin0", 8, DataType::Unsigned, input),
            ("Analogin1", 8, DataType::Unsigned, input),
            ("Analogin2", 8, DataType::Unsigned, input),
            ("Analogin3", 8, DataType::Unsigned, input),
        ]
    );
    let analog = &found.descriptor.process_data[2];
    assert_eq!((analog.record_address, analog.address), (0x4D7, 0x18));
    assert_eq!((analog.min, analog.max), (0.0, 36.3));
    assert_eq!(analog.unit, "volts");
    let modes: Vec<_> = found
        .descriptor
        .modes
        .iter()
        .map(|mode| (mode.index, mode.mode_type, mode.name.as_str()))
        .collect();
    assert_eq!(
        modes,
        [
            (0, ModeType::Hardware, "Standard"),
            (1, ModeType::Software, "I/O_Analog"),
        ]
    );
    let watchdog = found.descriptor.parameter("nvwatchdogtime").unwrap();
    assert_eq!(watchdog.data_type, DataType::NonvolUnsigned);
    assert_eq!((watchdog.address, watchdog.bits), (0x24, 16));
    assert_eq!((watchdog.max, watchdog.unit.as_str()), (65_535.0, "mS"));
    assert_eq!(found.descriptor.parameters.len(), 3);
}

/// Each access is a round trip, so accesses are counted: one for each eight bytes that matter.
#[test]
fn discovery_costs_one_access_for_eight_bytes() {
    for (mode, (ptoc, gtoc, rx, tx)) in MODES.into_iter().enumerate() {
        let mut image = Image::recorded("t03_setup_one", 0);
        let found = run(&mut image, &started(ptoc, gtoc, rx, tx));
        assert_eq!(found.problems, [], "mode {mode}");
        assert_eq!(found.accesses, image.accesses);
        // From the first record to the end of the GTOC, all records are adjacent.
        let first = found.descriptor.process_data[0].record_address;
        let span = u32::from(gtoc + 8 - first);
        println!(
            "mode {mode}: {} accesses for {span} bytes, byte by byte at least {span}",
            found.accesses
        );
        assert!(found.accesses <= span.div_ceil(8) + 2, "mode {mode}");
    }
}

/// FACTS 7.2: process data, modes of all indexes and parameters are in the GTOC.
#[test]
fn gtoc_repetitions_are_not_parameters() {
    let mut image = Image::recorded("t03_setup_one", 0);
    // Output, Input, both modes, a mode of another index, and the three parameters.
    let gtoc = [0x400, 0x416, 0x42B, 0x438, 0x55C, 0x445, 0x45F, 0x47F, 0];
    image.put_words(0x2000, &gtoc);
    let found = run(&mut image, &started(0x49A, 0x2000, 5, 2));
    assert_eq!(found.problems, []);
    assert_eq!(found.descriptor.process_data.len(), 2);
    let names: Vec<_> = found
        .descriptor
        .parameters
        .iter()
        .map(|p| &p.name)
        .collect();
    assert_eq!(names, ["UnitNumber", "NVWatchDogTime", "NVBaudRate"]);
    let modes: Vec<_> = found.descriptor.modes.iter().map(|m| m.index).collect();
    assert_eq!(modes, [0, 0, 1]);
}

/// FACTS 4.7; transcript t26: 24 in, 24 out, two analog inputs.
#[test]
fn a_7i64_is_recognised_by_its_name() {
    let mut image = Image::default();
    let remote = StartedRemote {
        name: RemoteName(*b"7I64"),
        ..started(0, 0, 8, 4)
    };
    let found = run(&mut image, &remote);
    assert_eq!((&found.problems[..], found.accesses), (&[][..], 0));
    let plan = found.plan.unwrap();
    assert_eq!((plan.input_bits, plan.output_bits), (64, 32));
    let sizes = ProcessDataSizes { rx: 9, tx: 4 };
    let other = run(&mut image, &StartedRemote { sizes, ..remote });
    let sizes = ProblemKind::Sizes {
        rx: 9,
        tx: 4,
        plan_rx: 8,
        plan_tx: 4,
    };
    assert_eq!(kinds(&other), [sizes]);
    let unknown = run(&mut image, &started(0, 0, 5, 2));
    assert_eq!(kinds(&unknown), [ProblemKind::NoTables]);
    // Its table is known, but it must not run without its own.
    let unit_number = 0x1200_0001;
    let known = StartedRemote {
        unit_number,
        ..started(0, 0, 5, 2)
    };
    assert_eq!(kinds(&run(&mut image, &known)), [ProblemKind::NoTables]);
}

/// A table cannot replace sizes that START did not report: no data would be transferred.
#[test]
fn remote_without_tables_and_sizes_is_refused_even_if_known() {
    const DRIVE: RemoteTable = RemoteTable {
        has_discovery: false,
        ..RemoteTable::new(
            "drive",
            *b"8I20",
            &[ElementTable::input("Fault", 16, DataType::Bits)],
        )
    };
    let options = DiscoveryOptions {
        tables: &[&DRIVE],
        ..DiscoveryOptions::default()
    };
    let discover = |rx| {
        let drive = StartedRemote {
            name: RemoteName(DRIVE.name),
            ..started(0, 0, rx, 0)
        };
        discover(&mut Image::default(), &drive, 3, &options)
    };
    assert_eq!(discover(3).problems, []);
    let untold = ProblemKind::Sizes {
        rx: 0,
        tx: 0,
        plan_rx: 2,
        plan_tx: 0,
    };
    assert_eq!(kinds(&discover(0)), [untold]);
}

/// A data record: bits, type, direction, limits, unit, name.
fn data(bits: u8, kind: u8, direction: u8, limits: [f32; 2], name: &str) -> Vec<u8> {
    let mut record = vec![0xA0, bits, kind, direction];
    record.extend(limits.map(f32::to_le_bytes).concat());
    record.extend([0x00, 0x10]);
    record.extend(b"V\0");
    record.extend(name.as_bytes());
    record.push(0);
    record
}

/// A remote with these records in its PTOC, in this order.
fn with_records(records: &[Vec<u8>], rx: u8, tx: u8) -> (Image, StartedRemote) {
    let mut image = Image::default();
    let mut table = Vec::new();
    for (record, address) in records.iter().zip((0x1000..).step_by(0x200)) {
        image.put(address, record);
        table.push(address);
    }
    table.push(0);
    image.put_words(0x100, &table);
    (image, started(0x100, 0, rx, tx))
}

fn good() -> Vec<u8> {
    data(8, 2, 0x00, [0.0, 10.0], "Good")
}

/// The damaged record has its own error, which contains the place; the good one behind it is found.
fn only_problem(record: Vec<u8>) -> ProblemKind {
    let (mut image, remote) = with_records(&[record, good()], 3, 0);
    let found = run(&mut image, &remote);
    let [problem] = found.problems.as_slice() else {
        panic!("expected one problem, got {:?}", found.problems);
    };
    assert_eq!((problem.table, problem.record), (Table::Process, 0x1000));
    let text = problem.to_string();
    assert!(
        text.contains("7I77 (unit number 0x000077AA), PTOC record at 0x1000"),
        "{text}"
    );
    let last = found.descriptor.process_data.last().unwrap();
    assert_eq!(last.name, "Good");
    problem.kind.clone()
}

fn any_image() -> impl Strategy<Value = Image> {
    // Dense with record types, zeros and printable characters, so that walks get far.
    let byte = prop_oneof![
        2 => Just(0u8),
        2 => Just(0xA0u8),
        1 => Just(0xB0u8),
        1 => Just(0x10u8),
        3 => any::<u8>(),
    ];
    (
        proptest::collection::vec(byte, 0..600),
        0u16..0x40,
        proptest::option::of((any::<u16>(), 0u16..64)),
    )
        .prop_map(|(bytes, base, gap)| {
            let mut image = Image::default();
            // Repeated over the whole address space.
            if !bytes.is_empty() {
                for address in 0..=u16::MAX {
                    let n = usize::from(address.wrapping_add(base)) % bytes.len();
                    image.bytes.insert(address, bytes[n]);
                }
            }
            image.missing = gap.map(|(first, length)| first..=first.saturating_add(length));
            image
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_memory_is_walked_within_the_limits(
        mut image in any_image(),
        ptoc: u16,
        gtoc: u16,
        rx: u8,
        tx: u8,
    ) {
        let found = run(&mut image, &started(ptoc, gtoc, rx, tx));
        prop_assert!(found.accesses <= DiscoveryOptions::default().accesses);
        prop_assert_eq!(found.accesses, image.accesses);
        prop_assert!(found.descriptor.process_data.len() <= 255);
        for record in &found.descriptor.process_data {
            prop_assert!(record.bits > 0);
            prop_assert!(record.min.is_finite() && record.max.is_finite());
            prop_assert!(record.name.chars().count() <= 48);
        }
        let bits: u32 = found
            .descriptor
            .process_data
            .iter()
            .filter(|record| record.direction.is_input())
            .map(|record| u32::from(record.bits))
            .sum();
        prop_assert!(bits <= 96 || found.plan.is_err());
    }
}
