//! The pins of an encoder, cycle by cycle.

use super::registers::bits;
use super::*;
use crate::hal::{GroupId, PinMaker};
use crate::modules::latch::LatchRequest;

struct Machine {
    pins: PinStore,
    group: GroupId,
    state: EncoderState,
    handles: EncoderPins,
    ms: u64,
}

impl Machine {
    fn new() -> Self {
        let mut pins = PinStore::default();
        let group = pins.add_group();
        let make = PinMaker::new(&mut pins, group, "hm2_7i92.0.encoder.00.");
        let handles = EncoderPins::new(make, Default::default(), true).unwrap();
        Self {
            state: EncoderState::new(handles.config(&mut pins), false),
            pins,
            group,
            handles,
            ms: 0,
        }
    }

    /// A read with these registers.
    fn read(&mut self, count: u16, control: u32) {
        self.ms += 1;
        let at = Instant::from_nanos(self.ms * 1_000_000);
        self.pins.begin_cycle(at);
        let sample = EncoderSample {
            count: u32::from(count),
            control,
            timestamp: (self.ms * 1000) as u16,
            asked: at,
            at,
        };
        let reading = self.state.read(sample);
        self.handles.publish(&mut self.pins, &reading);
        self.pins.group_good(self.group);
    }

    /// A write. Returns the content of the control register.
    fn write(&mut self) -> u32 {
        let (handles, pins) = (&self.handles, &mut self.pins);
        let command = handles.command(pins, &mut self.state, true);
        self.state.follow(command);
        self.state.control()
    }
}

#[test]
fn counts_position_and_reset_follow_the_encoder() {
    let mut m = Machine::new();
    let counter = m.handles.counter;
    m.pins.set_param(counter.scale, 8.0).unwrap();
    m.write();
    m.read(65_530, 0);
    m.write();
    m.read(10, 0);
    assert_eq!(m.pins.read(counter.count).ok(), Some(16));
    assert_eq!(m.pins.read(counter.position).ok(), Some(2.0));
    m.pins.set(counter.reset, true);
    m.write();
    m.read(10, 0);
    assert_eq!(m.pins.read(counter.count).ok(), Some(0));
    assert_eq!(m.pins.read(counter.rawcounts).ok(), Some(16));
}

#[test]
fn index_enable_goes_off_when_the_index_came_and_not_before() {
    let mut m = Machine::new();
    let counter = m.handles.counter;
    m.write();
    let idle = m.write();
    m.read(0, idle);
    let idle = m.write();
    m.read(100, idle);

    // Switched on after the write: the read that follows must not take the request as done.
    m.pins.set(counter.index_enable, true);
    m.read(200, idle);
    assert!(m.pins.read(counter.index_enable).value, "only asked for");
    let asked = m.write();
    assert_ne!(asked & bits::LATCH_ON_INDEX, 0);
    m.read(300, asked);
    assert!(m.pins.read(counter.index_enable).value, "still waiting");
    assert_eq!(m.state.latch.wanted, LatchRequest::Index);
    m.write();
    // The gateware clears the enable bit and has latched 350.
    let taken = asked & 0xFFFF & !bits::LATCH_ON_INDEX;
    m.read(400, 350 << 16 | taken);
    assert!(!m.pins.read(counter.index_enable).value);
    assert_eq!(m.pins.read(counter.count).ok(), Some(50));
    assert_eq!(m.write() & bits::LATCH_ON_INDEX, 0);
}

#[test]
fn parameters_choose_how_the_encoder_counts() {
    let mut m = Machine::new();
    let plain = m.write();
    assert_ne!(plain & bits::FILTER, 0, "filtered at first");
    for (param, on) in [
        (m.handles.filter, false),
        (m.handles.counter_mode, true),
        (m.handles.index_invert, true),
    ] {
        m.pins.set_param(param, on).unwrap();
    }
    let control = m.write();
    assert_eq!(control & bits::FILTER, 0);
    assert_ne!(control & bits::UP_DOWN, 0);
    let polarity = bits::INDEX_POLARITY;
    assert_ne!(control & polarity, plain & polarity);
}

#[test]
fn quadrature_error_is_kept_while_it_is_watched() {
    let mut m = Machine::new();
    let error = bits::QUADRATURE_ERROR;
    let shown = |m: &Machine| m.pins.read(m.handles.quad_error).ok();
    m.write();
    m.read(0, error);
    m.write();
    m.read(0, error);
    assert_eq!(shown(&m), Some(false), "not watched");
    m.pins.set(m.handles.quad_error_enable, true);
    assert_eq!(m.write() & error, error, "the one before is cleared");
    m.read(0, 0);
    m.read(0, error);
    m.write();
    m.read(0, 0);
    assert_eq!(shown(&m), Some(true));
    m.pins.set(m.handles.quad_error_enable, false);
    m.write();
    m.read(0, 0);
    assert_eq!(shown(&m), Some(false));
}
