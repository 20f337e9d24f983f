//! The pins of remotes: from interface registers to typed values and back.
// Floating-point values are compared exactly: a tolerance would hide a rounding error.
use crate::common::descriptors::{analog, descriptor, field_io, outputs_48, record};
use crate::take_inputs;
use mesa_hal::MesaError;
use mesa_hal::RemoteId;
use mesa_hal::boards::{
    AttachError, Finder, I7i72, I7i77Analog, I7i77Field, REMOTES, RemoteHandles, i7i77,
};
use mesa_hal::bus::Instant;
use mesa_hal::discovery::{DataDirection, DataType, PackingPlan, RemoteDescriptor};
use mesa_hal::hal::{AnyValue, PinError, PinStore, Role, ShortName};
use mesa_hal::remote::{ParameterError, RemotePins};
use proptest::prelude::*;

fn remote(pins: &mut PinStore, channel: u8, descriptor: &RemoteDescriptor) -> RemotePins {
    let table = REMOTES.into_iter().find(|table| table.matches(descriptor));
    let plan = PackingPlan::new(descriptor, 3).unwrap();
    RemotePins::new(
        pins,
        "hm2_7i92.0",
        RemoteId::new(0, channel),
        descriptor,
        &plan,
        table,
    )
    .unwrap()
}

fn handles<T: RemoteHandles>(pins: &PinStore, remote: &RemotePins) -> Result<T, AttachError> {
    T::find(&Finder::new(pins, &remote.prefix, T::TABLE.title))
}

fn cycle(pins: &mut PinStore) {
    let now = pins.now().after(std::time::Duration::from_millis(1));
    pins.begin_cycle(now);
}

#[test]
fn field_inputs_use_interface_0_and_outputs_its_low_16_bits() {
    // Manual 7I77: INTERFACE 0 inputs TB7 31..16, TB8 15..0; outputs TB7 15..8, TB8 7..0.
    let mut pins = PinStore::default();
    let mut remote = remote(&mut pins, 0, &field_io(0));
    let field = handles::<I7i77Field>(&pins, &remote).unwrap();
    cycle(&mut pins);
    take_inputs(&mut remote, &mut pins, &[0x8000_0004, 0, 0]);
    for (n, input) in field.inputs.iter().enumerate() {
        let expected = n == 2 || n == 31;
        assert_eq!(pins.read(input.pin).ok(), Some(expected), "input {n}");
        assert_eq!(pins.read(input.not).ok(), Some(!expected), "input {n} not");
    }
    pins.set(field.outputs[0].pin, true);
    pins.set(field.outputs[15].pin, true);
    let mut words = [u32::MAX; 3];
    remote.put_outputs(&mut pins, &mut words);
    assert_eq!(words, [0x8001, 0, 0]);

    let info = pins.info(field.inputs[2].pin).unwrap();
    assert_eq!(
        (&*info.place.terminal, &*info.place.signal),
        ("TB8 pin 3", "INPUT2")
    );
    let info = pins.info(field.outputs[8].pin).unwrap();
    assert_eq!(
        (&*info.place.terminal, &*info.place.signal),
        ("TB7 pin 17", "OUTPUT8")
    );
}

#[test]
fn modes_1_to_3_bring_voltages_field_voltage_and_mpgs() {
    for mode in 0..4 {
        let mut pins = PinStore::default();
        let remote = remote(&mut pins, 0, &field_io(mode));
        let field = handles::<I7i77Field>(&pins, &remote).unwrap();
        assert_eq!(field.analog_in.is_some(), mode >= 1);
        assert_eq!(field.field_voltage.is_some(), mode >= 2);
        assert_eq!(field.mpgs.is_some(), mode >= 3);
    }
    let mut pins = PinStore::default();
    let mut remote = remote(&mut pins, 0, &field_io(3));
    let field = handles::<I7i77Field>(&pins, &remote).unwrap();
    let [mpg, _] = field.mpgs.unwrap();
    pins.set_param(mpg.scale, 4.0).unwrap();
    // Bytes: 4 inputs, 4 voltages, field voltage, two counters.
    for (counter, count) in [(250, 0), (2, 8), (0x7F, 133), (0xFE, 260)] {
        cycle(&mut pins);
        take_inputs(
            &mut remote,
            &mut pins,
            &[0, 0x0000_00FF, 0x0000_00A9 | counter << 8],
        );
        assert_eq!(pins.read(mpg.count).ok(), Some(count));
        assert_eq!(pins.read(mpg.position).ok(), Some(f64::from(count) / 4.0));
    }
    let [volts, ..] = field.analog_in.unwrap();
    assert_eq!(pins.read(volts.volts).ok(), Some(f64::from(36.3_f32)));
    let volts = pins.read(field.field_voltage.unwrap().volts).value;
    assert!((volts - 169.0 * 36.3 / 255.0).abs() < 1e-5, "{volts}");

    // The counter of a restarted remote may have any value: no jump.
    remote.restarted();
    take_inputs(&mut remote, &mut pins, &[0, 0, 0x0000_0300]);
    assert_eq!(pins.read(mpg.rawcounts).ok(), Some(260));
    // At the next full revolution (512), the count becomes zero there.
    pins.set_param(mpg.counts_per_rev.unwrap(), 256).unwrap();
    pins.set(mpg.index_enable, true);
    for step in 1..=3_u32 {
        take_inputs(
            &mut remote,
            &mut pins,
            &[0, 0, ((3 + 100 * step) & 0xFF) << 8],
        );
    }
    assert_eq!(pins.read(mpg.index_enable).ok(), Some(false));
    assert_eq!(pins.read(mpg.rawcounts).ok(), Some(560));
    assert_eq!(pins.read(mpg.count).ok(), Some(560 - 512));
}

#[test]
fn analog_outputs_make_the_same_bits_as_linuxcnc() {
    let mut pins = PinStore::default();
    let remote = remote(&mut pins, 1, &analog());
    let card = handles::<I7i77Analog>(&pins, &remote).unwrap();
    for (output, volts) in card
        .analog_out
        .iter()
        .zip([5.0, -10.0, 0.0, 10.0, -5.0, 1.0])
    {
        pins.set(output.volts, volts);
    }
    pins.set(card.spinena.pin, true);
    let mut words = [0; 3];
    remote.put_outputs(&mut pins, &mut words);
    let stream = u128::from(words[0]) | u128::from(words[1]) << 32 | u128::from(words[2]) << 64;
    let raw: Vec<_> = (0..6)
        .map(|n| (stream >> (13 * n)) as u32 & 0x1FFF)
        .collect();
    assert_eq!(raw, [2047, 0x1000, 0, 4095, 0x1800, 409]);
    assert_eq!(stream >> 78, 0b10, "AnalogEna off, SpinEna on");
    let info = pins.info(card.analog_out[5].volts).unwrap();
    assert_eq!(
        (&*info.place.terminal, &*info.place.signal, &*info.unit),
        ("TB5 pin 24", "AOUT5", "volts")
    );
    assert_eq!(
        pins.total_rejections(),
        mesa_hal::hal::Rejections::default()
    );
}

#[test]
fn scale_and_limits_of_an_analog_output_work_as_in_linuxcnc() {
    let mut pins = PinStore::default();
    let remote = remote(&mut pins, 1, &analog());
    let [spindle, ..] = handles::<I7i77Analog>(&pins, &remote).unwrap().analog_out;
    let raw = |pins: &mut PinStore, value: f64| {
        let mut words = [0; 3];
        pins.set(spindle.volts, value);
        remote.put_outputs(pins, &mut words);
        words[0] & 0x1FFF
    };
    // 10 V at 3000 rpm.
    pins.set_param(spindle.full_scale, 3000.0).unwrap();
    pins.set_param(spindle.max_limit.unwrap(), 3000.0).unwrap();
    assert_eq!(raw(&mut pins, 3000.0), 4095);
    assert_eq!(raw(&mut pins, 1500.0), 2047);
    pins.set_param(spindle.max_limit.unwrap(), 1500.0).unwrap();
    assert_eq!(raw(&mut pins, 3000.0), 2047, "limited");
    assert_eq!(pins.rejections(spindle.volts).out_of_range, 1);
    // A limit beyond full scale does not let any value wrap around.
    pins.set_param(spindle.max_limit.unwrap(), 1e9).unwrap();
    assert_eq!(raw(&mut pins, 1e8), 4095);
    assert_eq!(pins.rejections(spindle.volts).out_of_range, 2);
    // A scale of zero is meaningless: the previous one stays.
    let none = pins.set_param(spindle.full_scale, 0.0);
    assert!(matches!(none, Err(PinError::BadScale { .. })));
    assert_eq!(raw(&mut pins, 1500.0), 2047);
    assert_eq!(raw(&mut pins, f64::NAN), 0);
    assert_eq!(pins.rejections(spindle.volts).not_finite, 1);
}

#[test]
fn failed_remote_is_safe_alone_until_rearmed() {
    let mut pins = PinStore::default();
    let mut field = remote(&mut pins, 0, &field_io(0));
    let mut drives = remote(&mut pins, 1, &analog());
    let io = handles::<I7i77Field>(&pins, &field).unwrap();
    let card = handles::<I7i77Analog>(&pins, &drives).unwrap();
    cycle(&mut pins);
    take_inputs(&mut field, &mut pins, &[1]);
    take_inputs(&mut drives, &mut pins, &[]);
    pins.set(io.outputs[3].pin, true);
    pins.set(card.analog_out[0].volts, 5.0);
    pins.set(card.analogena.pin, true);

    cycle(&mut pins);
    take_inputs(&mut field, &mut pins, &[1]);
    pins.fault(drives.group);
    let mut words = [0; 3];
    drives.put_outputs(&mut pins, &mut words);
    assert_eq!(words, [0; 3]);
    field.put_outputs(&mut pins, &mut words);
    assert_eq!(words, [1 << 3, 0, 0], "the other remote goes on");
    assert!(pins.read(io.inputs[0].pin).valid);

    cycle(&mut pins);
    take_inputs(&mut drives, &mut pins, &[]);
    pins.rearm(drives.group).unwrap();
    drives.put_outputs(&mut pins, &mut words);
    assert_eq!(words, [0; 3], "nothing of before the fault comes back");
    pins.set(card.analog_out[0].volts, -10.0);
    drives.put_outputs(&mut pins, &mut words);
    assert_eq!(words, [0x1000, 0, 0]);
}

#[test]
fn all_48_outputs_of_a_7i72_and_its_field_voltage() {
    let mut pins = PinStore::default();
    let mut remote = remote(&mut pins, 2, &outputs_48(1));
    let card = handles::<I7i72>(&pins, &remote).unwrap();
    for (n, output) in card.outputs.iter().enumerate() {
        pins.set(output.pin, true);
        let mut words = [0; 3];
        remote.put_outputs(&mut pins, &mut words);
        let stream = u64::from(words[0]) | u64::from(words[1]) << 32;
        assert_eq!((stream, words[2]), (1 << n, 0));
        pins.set(output.pin, false);
    }
    cycle(&mut pins);
    take_inputs(&mut remote, &mut pins, &[0xFFFF]);
    let volts = card.field_voltage.unwrap();
    assert_eq!(pins.read(volts.volts).ok(), Some(f64::from(36.3_f32)));
    let terminal = |n: usize| {
        pins.info(card.outputs[n].pin)
            .unwrap()
            .place
            .terminal
            .clone()
    };
    assert_eq!((&*terminal(1), &*terminal(47)), ("TB3 pin 2", "TB2 pin 24"));
}

#[test]
fn identity_is_checked_and_table_differences_are_reported() {
    let field = field_io(2);
    assert!(i7i77::FIELD.matches(&field));
    assert!(!i7i77::FIELD.matches(&analog()));
    assert!(!i7i77::FIELD.matches(&outputs_48(0)));
    for mode in 0..4 {
        assert!(i7i77::FIELD.differences(&field_io(mode)).is_empty());
    }
    assert!(i7i77::ANALOG.differences(&analog()).is_empty());

    let mut changed = analog();
    changed.process_data[2].bits = 12;
    changed.process_data[3].max = 5.0;
    changed.process_data.swap(0, 1);
    changed.process_data.pop();
    changed.process_data.push(record(
        "Brake",
        1,
        DataType::Boolean,
        DataDirection::Output,
        0.0,
        0.0,
    ));
    assert_eq!(
        i7i77::ANALOG.differences(&changed),
        [
            "AnalogOut0: place 1, by the table 0",
            "AnalogOut1: place 0, by the table 1",
            "AnalogOut2: width 12, by the table 13",
            "AnalogOut3: limits -10 to 5, by the table -10 to 10",
            "SpinEna: place none, by the table 7",
            "Brake: place 7, by the table none",
        ]
    );
}

#[test]
fn parameters_stay_in_the_remote_and_set_param_gives_advice() {
    let mut pins = PinStore::default();
    let mut remote = remote(&mut pins, 0, &field_io(0));
    let baud = pins
        .parameter::<u32>("hm2_7i92.0.7i77.0.0.nvbaudrate")
        .unwrap();
    let revision = pins
        .parameter::<u32>("hm2_7i92.0.7i77.0.0.swrevision")
        .unwrap();
    assert_eq!(pins.info(baud).unwrap().role, Role::InRemote);
    assert_eq!(pins.info(baud).unwrap().role.hal_direction(), "RW");
    assert_eq!(pins.info(revision).unwrap().role, Role::Property);
    assert!(pins.set_param(revision, 3).is_err());
    let refused = pins.set_param(baud, 10).unwrap_err();
    let name = ShortName::new("hm2_7i92.0.7i77.0.0.nvbaudrate");
    assert_eq!(refused, PinError::InRemote { name });
    let text = refused.advice().expect("advice").to_string();
    assert!(
        text.contains("`Configured::write_remote_parameter`"),
        "{text}"
    );
    assert!(text.contains("`Driver::write_remote_parameter`"), "{text}");

    let field = field_io(0);
    assert!(remote.parameter("NVBaudRate").is_some());
    assert!(remote.parameter("nvbaudrat").is_none());
    let parameter = remote.parameter("nvbaudrate").unwrap();
    assert_eq!((parameter.first, parameter.known), (None, None));
    let record = field.parameter("nvbaudrate").unwrap();
    for (value, raw) in [
        (AnyValue::from(10_u32), Some(10)),
        (AnyValue::from(10_i32), Some(10)),
        (AnyValue::from(10.0), Some(10)),
        (AnyValue::from(10.5), None),
        (AnyValue::from(f64::NAN), None),
        (AnyValue::from(-1_i32), None),
        (AnyValue::from(11_u64), Some(11)),
        // The table of baud rates ends at 11.
        (AnyValue::from(12_u64), None),
        (AnyValue::from(256_u64), None),
    ] {
        let found = record.raw_of(value);
        assert_eq!(found.ok(), raw, "{value:?}");
    }
    let read_only = field.parameter("swrevision").unwrap();
    assert_eq!(
        read_only.raw_of(AnyValue::from(3_u32)),
        Err(ParameterError::ReadOnly)
    );
    for value in [9, 10] {
        remote.parameters[3].publish(&mut pins, value);
        assert_eq!(u64::from(pins.param(baud)), value);
    }
    let parameter = remote.parameter("nvbaudrate").unwrap();
    assert_eq!((parameter.first, parameter.known), (Some(9), Some(10)));
}

#[test]
fn bidirectional_element_is_in_both_streams_and_pads_take_room() {
    use DataDirection::{Bidirectional, Input, Output};
    let data = vec![
        record("In", 3, DataType::Unsigned, Input, 0.0, 7.0),
        record("Gap", 2, DataType::Pad, Input, 0.0, 0.0),
        record("Both", 4, DataType::Bits, Bidirectional, 0.0, 0.0),
        record("Level", 8, DataType::Unsigned, Bidirectional, 0.0, 255.0),
        record("Pad", 5, DataType::Pad, Output, 0.0, 0.0),
        record("Out", 1, DataType::Boolean, Output, 0.0, 0.0),
    ];
    let mut pins = PinStore::default();
    let mut remote = remote(&mut pins, 0, &descriptor(*b"TEST", 1, 0, data));
    let bit = pins.inout::<bool>("hm2_7i92.0.TeST.0.0.both-02").unwrap();
    let level = pins.inout::<f64>("hm2_7i92.0.TeST.0.0.level").unwrap();
    let out = pins.output::<bool>("hm2_7i92.0.TeST.0.0.out").unwrap();
    cycle(&mut pins);
    take_inputs(&mut remote, &mut pins, &[0xAB << 9 | 0b0100 << 5 | 5]);
    assert_eq!(pins.read(bit).ok(), Some(true));
    assert_eq!(pins.read(level).ok(), Some(171.0));
    pins.set(level, 85.0);
    pins.set(out, true);
    let mut words = [0];
    remote.put_outputs(&mut pins, &mut words);
    assert_eq!(words, [1 << 17 | 85 << 4 | 0b0100]);
}

#[test]
fn count_in_two_parts_is_one_count_whichever_part_comes_first() {
    use DataType::{EncoderHigh, EncoderLow};
    let part = |data_type, bits| record("Enc", bits, data_type, DataDirection::Input, 0.0, 1.0);
    for high_first in [true, false] {
        let mut data = vec![part(EncoderHigh, 16), part(EncoderLow, 12)];
        if !high_first {
            data.reverse();
        }
        let mut pins = PinStore::default();
        let mut remote = remote(&mut pins, 0, &descriptor(*b"TEST", 1, 0, data));
        let count = pins.input::<i32>("hm2_7i92.0.TeST.0.0.enc.count").unwrap();
        for (at, expected) in [(0x0FFE, 0), (0x1001, 3), (0x0FFF_FFFF, -4095)] {
            let (high, low) = (at >> 12, at & 0xFFF);
            let word = if high_first {
                low << 16 | high
            } else {
                high << 12 | low
            };
            cycle(&mut pins);
            take_inputs(&mut remote, &mut pins, &[word]);
            assert_eq!(pins.read(count).ok(), Some(expected), "{at:x}");
        }
    }
}

#[test]
fn real_numbers_go_both_ways_and_none_that_is_none() {
    use DataDirection::{Input, Output};
    let data = vec![
        record("In", 32, DataType::Float, Input, 0.0, 0.0),
        record("Out", 64, DataType::Float, Output, -5.0, 5.0),
        record("Small", 32, DataType::Float, Output, 0.0, 0.0),
    ];
    let mut pins = PinStore::default();
    let mut remote = remote(&mut pins, 0, &descriptor(*b"TEST", 1, 0, data));
    let name = |pin: &str| format!("hm2_7i92.0.TeST.0.0.{pin}");
    let input = pins.input::<f64>(&name("in")).unwrap();
    let out = pins.output::<f64>(&name("out")).unwrap();
    let small = pins.output::<f64>(&name("small")).unwrap();
    cycle(&mut pins);
    take_inputs(&mut remote, &mut pins, &[1.5_f32.to_bits()]);
    assert_eq!(pins.read(input).ok(), Some(1.5));
    take_inputs(&mut remote, &mut pins, &[f32::NAN.to_bits()]);
    let reading = pins.read(input);
    assert_eq!((reading.value, reading.valid), (1.5, false));

    let sent = |pins: &mut PinStore, value: f64| {
        pins.set(out, value);
        pins.set(small, value);
        let mut words = [0; 3];
        remote.put_outputs(pins, &mut words);
        let wide = u64::from(words[0]) | u64::from(words[1]) << 32;
        (f64::from_bits(wide), f32::from_bits(words[2]))
    };
    assert_eq!(sent(&mut pins, 2.25), (2.25, 2.25));
    assert_eq!(sent(&mut pins, 1e300), (5.0, f32::MAX));
    assert_eq!(sent(&mut pins, f64::NEG_INFINITY), (0.0, 0.0));
}

fn any_record() -> impl Strategy<Value = mesa_hal::discovery::DataRecord> {
    let direction = prop_oneof![
        Just(DataDirection::Input),
        Just(DataDirection::Output),
        Just(DataDirection::Bidirectional)
    ];
    let data_type = prop_oneof![
        0..9_u8,
        Just(0x10),
        Just(0x11),
        Just(0x18),
        Just(0x28),
        any::<u8>()
    ];
    let bits = prop_oneof![9 => 1..=40_u8, 1 => any::<u8>()];
    let limit = || prop_oneof![9 => -100.0..100.0_f32, 1 => Just(0.0), 1 => any::<f32>()];
    let name = prop_oneof![9 => "[A-Za-z][A-Za-z0-9]{0,6}", 1 => "\\PC{0,48}"];
    (name, bits, data_type, direction, limit(), limit()).prop_map(
        |(name, bits, data_type, direction, min, max)| {
            record(
                &name,
                bits,
                DataType::from_byte(data_type),
                direction,
                min,
                max,
            )
        },
    )
}

proptest! {
    #[test]
    fn any_descriptor_gives_pins_or_an_error_and_finite_values(
        data in prop::collection::vec(any_record(), 0..7),
        parameters in prop::collection::vec(any_record(), 0..12),
        words in any::<[u32; 7]>(),
        value in any::<f64>(),
    ) {
        let mut pins = PinStore::default();
        let mut remote_descriptor = descriptor(*b"ANY1", 0, 0, data);
        remote_descriptor.parameters = parameters;
        let made = PackingPlan::new(&remote_descriptor, 7).ok().and_then(|plan| {
            let made = RemotePins::new(&mut pins, "hm2_7i92.0", RemoteId::new(0, 0), &remote_descriptor, &plan, None);
            Some((made.ok()?, plan.output_bits))
        });
        if let Some((mut remote, used)) = made {
            pins.begin_cycle(Instant::from_nanos(1));
            take_inputs(&mut remote, &mut pins, &words);
            for info in pins.infos().to_vec() {
                if let Ok(pin) = pins.output::<f64>(&info.name) {
                    pins.set(pin, value);
                }
                if let Ok(pin) = pins.input::<f64>(&info.name) {
                    prop_assert!(pins.read(pin).value.is_finite());
                }
            }
            let mut out = [0; 7];
            remote.put_outputs(&mut pins, &mut out);
            for bit in used..224 {
                prop_assert_eq!(out[bit as usize / 32] >> (bit % 32) & 1, 0);
            }
            prop_assert_eq!(pins.foreign_handles(), 0);
        }
    }
}
