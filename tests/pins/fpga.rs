//! Pins of the FPGA's encoders and I/O pins, cycle by cycle.
use mesa_hal::boards::fpga::{EncoderPins, GpioPins, PinUse};
use mesa_hal::bus::Instant;
use mesa_hal::hal::{GroupId, PinError, PinStore};
use mesa_hal::hostmot2::{
    ControlWord, CountWord, Encoder, EncoderConfig, EncoderSample, LatchRequest,
};

struct Machine {
    pins: PinStore,
    group: GroupId,
    encoder: Encoder,
    handles: EncoderPins,
    ms: u64,
}

impl Machine {
    fn new() -> Self {
        let mut pins = PinStore::new();
        let group = pins.add_group();
        let handles = EncoderPins::new(&mut pins, group, "hm2_7i92.0", 0, &[]).unwrap();
        Self {
            pins,
            group,
            encoder: Encoder::new(EncoderConfig::default(), 1e6),
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
            count: CountWord(u32::from(count)),
            control: ControlWord(control),
            timestamp: (self.ms * 1000) as u16,
            at,
        };
        self.handles.take(&mut self.pins, &mut self.encoder, sample);
        self.pins.group_good(self.group);
    }

    /// A write; what the control register is set to.
    fn write(&mut self) -> u32 {
        self.handles.command(&mut self.pins, &mut self.encoder);
        self.encoder.control().0
    }
}

#[test]
fn counts_position_and_reset_follow_the_encoder() {
    let mut m = Machine::new();
    m.pins.set_param(m.handles.scale, 8.0).unwrap();
    m.write();
    m.read(65_530, 0);
    m.write();
    m.read(10, 0);
    assert_eq!(m.pins.read(m.handles.count).ok(), Some(16));
    assert_eq!(m.pins.read(m.handles.position).ok(), Some(2.0));
    m.pins.set(m.handles.reset, true);
    m.write();
    m.read(10, 0);
    assert_eq!(m.pins.read(m.handles.count).ok(), Some(0));
    assert_eq!(m.pins.read(m.handles.rawcounts).ok(), Some(16));
}

#[test]
fn index_enable_goes_off_when_the_index_came_and_not_before() {
    let mut m = Machine::new();
    m.write();
    m.read(0, m.encoder.control().0);
    let idle = m.write();
    m.read(100, idle);

    // Switched on after the write: the read that follows must not take it for granted.
    m.pins.set(m.handles.index_enable, true);
    m.read(200, idle);
    assert!(
        m.pins.read(m.handles.index_enable).value,
        "only asked for yet"
    );
    let asked = m.write();
    assert_ne!(asked & ControlWord::LATCH_ON_INDEX, 0);
    m.read(300, asked);
    assert!(m.pins.read(m.handles.index_enable).value, "still waiting");
    assert_eq!(m.encoder.requested(), LatchRequest::Index);
    m.write();
    // The gateware takes the request back and has latched 350.
    m.read(
        400,
        350 << 16 | asked & 0xFFFF & !ControlWord::LATCH_ON_INDEX,
    );
    assert!(!m.pins.read(m.handles.index_enable).value);
    assert_eq!(m.pins.read(m.handles.count).ok(), Some(50));
    assert_eq!(m.write() & ControlWord::LATCH_ON_INDEX, 0);
}

#[test]
fn parameters_choose_how_the_encoder_counts() {
    let mut m = Machine::new();
    let plain = m.write();
    assert_ne!(plain & ControlWord::FILTER, 0, "filtered at first");
    m.pins.set_param(m.handles.filter, false).unwrap();
    m.pins.set_param(m.handles.counter_mode, true).unwrap();
    m.pins.set_param(m.handles.index_invert, true).unwrap();
    let control = m.write();
    assert_eq!(control & ControlWord::FILTER, 0);
    assert_ne!(control & ControlWord::UP_DOWN, 0);
    assert_ne!(
        control & ControlWord::INDEX_POLARITY,
        plain & ControlWord::INDEX_POLARITY
    );
}

#[test]
fn a_quadrature_error_is_kept_while_it_is_watched() {
    let mut m = Machine::new();
    let error = 1 << 15;
    m.read(0, error);
    assert_eq!(
        m.pins.read(m.handles.quad_error).ok(),
        Some(false),
        "not watched"
    );
    m.pins.set(m.handles.quad_error_enable, true);
    m.read(0, error);
    m.read(0, 0);
    assert_eq!(m.pins.read(m.handles.quad_error).ok(), Some(true));
    m.pins.set(m.handles.quad_error_enable, false);
    m.read(0, 0);
    assert_eq!(m.pins.read(m.handles.quad_error).ok(), Some(false));
}

#[test]
fn io_pins_have_what_their_use_allows() {
    let mut pins = PinStore::new();
    let group = pins.add_group();
    let mut make = |n, usage| GpioPins::new(&mut pins, group, "hm2_7i92.0", n, usage, &[]).unwrap();
    let gpio = make(0, PinUse::Gpio);
    let read = make(1, PinUse::ModuleInput);
    let driven = make(2, PinUse::ModuleOutput);
    assert!(read.input.is_some() && read.out.is_none() && read.invert_output.is_none());
    assert!(driven.input.is_none() && driven.out.is_none() && driven.invert_output.is_some());
    assert_eq!((read.setup(&pins), driven.setup(&pins)), (None, None));

    let out = gpio.out.unwrap();
    pins.set_param(gpio.is_output.unwrap(), true).unwrap();
    pins.set_param(gpio.invert_output.unwrap(), true).unwrap();
    pins.set(out, true);
    let setup = gpio.setup(&pins).unwrap();
    assert!(setup.output && setup.invert && !setup.open_drain);
    assert!(gpio.level(&mut pins), "the hardware inverts");
    pins.fault(group);
    assert!(!gpio.level(&mut pins), "safe after a fault");
    assert_eq!(
        pins.output::<bool>("hm2_7i92.0.gpio.001.out"),
        Err(PinError::NotFound)
    );
}
