//! Packing plans: the place of each element, against a packing done bit by bit.

use crate::common::descriptors::{analog, descriptor, field_io, outputs_48, record};
use crate::take_inputs;
use mesa_hal::RemoteId;
use mesa_hal::bus::Instant;
use mesa_hal::discovery::{DataDirection, DataRecord, DataType, PackingPlan, Problem, ProblemKind};
use mesa_hal::hal::PinStore;
use mesa_hal::remote::RemotePins;
use proptest::prelude::*;

const THREE: u8 = 3;
const SEVEN: u8 = 7;

fn plan_of(records: &[DataRecord], registers: u8) -> Result<PackingPlan, Problem> {
    PackingPlan::new(&descriptor(*b"TEST", 1, 0, records.to_vec()), registers)
}

fn numbers(widths: &[u8], direction: DataDirection) -> Vec<DataRecord> {
    widths
        .iter()
        .enumerate()
        .map(|(n, &bits)| {
            record(
                &format!("N{n}"),
                bits,
                DataType::Stream,
                direction,
                0.0,
                0.0,
            )
        })
        .collect()
}

#[test]
fn sizes_are_those_of_the_manuals() {
    // Manual 7I77, "SOFTWARE PROCESS DATA MODES"; FACTS 8.2 to 8.4: bytes of reply (with fault
    // byte) and request.
    for (descriptor, receive, transmit) in [
        (field_io(0), 5, 2),
        (field_io(1), 9, 2),
        (field_io(2), 10, 2),
        (field_io(3), 12, 2),
        (analog(), 1, 10),
        (outputs_48(0), 1, 6),
        (outputs_48(1), 3, 6),
    ] {
        let plan = PackingPlan::new(&descriptor, THREE).unwrap();
        assert_eq!(
            (plan.input_bytes() + 1, plan.output_bytes()),
            (receive, transmit)
        );
    }
}

#[test]
fn oversized_process_data_is_refused_with_its_size() {
    let inputs = numbers(&[64, 32, 1], DataDirection::Input);
    let kind = |records: &[DataRecord], registers| plan_of(records, registers).unwrap_err().kind;
    assert_eq!(
        kind(&inputs, THREE),
        ProblemKind::RegistersTooSmall {
            direction: "input",
            bits: 97,
            limit: 96
        }
    );
    assert!(plan_of(&inputs, SEVEN).is_ok());
    let outputs = numbers(&[64, 64, 64, 33], DataDirection::Output);
    assert_eq!(
        kind(&outputs, SEVEN),
        ProblemKind::RegistersTooSmall {
            direction: "output",
            bits: 225,
            limit: 224
        }
    );
    // More than any stream can number.
    let many = numbers(&[64; 2000], DataDirection::Bidirectional);
    assert!(plan_of(&many, SEVEN).is_err());
}

#[test]
fn damaged_records_are_refused_by_place() {
    let bad = |bits, data_type| {
        let records = [
            record("Good", 8, DataType::Bits, DataDirection::Input, 0.0, 0.0),
            DataRecord {
                record_address: 0x123,
                ..record("Bad", bits, data_type, DataDirection::Input, 0.0, 1.0)
            },
        ];
        let problem = plan_of(&records, THREE).unwrap_err();
        assert_eq!(problem.record, 0x123);
        problem.kind
    };
    let width = |bits, expected| ProblemKind::Illegal {
        field: "width",
        found: format!("{bits} bits"),
        expected,
    };
    assert_eq!(bad(0, DataType::Bits), width(0, "1 to 255"));
    assert_eq!(bad(65, DataType::Unsigned), width(65, "1 to 64"));
    assert_eq!(bad(16, DataType::Float), width(16, "32 or 64"));
    assert_eq!(bad(8, DataType::EncoderHigh), ProblemKind::HalfCount);
    let wide = [record(
        "Wide",
        96,
        DataType::Bits,
        DataDirection::Input,
        0.0,
        0.0,
    )];
    assert!(
        plan_of(&wide, THREE).is_ok(),
        "bits go up to the whole width"
    );
}

/// The bits of a list of values, one by one, which defines packing.
fn bit_by_bit(values: &[(u8, u64)]) -> Vec<bool> {
    values
        .iter()
        .flat_map(|&(bits, value)| (0..bits).map(move |bit| value >> bit & 1 != 0))
        .collect()
}

fn to_words(bits: &[bool]) -> [u32; 7] {
    let mut words = [0; 7];
    for (place, _) in bits.iter().enumerate().filter(|(_, bit)| **bit) {
        words[place / 32] |= 1 << (place % 32);
    }
    words
}

proptest! {
    #[test]
    fn packing_is_the_same_as_bit_by_bit_and_comes_back(
        elements in prop::collection::vec((1..=64_u8, any::<u64>()), 1..12),
        background in any::<u32>(),
    ) {
        let mut used = 0_u32;
        let elements: Vec<_> = elements
            .into_iter()
            .take_while(|&(bits, _)| { used += u32::from(bits); used <= 224 })
            .collect();
        let widths: Vec<_> = elements.iter().map(|&(bits, _)| bits).collect();
        let records = numbers(&widths, DataDirection::Bidirectional);
        let expected = to_words(&bit_by_bit(&elements));

        let descriptor = descriptor(*b"TEST", 1, 0, records);
        let plan = PackingPlan::new(&descriptor, SEVEN).unwrap();
        let mut pins = PinStore::default();
        let mut remote = RemotePins::new(&mut pins, "b", RemoteId::new(0, 0), &descriptor, &plan, None).unwrap();
        let name = |n: usize| format!("b.TeST.0.0.n{n}");
        let narrow = |pins: &PinStore, n| pins.inout::<u32>(&name(n)).ok();
        let wide = |pins: &PinStore, n| pins.inout::<u64>(&name(n)).unwrap();
        let value = |n: usize| elements[n].1 & u64::MAX >> (64 - elements[n].0);
        for n in 0..elements.len() {
            if let Some(pin) = narrow(&pins, n) {
                pins.set(pin, value(n) as u32);
            } else {
                let pin = wide(&pins, n);
                pins.set(pin, value(n));
            }
        }
        let mut words = [background; 7];
        remote.put_outputs(&mut pins, &mut words);
        prop_assert_eq!(words, expected);
        pins.begin_cycle(Instant::from_nanos(1));
        take_inputs(&mut remote, &mut pins, &words);
        for n in 0..elements.len() {
            let found = match narrow(&pins, n) {
                Some(pin) => u64::from(pins.read(pin).value),
                None => pins.read(wide(&pins, n)).value,
            };
            prop_assert_eq!(found, value(n));
        }
    }

    #[test]
    fn any_list_of_records_makes_a_plan_that_fits_or_an_error(
        raw in prop::collection::vec(
            (any::<u8>(), any::<u8>(), 0..3_u8, any::<f32>(), any::<f32>()), 0..300,
        ),
        seven in any::<bool>(),
    ) {
        let registers = if seven { SEVEN } else { THREE };
        let records: Vec<_> = raw
            .into_iter()
            .map(|(bits, code, direction, min, max)| {
                let direction = DataDirection::from_byte(direction * 0x40).unwrap();
                record("R", bits, DataType::from_byte(code), direction, min, max)
            })
            .collect();
        if let Ok(plan) = plan_of(&records, registers) {
            prop_assert!(plan.input_bits <= u32::from(registers) * 32);
            prop_assert!(plan.output_bits <= u32::from(registers) * 32);
            for element in &plan.elements {
                let end = |first: Option<u16>| first.map_or(0, |f| u32::from(f) + u32::from(element.bits));
                prop_assert!(end(element.input) <= plan.input_bits);
                prop_assert!(end(element.output) <= plan.output_bits);
            }
        }
    }
}
